"""Tables as logs: CSV and TSV, and the paper's folder of text files.

Columns are found by the patterns of the robot file. Stamps in ms, us and ns are recognised (W328).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dynid.arrays import Floats
from dynid.errors import Finding, LogLayout, LogNotFound, WrongUsage
from dynid.files import tuning
from dynid.files.columnwords import (
    by_name,
    is_time,
    matched,
    numbered,
    snippet,
    suggested,
    template,
    time_unit,
    unit_of,
    usual_joints,
)
from dynid.files.texttable import TextTable, text_table
from dynid.log import Log
from dynid.units import FACTORS

#: Pattern of the columns of each quantity where the robot file gives none; torques may be currents instead.
USUAL = {
    "position": "q_{name}",
    "velocity": "qd_{name}",
    "effort": "tau_{name}",
    "reference": "q_ref_{name}",
    "qd_reported": "qd_reported_{name}",
}
CURRENT = "i_{name}"
#: Units of stamps: their size [s], and how messages call them.
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_LONG = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}


def read_table(
    path: Path,
    joints: Sequence[str],
    patterns: Mapping[str, str] | None = None,
    rate: float | None = None,
    *,
    sensors: bool = False,
) -> Log:
    """Read a table; joints without a column of torques have NaN.

    Rows without any number of a joint are left out (W331): a table of several topics has a row per message of any.

    Args:
        path: .csv or .tsv file.
        joints: names of the joints in chain order, () when they are to be taken from the columns ``q_<name>``.
        patterns: names of the columns by ``time``, ``name``, ``position``, ``velocity``, ``effort``, ``reference``.
        rate: samples per second where there is no time [Hz].
        sensors: whether torques of some joints are meant rather than currents of all.

    Raises:
        LogNotFound: it cannot be read.
        LogLayout: columns are missing, or a cell is not a number.
    """
    table, patterns = text_table(path), patterns or {}
    if not table.names:
        raise table.wrong("no header; expected t, q_<joint>, tau_<joint>")
    if "position" not in patterns:
        joints = usual_joints(table.names) or joints
    if "name" in patterns:
        named = numbered(patterns["name"], table.names)
        if not named:
            raise _absent(table, patterns["name"])
        joints = [table.first[table.names.index(name)] for name in named]
    currents = matched(CURRENT, table.names, joints)
    columns = _columns(table, joints, patterns, currents, sensors=sensors)
    time = _time_column(table, patterns.get("time"), rate)
    wanted = [name for each in columns.values() for name in each]
    values = table.read([*wanted, time or ""])
    findings: tuple[Finding, ...] = ()
    empty = np.isnan(values[:, :-1]).all(axis=1)
    if 0 < (rows := int(np.count_nonzero(empty))) < len(values):
        text = f"{path.name}: {rows} of {len(values)} rows have no value and are left out"
        findings = (Finding("W331", "info", text, {"rows": rows}),)
        values = values[~empty]
    t = np.arange(len(values)) / (rate or 1.0)
    if time:
        t, noticed = in_seconds(values[:, -1], time, path.name)
        findings += noticed
    if currents and "" in columns["effort"]:
        text = f"{path.name}: its torques of some joints are used, its currents of all are not"
        findings += (Finding("W335", "warning", text, {"columns": currents}),)
    arrays = dict(zip(columns, np.split(values[:, :-1], len(columns), axis=1), strict=True))
    return Log(
        t,
        arrays.pop("position"),
        arrays.pop("effort"),
        tuple(joints),
        arrays.pop("velocity", None),
        source=path,
        tau_unit="A" if columns["effort"] == currents else "",
        units=_declared(columns),
        findings=findings,
        extra={"q_ref" if key == "reference" else key: x for key, x in arrays.items()},
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
    step = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
    unit, level, said = time_unit(name)[1], "info", f"as the name of {name} says"
    if not unit:
        unit = next((each for each, most in tuning.STEPS.items() if step < most), "s")
        level, said = "warning", f"a step of {step:.4g} in {name} can be nothing else"
    if unit == "s" or not len(known):
        return t, ()
    factor, start = SECONDS[unit], known[0]
    seconds = (t - start) * factor
    span = float(np.nanmax(seconds))
    rate = f" at {1 / (step * factor):.4g} Hz" if step else ""
    text = f"{where}: the stamps are {_LONG[unit]} ({span:.1f} s{rate}), {said}"
    noticed = Finding("W328", level, text, {"unit": unit, "seconds": span})
    # Why subtracted first: stamps of the calendar have more digits in ns than a number holds after the product.
    far = abs(start * factor) > tuning.CALENDAR_FROM_S
    return seconds + (0.0 if far else start * factor), (noticed,)


# ---------------------------------------------------------------- which columns
def _columns(
    table: TextTable,
    joints: Sequence[str],
    patterns: Mapping[str, str],
    currents: Sequence[str],
    *,
    sensors: bool,
) -> dict[str, Sequence[str]]:
    """Return for each quantity that is there one column a joint; "" for a joint without torque.

    Raises:
        LogLayout: positions, torques or what the robot file names are not there.
    """
    columns: dict[str, Sequence[str]] = {}
    have = by_name(table.names)
    for quantity, usual in USUAL.items():
        pattern = patterns.get(quantity, usual)
        named = [pattern.replace("{name}", joint) for joint in joints or ["<joint>"]]
        found: Sequence[str] = matched(pattern, table.names, joints)
        if quantity == "effort" and not found:
            some = [have.get(name, "") for name in named]
            usable = () if "effort" in patterns else currents
            found = some if any(some) and (sensors or not usable) else usable
        if found:
            columns[quantity] = found
        elif quantity in patterns or quantity in ("position", "effort"):
            lost = next((name for name in named if name not in have), pattern)
            paste = snippet(suggested(table.names) or template(table.names))
            raise _absent(table, lost, f"under `driver:` in the robot file: {paste}")
    return columns


def _time_column(table: TextTable, given: str | None, rate: float | None) -> str | None:
    """Return the column of the stamps; None where there is none but a rate.

    Raises:
        LogLayout: there is none, and no rate.
    """
    column = given or next(filter(is_time, table.names), None)
    if column in table.names or (rate is not None and not given):
        return column
    fix = "name it in the robot file, `driver: columns: {time: ...}`, or give --rate"
    raise _absent(table, f"'{given or 't'}'", fix)


def _absent(table: TextTable, name: str, fix: str = "") -> LogLayout:
    """Return the mistake of a column that is not there."""
    more = len(table.names) - 12
    have = ", ".join(table.names[:12]) + (f" and {more} more" if more > 0 else "")
    return table.wrong(f"no column {name}; it has {have}", fix)


def _declared(columns: Mapping[str, Sequence[str]]) -> dict[str, str]:
    """Return the units that the header gives for all columns of a quantity."""
    declared = {}
    for quantity in FACTORS.keys() & columns.keys():
        units = {unit_of(name) for name in columns[quantity] if name}
        if len(units) == 1 and (unit := units.pop()) in FACTORS[quantity]:
            declared[quantity] = unit
    return declared


# ---------------------------------------------------------------- a folder of texts
def read_folder(path: Path, rate: float | None = None) -> Log:
    """Read the paper's text files from a folder: one row per sample, one column per joint.

    Args:
        path: folder with position.txt, torque.txt and, if recorded, velocity.txt and time.txt. A file may have a line
            of names, of which the first may be that of a column of time.
        rate: samples per second where no file has the time [Hz].

    Raises:
        LogNotFound: position.txt or torque.txt is not there.
        LogLayout: rows or columns do not agree.
        WrongUsage: no file has the time, and no rate is given.
    """
    files = {key: path / f"{key}.txt" for key in ("position", "velocity", "torque", "time")}
    tables = {key: text_table(file) for key, file in files.items() if file.is_file()}
    if not {"position", "torque"} <= tables.keys():
        holds = ", ".join(sorted(each.name for each in path.iterdir())[:5]) or "nothing"
        raise LogNotFound(
            f"the folder {path} is no log: it holds {holds}",
            where=path,
            fix="give the folder with metadata.yaml of rosbag2, or with position.txt and torque.txt",
        )
    names: Sequence[str] = ()
    t: Floats | None = None
    arrays: dict[str, Floats] = {}
    for key, table in tables.items():
        heads, values = table.names, table.read()
        if key == "time" or (heads and is_time(heads[0])):
            t = values[:, 0] if key in ("position", "time") else t
            heads, values = heads[1:], values[:, 1:]
        names = names or heads
        if missing := [name for name in names if heads and name not in heads]:
            raise table.wrong(f"no column '{missing[0]}'")
        # A file without names has the order of the others.
        arrays[key] = values[:, [heads.index(name) for name in names]] if heads else values
        rows, expected = len(values), len(arrays["position"])
        if rows != expected:
            raise LogLayout(f"{key}.txt has {rows} rows, expected {expected}", where=files[key])
    if t is None and rate is None:
        raise WrongUsage(
            f"{path} has no time.txt and position.txt no time column",
            where=path,
            why="derivatives need the time of each sample",
            fix="give the sample rate: --rate 100",
        )
    t = np.arange(len(arrays["position"])) / (rate or 1.0) if t is None else t
    return Log(
        t, arrays["position"], arrays["torque"], tuple(names), arrays.get("velocity"), source=path
    )
