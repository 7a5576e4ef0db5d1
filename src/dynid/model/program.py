"""The regressor as a straight-line program: plain integer arrays, no code in files.

Slots are numbered: first the inputs, then the integer constants, then one slot an operation. An operation reads two
earlier slots. Each non-zero entry of the regressor names its row, its column and the slot that holds it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int32]

ADD, SUB, MUL, NEG = range(4)
#: Names of inputs; nothing else may become a variable when a program is written as code.
_INPUT = re.compile(r"(?:c|s|q|qd|qdd|a|d|ca|sa)[1-9][0-9]{0,3}|g[xyz]")


@dataclass(frozen=True)
class Program:
    """A straight-line program for the entries of a matrix.

    Attributes:
        inputs: names of the inputs: ``c1 s1 q1 qd1 qdd1`` vary with the motion; ``a1 d1 ca1 sa1 gx gy gz`` (and
            ``c1 s1`` of a prismatic joint) belong to the robot's geometry.
        constants: integer constants.
        op: operation codes, (M,).
        lhs: first operand's slot, (M,).
        rhs: second operand's slot, (M,); unused for a negation.
        rows: row of each entry, (E,).
        cols: column of each entry, (E,).
        outputs: slot of each entry, (E,).
        shape: rows and columns of the matrix.
    """

    inputs: tuple[str, ...]
    constants: tuple[int, ...]
    op: Ints
    lhs: Ints
    rhs: Ints
    rows: Ints
    cols: Ints
    outputs: Ints
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        """Check names, and that no operation reads a slot that is not yet there: all may come from a file."""
        first = len(self.inputs) + len(self.constants)
        slots = first + np.arange(len(self.op))
        arrays = (self.op, self.lhs, self.rhs, self.rows, self.cols, self.outputs)
        sound = (
            all(_INPUT.fullmatch(name) for name in self.inputs)
            and all(array.ndim == 1 and np.issubdtype(array.dtype, np.integer) for array in arrays)
            and len(self.op) == len(self.lhs) == len(self.rhs)
            and len(self.rows) == len(self.cols) == len(self.outputs)
            and all(_within(operand, slots) for operand in (self.lhs, self.rhs))
            and _within(self.op, NEG + 1)
            and _within(self.outputs, first + len(self.op))
            and _within(self.rows, self.shape[0])
            and _within(self.cols, self.shape[1])
        )
        if not sound:
            raise ValueError("the arrays do not form a straight-line program")

    @property
    def first(self) -> int:
        """Slot of the first operation."""
        return len(self.inputs) + len(self.constants)

    @property
    def joints(self) -> int:
        """Largest number of a joint that an input names."""
        return max((int(name.lstrip("acdqs")) for name in self.inputs if name[0] != "g"), default=0)

    @property
    def flops(self) -> int:
        """Number of operations."""
        return len(self.op)

    def restricted(self, columns: NDArray[np.intp]) -> Program:
        """Return the program of the given columns, renumbered in that order, without operations they do not need."""
        position = np.full(self.shape[1], -1)
        position[columns] = np.arange(len(columns))
        kept = position[self.cols] >= 0
        needed = np.zeros(self.first + self.flops, dtype=bool)
        needed[self.outputs[kept]] = True
        for k in range(self.flops - 1, -1, -1):
            if needed[self.first + k]:
                needed[self.lhs[k]] = True
                needed[self.rhs[k]] = True
        needed[: self.first] = True
        renumbered = np.cumsum(needed) - 1
        live = needed[self.first :]
        as_int = np.int32
        return Program(
            self.inputs,
            self.constants,
            self.op[live],
            renumbered[self.lhs[live]].astype(as_int),
            renumbered[self.rhs[live]].astype(as_int),
            self.rows[kept],
            position[self.cols[kept]].astype(as_int),
            renumbered[self.outputs[kept]].astype(as_int),
            (self.shape[0], len(columns)),
        )


def _within(values: Ints, limit: int | NDArray[np.intp]) -> bool:
    return bool(np.all((values >= 0) & (values < limit)))


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
        op, lhs, rhs, rows, cols, outputs = (np.ascontiguousarray(column) for column in (*ops.T, *out.T))
        program = Program(self.inputs, self.constants, op, lhs, rhs, rows, cols, outputs, shape)
        return program.restricted(np.arange(shape[1]))
