"""Edits of a robot file: what a mistake in it is made of, what takes it out, and how it is written down."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np

from dynid.diagnose import tuning
from dynid.diagnose.fit import RobotFileFit
from dynid.robot import JointMap, Robot
from dynid.text import yaml_word


@dataclass(frozen=True, order=True)
class Edit:
    """One edit of a robot file.

    Attributes:
        kind: ``"convention"``, ``"gravity"``, ``"order"``, ``"offset"``, ``"unit"``; of one joint ``"sign"`` (position
            and torque reversed together), ``"position"`` (position alone) and ``"torque"`` (torque alone); of all
            joints ``"torques"``, ``"positions"`` and ``"signs"``.
        value: joint numbers from 0, order of the columns, joint and quarter turns, or the direction of gravity.
    """

    kind: str
    value: tuple[float, ...] = ()


#: Edits of single joints, and their namesakes that reverse all joints.
OF_ALL = {"signs": "sign", "positions": "position", "torques": "torque"}


def edited(robot: Robot, edit: Edit) -> Robot:
    """Return a robot file with one edit."""
    if edit.kind == "convention":
        return replace(
            robot, convention="modified" if robot.convention == "standard" else "standard"
        )
    if edit.kind == "gravity":
        return replace(robot, gravity=edit.value)  # type: ignore[arg-type]
    driver = robot.columns
    if edit.kind == "order":
        names = tuple(robot.log_names[int(k)] for k in edit.value)
        return replace(robot, driver=replace(driver, joint_names=names))
    if edit.kind == "unit":
        unit = "deg" if driver.units["position"] == "rad" else "rad"
        return replace(robot, driver=replace(driver, units={**driver.units, "position": unit}))
    given = driver.map
    sign, offset, torque = list(given.sign), list(given.offset), list(given.torque_signs)
    if edit.kind == "offset":
        j, quarters = int(edit.value[0]), edit.value[1]
        offset[j] = math.remainder(offset[j] + quarters * math.pi / 2, 2 * math.pi)
    else:
        kind = OF_ALL.get(edit.kind, edit.kind)
        for j in map(int, edit.value or range(robot.n)):
            sign[j] *= 1 if kind == "torque" else -1
            torque[j] *= 1 if kind == "sign" else -1
    torques = tuple(torque) if min(torque) < 0 else ()
    return replace(robot, driver=replace(driver, map=JointMap(tuple(sign), tuple(offset), torques)))


def with_edits(robot: Robot, edits: Sequence[Edit]) -> Robot:
    """Return a robot file with edits, one after the other."""
    for edit in edits:
        robot = edited(robot, edit)
    return robot


#: Edits in words; of a joint with its name.
_WORDS = {
    "convention": "the other DH convention",
    "unit": "positions in the other unit",
    "signs": "all joints reversed",
    "positions": "all positions reversed",
    "torques": "all torques reversed",
    "sign": "{} reversed",
    "position": "the position of {} reversed",
    "torque": "the torque of {} reversed",
}


def in_words(edits: Sequence[Edit], robot: Robot) -> str:
    """Return edits in words."""
    return " and ".join(edit_in_words(edit, robot) for edit in edits)


def edit_in_words(edit: Edit, robot: Robot) -> str:
    """Return one edit in words."""
    if edit.kind == "gravity":
        axis = "xyz"[int(np.argmax(np.abs(edit.value)))]
        return f"gravity along {'-' if sum(edit.value) < 0 else '+'}{axis}"
    if edit.kind == "order":
        moved = [robot.joint_names[k] for k, source in enumerate(edit.value) if source != k]
        if len(moved) == 2:
            return f"the columns of {' and '.join(moved)} exchanged"
        return f"the columns in the order {', '.join(robot.log_names[int(k)] for k in edit.value)}"
    name = robot.joint_names[int(edit.value[0])] if edit.value else ""
    if edit.kind == "offset":
        return f"{name} offset by {90 * edit.value[1]:+.0f} deg"
    return _WORDS[edit.kind].format(name)


def as_robot_file_lines(edits: Sequence[Edit], robot: Robot, named: bool = True) -> str:
    """Return edits as lines of a robot file.

    Args:
        edits: what is changed.
        robot: the robot file as it is.
        named: whether the log names its columns; the robot file orders only named ones.
    """
    changed = with_edits(robot, edits)
    kinds = {edit.kind for edit in edits}
    lines = []
    if "convention" in kinds:
        lines.append(f"`convention: {changed.convention}`")
    if "gravity" in kinds:
        lines.append(f"`gravity: [{', '.join(f'{g:g}' for g in changed.gravity)}]`")
    spec = changed.driver
    if spec is not None and kinds - {"convention", "gravity"}:
        if "order" in kinds and not named:
            lines.append(f"put the columns of the log in the order {', '.join(spec.joint_names)}")
        was, now = robot.columns.map, spec.map
        names = ", ".join(map(yaml_word, spec.joint_names))
        keys = {
            f"joint_names: [{names}]": "order" in kinds and named,
            f"sign: {_signs(now.sign)}": now.sign != was.sign,
            f"torque_sign: {_signs(now.torque_signs)}": now.torque_signs != was.torque_signs,
            f"offset: [{', '.join(map(_angle, now.offset))}]": now.offset != was.offset,
            f"units: {{position: {spec.units['position']}}}": "unit" in kinds,
        }
        if inside := ", ".join(text for text, needed in keys.items() if needed):
            new = f"`driver: {{kind: generic, {inside}}}`"
            lines.append(f"under `driver:` `{inside}`" if robot.driver else new)
    return " and ".join(lines)


def _signs(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{value:g}' for value in values)}]"


def _angle(value: float) -> str:
    return f"{math.degrees(value):.6g} deg" if value else "0"


def edits_of(judge: RobotFileFit, names: Sequence[str]) -> Iterator[Edit]:
    """Yield all single edits of a robot file."""
    robot = judge.robot
    yield Edit("convention")
    if robot.torque.source != "gravity_free":
        yield from _directions(robot)
    if not judge.mapped:
        return
    for kind in ("sign", "position", "torque"):
        yield from (Edit(kind, (float(j),)) for j in range(robot.n))
    yield from map(Edit, OF_ALL)
    for j, joint in enumerate(robot.joints):
        yield from (
            Edit("offset", (float(j), quarter)) for quarter in (1.0, -1.0, 2.0) if joint.revolute
        )
    yield Edit("unit")
    yield from _orders(names)


def _directions(robot: Robot) -> Iterator[Edit]:
    """Yield the other directions of gravity along the axes of frame 0."""
    gravity = np.array(robot.gravity)
    size = float(np.linalg.norm(gravity))
    for other in size * np.concatenate([np.eye(3), -np.eye(3)]):
        if size and not np.allclose(other, gravity, atol=0.1 * size):
            yield Edit("gravity", tuple((other + 0.0).tolist()))


def _orders(names: Sequence[str]) -> Iterator[Edit]:
    """Yield orders of the columns: every exchange of two, and whole ones that recorders and people make."""
    same = list(range(n := len(names)))
    orders = []
    for a, b in combinations(same, 2):
        orders.append(list(same))
        orders[-1][a], orders[-1][b] = b, a
    by_name = sorted(same, key=lambda k: names[k])
    back = [by_name.index(k) for k in same]
    orders += [same[::-1], [*same[1:], 0], [n - 1, *same[:-1]], by_name, back]
    for order in dict.fromkeys(map(tuple, orders)):
        if order != tuple(same):
            yield Edit("order", tuple(map(float, order)))


def unlikeliness(edit: Edit) -> float:
    """Return how much less likely a mistake is than the likeliest one, in units of ``tuning.CLEAR``."""
    price = tuning.UNLIKELY[edit.kind]
    if edit.kind == "order":
        n = len(edit.value)
        moved = tuning.COLUMN_MOVED * max(0, sum(k != at for at, k in enumerate(edit.value)) - 2)
        # The reversed order, or the whole chain shifted.
        steps = {(b - a) % n for a, b in pairwise(edit.value)}
        price += min(moved, tuning.REGULAR_ORDER) if steps in ({1.0}, {n - 1.0}) else moved
    return price


def with_one_more(edits: tuple[Edit, ...], edit: Edit) -> tuple[Edit, ...] | None:
    """Return edits with one more, None where that says nothing new."""
    alike = [before for before in edits if before.kind == edit.kind]
    if edit.kind == "order" and alike:
        edits = tuple(before for before in edits if before not in alike)
        order = tuple(alike[0].value[int(k)] for k in edit.value)
        if order == tuple(sorted(order)):
            return None
        edit = Edit("order", order)
    elif any(edit.kind == "gravity" or edit.value[:1] == before.value[:1] for before in alike):
        return None
    return tuple(sorted((*edits, edit)))
