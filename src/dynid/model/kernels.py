"""Run a straight-line program on many samples at once, without generating code.

The program is bound to a robot's geometry, constants are folded, registers are reused as soon as their value is dead,
and then the list of array operations is run on blocks of samples small enough to stay in the processor's cache: with
NumPy, or by the compiled interpreter (``compiled``), to the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.model.compiled import TOGETHER, CompiledProgram, interpreter
from dynid.model.kinematics import geometry
from dynid.model.program import ADD, MUL, NEG, SUB, Program
from dynid.robot import Robot

Floats = NDArray[np.float64]

#: Samples a block: enough to hide the cost of starting an array operation, few enough for the cache.
BLOCK = 2048

#: The operations on plain numbers.
FOLD: dict[int, Callable[[float, float], float]] = {
    ADD: lambda a, b: a + b,
    SUB: lambda a, b: a - b,
    MUL: lambda a, b: a * b,
    NEG: lambda a, _: -a,
}
_UFUNC: dict[int, Any] = {ADD: np.add, SUB: np.subtract, MUL: np.multiply}


class Kernel:
    """A program bound to one robot, ready to run on blocks of samples.

    Args:
        program: the straight-line program.
        robot: the robot whose geometry is used.
    """

    def __init__(self, program: Program, robot: Robot) -> None:
        self._program, self._robot = program, robot
        fixed = geometry(robot)
        self._value: list[float | None] = [fixed.get(name) for name in program.inputs]
        self._value += [float(constant) for constant in program.constants]
        self._moving = [(slot, name) for slot, name in enumerate(program.inputs) if self._value[slot] is None]
        self._first, self._outputs = program.first, [int(slot) for slot in program.outputs]
        self.rows, self.cols, self.shape = program.rows, program.cols, program.shape
        self._fold()
        self._assign()

    def _fold(self) -> None:
        """Compute what does not move once."""
        program = self._program
        self._steps: list[tuple[int, int, int, int]] = []
        for k in range(program.flops):
            op, lhs, rhs = int(program.op[k]), int(program.lhs[k]), int(program.rhs[k])
            a, b = self._value[lhs], 0.0 if op == NEG else self._value[rhs]
            if a is not None and b is not None:
                self._value.append(FOLD[op](a, b))
            else:
                self._value.append(None)
                self._steps.append((op, lhs, rhs, program.first + k))

    def _assign(self) -> None:
        """Give each moving slot a register; an entry of the matrix is the register of the slot that it holds."""
        outputs = self._outputs
        entry = {slot: e for e, slot in reversed(list(enumerate(outputs))) if slot >= self._first and self._moves(slot)}
        copies = [(e, slot) for e, slot in enumerate(outputs) if entry.get(slot) != e]
        register, size = self._registers(entry, copies)
        self._pool = np.empty((size, BLOCK))
        self._entries = np.empty((len(outputs), BLOCK))

        def place(slot: int) -> float | Floats:
            value = self._value[slot]
            if value is not None:
                return value
            row: Floats = self._entries[entry[slot]] if slot in entry else self._pool[register[slot]]
            return row

        self._calls: list[tuple[Any, Any, Any, Any]] = [
            (np.multiply, place(lhs), -1.0, place(out))
            if op == NEG
            else (_UFUNC[op], place(lhs), place(rhs), place(out))
            for op, lhs, rhs, out in self._steps
        ]
        self._loads = [(self._pool[register[slot]], name) for slot, name in self._moving]
        self._register, self._entry = register, entry
        self._copied = [(self._entries[e], place(slot)) for e, slot in copies]

    @cached_property
    def _program_in_numbers(self) -> CompiledProgram:
        """The program for the compiled interpreter: rows of registers, then of entries, then of constants."""
        first, constants = len(self._pool) + len(self._entries), dict[float, int]()

        def row(slot: int) -> int:
            value = self._value[slot]
            if value is not None:
                return first + constants.setdefault(value, len(constants))
            return len(self._pool) + self._entry[slot] if slot in self._entry else self._register[slot]

        calls = [(op, row(lhs), row(lhs if op == NEG else rhs), row(out)) for op, lhs, rhs, out in self._steps]
        outputs = [row(slot) for slot in self._outputs]
        pool = np.zeros((first + len(constants), TOGETHER))
        pool[first:] = np.array(list(constants))[:, None]
        table = np.array(calls, dtype=np.int32).reshape(-1, 4)
        return CompiledProgram(table, pool, len(self._loads), np.array(outputs, dtype=np.int32))

    def _moves(self, slot: int) -> bool:
        return self._value[slot] is None

    def _registers(self, entry: dict[int, int], copies: list[tuple[int, int]]) -> tuple[dict[int, int], int]:
        """Return the register of each slot that is no entry, and how many there are; dead ones are reused."""
        last = {slot: k for k, step in enumerate(self._steps) for slot in _operands(step)}
        last |= {slot: len(self._steps) for _, slot in copies}
        register = {slot: r for r, (slot, _) in enumerate(self._moving)}
        free: list[int] = []
        size = len(register)
        for k, step in enumerate(self._steps):
            free += [register[slot] for slot in _operands(step) if last[slot] == k and slot in register]
            out = step[3]
            if out not in entry:
                if not free:
                    free.append(size)
                    size += 1
                register[out] = free.pop()
        return register, size

    def run(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return the entries of the matrix for at most ``BLOCK`` samples.

        Args:
            q: positions, (B, n) [rad or m].
            qd: velocities, (B, n) [rad/s or m/s].
            qdd: accelerations, (B, n) [rad/s^2 or m/s^2].

        Returns:
            Entries in the order of ``rows`` and ``cols``, (E, B); overwritten by the next call.
        """
        count, library = len(q), interpreter(len(q))
        for target, name in self._loads:
            target[:count] = moving_input(name, self._robot, q, qd, qdd)
            target[count:] = 0.0
        if library is not None:
            self._program_in_numbers.run(library, self._pool, self._entries, count)
            return self._entries[:, :count]
        for ufunc, a, b, out in self._calls:
            ufunc(a, b, out)
        for target, source in self._copied:
            target[:] = source
        return self._entries[:, :count]

    def blocks(self, q: Floats, qd: Floats, qdd: Floats) -> Iterator[tuple[slice, Floats]]:
        """Yield (samples, entries) block by block; the entries are overwritten by the next block."""
        for start in range(0, len(q), BLOCK):
            part = slice(start, min(start + BLOCK, len(q)))
            yield part, self.run(q[part], qd[part], qdd[part])


def _operands(step: tuple[int, int, int, int]) -> set[int]:
    """Return the slots that an operation reads."""
    op, lhs, rhs, _ = step
    return {lhs} if op == NEG else {lhs, rhs}


def moving_input(name: str, robot: Robot, q: Floats, qd: Floats, qdd: Floats) -> Floats:
    """Return one input that varies with the motion."""
    kind, index = name.rstrip("0123456789"), int(name[len(name.rstrip("0123456789")) :]) - 1
    if kind == "qd":
        return qd[:, index]
    if kind == "qdd":
        return qdd[:, index]
    if kind == "q":
        return q[:, index]
    angle = q[:, index] + robot.joints[index].theta_offset
    return np.cos(angle) if kind == "c" else np.sin(angle)
