"""Base parameters without thresholds: exact rank, classes and relations over a prime field (Paper Eq. 13).

Reads a Model, gives an ExactReduction: the leftmost independent columns in textbook order, and every other column as an
exact combination of them, with a formula in the DH symbols for each coefficient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import ReductionsDisagree
from dynid.model import tuning
from dynid.model.kinematics import geometry as geometry_of
from dynid.model.parameters import Parameter
from dynid.model.polynomial import ONE, Polynomial, joined, latex_symbol
from dynid.model.prime_field import (
    PRIME,
    Residues,
    circle_point,
    decimal_fraction,
    echelon,
    product,
    rational_circle,
    residue,
    run_program,
)
from dynid.model.regressor import Model
from dynid.model.symbolic_relations import name_coefficients

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Term:
    """A share of one parameter in a base parameter.

    Attributes:
        name: the parameter.
        formula: its coefficient in the DH symbols; None where no name was found.
        value: its coefficient as a number.
    """

    name: str
    formula: Polynomial | None
    value: float


#: The shares of all parameters in a base parameter, its own first.
Relation = tuple[Term, ...]


@dataclass(frozen=True)
class ExactReduction:
    """The base parameters of an arm, found without thresholds.

    Attributes:
        names: all columns, (c,).
        base: indices of the representatives, the leftmost independent columns, (p,).
        relations: of each base parameter, the shares of all parameters in it, its own first.
        none: names of the columns that are zero.
        geometry: value of each DH symbol [m, -].
        generic: whether the classes are those of any arm of this shape; False where special values of the DH table
            (an oblique mounting along a joint axis, for example) make more parameters dependent.
    """

    names: tuple[str, ...]
    base: NDArray[np.intp]
    relations: tuple[Relation, ...]
    none: tuple[str, ...]
    geometry: dict[str, float]
    generic: bool

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return len(self.base)

    @cached_property
    def alone(self) -> tuple[str, ...]:
        """Names of the parameters that are identifiable by themselves."""
        return tuple(relation[0].name for relation in self.relations if len(relation) == 1)

    @cached_property
    def combined(self) -> tuple[str, ...]:
        """Names of the parameters that are identifiable only in combination."""
        apart = {*self.alone, *self.none}
        return tuple(name for name in self.names if name not in apart)

    @property
    def unnamed(self) -> int:
        """Number of coefficients that have no formula."""
        return sum(term.formula is None for relation in self.relations for term in relation)

    @cached_property
    def K(self) -> Floats:
        """The matrix of theta = K gamma, (p, c)."""
        index = {name: k for k, name in enumerate(self.names)}
        K = np.zeros((self.rank, len(self.names)))
        for row, relation in enumerate(self.relations):
            for term in relation:
                K[row, index[term.name]] = term.value
        return K


def reduce_exactly(model: Model, *, still: bool = False) -> ExactReduction:
    """Find the base parameters of a model without thresholds.

    Args:
        model: the model; friction and coupled motors take part like any other column, added effects do not.
        still: whether to reduce the torques at rest instead: the gravity parameters that vendors publish.

    Returns:
        Rank, classes and relations with a formula for each coefficient where one was found.

    Raises:
        ReductionsDisagree: when the relations do not hold at further random states.

    Source: Paper Eq. 13 and section II-B; docs/explanation/base-parameters.md.
    """
    regressor = FieldRegressor(model, still=still)
    own = regressor.actual()
    base, K = regressor.relations(own)
    found = name_coefficients(regressor, base, K[0])
    numbers = _numbers(model, base, K[0], found.formulas, regressor)
    names = model.parameter_names[: model.plain_size]
    groups = []
    for row, b in enumerate(base):
        shares = [int(b), *(int(j) for j in np.flatnonzero(K[0, row]) if j != b)]
        groups.append(
            tuple(
                Term(names[j], ONE if j == b else found.formulas.get((row, j)), numbers[row, j])
                for j in shares
            )
        )
    none = tuple(name for j, name in enumerate(names) if not K[0, :, j].any())
    return ExactReduction(
        names, np.array(base, dtype=np.intp), tuple(groups), none, regressor.values, found.generic
    )


def _numbers(
    model: Model,
    base: Sequence[int],
    K: Residues,
    formulas: dict[tuple[int, int], Polynomial],
    regressor: FieldRegressor,
) -> Floats:
    """Return K as numbers: from the formulas, and by least squares on random states where there is none."""
    numbers = np.zeros(K.shape)
    numbers[np.arange(len(base)), base] = 1.0
    for (row, col), formula in formulas.items():
        numbers[row, col] = formula.value(regressor.values)
    open_columns = sorted(
        {int(j) for i, j in np.argwhere(K) if (int(i), int(j)) not in formulas and base[i] != j}
    )
    if open_columns:
        q, qd, qdd = np.random.default_rng(0).uniform(-2, 2, (3, 200, model.robot.n))
        P = model.regressor(q, qd * regressor.moving, qdd * regressor.moving).reshape(
            -1, model.plain_size
        )
        scale = np.linalg.norm(P[:, base], axis=0)
        solved = (
            np.linalg.lstsq(P[:, base] / scale, P[:, open_columns], rcond=None)[0] / scale[:, None]
        )
        for k, j in enumerate(open_columns):
            for row in np.flatnonzero(K[:, j]).tolist():
                if (row, j) not in formulas:
                    numbers[row, j] = solved[row, k]
    return numbers


# ---------------------------------------------------------------- the regressor in the prime field
class FieldRegressor:
    """The regressor's columns in the prime field: random joint states, several values of the geometry.

    Args:
        model: the model.
        still: whether the joint states are at rest: gravity and offsets only.
        seed: of the random states and geometries.
    """

    def __init__(self, model: Model, *, still: bool = False, seed: int = 0) -> None:
        self.model, self.moving = model, not still
        self._rng = np.random.default_rng(seed)
        self._program = model.rigid.restricted(model.link_columns)
        values = geometry_of(model.robot)
        self.symbols = tuple(name for name in model.rigid.inputs if name in values)
        self._angles = {
            f"{kind}a{i}": joint.twist
            for i, joint in enumerate(model.robot.joints, 1)
            for kind in "cs"
        } | {
            f"{kind}{i}": joint.theta_offset
            for i, joint in enumerate(model.robot.joints, 1)
            for kind in "cs"
        }
        self.values = {name: values[name] for name in self.symbols}

    def actual(self) -> dict[str, Residues]:
        """Return the arm's own geometry."""
        return {name: self._own(name) for name in self.symbols}

    def free(self, count: int, turned: bool) -> dict[str, Residues]:
        """Return ``count`` random geometries with the arm's gravity; twists are random too when ``turned``."""
        drawn: dict[str, Residues] = {}
        for name in self.symbols:
            if name.startswith("g") or (name in self._angles and not turned):
                drawn[name] = self._own(name)
            elif name in self._angles:
                partner = name[1:]
                if "c" + partner not in drawn:
                    drawn["c" + partner], drawn["s" + partner] = rational_circle(self.random(count))
            else:
                drawn[name] = self.random(count)
        return drawn

    def columns(
        self, geometry: dict[str, Residues], chosen: NDArray[np.intp] | None = None, *, samples: int
    ) -> Residues:
        """Return columns of the regressor stacked over new random states.

        Args:
            geometry: values of the geometric symbols, (1,) or (G,).
            chosen: rigid-body columns (all columns with the friction ones when None).
            samples: number of joint states.

        Returns:
            Stacked columns, (G, samples * n, c).
        """
        program = self._program if chosen is None else self._program.restricted(chosen)
        n = self.model.robot.n
        q, qd, qdd = (self.random((samples, n)) for _ in range(3))
        qd, qdd = qd * self.moving, qdd * self.moving
        P = run_program(program, self._inputs(geometry, q, qd, qdd))
        count = max((len(value) for value in geometry.values()), default=1)
        P = np.broadcast_to(P, (count, samples, *P.shape[2:]))
        if chosen is None and self.model.friction:
            friction = self._friction(qd, qdd)
            P = np.concatenate([P, np.broadcast_to(friction, (count, *friction.shape))], axis=-1)
        return P.reshape(count, samples * n, -1)

    def relations(self, geometry: dict[str, Residues]) -> tuple[list[int], Residues]:
        """Find the relations among all columns, checked on further states.

        Args:
            geometry: values of the geometric symbols, (G,) each.

        Returns:
            The leftmost independent columns, the same in every geometry, and K, (G, p, c).

        Raises:
            ReductionsDisagree: the relations do not hold at further random states.
            ZeroDivisionError: a column is dependent in some of the geometries only.
        """
        columns = self.columns(geometry, samples=tuning.FIELD_STATES + tuning.FIELD_CHECKS)
        used = tuning.FIELD_STATES * self.model.robot.n
        base, K = echelon(columns[:, :used])
        for A, k in zip(columns[:, used:], K, strict=True):
            if np.any(product(A[:, base], k) != A):
                raise ReductionsDisagree(
                    "relations found at 24 random states do not hold at 4 further ones"
                )
        return base, K

    def _inputs(
        self, geometry: dict[str, Residues], q: Residues, qd: Residues, qdd: Residues
    ) -> dict[str, Residues]:
        """Return the program's inputs: geometry (G, 1) and motion (1, samples)."""
        inputs: dict[str, Residues] = {name: value[:, None] for name, value in geometry.items()}
        for j, joint in enumerate(self.model.robot.joints):
            inputs |= {
                f"q{j + 1}": q[None, :, j],
                f"qd{j + 1}": qd[None, :, j],
                f"qdd{j + 1}": qdd[None, :, j],
            }
            if joint.revolute:
                inputs[f"c{j + 1}"], inputs[f"s{j + 1}"] = rational_circle(self.random((1, len(q))))
        return inputs

    def _friction(self, qd: Residues, qdd: Residues) -> Residues:
        """Return the friction columns; a sign, which is no polynomial of the state, takes part as random numbers."""
        block = np.zeros((*qd.shape, len(self.model.friction)), dtype=np.uint64)
        for k, parameter in enumerate(self.model.friction):
            share = self._share(parameter)
            rows = np.flatnonzero(share)
            if parameter.kind == "fo":
                block[:, rows, k] = 1
            elif parameter.kind in ("fc", "fcc"):
                block[:, rows, k] = self.random((len(qd), len(rows))) if self.moving else 0
            else:
                signal = product(qdd if parameter.kind == "Imc" else qd, share)
                block[:, :, k] = product(signal[:, None], share[None])
        return block

    def _share(self, parameter: Parameter) -> Residues:
        """Return what a motor puts on each joint, (n,): exactly the quotients that ``Parameter.share`` rounds."""
        robot, own = self.model.robot, parameter.number - 1
        row = [Fraction(int(j == own)) for j in range(robot.n)]
        if parameter.share and robot.coupling:
            row = [decimal_fraction(x) for x in robot.coupling.matrix[own]]
        return np.array([residue(x / row[own] if row[own] else x) for x in row], dtype=np.uint64)

    def random(self, shape: int | tuple[int, ...]) -> Residues:
        """Return random elements of the field."""
        return self._rng.integers(1, PRIME, shape, dtype=np.uint64)

    def _own(self, name: str) -> Residues:
        if name in self._angles:
            number = circle_point(self._angles[name])[name[0] == "s"]
        else:
            number = residue(self.values[name])
        return np.array([number], dtype=np.uint64)


