"""Formulas for the coefficients of the relations, found in the prime field and verified there at other geometries.

First a coefficient is compared with monomials of at most two lengths. What is left (chains of oblique twists) is found
link by link: a parameter is expressed by those of its own and the neighbouring link, where coefficients are short, and the
already named relations of the neighbours are put in.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations_with_replacement, product

import numpy as np

from dynid.model.exact import Draws, relations
from dynid.model.field import PRIME, ROOTS, Residues, echelon, residue
from dynid.model.formula import ONE, Formula

Formulas = dict[tuple[int, int], Formula]

#: Numbers that a coefficient may carry beside its symbols.
_FACTORS = sorted(
    {Fraction(s * a, b) for s in (1, -1) for a in (1, 2, 3, 4, 8) for b in (1, 2, 3, 4)}, key=lambda f: (f.denominator, abs(f), f < 0)
)
#: Random states of a neighbourhood of two or three links: its 33 columns need no more rows.
_SAMPLES = 12
#: Largest number of monomials that a coefficient is fitted with.
_TABLE = 160


@dataclass(frozen=True)
class Names:
    """Formulas found.

    Attributes:
        formulas: by row and column of K.
        generic: whether the base columns are those of any arm of this shape.
    """

    formulas: Formulas
    generic: bool


def name_coefficients(draws: Draws, base: Sequence[int], K: Residues) -> Names:
    """Name the coefficients of K.

    Args:
        draws: source of random geometries.
        base: base columns at the arm's own geometry.
        K: relations at the arm's own geometry, (p, c).

    Returns:
        The formulas found. Twists are symbols where that leaves the base columns the same; else they are numbers.
    """
    for turned in (True, False):
        geometry = draws.free(2, turned)
        try:
            found, values = relations(draws, geometry)
        except ZeroDivisionError:
            continue
        if found == list(base):
            return Names(_Namer(draws, geometry, turned, found, values).run(K), True)
    own = draws.actual()
    return Names(_Namer(draws, own, False, list(base), K[None]).run(K), False)


class _Namer:
    """Names the coefficients of relations that are known at two random geometries."""

    def __init__(self, draws: Draws, geometry: dict[str, Residues], turned: bool, base: list[int], K: Residues) -> None:
        self._draws, self._turned, self._base, self._K = draws, turned, base, K
        self._at = [{name: int(v[g % len(v)]) for name, v in geometry.items()} for g in range(len(K))]
        lengths = [name for name in draws.symbols if name[0] in "ad"] if len(K) > 1 else []
        angles = [name for name in draws.symbols if name[0] in "cs"]
        self._symbols = lengths + (angles if turned else [])
        self._roots = {} if turned or not angles else ROOTS
        self._monomials = [Formula.monomial(1, dict(m)) for m in _lengths(lengths)]
        self._factors = {
            residue(f) * root % PRIME: Formula.monomial(f, {f"sqrt({k})": 1} if k > 1 else {})
            for k, root in ((1, 1), *self._roots.items())
            for f in _FACTORS
        }
        self._links = draws.model.link_columns // 11 + 1
        self._formulas: Formulas = {}

    def run(self, own: Residues) -> Formulas:
        """Return the formulas of the coefficients that are not zero at the arm's own geometry."""
        dependent = [j for j in range(self._K.shape[2]) if j not in self._base and self._K[0, :, j].any()]
        inverses = np.array([pow(m.residue(self._at[0]), -1, PRIME) for m in self._monomials], dtype=np.uint64)
        for j in dependent:
            if not all(self._single(int(i), j, inverses) for i in np.flatnonzero(self._K[0, :, j])):
                self._by_links(j)
        return {cell: formula for cell, formula in self._formulas.items() if own[cell]}

    def _verified(self, i: int, j: int, formula: Formula) -> bool:
        return all(formula.residue(at) == int(k[i, j]) for at, k in zip(self._at, self._K, strict=True))

    def _single(self, i: int, j: int, inverses: Residues) -> bool:
        """Name a coefficient that is one monomial of lengths."""
        quotients = self._K[0, i, j] * inverses % np.uint64(PRIME)
        for monomial, quotient in zip(self._monomials, quotients.tolist(), strict=True):
            if quotient in self._factors:
                formula = self._factors[quotient] * monomial
                if self._verified(i, j, formula):
                    self._formulas[i, j] = formula
                    return True
        return False

    def _by_links(self, j: int) -> None:
        """Name a column's coefficients from the relations within its link and the ones before it."""
        if j >= len(self._links) or not self._symbols:
            return
        last = int(self._links[j])
        for first in range(last - 1, max(last - 4, 0), -1):
            local = self._local(j, first)
            if local is not None and self._substitute(j, local):
                return

    def _substitute(self, j: int, local: dict[int, Formula]) -> bool:
        """Express a column by base columns, given its expression by columns before it."""
        total: dict[int, Formula] = {}
        for column, factor in local.items():
            if column in self._base:
                share = {self._base.index(column): ONE}
            else:
                rows = [int(i) for i in np.flatnonzero(self._K[0, :, column])]
                if any((i, column) not in self._formulas for i in rows):
                    return False
                share = {i: self._formulas[i, column] for i in rows}
            for i, formula in share.items():
                total[i] = total.get(i, Formula(())) + factor * formula
        right = {i: formula for i, formula in total.items() if self._verified(i, j, formula)}
        self._formulas |= {(i, j): formula for i, formula in right.items() if formula.terms}
        return len(right) == len(total)

    def _local(self, j: int, first: int) -> dict[int, Formula] | None:
        """Return the expression of a column by those of links ``first`` to its own, None when there is none."""
        last = int(self._links[j])
        columns = np.flatnonzero((self._links >= first) & (self._links <= last) & (np.arange(len(self._links)) <= j))
        for symbols in self._neighbours(first, last):
            table = _table(symbols, self._roots)
            if len(table) > _TABLE:
                continue
            geometry = self._draws.free(len(table) + 4, self._turned)
            try:
                pivots, K = echelon(self._draws.columns(geometry, columns, _SAMPLES))
            except ZeroDivisionError:
                return None
            if len(columns) - 1 in pivots:
                return None
            used = np.flatnonzero(K[0, :, -1])
            fitted = _fit(table, geometry, K[:, used, -1])
            if fitted is not None:
                return {int(columns[pivots[i]]): formula for i, formula in zip(used, fitted, strict=True)}
        return None

    def _neighbours(self, first: int, last: int) -> Iterator[list[str]]:
        """Yield growing lists of the symbols that a relation between these links may hold."""
        for start in range(last, first - 1, -1):
            yield [s for s in self._symbols if start <= int(s.lstrip("acds")) <= last]


