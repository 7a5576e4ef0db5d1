"""Formulas for the coefficients of the relations, found in the prime field and verified there at other geometries.

First a coefficient is compared with monomials of at most two lengths. What is left (chains of oblique twists) is found
link by link: a parameter is expressed by those of its own and the neighbouring link, where coefficients are short, and
the already named relations of the neighbours are put in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations_with_replacement
from itertools import product as pairings
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.model import tuning
from dynid.model.polynomial import ONE, Polynomial
from dynid.model.prime_field import PRIME, ROOTS, Residues, echelon, inverse, product, residue
from dynid.model.regrouping import regrouping
from dynid.robot import Joint

if TYPE_CHECKING:
    from dynid.model.exact import FieldRegressor

Formulas = dict[tuple[int, int], Polynomial]

#: Numbers that a coefficient may carry with its symbols.
_FACTORS = sorted(
    {Fraction(s * a, b) for s in (1, -1) for a in (1, 2, 3, 4, 8) for b in (1, 2, 3, 4)},
    key=lambda f: (f.denominator, abs(f), f < 0),
)


@dataclass(frozen=True)
class NamedCoefficients:
    """Formulas found.

    Attributes:
        formulas: by row and column of K.
        generic: whether the base columns are those of any arm of this shape.
    """

    formulas: Formulas
    generic: bool


def name_coefficients(
    regressor: FieldRegressor, base: Sequence[int], K: Residues
) -> NamedCoefficients:
    """Name the coefficients of K.

    Args:
        regressor: source of random geometries.
        base: base columns at the arm's own geometry.
        K: relations at the arm's own geometry, (p, c).

    Returns:
        The formulas found. Twists are symbols where that leaves the base columns the same; else they are numbers.
    """
    for turned in (True, False):
        geometry = regressor.free(2, turned)
        try:
            found, values = regressor.relations(geometry)
        except ZeroDivisionError:
            continue
        if found == list(base):
            return NamedCoefficients(
                _Naming(regressor, geometry, turned, found, values).run(K), True
            )
    own = regressor.actual()
    return NamedCoefficients(_Naming(regressor, own, False, list(base), K[None]).run(K), False)


class _Naming:
    """Names the coefficients of relations that are known at two random geometries."""

    def __init__(
        self,
        regressor: FieldRegressor,
        geometry: dict[str, Residues],
        turned: bool,
        base: list[int],
        K: Residues,
    ) -> None:
        self._regressor, self._turned, self._base, self._K = regressor, turned, base, K
        self._at = [
            {name: int(v[g % len(v)]) for name, v in geometry.items()} for g in range(len(K))
        ]
        lengths = [name for name in regressor.symbols if name[0] in "ad"] if len(K) > 1 else []
        angles = [name for name in regressor.symbols if name[0] in "cs"]
        self._symbols = lengths + (angles if turned else [])
        self._roots = {} if turned or not angles else ROOTS
        self._monomials = [Polynomial.monomial(1, dict(m)) for m in lengths_up_to_two(lengths)]
        self._factors = {
            residue(f) * root % PRIME: Polynomial.monomial(f, {f"sqrt({k})": 1} if k > 1 else {})
            for k, root in ((1, 1), *self._roots.items())
            for f in _FACTORS
        }
        self._known = np.array(list(self._factors), dtype=np.uint64)
        self._links = regressor.model.link_columns // 11 + 1
        joints = regressor.model.robot.joints
        self._dimension = [
            _dimension(joints[k // 11], k) for k in regressor.model.link_columns.tolist()
        ]
        self._regroupings: dict[int, dict[int, dict[int, Polynomial]]] = {}
        self._windows: dict[tuple[int, int, int], _Window | None] = {}
        self._formulas: Formulas = {}

    def run(self, own: Residues) -> Formulas:
        """Return the formulas of the coefficients that are not zero at the arm's own geometry."""
        dependent = [
            j for j in range(self._K.shape[2]) if j not in self._base and self._K[0, :, j].any()
        ]
        inverses = np.array(
            [pow(m.residue(self._at[0]), -1, PRIME) for m in self._monomials], dtype=np.uint64
        )
        for j in dependent:
            named = [self._single(int(i), j, inverses) for i in np.flatnonzero(self._K[0, :, j])]
            if not all(named):
                self._by_links(j)
        return {cell: formula for cell, formula in self._formulas.items() if own[cell]}

    def _verified(self, i: int, j: int, formula: Polynomial) -> bool:
        return all(
            formula.residue(at) == int(k[i, j]) for at, k in zip(self._at, self._K, strict=True)
        )

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
        for first in range(last, max(last - tuning.NEIGHBOURING_LINKS, 0), -1):
            local = self._local(j, first, last)
            if local is not None and self._substitute(j, local):
                return

    def _substitute(self, j: int, local: dict[int, Polynomial]) -> bool:
        """Express a column by base columns, given its expression by columns before it; tell whether all have a name."""
        total: dict[int, Polynomial] = {}
        open_rows: set[int] = set()
        for column, factor in local.items():
            own = column in self._base
            for i in (
                [self._base.index(column)]
                if own
                else np.flatnonzero(self._K[0, :, column]).tolist()
            ):
                formula = ONE if own else self._formulas.get((i, column))
                if formula is None:
                    open_rows.add(i)
                else:
                    total[i] = total.get(i, Polynomial(())) + factor * formula
        for i, formula in total.items():
            if i not in open_rows and formula.terms and self._verified(i, j, formula):
                self._formulas.setdefault((i, j), formula)
        return all((i, j) in self._formulas for i in np.flatnonzero(self._K[0, :, j]).tolist())

    def _passed(self, link: int) -> dict[int, dict[int, Polynomial]]:
        """Return the parameters that pass through a link's joint, expressed by others of it and the link before."""
        if link not in self._regroupings:
            self._regroupings[link] = self._find_passed(link) if link > 1 else {}
        return self._regroupings[link]

    def _find_passed(self, link: int) -> dict[int, dict[int, Polynomial]]:
        joint, convention = (
            self._regressor.model.robot.joints[link - 1],
            self._regressor.model.robot.convention,
        )
        both = [11 * (link - 2) + k for k in (*range(10), *range(11, 21))]
        place = {int(k): i for i, k in enumerate(self._regressor.model.link_columns)}
        passed: dict[int, dict[int, Polynomial]] = {}
        for stage in (0, 1):
            tables = self._tables(link, link, stage)
            geometry = self._regressor.free(needed_geometries(tables), self._turned)
            try:
                dependent, K = regrouping(joint, link, convention, geometry)
            except ZeroDivisionError:
                return passed
            fitter = FormulaFitter(tables, geometry, len(K))
            for row, own in enumerate(dependent):
                used = np.flatnonzero(K[0, row]).tolist()
                degree = {
                    k: _dimension(joint, both[k]) - _dimension(joint, both[own + 10]) for k in used
                }
                found = {
                    both[k]: fitter.fitted(degree[k], K[:, row, k], self._factors) for k in used
                }
                named = {
                    place[k]: formula
                    for k, formula in found.items()
                    if formula is not None and k in place
                }
                if len(named) == len(used) and both[own + 10] in place:
                    passed.setdefault(place[both[own + 10]], named)
            if len(passed) == len(dependent):
                break
        return passed

    def _tables(self, first: int, last: int, stage: int) -> dict[int, list[Polynomial]]:
        symbols = [s for s in self._symbols if first <= int(s.lstrip("acds")) <= last]
        return {degree: monomials(symbols, degree, stage, self._roots) for degree in range(-2, 3)}

    def _local(self, j: int, first: int, last: int) -> dict[int, Polynomial] | None:
        """Return the expression of a column by others of links ``first`` to ``last``, None when there is none."""
        found: dict[int, Polynomial] = {}
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
            geometry = self._regressor.free(needed_geometries(tables), self._turned)
            columns = np.flatnonzero((self._links >= first) & (self._links <= last))
            try:
                pivots, K = echelon(
                    self._regressor.columns(geometry, columns, samples=tuning.NEIGHBOURHOOD_STATES)
                )
            except ZeroDivisionError:
                self._windows[key] = None
            else:
                fitter = FormulaFitter(tables, geometry, len(K))
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
    fitter: FormulaFitter