# ---------------------------------------------------------------- text, JSON and LaTeX
def base_name(relation: Relation) -> str:
    """Return the name of a base parameter: a combination is called after its representative with an R, ``Ixx2R``."""
    return relation[0].name + ("R" if len(relation) > 1 else "")


def relation_text(relation: Relation) -> str:
    """Return one relation as text, such as ``mcz2R = mcz2 - mcy3 + d3*(m3+m4)``."""
    parts = []
    for terms in _factored(relation):
        names = "+".join(term.name for term in terms)
        body = f"({names})" if len(terms) > 1 else names
        sign, factor = _factor(terms[0])
        parts.append((sign, f"{factor}*{body}" if factor else body))
    return f"{base_name(relation)} = {joined(parts)}"


def coefficient_values(relation: Relation) -> dict[str, float]:
    """Return the number behind each coefficient that is not 1 or -1, by its text."""
    found = {}
    for terms in _factored(relation):
        formula = terms[0].formula
        if formula is not None and formula.degree:
            found[formula.text()] = terms[0].value
    return found


def relations_text(reduction: ExactReduction, *, alone: bool = False) -> str:
    """Return all relations as text, with the numbers of their coefficients and a sentence on how to read it.

    Args:
        reduction: the base parameters.
        alone: whether to list the parameters that stand alone as well.
    """
    lines = []
    for relation in reduction.relations:
        if len(relation) > 1 or alone:
            values = ", ".join(
                f"{text} = {value:.6g}" for text, value in coefficient_values(relation).items()
            )
            lines.append(relation_text(relation) + (f"    [{values}]" if values else ""))
    if reduction.unnamed:
        lines.append(
            f"{reduction.unnamed} coefficients have no formula and are given as numbers only"
        )
    return "\n".join(lines)


