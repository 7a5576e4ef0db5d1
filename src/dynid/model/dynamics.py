"""Symbolic recursive Newton-Euler equations, linear in the parameters (Paper Eqs. 1-8 in their right form).

Outward the frames' velocities and accelerations, inward the wrench that each link's ten parameters cause; both with
every intermediate expression named on the way. The result is a straight-line program for P with tau = P gamma.
docs/explanation/paper-map.md lists where the printed equations differ.
"""

from __future__ import annotations

from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from dynid.model.kinematics import Step, symbolic_step
from dynid.model.parameters import TENSOR
from dynid.model.program import ADD, MUL, NEG, SUB, Program
from dynid.robot import Robot

if TYPE_CHECKING:
    from sympy import Expr, Symbol

    from dynid.model.kinematics import Matrix, Vector


class Recorder:
    """Gives a name to each intermediate SymPy expression and the same name to equal ones."""

    def __init__(self) -> None:
        self.assignments: list[tuple[Symbol, Expr]] = []
        self._known: dict[Expr, Symbol] = {}

    def let(self, expression: Expr) -> Expr:
        """Return a symbol, or its negative, that stands for the expression."""
        from sympy import Symbol

        if expression.is_Atom or (-expression).is_Atom:
            return expression
        if expression in self._known:
            return self._known[expression]
        opposite = -expression
        if opposite in self._known:
            return -self._known[opposite]
        # Why: the side with fewer minus signs is kept, since a sum of negative terms would cost one more operation.
        terms = expression.args if expression.is_Add else (expression,)
        flipped = 2 * sum(bool(term.as_coeff_Mul()[0].is_negative) for term in terms) > len(terms)
        symbol, kept = Symbol(f"t{len(self.assignments)}"), opposite if flipped else expression
        self._known[kept] = symbol
        self.assignments.append((symbol, kept))
        return -symbol if flipped else symbol

    def vector(self, entries: Vector) -> Vector:
        """Name the entries of a vector."""
        return [self.let(entry) for entry in entries]


def dot(a: Vector, b: Vector) -> Expr:
    """Return a . b; most entries are zero, and leaving them out is most of the speed of the derivation."""
    from sympy import Integer

    return sum((x * y for x, y in zip(a, b, strict=True) if x and y), Integer(0))


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    pairs = ((1, 2), (2, 0), (0, 1))
    return [dot([a[i], -a[j]], [b[j], b[i]]) for i, j in pairs]


def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return [x + y if x and y else x or y for x, y in zip(a, b, strict=True)]


def rotate(R: Matrix, v: Vector) -> Vector:
    """Return R v."""
    return [dot(row, v) for row in R]


def transposed(R: Matrix) -> Matrix:
    """Return the transpose, which is the inverse of a rotation."""
    return [list(column) for column in zip(*R, strict=True)]


def derive(robot: Robot) -> tuple[Program, Recorder, dict[tuple[int, int], Expr]]:
    """Derive the full regressor of an arm.

    Args:
        robot: the arm; only its geometry, gravity and rotor inertia columns matter here.

    Returns:
        The program of P, (n, 11 n); the named expressions; and each entry of P as an expression of them.

    Source: Paper Eqs. 1-8. Deviations: Eq. 2 has omega, not its derivative, in the cross product; Eq. 3 has the
        angular velocity of link i; the last step of Eq. 6 projects on the joint axis.
    """
    recorder = Recorder()
    steps = [symbolic_step(joint, i + 1, robot.convention) for i, joint in enumerate(robot.joints)]
    steps = [
        Step([recorder.vector(row) for row in s.R], recorder.vector(s.r), recorder.vector(s.z))
        for s in steps
    ]
    motion = _outward(robot, steps, recorder)
    entries: dict[tuple[int, int], Expr] = {}
    for k in range(robot.n):
        _inward(robot, steps, motion[k], k, recorder, entries)
    for i, joint in enumerate(robot.joints):
        if joint.motor_inertia:
            entries[i, 11 * i + 10] = _symbol(f"qdd{i + 1}")
    return _compile(recorder, entries, (robot.n, 11 * robot.n)), recorder, entries


def _symbol(name: str) -> Expr:
    from sympy import Symbol

    return Symbol(name)