def _dimension(joint: Joint, column: int) -> int:
    """Return the power of metres in the unit of a rigid-body parameter of a joint's link."""
    kind = column % 11
    if kind == 10:
        return 2 if joint.revolute else 0
    return 0 if kind == 0 else 1 if kind < 4 else 2


# ---------------------------------------------------------------- fitting sums of monomials to known coefficients
class FormulaFitter:
    """Names coefficients that are known at many geometries.

    Args:
        tables: monomials that a coefficient of each degree in lengths may hold.
        geometry: the geometries, (G,) each.
        count: G.
    """

    def __init__(
        self, tables: dict[int, list[Polynomial]], geometry: dict[str, Residues], count: int
    ) -> None:
        self._tables, self._geometry, self._count = tables, geometry, count
        self._solvers: dict[int, _Solver] = {}

    def fitted(
        self, degree: int, wanted: Residues, factors: dict[int, Polynomial]
    ) -> Polynomial | None:
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


def needed_geometries(tables: dict[int, list[Polynomial]]) -> int:
    """Return at how many geometries a coefficient must be known to be fitted with these tables."""
    return max(map(len, tables.values())) + tuning.FIT_CHECKS


def lengths_up_to_two(lengths: Sequence[str]) -> list[tuple[tuple[str, int], ...]]:
    """Return monomials of at most two lengths, and the inverses of one."""
    found: list[tuple[tuple[str, int], ...]] = []
    for degree in (0, 1, 2):
        for chosen in combinations_with_replacement(lengths, degree):
            found.append(tuple((s, chosen.count(s)) for s in sorted(set(chosen))))
    return found + [((s, -k),) for k in (1, 2) for s in lengths]


