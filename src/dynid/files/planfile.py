"""What a person writes down about a motion: PLAN.yaml, and waypoints as CSV.

PLAN.yaml holds options of ``dynid trajectory`` by their long names, waypoints, and what stands around the arm.
Waypoints are in DH angles; a CSV has one row per waypoint, one column per joint, and may have a header with a column
``t``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dynid.arrays import Floats
from dynid.errors import JointCountDiffers, LogLayout, TimeNotIncreasing
from dynid.files import tuning
from dynid.files.robotkeys import (
    NUMBER,
    TEXT,
    VECTOR,
    Keys,
    choice,
    coordinate,
    or_null,
    per_joint,
    several,
    unit_of,
)
from dynid.files.texttable import text_table
from dynid.files.yamlfile import Value, read_yaml
from dynid.options import MOST
from dynid.robot import Robot
from dynid.units import ANGLE

#: Why a file of waypoints cannot be used, and the fix.
_LAYOUT = {
    "why": "a motion goes through one pose per row, with one column per joint",
    "fix": "write one row per waypoint: positions [rad or m] in the order of the joints, or a heading with their names",
}
Corners = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class Waypoints:
    """Points that a motion goes through.

    Attributes:
        q: (K, n) [rad or m].
        times: (K,) [s]; None to let the limits decide.
    """

    q: Floats
    times: Floats | None = None


class PlanFile(NamedTuple):
    """A plan file, besides the options in it.

    Attributes:
        waypoints: points to go through; None to search for an exciting motion.
        obstacles: boxes that no link may touch, least and greatest corner [m].
        workspace: box that the tool stays in; None without one.
    """

    waypoints: Waypoints | None
    obstacles: tuple[Corners, ...]
    workspace: Corners | None


def _corners(value: Value) -> Corners:
    lower, upper = value.read({"lower": VECTOR, "upper": VECTOR}, ["lower", "upper"]).values()
    (a, b, c), (d, e, f) = np.minimum(lower, upper).tolist(), np.maximum(lower, upper).tolist()
    return (a, b, c), (d, e, f)


_KEYS: Keys = {
    "angle_unit": choice(*ANGLE),
    "waypoints": several(per_joint(coordinate)),
    "times": several(NUMBER),
    "obstacles": several(_corners),
    "workspace": _corners,
}


def read_plan(path: Path, robot: Robot, options: Sequence[str]) -> PlanFile:
    """Read a plan file, which may also set some options of the command."""
    root, readers = read_yaml(path), dict.fromkeys(options, or_null(TEXT)) | _KEYS
    keys = root.mapping(list(readers))
    given = root.within(angle_unit=unit_of(keys), joints=robot.joints).read(readers)
    waypoints, times = None, None
    if "waypoints" in given:
        q = np.array(given["waypoints"]).reshape(-1, robot.n)
        if "times" in given:
            keys["times"].items(len(q))
            times = np.array(given["times"])
        waypoints = _checked(Waypoints(q, times), path)
    return PlanFile(waypoints, given.get("obstacles", ()), given.get("workspace"))


def read_waypoints(path: Path, robot: Robot) -> Waypoints:
    """Read waypoints from CSV: positions in rad or m, columns by joint name when there is a header.

    Raises:
        LogNotFound: no such file.
        LogLayout: a row is not numbers, or a column is missing.
        JointCountDiffers: another number of columns than joints.
        TimeNotIncreasing: the times do not increase.
    """
    try:
        table = text_table(path)
        rows = table.read()
    except LogLayout as error:
        raise LogLayout(error.what, where=error.where, **_LAYOUT) from error
    names = [name.removeprefix("q_") for name in table.names]
    times = rows[:, names.index("t")] if "t" in names else None
    if names:
        for name in robot.joint_names:
            if name not in names:
                text = f"{path} has no column {name}; it has {', '.join(names)}"
                raise LogLayout(text, where=path, **_LAYOUT)
        rows = rows[:, [names.index(name) for name in robot.joint_names]]
    if rows.shape[1] != robot.n:
        raise JointCountDiffers(
            f"{path} has {rows.shape[1]} columns, {robot.name} {robot.n} joints", where=path
        )
    return _checked(Waypoints(rows, times), path)


def _checked(waypoints: Waypoints, path: Path) -> Waypoints:
    for k in np.flatnonzero(~np.all(np.abs(waypoints.q) <= MOST, axis=1)):
        text = f"{path}: row {k + 1} is not numbers up to {MOST:g}"
        raise LogLayout(text, where=path, **_LAYOUT)
    if len(waypoints.q) < 2:
        raise LogLayout(
            f"{path} has {len(waypoints.q)} waypoints; a motion needs at least 2",
            where=path,
            **_LAYOUT,
        )
    if waypoints.times is not None:
        for k in np.flatnonzero(~(np.diff(waypoints.times) >= tuning.LEAST_WAYPOINT_STEP_S)):
            least = f"{tuning.LEAST_WAYPOINT_STEP_S:g} s later than waypoint {k + 1}"
            raise TimeNotIncreasing(f"waypoint {k + 2} must be at least {least}", where=path)
    return waypoints
