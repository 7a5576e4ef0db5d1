"""Arithmetic in a prime field: exact linear algebra on the regressor without any tolerance.

Every length is a fraction, every angle a rational point of the unit circle, so each entry of the regressor is a whole
number modulo the prime; a relation that holds there at random states holds for the arm, up to a chance of one in 10^6.
Source: Schwartz-Zippel lemma.
"""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from dynid.model.program import ADD, MUL, SUB, Program

Residues = NDArray[np.uint64]

#: Below 2^31, so that products fit 64 bits, and 23 modulo 24, so that 2 and 3 have square roots and -1 has none.
PRIME = 2147483543
_P = np.uint64(PRIME)
#: Square roots of 2, 3 and 6; their signs are those of one embedding, since the third is the product of the first two.
ROOTS: dict[int, int] = {k: pow(k, (PRIME + 1) // 4, PRIME) for k in (2, 3)}
ROOTS[6] = ROOTS[2] * ROOTS[3] % PRIME
_STEP = math.pi / 12
#: An angle this close to a multiple of 15 degrees is one: this undoes rounding only, the robot file snaps coarsely.
_ROUNDING_RAD = 1e-9


def decimal_fraction(value: float) -> Fraction:
    """Return the decimal fraction that a person typed: 0.41 is 41/100."""
    return Fraction(repr(float(value)))


def residue(value: float | Fraction) -> int:
    """Return a number as typed modulo the prime."""
    fraction = value if isinstance(value, Fraction) else decimal_fraction(value)
    return fraction.numerator * pow(fraction.denominator, -1, PRIME) % PRIME


def circle_point(angle: float) -> tuple[int, int]:
    """Return cosine and sine: exact for multiples of 15 degrees, else the rational point with that half tangent."""
    steps = round(angle / _STEP)
    if abs(angle - steps * _STEP) > _ROUNDING_RAD:
        c, s = rational_circle(np.array([residue(math.tan(angle / 2))], dtype=np.uint64))
        return int(c[0]), int(s[0])
    return _fifteen(steps), _fifteen(6 - steps)


def _fifteen(steps: int) -> int:
    """Return the cosine of a multiple of 15 degrees."""
    quarter = pow(4, -1, PRIME)
    first = [4, ROOTS[6] + ROOTS[2], 2 * ROOTS[3], 2 * ROOTS[2], 2, ROOTS[6] - ROOTS[2], 0]
    steps = min(steps % 24, -steps % 24)
    return (first[steps] if steps <= 6 else -first[12 - steps]) * quarter % PRIME


def rational_circle(t: Residues) -> tuple[Residues, Residues]:
    """Return cosine and sine for half tangents, elementwise; 1 + t^2 is never zero since -1 has no square root."""
    square = t * t % _P
    scale = inverse(square + np.uint64(1))
    return (np.uint64(1) + _P - square) % _P * scale % _P, np.uint64(2) * t % _P * scale % _P


def inverse(values: Residues) -> Residues:
    """Return 1 / values, elementwise."""
    return np.array(
        [pow(value, -1, PRIME) for value in values.ravel().tolist()], dtype=np.uint64
    ).reshape(values.shape)


def product(A: Residues, B: Residues) -> Residues:
    """Return the matrix product; B is split in two halves so that sums of products stay exact."""
    low, high = B & np.uint64(0x7FFF), B >> np.uint64(15)
    # Why: 31 + 16 bits leave 17 bits for the number of terms.
    return ((A @ high % _P) * np.uint64(0x8000) + A @ low) % _P


def run_program(program: Program, inputs: dict[str, Residues]) -> Residues:
    """Run a straight-line program in the field.

    Args:
        program: the program.
        inputs: values by name, each broadcastable to one common shape (...).

    Returns:
        The matrix, (..., rows, columns).
    """
    shape = np.broadcast_shapes(*(np.shape(inputs[name]) for name in program.inputs))
    slots = [np.broadcast_to(inputs[name], shape) for name in program.inputs]
    slots += [np.full(shape, constant % PRIME, dtype=np.uint64) for constant in program.constants]
    zero = np.zeros(shape, dtype=np.uint64)
    # Why: unsigned differences wrap round, and the smaller of both candidates is the reduced one.
    for op, lhs, rhs in zip(
        program.op.tolist(), program.lhs.tolist(), program.rhs.tolist(), strict=True
    ):
        if op == MUL:
            slots.append(slots[lhs] * slots[rhs] % _P)
        elif op == ADD:
            total = slots[lhs] + slots[rhs]
            slots.append(np.minimum(total, total - _P))
        else:
            total = slots[lhs] - slots[rhs] if op == SUB else zero - slots[lhs]
            slots.append(np.minimum(total, total + _P))
    matrix = np.zeros((*shape, *program.shape), dtype=np.uint64)
    for row, col, out in zip(
        program.rows.tolist(), program.cols.tolist(), program.outputs.tolist(), strict=True
    ):
        matrix[..., row, col] = slots[out]
    return matrix


def echelon(A: Residues) -> tuple[list[int], Residues]:
    """Return the reduced row echelon forms of several matrices that have the same structure.

    Args:
        A: matrices, (G, r, c).

    Returns:
        The pivot columns, which are the leftmost independent ones; and K with A = A[:, :, pivots] K, (G, rank, c).

    Raises:
        ZeroDivisionError: when a pivot column is dependent in some of the matrices only.
    """
    A = A.copy()
    draws = np.arange(len(A))
    pivots: list[int] = []
    for column in range(A.shape[2]):
        rank = len(pivots)
        alive = A[:, rank:, column] != 0
        if not alive.any():
            continue
        chosen = rank + alive.argmax(axis=1)
        if not alive.any(axis=1).all():
            raise ZeroDivisionError("a column is dependent for some values of the geometry only")
        heads = A[draws, chosen, column:]
        A[draws, chosen, column:] = A[:, rank, column:]
        heads = heads * inverse(heads[:, :1]) % _P
        A[:, rank, column:] = 0
        touched = np.flatnonzero(A[:, :, column].any(axis=0))
        update = A[:, touched, column:] + (_P - A[:, touched, column, None]) * heads[:, None, :]
        # Why: NumPy divides by a scalar much faster than it takes a remainder.
        A[:, touched, column:] = update - update // _P * _P
        A[:, rank, column:] = heads
        pivots.append(column)
    return pivots, A[:, : len(pivots)]
