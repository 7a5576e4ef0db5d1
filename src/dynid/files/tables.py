"""Tables as logs: CSV and TSV, and the paper's folder of text files.

Columns are found by the patterns of the robot file. Stamps in ms, us and ns are recognised (W328).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding, LogLayout, LogNotFound, WrongUsage
from dynid.files import tuning
from dynid.files.columnwords import (
    is_time,
    matched,
    snippet,
    suggested,
    template,
    time_unit,
    unit_of,
    usual_joints,
)
from dynid.files.dialect import Dialect, dialect_of
from dynid.log import COLUMNS, Log
from dynid.units import FACTORS

Floats = NDArray[np.float64]

#: Patterns that are tried where the robot file gives none.
USUAL = {
    "position": ("q_{name}",),
    "velocity": ("qd_{name}",),
    "effort": ("tau_{name}", "i_{name}"),
    "reference": ("q_ref_{name}",),
}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_LONG = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}


def read_table(
    path: Path,
    joints: Sequence[str],
    patterns: Mapping[str, str] | None = None,
    rate: float | None = None,
) -> Log:
    """Read a table.

    Args:
        path: .csv or .tsv file.
        joints: names of the joints in chain order, () when they are to be taken from the columns ``q_<name>``.
        patterns: names of the columns by ``time``, ``name``, ``position``, ``velocity``, ``effort``, ``reference``.
        rate: samples per second where there is no time [Hz].

    Raises:
        LogNotFound: it cannot be read.
        LogLayout: columns are missing, or a cell is not a number.
    """
    dialect, patterns = dialect_of(path), patterns or {}
    names = dialect.names
    if not names:
        raise LogLayout(
            f"{path.name}: no header; expected t, q_<joint>, tau_<joint>", where=f"{path}:1"
        )
    if "position" not in patterns:
        joints = usual_joints(names) or joints
    if "name" in patterns:
        joints = _names_in_rows(path, dialect, patterns["name"])
    columns = _columns(path, names, joints, patterns)
    time = _time_column(path, names, patterns.get("time"), rate)
    chosen = [*([time] if time else []), *(name for each in columns.values() for name in each)]
    values = dialect.read(path, [names.index(name) for name in chosen])
    findings: tuple[Finding, ...] = ()
    # Why: a table of several topics has a row for each message of any.
    empty = np.isnan(values[:, 1 if time else 0 :]).all(axis=1)
    if 0 < (rows := int(np.count_nonzero(empty))) < len(values):
        text = (
            f"{path.name}: {rows} of {len(values)} rows have no value of any joint and are left out"
        )
        findings = (Finding("W331", "info", text, {"rows": rows}),)
        values = values[~empty]
    if time:
        t, noticed = in_seconds(values[:, 0], time, path.name)
        values, findings = values[:, 1:], (*findings, *noticed)
    else:
        t = np.arange(len(values)) / positive_rate(rate)
    arrays = dict(zip(columns, np.split(values, len(columns), axis=1), strict=True))
    current = columns["effort"] == matched("i_{name}", names, joints)
    return Log(
        t,
        arrays["position"],
        arrays["effort"],
        tuple(joints),
        arrays.get("velocity"),
        source=path,
        tau_unit="A" if current else "",
        units=_declared(columns, dialect),
        findings=findings,
        extra={
            "q_ref" if key == "reference" else key: x
            for key, x in arrays.items()
            if key not in FACTORS
        },
    )


def in_seconds(t: Floats, name: str, where: str) -> tuple[Floats, tuple[Finding, ...]]:
    """Return stamps in seconds, and what was noticed (W328).

    Args:
        t: stamps as they are in the file, (N,).
        name: of their column, which may end with their unit.
        where: name of the file, for the message.
    """
    known = t[np.isfinite(t)]
    steps = np.diff(known)
    usual = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    start, end = (float(known[0]), float(known[-1])) if len(known) else (0.0, 0.0)
    named = time_unit(name)[1] in _LONG
    unit = time_unit(name)[1] if named else _unit_of(start, len(known), usual)
    if unit == "s":
        return t, ()
    # Why subtracted first: stamps of the calendar have more digits in ns than a number holds after the product.
    factor = SECONDS[unit]
    offset = 0.0 if abs(start) * factor > tuning.CALENDAR_FROM_S else start * factor
    span = (end - start) * factor
    rate = f" at {1 / (usual * factor):.4g} Hz" if usual else ""
    said = (
        f"as the name of {name} says"
        if named
        else f"a step of {usual:.4g} in {name} can be nothing else"
    )
    text = f"{where}: the stamps are {_LONG[unit]} ({span:.1f} s{rate}), {said}"
    level = "info" if named else "warning"
    noticed = Finding("W328", level, text, {"unit": unit, "seconds": span})
    return (t - start) * factor + offset, (noticed,)


def _unit_of(start: float, count: int, step: float) -> str:
    """Return the unit of stamps that name none: from the calendar where they count from 1970, else from their step."""
    for unit, factor in SECONDS.items():
        if tuning.CALENDAR_S[0] < start * factor < tuning.CALENDAR_S[1]:
            return unit
    told = next((unit for unit, (low, high) in tuning.STEPS.items() if low <= step < high), "s")
    return told if count >= tuning.LEAST_STAMPS else "s"


# ---------------------------------------------------------------- which columns
def _columns(
    path: Path, names: Sequence[str], joints: Sequence[str], patterns: Mapping[str, str]
) -> dict[str, list[str]]:
    """Return for each quantity that is there one column a joint.

    Raises:
        LogLayout: positions, torques or what the robot file names are not there.
    """
    further = {
        key: (f"{key}_{{name}}",)
        for key in COLUMNS
        if COLUMNS[key] and key not in ("q", "qd", "tau", "q_ref")
    }
    columns = {}
    for key, usual in (USUAL | further).items():
        tried = (patterns[key],) if key in patterns else usual
        found = next(filter(None, (matched(pattern, names, joints) for pattern in tried)), None)
        if found:
            columns[key] = found
        elif key in patterns or key in ("position", "effort"):
            raise _missing(path, names, tried, joints, key)
    return columns


def _missing(
    path: Path, names: Sequence[str], tried: Sequence[str], joints: Sequence[str], key: str
) -> LogLayout:
    fix = f"under `driver:` in the robot file: {snippet(suggested(names) or template(names))}"
    wanted = [tried[0].replace("{name}", joint) for joint in joints]
    lost = next((name for name in wanted if name not in names), tried[0])
    starts = tuple(filter(None, (pattern.split("{")[0] for pattern in tried)))
    if key == "effort" and wanted and any(name.startswith(starts) for name in names):
        joint = lost.removeprefix("tau_")
        text = f"joint '{joint}' has q_{joint} but no {lost}"
    else:
        shown = lost if joints else lost.replace("{name}", "<joint>")
        text = f"no column {shown}; it has {_listed(names)}"
    return LogLayout(f"{path.name}:1: {text}", where=f"{path}:1", fix=fix)


def _time_column(
    path: Path, names: Sequence[str], given: str | None, rate: float | None
) -> str | None:
    """Return the column of the stamps; None where there is none but a rate.

    Raises:
        LogLayout: there is none, and no rate.
    """
    found = given or next(filter(is_time, names), None)
    if found in names or (rate is not None and not given):
        return found
    guess = suggested(names)
    fix = "add the column t, or give --rate"
    if "time" in guess:
        fix = f"under `driver:` in the robot file: columns: {{time: {guess['time']}}}"
    raise LogLayout(
        f"{path.name}:1: no column '{given or 't'}'; it has {_listed(names)}",
        where=f"{path}:1",
        fix=fix,
    )


def _names_in_rows(path: Path, dialect: Dialect, pattern: str) -> tuple[str, ...]:
    """Return the names of the joints that stand in columns of their own, as in what ROS writes of joint states.

    Raises:
        LogLayout: there are no such columns.
    """
    names = dialect.names
    chosen = next(filter(None, (matched(pattern, names, [""] * k) for k in range(32, 0, -1))), None)
    if not chosen:
        raise LogLayout(
            f"{path.name}:1: no column {pattern}; it has {_listed(names)}", where=f"{path}:1"
        )
    return tuple(dialect.first[names.index(name)] for name in chosen if dialect.first)


def _declared(columns: Mapping[str, Sequence[str]], dialect: Dialect) -> dict[str, str]:
    """Return the units that the header gives for all columns of a quantity."""
    below = dict(zip(dialect.names, dialect.units, strict=False))
    found = {}
    for key in FACTORS:
        units = {unit_of(name, below.get(name, "")) for name in columns.get(key, ())}
        if len(units) == 1 and (unit := units.pop()) in FACTORS[key]:
            found[key] = unit
    return found


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


# ---------------------------------------------------------------- a folder of texts
@dataclass(frozen=True)
class _Text:
    """One text file of a folder: its path, names of its columns (() without a header) and values, (N, columns)."""

    path: Path
    names: tuple[str, ...]
    values: Floats

    @property
    def has_time(self) -> bool:
        """Whether the first column is time."""
        return bool(self.names) and is_time(self.names[0])

    def without_time(self) -> _Text:
        """Return the columns besides time."""
        return _Text(self.path, self.names[1:], self.values[:, 1:]) if self.has_time else self


def read_folder(path: Path, rate: float | None = None) -> Log:
    """Read the paper's text files from a folder: one row per sample, one column per joint.

    Args:
        path: folder with position.txt, torque.txt and, if recorded, velocity.txt and time.txt.
        rate: samples per second where no file has the time [Hz].

    Raises:
        LogNotFound: position.txt or torque.txt is not there.
        LogLayout: rows or columns do not agree.
        WrongUsage: no file has the time, and no rate is given.
    """
    for name in ("position.txt", "torque.txt"):
        if not (path / name).is_file():
            holds = ", ".join(sorted(each.name for each in path.iterdir())[:5]) or "nothing"
            raise LogNotFound(
                f"the folder {path} is no log: it holds {holds}",
                where=str(path),
                fix="give the folder with metadata.yaml of rosbag2, or with position.txt and torque.txt",
            )
    texts = {
        key: _read_text(path / f"{key}.txt")
        for key in ("position", "velocity", "torque", "time")
        if (path / f"{key}.txt").is_file()
    }
    position = texts["position"]
    for text in texts.values():
        if len(text.values) != len(position.values):
            what = f"{text.path.name} has {len(text.values)} rows, expected {len(position.values)}"
            raise LogLayout(what, where=str(text.path))
    if "time" in texts or position.has_time:
        t = texts.pop("time", position).values[:, 0]
    elif rate is None:
        raise WrongUsage(
            f"{path} has no time.txt and position.txt no time column",
            where=str(path),
            why="derivatives need the time of each sample",
            fix="give the sample rate: --rate 100",
        )
    else:
        t = np.arange(len(position.values)) / positive_rate(rate)
    texts = {key: text.without_time() for key, text in texts.items()}
    names = next((text.names for text in texts.values() if text.names), ())
    arrays = {
        key: _in_order(text, names, texts["position"].values.shape[1])
        for key, text in texts.items()
    }
    return Log(t, arrays["position"], arrays["torque"], names, arrays.get("velocity"), source=path)


def _read_text(path: Path) -> _Text:
    dialect = dialect_of(path)
    return _Text(path, dialect.names, dialect.read(path, range(dialect.width)))


def _in_order(text: _Text, names: Sequence[str], width: int) -> Floats:
    """Return the columns in the order of ``names``; a file without header has the order of the others."""
    if text.values.shape[1] != width:
        what = f"{text.path.name} has {text.values.shape[1]} columns, position.txt {width}"
        raise LogLayout(what, where=str(text.path))
    if not text.names or tuple(text.names) == tuple(names):
        return text.values
    missing = [name for name in names if name not in text.names]
    if missing:
        raise LogLayout(f"{text.path.name}:1: no column '{missing[0]}'", where=f"{text.path}:1")
    return text.values[:, [text.names.index(name) for name in names]]


def positive_rate(rate: float | None) -> float:
    """Return the sample rate that the user gave [Hz].

    Raises:
        WrongUsage: it is none.
    """
    if rate is None or not np.isfinite(rate) or rate <= 0:
        raise WrongUsage(
            f"--rate {rate} is not a sample rate", fix="give samples per second, such as --rate 100"
        )
    return rate
