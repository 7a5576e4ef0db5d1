"""Edits of a robot file: what a mistake in it is made of, what takes it out, and how it is written down."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dynid.diagnose import tuning
from dynid.diagnose.fit import Judge
from dynid.model.parameters import expected_torque
from dynid.robot import DriverSpec, JointMap, Robot
from dynid.text import yaml_word

Floats = NDArray[np.float64]


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
        return replace(
            robot, convention="modified" if robot.convention == "standard" else "standard"
        )
    if edit.kind == "gravity":
        return replace(robot, gravity=edit.value)  # type: ignore[arg-type]
    n = robot.n
    driver = robot.driver or DriverSpec(
        "generic", None, robot.joint_names, JointMap((1.0,) * n, (0.0,) * n)
    )
    if edit.kind == "order":
        names = robot.log_names
        return replace(
            robot, driver=replace(driver, joint_names=tuple(names[int(k)] for k in edit.value))
        )
    if edit.kind == "unit":
        unit = "deg" if driver.units["position"] == "rad" else "rad"
        return replace(robot, driver=replace(driver, units={**driver.units, "position": unit}))
    sign, offset, torque = (
        list(driver.map.sign),
        list(driver.map.offset),
        list(driver.map.torque_signs),
    )
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
        lines.append(
            f"under `driver:` `{inside}`"
            if before is not None
            else f"`driver: {{kind: generic, {inside}}}`"
        )
    return " and ".join(lines)


def _signs(values: Sequence[float]) -> str:
    return f"[{', '.join(f'{value:g}' for value in values)}]"


def _angle(value: float) -> str:
    return f"{math.degrees(value):.6g} deg" if value else "0"


def edits_of(judge: Judge, names: Sequence[str]) -> Iterator[Edit]:
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
    yield from _orders(judge, names)


def _directions(robot: Robot) -> Iterator[Edit]:
    """Yield the other directions of gravity along the axes of frame 0."""
    gravity = np.array(robot.gravity)
    size = float(np.linalg.norm(gravity))
    for other in size * np.concatenate([np.eye(3), -np.eye(3)]):
        if size and not np.allclose(other, gravity, atol=0.1 * size):
            yield Edit("gravity", tuple((other + 0.0).tolist()))


def _orders(judge: Judge, names: Sequence[str]) -> Iterator[Edit]:
    """Yield orders of the columns: every exchange of two, and whole ones that recorders and people make."""
    n = judge.robot.n
    same = list(range(n))
    seen = {tuple(same)}
    by_name = sorted(same, key=lambda k: names[k])
    whole = [
        same[::-1],
        [*same[1:], 0],
        [n - 1, *same[:-1]],
        by_name,
        [by_name.index(k) for k in same],
        _by_size(judge),
    ]
    swaps = [
        [b if k == a else a if k == b else k for k in same]
        for a in range(n)
        for b in range(a + 1, n)
    ]
    for order in [*swaps, *whole]:
        if sorted(order) == same and tuple(order) not in seen:
            seen.add(tuple(order))
            yield Edit("order", tuple(float(k) for k in order))


def _by_size(judge: Judge) -> list[int]:
    """Return the assignment of columns to joints by range of motion and size of the torque."""
    robot, x = judge.robot, judge.x
    have = np.std(judge.tau, axis=0) + 1e-9
    carried = np.sqrt(np.mean(expected_torque(x[0], robot) ** 2, axis=0)) + 0.02
    size = np.array([joint.limits.torque or np.nan for joint in robot.joints])
    wanted = size if np.isfinite(size).all() else carried
    cost = np.abs(np.log(have / have.mean())[None, :] - np.log(wanted / wanted.mean())[:, None])
    for j, joint in enumerate(robot.joints):
        if (
            joint.limits.position is not None
            and robot.coupling is None
            and robot.driver is not None
        ):
            map_ = robot.driver.map
            low, high = sorted((np.array(joint.limits.position) - map_.offset[j]) * map_.sign[j])
            outside = np.maximum(0, x[0].max(axis=0) - high) + np.maximum(0, low - x[0].min(axis=0))
            cost[j] += 3.0 * outside
    return assignment(cost)


def unlikeliness(edit: Edit) -> float:
    """Return how much less likely a mistake is than the likeliest one, in units of ``tuning.CLEAR``."""
    moved = (
        sum(int(source) != k for k, source in enumerate(edit.value)) if edit.kind == "order" else 0
    )
    odd = tuning.COLUMN_MOVED * max(0, moved - 2)
    return tuning.UNLIKELY[edit.kind] + (
        min(odd, tuning.REGULAR_ORDER) if _regular(edit.value) else odd
    )


def _regular(order: Sequence[float]) -> bool:
    """Return whether an order is the reversed one, or the whole chain shifted."""
    steps = {(b - a) % len(order) for a, b in pairwise(order)} if len(order) > 1 else set()
    return steps in ({1.0}, {len(order) - 1.0})


def with_one_more(edits: tuple[Edit, ...], edit: Edit) -> tuple[Edit, ...] | None:
    """Return edits with one more, None where that says nothing new."""
    for before in edits:
        if (
            before.kind == edit.kind
            and edit.kind != "order"
            and (not edit.value or before.value[0] == edit.value[0])
        ):
            return None
        if before.kind == edit.kind == "gravity":
            return None
    if edit.kind == "order":
        own = next((before for before in edits if before.kind == "order"), None)
        if own is not None:
            order = tuple(own.value[int(k)] for k in edit.value)
            if order == tuple(float(k) for k in range(len(order))):
                return None
            rest = tuple(before for before in edits if before is not own)
            return tuple(sorted((*rest, Edit("order", order)), key=_place))
    return tuple(sorted((*edits, edit), key=_place))


def _place(edit: Edit) -> tuple[str, tuple[float, ...]]:
    return edit.kind, edit.value


def assignment(cost: Floats) -> list[int]:
    """Return the column of each row such that the costs of all add up to the least.

    Source: Kuhn 1955; shortest augmenting paths as in Jonker, Volgenant 1987.

    Args:
        cost: of every row with every column, (n, n), in any unit.
    """
    n = len(cost)
    row_price, price = np.zeros(n), np.zeros(n)
    row_of = np.full(n, -1)
    for start in range(n):
        distance, before, done = np.full(n, np.inf), np.full(n, -1), np.zeros(n, dtype=bool)
        row, column = start, -1
        while True:
            if column >= 0:
                done[column] = True
            reduced = (
                cost[row] - row_price[row] - price + (distance[column] if column >= 0 else 0.0)
            )
            shorter = ~done & (reduced < distance)
            distance[shorter], before[shorter] = reduced[shorter], column
            column = int(np.argmin(np.where(done, np.inf, distance)))
            if row_of[column] < 0:
                break
            row = int(row_of[column])
        row_price[start] += distance[column]
        for other in np.flatnonzero(done):
            row_price[row_of[other]] += distance[column] - distance[other]
            price[other] -= distance[column] - distance[other]
        while column >= 0:
            last = int(before[column])
            row_of[column] = start if last < 0 else row_of[last]
            column = last
    return [int(k) for k in np.argsort(row_of)]
