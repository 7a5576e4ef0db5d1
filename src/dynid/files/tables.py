"""Tables as logs: CSV and TSV in any dialect, Parquet, the paper's folder of text files.

Columns are found by the patterns of the robot file.

Reads block by block and keeps only the columns that are asked for. Stamps in ms, us and ns are recognised (W328).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid import limits
from dynid.errors import Finding, LogLayout, LogNotFound, PackageMissing, WrongUsage
from dynid.files import tuning
from dynid.files.columnwords import (
    TIME_NAMES,
    stamps_of,
    suggested,
    time_unit,
    unit_of,
    usual_joints,
)
from dynid.files.dialect import Dialect, dialect_of, seconds_of
from dynid.log import COLUMNS, Log
from dynid.scratch import USUAL as NUMBERS
from dynid.scratch import Growing, filled, spread, taken
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
#: Columns of an index that pandas has written without a name.
_INDEX = ("__index_level_0__", "")


def column_names(path: Path) -> tuple[str, ...]:
    """Return the names of the columns of a table.

    Raises:
        LogNotFound: it cannot be read.
        LogLayout: it has no header.
    """
    return _column_names(path, _dialect(path))


def _dialect(path: Path) -> Dialect | None:
    """Return how a text table is written; None for Parquet."""
    return None if path.suffix == ".parquet" else dialect_of(path)


def _column_names(path: Path, dialect: Dialect | None) -> tuple[str, ...]:
    names = tuple(_schema(path).names) if dialect is None else dialect.names
    limits.check("columns", len(names), path)
    limits.check("name_length", max(map(len, names), default=0), path)
    if not names:
        raise LogLayout(
            f"{path.name}: no header; expected t, q_<joint>, tau_<joint>", where=f"{path}:1"
        )
    return names


def read_table(
    path: Path,
    joints: Sequence[str],
    patterns: Mapping[str, str] | None = None,
    rate: float | None = None,
) -> Log:
    """Read a table.

    Args:
        path: .csv, .tsv or .parquet file.
        joints: names of the joints in chain order, () when they are to be taken from the columns ``q_<name>``.
        patterns: names of the columns by ``time``, ``name``, ``position``, ``velocity``, ``effort``, ``reference``.
        rate: samples per second where there is no time [Hz].

    Raises:
        LogNotFound: it cannot be read.
        LogLayout: columns are missing, or a cell is not a number.
        PackageMissing: Parquet without pyarrow.
    """
    dialect = _dialect(path)
    names = _column_names(path, dialect)
    layout = _layout(path, dialect, names, joints, dict(patterns or {}), rate)
    wanted = [name for columns in layout.columns.values() for name in columns]
    values = _read_columns(path, dialect, [*layout.time, *wanted])
    values, findings = _with_joints(values, len(layout.time), path.name)
    t, noticed = _time(values[:, : len(layout.time)], layout, path.name, rate)
    edges = np.cumsum([len(layout.time), *map(len, layout.columns.values())])
    arrays = {
        key: values[:, a:b] for key, a, b in zip(layout.columns, edges[:-1], edges[1:], strict=True)
    }
    return Log(
        t,
        arrays["position"],
        arrays["effort"],
        layout.joints,
        arrays.get("velocity"),
        source=path,
        tau_unit="A" if layout.current else "",
        units=layout.units,
        findings=(*findings, *noticed),
        extra={
            "q_ref" if key == "reference" else key: x
            for key, x in arrays.items()
            if key not in FACTORS
        },
    )


def _with_joints(values: Floats, first: int, where: str) -> tuple[Floats, tuple[Finding, ...]]:
    """Return the rows that have any joint value: a table of several topics has a row for each message of any (W331)."""
    empty = filled(len(values), lambda part: np.asarray(np.isnan(values[part, first:]).all(axis=1)))
    if not empty.any() or empty.all():
        return values, ()
    text = f"{where}: {int(empty.sum())} of {len(empty)} rows have no value of any joint and are left out"
    return taken(values, np.flatnonzero(~empty)), (
        Finding("W331", "info", text, {"rows": int(empty.sum())}),
    )


def _time(
    stamps: Floats, layout: _Layout, where: str, rate: float | None
) -> tuple[Floats, tuple[Finding, ...]]:
    """Return the time of some rows, (N,) [s], and what was noticed."""
    if not layout.time:
        return np.arange(len(stamps)) / positive_rate(rate), ()
    if len(layout.time) == 2:
        # Why subtracted first: seconds since 1970 and nanoseconds do not fit into one number.
        start = stamps[0, 0]
        return filled(
            len(stamps), lambda part: (stamps[part, 0] - start) + stamps[part, 1] * SECONDS["ns"]
        ), ()
    if layout.date:
        return stamps[:, 0], ()
    return in_seconds(stamps[:, 0], layout.time[0], where)


def in_seconds(t: Floats, name: str, where: str) -> tuple[Floats, tuple[Finding, ...]]:
    """Return stamps in seconds, and what was noticed (W328).

    Args:
        t: stamps as they are in the file, (N,).
        name: of their column, which may end with their unit.
        where: name of the file, for the message.
    """
    step = np.concatenate(
        [np.diff(part[np.isfinite(part)]) for part in (t[some] for some in spread(len(t), NUMBERS))]
    )
    usual = float(np.median(step[step > 0])) if np.any(step > 0) else 0.0
    known = np.flatnonzero(filled(len(t), lambda part: np.isfinite(t[part])))
    start, end = (float(t[known[0]]), float(t[known[-1]])) if len(known) else (0.0, 0.0)
    named = time_unit(name)[1] in _LONG
    unit = time_unit(name)[1] if named else _unit_of(start, len(known), usual)
    if unit == "s":
        return t, ()
    # Why subtracted first: stamps of the calendar have more digits in ns than a number holds after the product.
    factor = SECONDS[unit]
    offset = 0.0 if abs(start) * factor > 1e6 else start * factor
    seconds = filled(len(t), lambda part: (t[part] - start) * factor + offset)
    span = (end - start) * factor
    rate = f" at {1 / (usual * factor):.4g} Hz" if usual else ""
    said = (
        f"as the name of {name} says"
        if named
        else f"a step of {usual:.4g} in {name} can be nothing else"
    )
    text = f"{where}: the stamps are {_LONG[unit]} ({span:.1f} s{rate}), {said}"
    return seconds, (
        Finding("W328", "info" if named else "warning", text, {"unit": unit, "seconds": span}),
    )


def _unit_of(start: float, count: int, step: float) -> str:
    """Return the unit of stamps that name none: from the calendar where they count from 1970, else from their step."""
    for unit, factor in SECONDS.items():
        if tuning.CALENDAR_S[0] < start * factor < tuning.CALENDAR_S[1]:
            return unit
    told = next((unit for unit, (low, high) in tuning.STEPS.items() if low <= step < high), "s")
    return told if count >= tuning.LEAST_STAMPS else "s"


def template(names: Sequence[str]) -> dict[str, str]:
    """Return patterns to fill in where the names of the columns do not tell what they hold."""
    time = next(iter(stamps_of(names)), "TIME")
    return {"time": time, "position": "POSITION_{i}", "effort": "TORQUE_{i}"}


def snippet(patterns: Mapping[str, str]) -> str:
    """Return patterns as they stand in a robot file."""
    order = ("time", "name", "position", "velocity", "effort", "reference")
    inside = ", ".join(
        f"{key}: {json.dumps(patterns[key], ensure_ascii=not patterns[key].isprintable())}"
        for key in order
        if key in patterns
    )
    return f"columns: {{{inside}}}"


# ---------------------------------------------------------------- which columns
@dataclass(frozen=True)
class _Layout:
    """Which columns are read.

    Attributes:
        joints: names of the joints.
        time: column of the stamps, or those of seconds and nanoseconds, () where the rate is given.
        date: whether stamps are dates.
        columns: for each quantity, one column a joint.
        current: whether the efforts are currents in A by their name.
        units: what the header says of ``position``, ``velocity`` and ``effort``.
    """

    joints: tuple[str, ...]
    time: tuple[str, ...]
    date: bool
    columns: dict[str, list[str]]
    current: bool
    units: dict[str, str]


def _layout(
    path: Path,
    dialect: Dialect | None,
    names: Sequence[str],
    joints: Sequence[str],
    patterns: dict[str, str],
    rate: float | None,
) -> _Layout:
    if "position" not in patterns:
        joints = usual_joints(names) or joints
    if "name" in patterns:
        joints = _names_in_rows(path, dialect, names, patterns["name"])
    columns: dict[str, list[str]] = {}
    current = False
    further = {
        key: (f"{key}_{{name}}",)
        for key in COLUMNS
        if COLUMNS[key] and key not in ("q", "qd", "tau", "q_ref")
    }
    for key, usual in (USUAL | further).items():
        tried = (patterns[key],) if key in patterns else usual
        found = next(((p, c) for p in tried if (c := matched(p, names, joints))), None)
        if found:
            columns[key] = found[1]
            current = current or (key == "effort" and found[0] == "i_{name}")
        elif key in patterns or key in ("position", "effort"):
            raise _missing(path, names, tried, joints, key)
    time = _time_columns(path, names, patterns.get("time"), dialect, rate)
    dated = (
        dialect is not None and len(time) == 1 and dialect.date(names.index(time[0])) is not None
    )
    return _Layout(tuple(joints), time, dated, columns, current, _declared(columns, names, dialect))


def _time_columns(
    path: Path, names: Sequence[str], given: str | None, dialect: Dialect | None, rate: float | None
) -> tuple[str, ...]:
    """Return the column of the stamps, or two.

    Raises:
        LogLayout: there is none, and no rate.
    """
    found = (given,) if given else stamps_of(names)
    if not found and rate is None:
        found = tuple(name for name in _INDEX if name in names and _clock(path, name, dialect))[:1]
    if found and set(found) <= set(names):
        return found
    if rate is not None and not given:
        return ()
    guess = suggested(names)
    fix = "add the column t, or give --rate"
    if "time" in guess:
        fix = f"under `driver:` in the robot file: columns: {{time: {guess['time']}}}"
    raise LogLayout(
        f"{path.name}:1: no column '{given or 't'}'; it has {_listed(names)}",
        where=f"{path}:1",
        fix=fix,
    )


def _clock(path: Path, name: str, dialect: Dialect | None) -> bool:
    """Return whether a column without a name is a clock rather than the number of the row."""
    if dialect is not None:
        place = dialect.names.index(name)
        return place < len(dialect.first) and bool(
            dialect.date(place) is not None or "." in dialect.first[place]
        )
    return not str(_schema(path).field(name).type).startswith(
        ("int", "uint", "string", "large_string")
    )


def _names_in_rows(
    path: Path, dialect: Dialect | None, names: Sequence[str], pattern: str
) -> tuple[str, ...]:
    """Return the names of the joints that stand in columns of their own, as in what ROS writes of joint states.

    Raises:
        LogLayout: there are no such columns.
    """
    count = next((k for k in range(len(names), 0, -1) if matched(pattern, names, [""] * k)), 0)
    if not count:
        raise LogLayout(
            f"{path.name}:1: no column {pattern}; it has {_listed(names)}", where=f"{path}:1"
        )
    chosen = matched(pattern, names, [""] * count)
    if dialect is not None:
        return (
            tuple(dialect.first[dialect.names.index(name)] for name in chosen)
            if dialect.first
            else ()
        )
    batch = next(iter(_open_parquet(path).iter_batches(batch_size=1, columns=chosen)), None)
    return tuple(str(batch.column(name)[0]) for name in chosen) if batch is not None else ()


def _declared(
    columns: Mapping[str, list[str]], names: Sequence[str], dialect: Dialect | None
) -> dict[str, str]:
    """Return the units that the header gives for all columns of a quantity."""
    below = dialect.units if dialect is not None else ()
    found = {}
    for key in ("position", "velocity", "effort"):
        words = {
            unit_of(name, below[names.index(name)] if below else "")
            for name in columns.get(key, [])
        }
        if len(words) == 1 and (unit := words.pop()) in FACTORS[key]:
            found[key] = unit
    return found


def matched(pattern: str, names: Sequence[str], joints: Sequence[str]) -> list[str]:
    """Return the columns of a pattern in chain order, [] where one is missing; numbers count from 0 or 1."""
    has = set(names)
    if "{i}" not in pattern:
        found = [pattern.replace("{name}", joint) for joint in joints]
        return found if found and set(found) <= has else []
    for first in (1, 0):
        found = [
            pattern.replace("{i}", str(first + k)).replace("{name}", joint)
            for k, joint in enumerate(joints)
        ]
        # Why: of an arm with six joints and columns 0 to 6, 0 to 5 are the arm and 6 is its gripper.
        if set(found) <= has and not (first and pattern.replace("{i}", "0") in has):
            return found
    return []


def _missing(
    path: Path, names: Sequence[str], tried: Sequence[str], joints: Sequence[str], key: str
) -> LogLayout:
    guess = suggested(names)
    have = {pattern.split("{")[0] for pattern in tried}
    some = [name for name in names if any(name.startswith(start) for start in have if start)]
    lost = next(
        (wanted for joint in joints if (wanted := tried[0].replace("{name}", joint)) not in names),
        tried[0],
    )
    fix = f"under `driver:` in the robot file: {snippet(guess or template(names))}"
    if key == "effort" and some and joints:
        text = f"{path.name}:1: joint '{lost.removeprefix('tau_')}' has q_{lost.removeprefix('tau_')} but no {lost}"
        return LogLayout(text, where=f"{path}:1", fix=fix)
    shown = lost if "{name}" not in tried[0] or joints else tried[0].replace("{name}", "<joint>")
    return LogLayout(
        f"{path.name}:1: no column {shown}; it has {_listed(names)}", where=f"{path}:1", fix=fix
    )


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


# ---------------------------------------------------------------- the numbers
def _read_columns(path: Path, dialect: Dialect | None, chosen: Sequence[str]) -> Floats:
    """Return columns of a table by name, (N, k); in a file where they are long."""
    if dialect is None:
        return _joined(path, len(chosen), _parquet(path, chosen))
    return _joined(
        path, len(chosen), dialect.read(path, [dialect.names.index(name) for name in chosen])
    )


def _joined(path: Path, width: int, blocks: Iterator[Floats]) -> Floats:
    found = Growing(width)
    for block in blocks:
        limits.check("samples", len(found) + len(block), path)
        found.append(block)
    if not len(found):
        raise LogLayout(f"{path.name} has no samples", where=str(path))
    return found.whole()


def _schema(path: Path) -> Any:  # noqa: ANN401
    return _open_parquet(path).schema_arrow


def pyarrow_of() -> tuple[Any, Any]:
    """Return pyarrow and its module of Parquet.

    Raises:
        PackageMissing: it is not installed.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        if not isinstance(error, ModuleNotFoundError):
            raise
        raise PackageMissing(
            "pyarrow is not installed: Parquet cannot be read or written",
            fix="pip install 'dynid[parquet]'",
        ) from error
    return pyarrow, parquet


