"""Monomials in the DH symbols, and sums of them that give a coefficient known at many geometries of the prime field."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations_with_replacement
from itertools import product as pairings

import numpy as np

from dynid.model.formula import Formula
from dynid.model.prime_field import PRIME, ROOTS, Residues, echelon, inverse, product

#: Largest number of monomials that a coefficient is fitted with, and the geometries beyond it that check the fit.
_TABLE, _CHECKS = 130, 4


class Fitter:
    """Names coefficients that are known at many geometries.

    Args:
        tables: monomials that a coefficient of each degree in lengths may hold.
        geometry: the geometries, (G,) each.
        count: G.
    """

    def __init__(self, tables: dict[int, list[Formula]], geometry: dict[str, Residues], count: int) -> None:
        self._tables, self._geometry, self._count = tables, geometry, count
        self._solvers: dict[int, _Solver] = {}

    def fitted(self, degree: int, wanted: Residues, factors: dict[int, Formula]) -> Formula | None:
        """Return the formula of a coefficient known at all geometries, None when the table does not hold it."""
        table = self._tables.get(degree, [])
        if not table:
            return None
        if degree not in self._solvers:
            self._solvers[degree] = _solver(table, self._geometry, self._count)
        solver = self._solvers[degree]
        ratios = wanted[:2, None] * solver.inverses % np.uint64(PRIME)
        for k in np.flatnonzero(ratios[0] == ratios[1]).tolist():
            if int(ratios[0, k]) in factors:
                return factors[int(ratios[0, k])] * table[k]
        return _fit(table, solver, wanted)


def needed_geometries(tables: dict[int, list[Formula]]) -> int:
    """Return at how many geometries a coefficient must be known to be fitted with these tables."""
    return max(map(len, tables.values())) + _CHECKS


def lengths_up_to_two(lengths: Sequence[str]) -> list[tuple[tuple[str, int], ...]]:
    """Return monomials of at most two lengths, and the inverses of one."""
    found: list[tuple[tuple[str, int], ...]] = []
    for degree in (0, 1, 2):
        for chosen in combinations_with_replacement(lengths, degree):
            found.append(tuple((s, chosen.count(s)) for s in sorted(set(chosen))))
    return found + [((s, -k),) for k in (1, 2) for s in lengths]


def monomials(symbols: Sequence[str], degree: int, stage: int, roots: dict[int, int]) -> list[Formula]:
    """Return the monomials of one degree in lengths that a coefficient may hold, simple ones first.

    Stage 0 has no negative powers of lengths and few of angles, stage 1 and 2 have more; stage 2 is for more joints.
    """
    lengths = [s for s in symbols if s[0] in "ad"]
    angles = [s for s in symbols if s[0] in "cs"]
    most = (2, 4, 2)[stage] if len(angles) < 3 else (2, 3, 2)[stage]
    reach = range(0 if stage == 0 else -2, 3)
    stretched = [p for p in pairings(reach, repeat=len(lengths)) if sum(p) == degree and sum(map(abs, p)) <= 4]
    turned = [
        p
        for p in pairings(range(-2, 3), repeat=len(angles))
        if sum(map(abs, p)) <= (4 if min(p, default=0) >= 0 else most)
    ]
    surds: list[dict[str, int]] = [{}, *({f"sqrt({k})": 1} for k in roots)]
    powers = [
        {**dict(zip(lengths, a, strict=True)), **dict(zip(angles, b, strict=True)), **c}
        for a, b, c in pairings(sorted(stretched, key=_complexity), sorted(turned, key=_complexity), surds)
    ]
    return [Formula.monomial(1, p) for p in powers][:_TABLE]


def _complexity(powers: tuple[int, ...]) -> tuple[int, int]:
    return sum(map(abs, powers)), sum(k < 0 for k in powers)


@dataclass(frozen=True)
class _Solver:
    """The values of a table's monomials at G geometries, ready to solve for sums of them.

    Attributes:
        rows: values, (G, M).
        inverses: reciprocals at the first two geometries, (2, M).
        independent: the leftmost independent monomials, (m,).
        solve: inverse of their values at the first m geometries, (m, m).
    """

    rows: Residues
    inverses: Residues
    independent: list[int]
    solve: Residues


def _solver(table: list[Formula], geometry: dict[str, Residues], count: int) -> _Solver:
    rows = _evaluated(table, geometry, count)
    independent, _ = echelon(rows[None])
    size = len(independent)
    square = np.concatenate([rows[:size, independent], np.eye(size, dtype=np.uint64)], axis=1)
    return _Solver(rows, inverse(rows[:2]), independent, echelon(square[None])[1][0, :, size:])


def _fit(table: list[Formula], solver: _Solver, wanted: Residues) -> Formula | None:
    """Return the sum of table entries that gives the wanted value at every geometry, None when there is none."""
    size = len(solver.independent)
    shares = product(solver.solve, wanted[:size, None])
    if np.any(product(solver.rows[:, solver.independent], shares)[:, 0] != wanted):
        return None
    total = Formula(())
    for k in np.flatnonzero(shares).tolist():
        factor = small_fraction(int(shares[k, 0]))
        if factor is None:
            return None
        total += Formula.monomial(factor, dict(table[solver.independent[k]].terms[0][1]))
    return total


def _evaluated(table: list[Formula], geometry: dict[str, Residues], count: int) -> Residues:
    """Return the value of each monomial at each geometry, (G, M)."""
    known = {name: np.resize(value, count) for name, value in geometry.items()}
    known |= {f"sqrt({k})": np.full(count, root, dtype=np.uint64) for k, root in ROOTS.items()}
    raised: dict[tuple[str, int], Residues] = {}
    rows = np.ones((count, len(table)), dtype=np.uint64)
    for column, monomial in enumerate(table):
        for symbol, exponent in monomial.terms[0][1]:
            if (symbol, exponent) not in raised:
                raised[symbol, exponent] = np.array(
                    [pow(x, exponent, PRIME) for x in known[symbol].tolist()], dtype=np.uint64
                )
            rows[:, column] = rows[:, column] * raised[symbol, exponent] % np.uint64(PRIME)
    return rows


def small_fraction(value: int, limit: int = 1000) -> Fraction | None:
    """Return the fraction of numbers up to ``limit`` that a residue stands for, None when there is none."""
    r0, r1, t0, t1 = PRIME, value, 0, 1
    while r1 > limit:
        r0, r1, t0, t1 = r1, r0 % r1, t1, t0 - r0 // r1 * t1
    if t1 == 0 or abs(t1) > limit:
        return None
    return Fraction(r1, t1)
