"""Formulas for the coefficients of the relations, found in the prime field and verified there at other geometries.

First a coefficient is compared with monomials of at most two lengths. What is left (chains of oblique twists) is found
link by link: a parameter is expressed by those of its own and the neighbouring link, where coefficients are short, and
the already named relations of the neighbours are put in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from dynid.model.exact import Draws, relations
from dynid.model.formula import ONE, Formula
from dynid.model.monomials import Fitter, lengths_up_to_two, monomials, needed_geometries
from dynid.model.prime_field import PRIME, ROOTS, Residues, echelon, residue
from dynid.model.regrouping import transfer
from dynid.robot import Joint

Formulas = dict[tuple[int, int], Formula]

#: Numbers that a coefficient may carry beside its symbols.
_FACTORS = sorted(
    {Fraction(s * a, b) for s in (1, -1) for a in (1, 2, 3, 4, 8) for b in (1, 2, 3, 4)},
    key=lambda f: (f.denominator, abs(f), f < 0),
)
#: Random states of a neighbourhood of two or three links: its 33 columns need no more rows.
_SAMPLES = 12
#: Number of neighbouring links that a relation is looked for in.
_REACH = 2


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
        self._monomials = [Formula.monomial(1, dict(m)) for m in lengths_up_to_two(lengths)]
        self._factors = {
            residue(f) * root % PRIME: Formula.monomial(f, {f"sqrt({k})": 1} if k > 1 else {})
            for k, root in ((1, 1), *self._roots.items())
            for f in _FACTORS
        }
        self._known = np.array(list(self._factors), dtype=np.uint64)
        self._links = draws.model.link_columns // 11 + 1
        joints = draws.model.robot.joints
        self._dimension = [_dimension(joints[k // 11], k) for k in draws.model.link_columns.tolist()]
        self._transfers: dict[int, dict[int, dict[int, Formula]]] = {}
        self._windows: dict[tuple[int, int, int], _Window | None] = {}
        self._formulas: Formulas = {}

    def run(self, own: Residues) -> Formulas:
        """Return the formulas of the coefficients that are not zero at the arm's own geometry."""
        dependent = [j for j in range(self._K.shape[2]) if j not in self._base and self._K[0, :, j].any()]
        inverses = np.array([pow(m.residue(self._at[0]), -1, PRIME) for m in self._monomials], dtype=np.uint64)
        for j in dependent:
            named = [self._single(int(i), j, inverses) for i in np.flatnonzero(self._K[0, :, j])]
            if not all(named):
                self._by_links(j)
        return {cell: formula for cell, formula in self._formulas.items() if own[cell]}

    def _verified(self, i: int, j: int, formula: Formula) -> bool:
        return all(formula.residue(at) == int(k[i, j]) for at, k in zip(self._at, self._K, strict=True))

    def _single(self, i: int, j: int, inverses: Residues) -> bool:
        """Name a coefficient that is one monomial of lengths."""
        quotients = self._K[0, i, j] * inverses % np.uint64(PRIME)
        for k in np.flatnonzero(np.isin(quotients, self._known)).tolist():
            formula = self._factors[int(quotients[k])] * self._monomials[k]
            if self._verified(i, j, formula):
                self._formulas[i, j] = formula
                return True
        return False

    def _by_links(self, j: int) -> None:
        """Name a column's coefficients from the relations within its link, or with the ones before it."""
        if j >= len(self._links) or not self._symbols:
            return
        last = int(self._links[j])
        passed = self._passed(last).get(j)
        if passed is not None:
            self._substitute(j, passed)
            return
        for first in range(last, max(last - _REACH, 0), -1):
            local = self._local(j, first, last)
            if local is not None and self._substitute(j, local):
                return

    def _substitute(self, j: int, local: dict[int, Formula]) -> bool:
        """Express a column by base columns, given its expression by columns before it; tell whether all have a name."""
        total: dict[int, Formula] = {}
        open_rows: set[int] = set()
        for column, factor in local.items():
            own = column in self._base
            for i in [self._base.index(column)] if own else np.flatnonzero(self._K[0, :, column]).tolist():
                formula = ONE if own else self._formulas.get((i, column))
                if formula is None:
                    open_rows.add(i)
                else:
                    total[i] = total.get(i, Formula(())) + factor * formula
        for i, formula in total.items():
            if i not in open_rows and formula.terms and self._verified(i, j, formula):
                self._formulas.setdefault((i, j), formula)
        return all((i, j) in self._formulas for i in np.flatnonzero(self._K[0, :, j]).tolist())

    def _passed(self, link: int) -> dict[int, dict[int, Formula]]:
        """Return the parameters that pass through a link's joint, expressed by others of it and the link before."""
        if link not in self._transfers:
            self._transfers[link] = self._find_passed(link) if link > 1 else {}
        return self._transfers[link]

    def _find_passed(self, link: int) -> dict[int, dict[int, Formula]]:
        joint, convention = self._draws.model.robot.joints[link - 1], self._draws.model.robot.convention
        both = [11 * (link - 2) + k for k in (*range(10), *range(11, 21))]
        place = {int(k): i for i, k in enumerate(self._draws.model.link_columns)}
        passed: dict[int, dict[int, Formula]] = {}
        for stage in (0, 1):
            tables = self._tables(link, link, stage)
            geometry = self._draws.free(needed_geometries(tables), self._turned)
            try:
                dependent, K = transfer(joint, link, convention, geometry)
            except ZeroDivisionError:
                return passed
            fitter = Fitter(tables, geometry, len(K))
            for row, own in enumerate(dependent):
                used = np.flatnonzero(K[0, row]).tolist()
                degree = {k: _dimension(joint, both[k]) - _dimension(joint, both[own + 10]) for k in used}
                found = {both[k]: fitter.fitted(degree[k], K[:, row, k], self._factors) for k in used}
                named = {place[k]: formula for k, formula in found.items() if formula is not None and k in place}
                if len(named) == len(used) and both[own + 10] in place:
                    passed.setdefault(place[both[own + 10]], named)
            if len(passed) == len(dependent):
                break
        return passed

    def _tables(self, first: int, last: int, stage: int) -> dict[int, list[Formula]]:
        symbols = [s for s in self._symbols if first <= int(s.lstrip("acds")) <= last]
        return {degree: monomials(symbols, degree, stage, self._roots) for degree in range(-2, 3)}

    def _local(self, j: int, first: int, last: int) -> dict[int, Formula] | None:
        """Return the expression of a column by others of links ``first`` to ``last``, None when there is none."""
        found: dict[int, Formula] = {}
        for stage in range(3):
            window = self._window(first, last, stage)
            if window is None or j in window.pivots:
                return None
            place = int(np.flatnonzero(window.columns == j)[0])
            for row in np.flatnonzero(window.K[0, :, place]).tolist():
                column = window.pivots[row]
                if column not in found:
                    degree = self._dimension[column] - self._dimension[j]
                    formula = window.fitter.fitted(degree, window.K[:, row, place], self._factors)
                    if formula is not None:
                        found[column] = formula
            if len(found) == np.count_nonzero(window.K[0, :, place]):
                return found
        return None

    def _window(self, first: int, last: int, stage: int) -> _Window | None:
        """Return the relations among some neighbouring links at many geometries, kept for the other columns there."""
        key = first, last, stage
        if key not in self._windows:
            tables = self._tables(last if stage < 2 else first, last, stage)
            geometry = self._draws.free(needed_geometries(tables), self._turned)
            columns = np.flatnonzero((self._links >= first) & (self._links <= last))
            try:
                pivots, K = echelon(self._draws.columns(geometry, columns, samples=_SAMPLES))
            except ZeroDivisionError:
                self._windows[key] = None
            else:
                fitter = Fitter(tables, geometry, len(K))
                self._windows[key] = _Window(columns, [int(columns[k]) for k in pivots], K, fitter)
        return self._windows[key]


@dataclass(frozen=True)
class _Window:
    """Relations among the columns of some neighbouring links.

    Attributes:
        columns: the columns, (w,).
        pivots: the leftmost independent ones.
        K: relations at G geometries, (G, p, w).
        fitter: names coefficients that are known at these geometries.
    """

    columns: NDArray[np.intp]
    pivots: list[int]
    K: Residues
    fitter: Fitter


def _dimension(joint: Joint, column: int) -> int:
    """Return the power of metres in the unit of a rigid-body parameter of a joint's link."""
    kind = column % 11
    if kind == 10:
        return 2 if joint.revolute else 0
    return 0 if kind == 0 else 1 if kind < 4 else 2
