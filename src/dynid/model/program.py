"""The regressor as a straight-line program: plain integer arrays, no code in files, and its evaluation on many samples.

Slots are numbered: first the inputs, then one slot an operation. An operation reads two
earlier slots. Each non-zero entry of the regressor names its row, its column and the slot that holds it.

For evaluation a program is bound to a robot's geometry, constants are folded, and the list of array operations is
run on blocks of samples that stay in the processor's cache.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Floats
from dynid.model.kinematics import geometry
from dynid.robot import Robot

Ints = NDArray[np.int32]

ADD, SUB, MUL, NEG = range(4)
#: The operations on plain numbers.
FOLD: dict[int, Callable[[float, float], float]] = {
    ADD: operator.add,
    SUB: operator.sub,
    MUL: operator.mul,
    NEG: lambda a, _: -a,
}
UFUNC: dict[int, Any] = {ADD: np.add, SUB: np.subtract, MUL: np.multiply}


@dataclass(frozen=True)
class Program:
    """A straight-line program for the entries of a matrix.

    Attributes:
        inputs: names of the inputs: ``c1 s1 q1 qd1 qdd1`` vary with the motion; ``a1 d1 ca1 sa1 gx gy gz`` (and
            ``c1 s1`` of a prismatic joint) belong to the robot's geometry.
        op: operation codes, (M,).
        lhs: first operand's slot, (M,).
        rhs: second operand's slot, (M,); unused for a negation.
        rows: row of each entry, (E,).
        cols: column of each entry, (E,).
        outputs: slot of each entry, (E,).
        shape: rows and columns of the matrix.
    """

    inputs: tuple[str, ...]
    op: Ints
    lhs: Ints
    rhs: Ints
    rows: Ints
    cols: Ints
    outputs: Ints
    shape: tuple[int, int]

    @property
    def flops(self) -> int:
        """Number of operations."""
        return len(self.op)

    def restricted(self, columns: NDArray[np.intp]) -> Program:
        """Return the program of the given columns, renumbered in that order, without what they do not need."""
        position = np.full(self.shape[1], -1, dtype=np.int32)
        position[columns] = np.arange(len(columns))
        kept = position[self.cols] >= 0
        first = len(self.inputs)
        needed = np.zeros(first + self.flops, dtype=bool)
        needed[self.outputs[kept]] = True
        for k in range(self.flops - 1, -1, -1):
            if needed[first + k]:
                needed[[self.lhs[k], self.rhs[k]]] = True
        inputs = needed[:first]
        renumbered = np.cumsum(needed, dtype=np.int32) - 1
        live = needed[first:]
        return Program(
            tuple(compress(self.inputs, inputs)),
            self.op[live],
            renumbered[self.lhs[live]],
            renumbered[self.rhs[live]],
            self.rows[kept],
            position[self.cols[kept]],
            renumbered[self.outputs[kept]],
            (self.shape[0], len(columns)),
        )


# ---------------------------------------------------------------- evaluation
#: Operation, slots of both operands, slot of the result.
Step = tuple[int, int, int, int]


def bound(
    program: Program, robot: Robot
) -> tuple[list[float | None], list[tuple[int, str]], list[Step]]:
    """Return a program with a robot's geometry put in and everything computed that does not move.

    Returns:
        The number of each slot, None where it moves; slot and name of each input that moves; the steps that are left.
    """
    fixed = geometry(robot)
    value = [fixed.get(name) for name in program.inputs]
    moving = [(slot, name) for slot, name in enumerate(program.inputs) if value[slot] is None]
    steps = []
    for op, lhs, rhs in np.stack([program.op, program.lhs, program.rhs], axis=1).tolist():
        a, b = value[lhs], 0.0 if op == NEG else value[rhs]
        if a is None or b is None:
            steps.append((op, lhs, rhs, len(value)))
        value.append(None if a is None or b is None else FOLD[op](a, b))
    return value, moving, steps


def moving_input(name: str, robot: Robot, q: Floats, qd: Floats, qdd: Floats) -> Floats:
    """Return one input that varies with the motion."""
    kind, joint = input_of(name)
    if kind in ("c", "s"):
        angle = q[:, joint] + robot.joints[joint].theta_offset
        return np.cos(angle) if kind == "c" else np.sin(angle)
    return {"q": q, "qd": qd, "qdd": qdd}[kind][:, joint]


def input_of(name: str) -> tuple[str, int]:
    """Return kind and joint (0-based) of an input that varies with the motion."""
    kind = name.rstrip("0123456789")
    return kind, int(name[len(kind) :]) - 1


class Evaluator:
    """A program bound to one robot and a number of samples; it keeps every intermediate value.

    Args:
        program: the straight-line program.
        robot: the robot whose geometry is used.
        samples: most samples of a run.
    """

    def __init__(self, program: Program, robot: Robot, samples: int) -> None:
        self._robot = robot
        self._value, self._moving, self._steps = bound(program, robot)
        moving = [slot for slot, _ in self._moving] + [step[3] for step in self._steps]
        self._row = {slot: row for row, slot in enumerate(moving)}
        self._values = np.zeros((len(moving), samples))
        self._outputs = program.outputs.tolist()
        self._entries = np.empty((len(self._outputs), samples))
        self._calls = [
            (np.multiply, self._at(lhs), -1.0, self._at(out))
            if op == NEG
            else (UFUNC[op], self._at(lhs), self._at(rhs), self._at(out))
            for op, lhs, rhs, out in self._steps
        ]

    def _at(self, slot: int) -> Any:  # noqa: ANN401 - a number or a row
        return self._values[self._row[slot]] if self._value[slot] is None else self._value[slot]

    def run(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return the entries of the matrix, (E, N); overwritten by the next call."""
        count = len(q)
        for row, (_, name) in zip(self._values, self._moving, strict=False):
            row[:count] = moving_input(name, self._robot, q, qd, qdd)
        for ufunc, a, b, out in self._calls:
            ufunc(a, b, out)
        for entry, slot in zip(self._entries, self._outputs, strict=True):
            entry[:] = self._at(slot)
        return self._entries[:, :count]
