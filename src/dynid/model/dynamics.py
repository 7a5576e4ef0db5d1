"""Recursive Newton-Euler equations, linear in the parameters, written down as a program (Paper Eqs. 1-8, right form).

The equations are computed once with symbols in place of numbers: outward the links' velocities and
accelerations, inward the wrenches of each link's ten parameters. What is done to the symbols is the
straight-line program for P with tau = P gamma. docs/explanation/paper-map.md lists where the printed
equations differ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.model.kinematics import dh_step, right_angle
from dynid.model.program import ADD, MUL, NEG, SUB, Program
from dynid.robot import Robot

#: Symbols, and plain 0, 1 and -1 where an entry always is that.
Vector = NDArray[np.object_]
#: Rotation from a link's frame to the previous one (Paper Eq. 12), (3, 3); from the previous frame's origin to the
#: link's, (3,), in the link's frame (standard) or in the previous one (modified); joint axis in the link's frame, (3,).
Step = tuple[Vector, Vector, Vector]
#: Inputs that a joint may have.
KINDS = ("q", "qd", "qdd", "c", "s", "a", "d", "ca", "sa")


class Recorder:
    """Operations in their order, each once however often it is wanted (value numbering).

    Args:
        inputs: number of slots before that of the first operation.
    """

    def __init__(self, inputs: int) -> None:
        self.inputs = inputs
        self.operations: dict[tuple[int, int, int], int] = {}

    def slot(self, op: int, lhs: int, rhs: int) -> int:
        """Return the slot of an operation."""
        return self.operations.setdefault((op, lhs, rhs), self.inputs + len(self.operations))


@dataclass(frozen=True)
class Symbol:
    """What stands in a slot, or its negative; sums, differences and products are recorded.

    Attributes:
        recorder: of the operations.
        slot: the slot.
        sign: 1 or -1.
    """

    recorder: Recorder
    slot: int
    sign: int = 1

    def __neg__(self) -> Symbol:
        """Return the negative, which costs nothing."""
        return Symbol(self.recorder, self.slot, -self.sign)

    def __add__(self, other: Symbol | int) -> Symbol | int:
        """Return the sum with another one or a plain 0."""
        if isinstance(other, int):
            return self
        first, second = sorted((self, other), key=lambda symbol: symbol.slot)
        if first.slot == second.slot and first.sign != second.sign:
            return 0
        op = ADD if first.sign == second.sign else SUB
        return Symbol(self.recorder, self.recorder.slot(op, first.slot, second.slot), first.sign)

    def __sub__(self, other: Symbol | int) -> Symbol | int:
        """Return the difference."""
        return self + -other

    def __rsub__(self, other: int) -> Symbol | int:
        """Return the difference from a plain 0."""
        return -self

    def __mul__(self, other: Symbol | int) -> Symbol | int:
        """Return the product with another one or a plain 0, 1 or -1."""
        if isinstance(other, int):
            return Symbol(self.recorder, self.slot, self.sign * other) if other else 0
        slot = self.recorder.slot(MUL, *sorted((self.slot, other.slot)))
        return Symbol(self.recorder, slot, self.sign * other.sign)

    __radd__, __rmul__ = __add__, __mul__


def derive(robot: Robot) -> Program:
    """Derive the full regressor of an arm, the program of P, (n, 11 n).

    Only geometry, gravity and rotor inertia columns of the arm matter here.

    Source: Paper Eqs. 1-8. Deviations: Eq. 2 has omega, not its derivative, in the cross product; Eq. 3 has the
        angular velocity of link i; the last step of Eq. 6 projects on the joint axis.
    """
    names = [f"g{x}" for x in "xyz"]
    names += [f"{kind}{i}" for i in range(1, robot.n + 1) for kind in KINDS]
    recorder = Recorder(len(names))
    inputs = {name: Symbol(recorder, k) for k, name in enumerate(names)}
    standard, entries = robot.convention == "standard", dict[tuple[int, int], Symbol]()
    w = dw = np.array([0, 0, 0], dtype=object)
    # Why: an upward acceleration of the base replaces gravity on every link.
    dv = np.array([-inputs[f"g{x}"] if g else 0 for x, g in zip("xyz", robot.gravity, strict=True)])
    steps = []
    for i, joint in enumerate(robot.joints):
        steps.append(_step(robot, i, inputs))
        R, r, z = steps[i]
        qd, qdd = z * inputs[f"qd{i + 1}"], z * inputs[f"qdd{i + 1}"]
        if not standard:
            dv = dv + _of_turning(w, dw) @ r
        w, dw, dv = R.T @ w, R.T @ dw, R.T @ dv
        coriolis = _cross(w) @ qd
        if joint.revolute:
            w, dw = w + qd, dw + coriolis + qdd
        else:
            dv = dv + qdd + (coriolis + coriolis)
        if standard:
            dv = dv + _of_turning(w, dw) @ r
        force, moment = _unit_wrenches(w, dw, dv)
        for j in range(i, -1, -1):
            R, r, z = steps[j]
            moment = moment + _cross(r) @ force if standard else moment
            torque = z @ (moment if robot.joints[j].revolute else force)
            entries |= {(j, 11 * i + p): x for p, x in enumerate(torque) if isinstance(x, Symbol)}
            force, moment = R @ force, R @ moment
            moment = moment if standard else moment + _cross(r) @ force
        if joint.motor_inertia:
            entries[i, 11 * i + 10] = inputs[f"qdd{i + 1}"]
    return _program(names, recorder, entries, robot.n)


def _step(robot: Robot, i: int, inputs: dict[str, Symbol]) -> Step:
    """Return the transform of a joint; geometry that is zero by design stays zero."""
    joint, number = robot.joints[i], i + 1
    moving = inputs[f"c{number}"], inputs[f"s{number}"]
    twist = right_angle(joint.twist) or (inputs[f"ca{number}"], inputs[f"sa{number}"])
    angle = (not joint.revolute and right_angle(joint.theta_offset)) or moving
    a, d = (inputs[f"{key}{number}"] if getattr(joint, key) else 0 for key in ("a", "d"))
    d = d if joint.revolute else inputs[f"q{number}"] + d
    rows, along = dh_step(robot.convention, angle, twist, a, d)
    R = np.array(rows, dtype=object)
    if robot.convention == "standard":
        return R, np.array([a, d * twist[1], d * twist[0]], dtype=object), R[2]
    return R, np.array(along, dtype=object), np.array([0, 0, 1], dtype=object)


def _cross(v: Vector) -> Vector:
    """Return the matrix of the cross product with a vector, (3, 3)."""
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=object)


def _of_turning(w: Vector, dw: Vector) -> Vector:
    """Return what turns a place on a body into its acceleration against the body's origin (Paper Eq. 3), (3, 3)."""
    return _cross(dw) + _cross(w) @ _cross(w)