def monomials(
    symbols: Sequence[str], degree: int, stage: int, roots: dict[int, int]
) -> list[Polynomial]:
    """Return the monomials of one degree in lengths that a coefficient may hold, simple ones first.

    Stage 0 has no negative powers of lengths and few of angles, stage 1 and 2 have more; stage 2 is for more joints.
    """
    lengths = [s for s in symbols if s[0] in "ad"]
    angles = [s for s in symbols if s[0] in "cs"]
    most = (2, 4, 2)[stage] if len(angles) < 3 else (2, 3, 2)[stage]
    reach = range(0 if stage == 0 else -2, 3)
    stretched = [
        p
        for p in pairings(reach, repeat=len(lengths))
        if sum(p) == degree and sum(map(abs, p)) <= 4
    ]
    turned = [
        p
        for p in pairings(range(-2, 3), repeat=len(angles))
        if sum(map(abs, p)) <= (4 if min(p, default=0) >= 0 else most)
    ]
    surds: list[dict[str, int]] = [{}, *({f"sqrt({k})": 1} for k in roots)]
    powers = [
        {**dict(zip(lengths, a, strict=True)), **dict(zip(angles, b, strict=True)), **c}
        for a, b, c in pairings(
            sorted(stretched, key=_complexity), sorted(turned, key=_complexity), surds
        )
    ]
    return [Polynomial.monomial(1, p) for p in powers][: tuning.MOST_MONOMIALS]


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


def _solver(table: list[Polynomial], geometry: dict[str, Residues], count: int) -> _Solver:
    rows = _evaluated(table, geometry, count)
    independent, _ = echelon(rows[None])
    size = len(independent)
    square = np.concatenate([rows[:size, independent], np.eye(size, dtype=np.uint64)], axis=1)
    return _Solver(rows, inverse(rows[:2]), independent, echelon(square[None])[1][0, :, size:])


def _fit(table: list[Polynomial], solver: _Solver, wanted: Residues) -> Polynomial | None:
    """Return the sum of table entries that gives the wanted value at every geometry, None when there is none."""
    size = len(solver.independent)
    shares = product(solver.solve, wanted[:size, None])
    if np.any(product(solver.rows[:, solver.independent], shares)[:, 0] != wanted):
        return None
    total = Polynomial(())
    for k in np.flatnonzero(shares).tolist():
        factor = small_fraction(int(shares[k, 0]))
        if factor is None:
            return None
        total += Polynomial.monomial(factor, dict(table[solver.independent[k]].terms[0][1]))
    return total


def _evaluated(table: list[Polynomial], geometry: dict[str, Residues], count: int) -> Residues:
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