def relations_json(reduction: ExactReduction) -> dict[str, Any]:
    """Return all relations for programs.

    Returns:
        ``rank``, ``classes``, ``symbols`` (value of each DH symbol), ``unnamed`` (number of coefficients without a
        formula) and ``groups``: of each base parameter ``name``, ``terms`` (coefficient of each parameter),
        ``formulas`` (the same as text, null where there is none) and ``text``.
    """
    groups = [
        {
            "name": base_name(relation),
            "terms": {term.name: term.value for term in relation},
            "formulas": {
                term.name: term.formula.text() if term.formula else None for term in relation
            },
            "text": relation_text(relation),
        }
        for relation in reduction.relations
    ]
    classes = {
        "alone": list(reduction.alone),
        "none": list(reduction.none),
        "combined": list(reduction.combined),
    }
    return {
        "rank": reduction.rank,
        "classes": classes,
        "symbols": reduction.geometry,
        "unnamed": reduction.unnamed,
        "groups": groups,
    }


def relations_latex(reduction: ExactReduction) -> str:
    """Return the relations of all combinations as a LaTeX ``align*`` environment."""
    rows = []
    for relation in reduction.relations:
        if len(relation) > 1:
            own = latex_symbol(relation[0].name)
            rows.append(
                rf"  {own}^{{R}} &= {joined([_latex_part(terms) for terms in _factored(relation)])}"
            )
    return "\n".join([r"\begin{align*}", " \\\\\n".join(rows), r"\end{align*}"])