def _unit_wrenches(w: Vector, dw: Vector, dv: Vector) -> tuple[Vector, Vector]:
    """Return force and moment at the link's origin for one unit of each of its ten parameters (Eqs. 4-5), (3, 10)."""

    def inertial(x: Vector) -> Vector:
        a, b, c = x
        return np.array([[a, b, c, 0, 0, 0], [0, a, 0, b, c, 0], [0, 0, a, 0, b, c]], dtype=object)

    none = np.array([[0] * 6] * 3, dtype=object)
    force = [dv[:, None], _of_turning(w, dw), none]
    moment = [none[:, :1], -_cross(dv), inertial(dw) + _cross(w) @ inertial(w)]
    return np.hstack(force), np.hstack(moment)


def _program(
    names: list[str], recorder: Recorder, entries: dict[tuple[int, int], Symbol], n: int
) -> Program:
    """Return the program of the recorded operations that entries need."""
    places = []
    for (row, col), x in sorted(entries.items()):
        slot = x.slot if x.sign > 0 else recorder.slot(NEG, x.slot, x.slot)
        places.append((row, col, slot))
    columns = (
        np.ascontiguousarray(np.reshape(np.array(rows, dtype=np.int32), (-1, 3)).T)
        for rows in (list(recorder.operations), places)
    )
    (op, lhs, rhs), (row, col, out) = columns
    program = Program(tuple(names), op, lhs, rhs, row, col, out, (n, 11 * n))
    return program.restricted(np.arange(11 * n))