def _lengths(lengths: Sequence[str]) -> list[tuple[tuple[str, int], ...]]:
    """Return monomials of at most two lengths, and the inverse of one."""
    found: list[tuple[tuple[str, int], ...]] = []
    for degree in (0, 1, 2):
        for chosen in combinations_with_replacement(lengths, degree):
            found.append(tuple((s, chosen.count(s)) for s in sorted(set(chosen))))
    return found + [((s, -1),) for s in lengths]


def _table(symbols: Sequence[str], roots: dict[int, int]) -> list[Formula]:
    """Return the monomials that a coefficient is fitted with, simple ones first: lengths times angles times roots."""
    lengths = [dict(m) for m in _lengths([s for s in symbols if s[0] in "ad"])]
    angles = [s for s in symbols if s[0] in "cs"]
    powers = [p for p in product(range(-2, 3), repeat=len(angles)) if sum(abs(k) for k in p) <= 4]
    turns = [dict(zip(angles, p, strict=True)) for p in sorted(powers, key=lambda p: (sum(map(abs, p)), min(p, default=0) < 0))]
    surds: list[dict[str, int]] = [{}, *({f"sqrt({k})": 1} for k in roots)]
    return [Formula.monomial(1, {**a, **b, **c}) for a, b, c in product(lengths, turns, surds)]


def _fit(table: list[Formula], geometry: dict[str, Residues], values: Residues) -> list[Formula] | None:
    """Return the sums of table entries that give the values (G, k) at G geometries, None when there are none."""
    count = len(values)
    at = [{name: int(v[g % len(v)]) for name, v in geometry.items()} for g in range(count)]
    rows = np.array([[m.residue(point) for m in table] for point in at], dtype=np.uint64)
    pivots, K = echelon(np.concatenate([rows, values], axis=1)[None])
    if pivots and pivots[-1] >= len(table):
        return None
    fitted = []
    for column in range(len(table), len(table) + values.shape[1]):
        total = Formula(())
        for row in np.flatnonzero(K[0, :, column]):
            factor = small_fraction(int(K[0, row, column]))
            if factor is None:
                return None
            total += Formula.monomial(factor, {}) * table[pivots[row]]
        fitted.append(total)
    return fitted


def small_fraction(value: int, limit: int = 1000) -> Fraction | None:
    """Return the fraction with numerator and denominator up to ``limit`` that a residue stands for, None when there is none."""
    r0, r1, t0, t1 = PRIME, value, 0, 1
    while r1 > limit:
        r0, r1, t0, t1 = r1, r0 % r1, t1, t0 - r0 // r1 * t1
    if t1 == 0 or abs(t1) > limit:
        return None
    return Fraction(r1, t1)