def _outward(robot: Robot, steps: list[Step], rec: Recorder) -> list[tuple[Vector, Vector, Vector]]:
    """Return angular velocity, angular acceleration and acceleration of each link's origin, in the link's frame."""
    from sympy import Integer

    zero = Integer(0)
    w: Vector = [zero] * 3
    dw: Vector = [zero] * 3
    # Why: an upward acceleration of the base replaces gravity on every link.
    dv: Vector = [
        -_symbol(f"g{x}") if g else zero for x, g in zip("xyz", robot.gravity, strict=True)
    ]
    motion = []
    for i, (joint, step) in enumerate(zip(robot.joints, steps, strict=True)):
        back = transposed(step.R)
        qd = [rec.let(_symbol(f"qd{i + 1}") * z) for z in step.z]
        qdd = [rec.let(_symbol(f"qdd{i + 1}") * z) for z in step.z]
        if robot.convention == "modified":
            dv = _carried(dv, dw, w, step.r, rec)
        w_before = rec.vector(rotate(back, w))
        dw, dv = rec.vector(rotate(back, dw)), rec.vector(rotate(back, dv))
        if joint.revolute:
            dw = rec.vector(add(add(dw, cross(w_before, qd)), qdd))
            w = rec.vector(add(w_before, qd))
        else:
            w = w_before
            coriolis = rec.vector(cross(w, qd))
            dv = rec.vector(add(add(dv, qdd), [2 * c for c in coriolis]))
        if robot.convention == "standard":
            dv = _carried(dv, dw, w, step.r, rec)
        motion.append((w, dw, dv))
    return motion


def _carried(dv: Vector, dw: Vector, w: Vector, r: Vector, rec: Recorder) -> Vector:
    """Return the acceleration at a point moved by r (Paper Eq. 3)."""
    spin = rec.vector(cross(w, r))
    return rec.vector(add(add(dv, rec.vector(cross(dw, r))), rec.vector(cross(w, spin))))


def _body_wrench(w: Vector, dw: Vector, dv: Vector, rec: Recorder) -> list[tuple[Vector, Vector]]:
    """Return force and moment at the link's origin for one unit of each of its ten parameters (Paper Eqs. 4-5)."""
    from sympy import Integer

    zero = Integer(0)
    none: Vector = [zero] * 3
    unit = [[Integer(int(i == j)) for j in range(3)] for i in range(3)]
    wrench: list[tuple[Vector, Vector]] = [(dv, none)]
    products = [[rec.let(w[i] * w[j]) for j in range(3)] for i in range(3)]
    for axis in range(3):
        # Why: w x (w x e) = w (w.e) - e (w.w), written out so that the products are shared.
        first, second = (axis + 1) % 3, (axis + 2) % 3
        centripetal = [products[i][axis] for i in range(3)]
        centripetal[axis] = -products[first][first] - products[second][second]
        force = rec.vector(add(cross(dw, unit[axis]), centripetal))
        wrench.append((force, rec.vector(cross(unit[axis], dv))))
    for i, j in TENSOR:
        turned = {i: j, j: i}  # (unit tensor) w has component w[j] at i and w[i] at j
        angular = [dw[turned[k]] if k in turned else zero for k in range(3)]
        gyroscopic = []
        for k in range(3):
            first, second = (k + 1) % 3, (k + 2) % 3
            plus = products[first][turned[second]] if second in turned else zero
            minus = products[second][turned[first]] if first in turned else zero
            gyroscopic.append(plus - minus)
        wrench.append((none, rec.vector(add(angular, gyroscopic))))
    return wrench


def _inward(
    robot: Robot,
    steps: list[Step],
    motion: tuple[Vector, Vector, Vector],
    link: int,
    rec: Recorder,
    entries: dict[tuple[int, int], Expr],
) -> None:
    """Carry the ten unit wrenches of one link to every joint before it and project them on the joint axes (Eq. 6)."""
    wrench = _body_wrench(*motion, rec)
    for i in range(link, -1, -1):
        step = steps[i]
        revolute = robot.joints[i].revolute
        for p, (f, moment) in enumerate(wrench):
            n = (
                rec.vector(add(moment, rec.vector(cross(step.r, f))))
                if robot.convention == "standard"
                else moment
            )
            effort = n if revolute else f
            torque = rec.let(dot(step.z, effort))
            if torque != 0:
                entries[i, 11 * link + p] = torque
            if i:
                wrench[p] = _moved(
                    step.R, f, n, step.r if robot.convention == "modified" else None, rec
                )


