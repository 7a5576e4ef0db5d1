"""Edits of a robot file: what a mistake in it is made of, what takes it out, and how it is written down."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.robot import DriverSpec, JointMap, Robot
from dynid.text import yaml_word


@dataclass(frozen=True)
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
        return replace(robot, convention="modified" if robot.convention == "standard" else "standard")
    if edit.kind == "gravity":
        return replace(robot, gravity=edit.value)  # type: ignore[arg-type]
    n = robot.n
    driver = robot.driver or DriverSpec("generic", None, robot.joint_names, JointMap((1.0,) * n, (0.0,) * n))
    if edit.kind == "order":
        names = robot.log_names
        return replace(robot, driver=replace(driver, joint_names=tuple(names[int(k)] for k in edit.value)))
    if edit.kind == "unit":
        unit = "deg" if driver.units["position"] == "rad" else "rad"
        return replace(robot, driver=replace(driver, units={**driver.units, "position": unit}))
    sign, offset, torque = list(driver.map.sign), list(driver.map.offset), list(driver.map.torque_signs)
    if edit.kind == "offset":
        j = int(edit.value[0])
        offset[j] = math.remainder(offset[j] + edit.value[1] * math.pi / 2, 2 * math.pi)
    else:
        for j in range(n) if edit.kind in OF_ALL else (int(edit.value[0]),):
            sign[j] *= 1 if edit.kind in ("torque", "torques") else -1
            torque[j] *= 1 if edit.kind in ("sign", "signs") else -1
    given = tuple(torque) if any(each < 0 for each in torque) else ()
    return replace(robot, driver=replace(driver, map=JointMap(tuple(sign), tuple(offset), given)))


def with_edits(robot: Robot, edits: Sequence[Edit]) -> Robot:
    """Return a robot file with edits, one after the other."""
    for edit in edits:
        robot = edited(robot, edit)
    return robot


def said(edits: Sequence[Edit], robot: Robot) -> str:
    """Return edits in words."""
    return " and ".join(_said(edit, robot) for edit in edits)


def _said(edit: Edit, robot: Robot) -> str:
    if edit.kind in _WORDS:
        return _WORDS[edit.kind]
    if edit.kind == "gravity":
        return f"gravity along {'-' if sum(edit.value) < 0 else '+'}{'xyz'[int(np.argmax(np.abs(edit.value)))]}"
    if edit.kind == "order":
        moved = [robot.joint_names[k] for k, source in enumerate(edit.value) if source != k]
        if len(moved) == 2:
            return f"the columns of {' and '.join(moved)} exchanged"
        return f"the columns in the order {', '.join(robot.log_names[int(k)] for k in edit.value)}"
    name = robot.joint_names[int(edit.value[0])]
    if edit.kind == "offset":
        return f"{name} offset by {90 * edit.value[1]:+.0f} deg"
    return {"sign": f"{name} reversed", "position": f"the position of {name} reversed"}.get(
        edit.kind, f"the torque of {name} reversed"
    )


_WORDS = {
    "convention": "the other DH convention",
    "unit": "positions in the other unit",
    "signs": "all joints reversed",
    "positions": "all positions reversed",
    "torques": "all torques reversed",
}


def pasted(edits: Sequence[Edit], robot: Robot, named: bool = True) -> str:
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
    spec, before = changed.driver, robot.driver
    if spec is None or not kinds - {"convention", "gravity"}:
        return " and ".join(lines)
    if "order" in kinds and not named:
        lines.append(f"put the columns of the log in the order {', '.join(spec.joint_names)}")
    plain = JointMap((1.0,) * robot.n, (0.0,) * robot.n)
    was = before.map if before is not None else plain
    keys = {
        f"joint_names: [{', '.join(map(yaml_word, spec.joint_names))}]": "order" in kinds and named,
        f"sign: {_signs(spec.map.sign)}": spec.map.sign != was.sign,
        f"torque_sign: {_signs(spec.map.torque_signs)}": spec.map.torque_signs != was.torque_signs,
        f"offset: [{', '.join(map(_angle, spec.map.offset))}]": spec.map.offset != was.offset,
        f"units: {{position: {spec.units['position']}}}": "unit" in kinds,
    }
    inside = ", ".join(text for text, needed in keys.items() if needed)
    if inside:
        lines.append(f"under `driver:` `{inside}`" if before is not None else f"`driver: {{kind: generic, {inside}}}`")
    return " and ".join(lines)


def _signs(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{value:g}' for value in values)}]"


def _angle(value: float) -> str:
    return f"{math.degrees(value):.6g} deg" if value else "0"
