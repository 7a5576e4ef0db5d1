"""What a person writes down about a motion: PLAN.yaml, and waypoints as CSV.

PLAN.yaml holds options of ``dynid trajectory`` by their long names, waypoints, and what stands around the arm.
Waypoints are in DH angles; a CSV has one row per waypoint, one column per joint, and may have a header with a column
``t``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.errors import (
    JointCountDiffers,
    LogLayout,
    LogNotFound,
    PositionInDegrees,
    TimeNotIncreasing,
)
from dynid.files import tuning
from dynid.files.yamlfile import LARGEST, Value, read_yaml
from dynid.robot import Robot
from dynid.units import ANGLE

Floats = NDArray[np.float64]
#: What is said beside a file of waypoints that cannot be used.
_LAYOUT = {
    "why": "a motion goes through one pose per row, with one column per joint",
    "fix": "write one row per waypoint: positions [rad or m] in the order of the joints, or a heading with their names",
}
Corners = tuple[tuple[float, float, float], tuple[float, float, float]]

#: Options that PLAN.yaml may set, all as numbers or words of the command line.
OPTIONS = (
    "alpha",
    "duration",
    "segments",
    "basis",
    "cost",
    "margin",
    "tool_speed",
    "floor",
    "rate",
)
_KEYS = (*OPTIONS, "angle_unit", "waypoints", "times", "obstacles", "workspace")


@dataclass(frozen=True)
class Waypoints:
    """Points that a motion goes through.

    Attributes:
        q: (K, n) [rad or m].
        times: (K,) [s]; None to let the limits decide.
    """

    q: Floats
    times: Floats | None = None


@dataclass(frozen=True)
class PlanFile:
    """A plan file.

    Attributes:
        options: values of command line options as text.
        places: ``file:line`` of each option.
        waypoints: points to go through; None to search for an exciting motion.
        obstacles: boxes that no link may touch, least and greatest corner [m].
        workspace: box that the tool stays in; None without one.
    """

    options: dict[str, str] = field(default_factory=dict)
    places: dict[str, str] = field(default_factory=dict)
    waypoints: Waypoints | None = None
    obstacles: tuple[Corners, ...] = ()
    workspace: Corners | None = None


def read_plan(path: Path, robot: Robot) -> PlanFile:
    """Read a plan file."""
    keys = read_yaml(path).mapping(_KEYS)
    unit = keys["angle_unit"].choice(tuple(ANGLE)) if "angle_unit" in keys else "rad"
    given = {name: value for name, value in keys.items() if name in OPTIONS and not value.is_null}
    return PlanFile(
        options={name: value.text() for name, value in given.items()},
        places={name: value.where for name, value in given.items()},
        waypoints=_waypoints(keys, robot, unit, path) if "waypoints" in keys else None,
        obstacles=_boxes(keys["obstacles"]) if "obstacles" in keys else (),
        workspace=_box(keys["workspace"]) if "workspace" in keys else None,
    )


def _boxes(value: Value) -> tuple[Corners, ...]:
    return tuple(_box(box) for box in value.items())


def _waypoints(keys: dict[str, Value], robot: Robot, unit: str, path: Path) -> Waypoints:
    rows = keys["waypoints"].items()
    factor = [ANGLE[unit] if joint.revolute else 1.0 for joint in robot.joints]
    q = np.array([[item.number() for item in row.items(robot.n)] for row in rows]) * factor
    times = (
        np.array([value.number() for value in keys["times"].items(len(rows))])
        if "times" in keys
        else None
    )
    other = "deg" if unit == "rad" else "rad"
    return _checked(
        Waypoints(q.reshape(len(rows), robot.n), times),
        robot,
        str(path),
        f"write `angle_unit: {other}`",
    )


def _box(value: Value) -> Corners:
    corners = value.mapping(("lower", "upper"), required=("lower", "upper"))
    (a, b, c), (d, e, f) = (
        [item.number() for item in corners[name].items(3)] for name in ("lower", "upper")
    )
    return (min(a, d), min(b, e), min(c, f)), (max(a, d), max(b, e), max(c, f))


def read_waypoints(path: Path, robot: Robot) -> Waypoints:
    """Read waypoints from CSV: positions in rad or m, columns by joint name when there is a header.

    Raises:
        LogNotFound: no such file.
        LogLayout: a row is not numbers, or a column is missing.
        JointCountDiffers: another number of columns than joints.
        TimeNotIncreasing: the times do not increase.
        PositionInDegrees: angles beyond two turns.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise LogNotFound(f"cannot read waypoints from {path}: {error}", where=str(path)) from None
    lines = [line for line in text.splitlines() if line.strip() and line[0] != "#"]
    cells = [[cell.strip() for cell in line.replace(";", ",").split(",")] for line in lines]
    header = cells.pop(0) if cells and any(not _is_number(cell) for cell in cells[0]) else None
    rows = _numbers(cells, path, 1 + (header is not None))
    times: Floats | None = None
    if header is not None:
        names = [name.removeprefix("q_") for name in header]
        if len(names) != rows.shape[1]:
            what = f"{path} has {len(names)} headings over {rows.shape[1]} columns"
            raise LogLayout(what, where=str(path), **_LAYOUT)
        times = rows[:, names.index("t")] if "t" in names else None
        missing = [name for name in robot.joint_names if name not in names]
        if missing:
            what = f"{path} has no column {missing[0]}; it has {', '.join(names)}"
            raise LogLayout(what, where=str(path), **_LAYOUT)
        rows = rows[:, [names.index(name) for name in robot.joint_names]]
    elif rows.shape[1] == robot.n + 1:
        times, rows = rows[:, 0], rows[:, 1:]
    if rows.shape[1] != robot.n:
        raise JointCountDiffers(
            f"{path} has {rows.shape[1]} columns, {robot.name} {robot.n} joints", where=str(path)
        )
    fix = "write them into PLAN.yaml under `waypoints:` with `angle_unit: deg`, or divide them by 57.29578"
    return _checked(Waypoints(rows, times), robot, str(path), fix)