def _moved(
    R: Matrix, f: Vector, n: Vector, r: Vector | None, rec: Recorder
) -> tuple[Vector, Vector]:
    """Express a wrench in the previous frame; with r, also about the previous frame's origin."""
    f, n = rec.vector(rotate(R, f)), rec.vector(rotate(R, n))
    return f, (rec.vector(add(n, rec.vector(cross(r, f)))) if r is not None else n)


class Builder:
    """Collects operations and finds equal ones (value numbering), so that nothing is computed twice."""

    def __init__(self, inputs: tuple[str, ...], constants: tuple[int, ...]) -> None:
        self.inputs, self.constants = inputs, constants
        self._ops: list[tuple[int, int, int]] = []
        self._known: dict[tuple[int, int, int], int] = {}

    def slot(self, op: int, lhs: int, rhs: int) -> int:
        """Return the slot of an operation, a new one only when it is not there yet."""
        if op in (ADD, MUL) and lhs > rhs:
            lhs, rhs = rhs, lhs
        key = (op, lhs, rhs)
        if key not in self._known:
            self._known[key] = len(self.inputs) + len(self.constants) + len(self._ops)
            self._ops.append(key)
        return self._known[key]

    def build(self, entries: list[tuple[int, int, int]], shape: tuple[int, int]) -> Program:
        """Return the program whose entries are (row, column, slot), without operations that no entry needs."""
        ops = np.array(self._ops, dtype=np.int32).reshape(-1, 3)
        out = np.array(entries, dtype=np.int32).reshape(-1, 3)
        op, lhs, rhs, rows, cols, outputs = (
            np.ascontiguousarray(column) for column in (*ops.T, *out.T)
        )
        program = Program(self.inputs, self.constants, op, lhs, rhs, rows, cols, outputs, shape)
        return program.restricted(np.arange(shape[1]))


def _compile(
    rec: Recorder, entries: dict[tuple[int, int], Expr], shape: tuple[int, int]
) -> Program:
    """Turn the named expressions into a straight-line program."""
    defined = {symbol for symbol, _ in rec.assignments}
    used = set().union(
        *(e.free_symbols for _, e in rec.assignments), *(e.free_symbols for e in entries.values())
    )
    inputs = tuple(sorted(str(symbol) for symbol in used - defined))
    builder = Builder(inputs, (0, 1, 2))
    slots = {name: k for k, name in enumerate(inputs)}
    constants = {value: len(inputs) + k for k, value in enumerate(builder.constants)}
    zero = constants[0]

    def slot(e: Expr) -> int:
        if e.is_Symbol:
            return slots[e.name]
        if e.is_Integer and int(e) in constants:
            return constants[int(e)]
        if e.is_Pow:
            base = slot(e.base)
            return builder.slot(MUL, base, base)
        factor, rest = e.as_coeff_Mul()
        if factor != 1:
            size = (
                slot(rest)
                if abs(factor) == 1
                else builder.slot(MUL, constants[abs(int(factor))], slot(rest))
            )
            return builder.slot(NEG, size, zero) if factor.is_negative else size
        if e.is_Mul:
            first, *others = sorted(slot(part) for part in e.args)
            return reduce(lambda total, value: builder.slot(MUL, total, value), others, first)
        signed = [(bool(part.as_coeff_Mul()[0].is_negative), part) for part in e.args]
        terms = sorted((negative, slot(-part if negative else part)) for negative, part in signed)
        total = builder.slot(NEG, terms[0][1], zero) if terms[0][0] else terms[0][1]
        for negative, value in terms[1:]:
            total = builder.slot(SUB if negative else ADD, total, value)
        return total

    for symbol, expression in rec.assignments:
        slots[str(symbol)] = slot(expression)
    return builder.build([(row, col, slot(e)) for (row, col), e in sorted(entries.items())], shape)