def _open_parquet(path: Path) -> Any:  # noqa: ANN401
    pyarrow, parquet = pyarrow_of()
    try:
        with limits.open_file(path):
            pass
        # Why: else a group of rows is read whole, and some writers put all rows into one.
        stream = {"buffer_size": limits.MIB, "pre_buffer": False}
        most = {"thrift_string_size_limit": limits.MIB, "thrift_container_size_limit": limits.MIB}
        return parquet.ParquetFile(path, **stream, **most)
    except (pyarrow.ArrowException, OSError, ValueError) as error:
        raise LogNotFound(
            f"{path.name} is not a Parquet file, or is damaged: {error}", where=str(path)
        ) from error


def _parquet(path: Path, chosen: Sequence[str]) -> Iterator[Floats]:
    import pyarrow

    file = _open_parquet(path)
    limits.check("samples", file.metadata.num_rows, path)
    try:
        for batch in file.iter_batches(batch_size=tuning.ROWS, columns=list(dict.fromkeys(chosen))):
            yield np.column_stack([_floats(batch.column(name), name, path) for name in chosen])
    except (pyarrow.ArrowException, OSError) as error:
        raise LogNotFound(f"{path.name} is damaged: {error}", where=str(path)) from error


def _floats(column: Any, name: str, path: Path) -> Floats:  # noqa: ANN401
    import pyarrow

    kind = column.type
    if pyarrow.types.is_timestamp(kind) or pyarrow.types.is_duration(kind):
        # Unit: whole numbers of the column's own unit; what they are in seconds is told by their step.
        column = column.cast(pyarrow.int64())
    elif pyarrow.types.is_string(kind) or pyarrow.types.is_large_string(kind):
        stamps = [seconds_of(word or "") for word in column.to_pylist()]
        if None in stamps:
            raise LogLayout(
                f"{path.name}: column '{name}' holds words, not numbers", where=str(path)
            )
        return np.array([whole + part for whole, part in filter(None, stamps)])
    elif not (pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind)):
        raise LogLayout(f"{path.name}: column '{name}' holds {kind}, not numbers", where=str(path))
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=float)


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
        return bool(self.names) and self.names[0].lower() in TIME_NAMES

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
    limits.check("columns", dialect.width, path)
    limits.check("name_length", max(map(len, dialect.names), default=0), path)
    return _Text(
        path, dialect.names, _joined(path, dialect.width, dialect.read(path, range(dialect.width)))
    )


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