def _factored(relation: Relation) -> list[tuple[Term, ...]]:
    """Return the terms of a relation gathered by equal coefficient: plain ones first and one by one, then by degree."""
    gathered: dict[object, list[Term]] = {}
    for term in relation:
        plain = term.formula is not None and term.formula.degree == 0 and abs(term.value) == 1
        key: object = term.name if plain or term.formula is None else term.formula
        gathered.setdefault(key, []).append(term)
    # Why: a stable sort keeps textbook order among equals.
    return sorted((tuple(terms) for terms in gathered.values()), key=_weight)


def _weight(terms: tuple[Term, ...]) -> tuple[bool, int]:
    formula = terms[0].formula
    return formula is None, formula.degree if formula is not None else 0


def _factor(term: Term) -> tuple[str, str]:
    """Return sign and size of a coefficient as text; the size is empty for 1."""
    if term.formula is None:
        return "-" if term.value < 0 else "+", f"{abs(term.value):.9g}"
    if len(term.formula.terms) > 1:
        return "+", f"({term.formula.text()})"
    size = (-term.formula if term.formula.negative else term.formula).text()
    return "-" if term.formula.negative else "+", "" if size == "1" else size


def _latex_part(terms: tuple[Term, ...]) -> tuple[str, str]:
    names = " + ".join(latex_symbol(term.name) for term in terms)
    body = rf"\left({names}\right)" if len(terms) > 1 else names
    formula = terms[0].formula
    sign, plain = _factor(terms[0])
    if formula is None or not plain:
        return sign, f"{plain} {body}".strip()
    if len(formula.terms) > 1:
        return sign, rf"\left({formula.latex()}\right) {body}"
    return sign, f"{(-formula if formula.negative else formula).latex()} {body}"