def _checked(waypoints: Waypoints, robot: Robot, where: str, fix: str) -> Waypoints:
    if len(waypoints.q) < 2:
        raise LogLayout(
            f"{where} has {len(waypoints.q)} waypoints; a motion needs at least 2",
            where=where,
            **_LAYOUT,
        )
    if waypoints.times is not None:
        falling = np.flatnonzero(np.diff(waypoints.times) < tuning.LEAST_WAYPOINT_STEP_S)
        if len(falling):
            row = int(falling[0]) + 1
            what = f"waypoint {row + 1} must be at least {tuning.LEAST_WAYPOINT_STEP_S:g} s later than waypoint {row}"
            raise TimeNotIncreasing(what, where=where)
    far = np.abs(waypoints.q) * [joint.revolute for joint in robot.joints]
    if far.max() > tuning.MOST_WAYPOINT_RAD:
        k, j = np.unravel_index(far.argmax(), far.shape)
        raise PositionInDegrees(
            f"{where}: {robot.joint_names[j]} is {waypoints.q[k, j]:g} rad at waypoint {k + 1}",
            where=where,
            why="that is more than two turns: probably another unit is meant",
            fix=fix,
        )
    return waypoints


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _numbers(cells: list[list[str]], path: Path, first: int) -> Floats:
    width = len(cells[0]) if cells else 0
    for k, row in enumerate(cells):
        if len(row) != width or not all(
            _is_number(cell) and abs(float(cell)) <= LARGEST for cell in row
        ):
            what = f"{path}: row {first + k} is not {width} numbers up to {LARGEST:g}: {','.join(row)[:60]}"
            raise LogLayout(what, where=str(path), **_LAYOUT)
    return np.array(cells, dtype=float).reshape(len(cells), width)
