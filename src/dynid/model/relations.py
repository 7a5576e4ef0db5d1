"""How base parameters are made of all parameters, with coefficients in the symbols of the DH table.

A joint cannot tell on which side mass on its axis belongs (a sliding one: where rotational inertia
belongs). This gives relations between the parameters of two neighbouring links, in any arm; put
into one another from the base outwards they give the relations of the arm, each checked against
the numbers. Source: Gautier & Khalil 1990; pseudo-inertia as in Wensing 2018.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sympy import Expr, Integer, Matrix, Symbol, cancel, expand, latex, zeros  # noqa: TID253

from dynid.errors import ReductionsDisagree
from dynid.model import tuning
from dynid.model.kinematics import dh_step, geometry, right_angle
from dynid.model.parameters import TENSOR
from dynid.model.reduce import Reduction, reduce_plain, with_added
from dynid.model.regressor import Model
from dynid.robot import Joint

Floats = NDArray[np.float64]
#: A column as a combination of others.
Shares = dict[int, Expr]

#: Length, offset, cosine and sine of the twist, cosine and sine of a sliding joint's angle.
A, D, CA, SA, C, S = map(Symbol, ("a", "d", "ca", "sa", "c", "s"))
ONE = Integer(1)


@dataclass(frozen=True)
class Term:
    """A share of one parameter in a base parameter: its name, formula (None if none was found), value."""

    name: str
    formula: Expr | None
    value: float


#: The shares of all parameters in a base parameter, its own first.
Relation = tuple[Term, ...]


def base_parameters(
    model: Model, *, samples: int = 200, seed: int = 0, tolerance: float | None = None
) -> Reduction:
    """Find the base parameters of a model, with a formula for each relation.

    Args: as for ``reduce_plain``.

    Raises:
        ReductionsDisagree: the singular values leave the rank open.
    """
    plain = reduce_plain(model, samples=samples, seed=seed, tolerance=tolerance)
    values, rank = plain.singular_values / plain.singular_values[0], plain.rank
    if rank < len(values) and values[rank] > tuning.ROUNDED_VALUE:
        shown = ", ".join(f"{k}: {values[k - 1]:.1e}" for k in range(rank - 1, rank + 3))
        raise ReductionsDisagree(
            f"whether there are {rank} base parameters or more is open; singular values relative to the largest "
            f"are {shown}"
        )
    relations, K = relations_of(model, plain), np.zeros_like(plain.K)
    at = {name: k for k, name in enumerate(plain.names)}
    for row, relation in zip(K, relations, strict=True):
        row[[at[term.name] for term in relation]] = [term.value for term in relation]
    formulas = tuple(map(relation_text, relations))
    return with_added(replace(plain, K=K, formulas=formulas), model)


def relations_of(
    model: Model, found: Reduction | None = None, *, still: bool = False
) -> tuple[Relation, ...]:
    """Return what each base parameter is made of.

    Args:
        model: the model.
        found: its base parameters by numbers, without those of added effects; None finds them.
        still: whether they are those of the torques at rest.
    """
    found = found or reduce_plain(model, still=still)
    columns = _columns(model, found, still)
    values = np.array([column.values for column in columns]).T
    groups = []
    for row, base in enumerate(found.base.tolist()):
        shares = [base, *(k for k in np.flatnonzero(values[row]).tolist() if k != base)]
        terms = [(k, columns[k].formulas.get(row)) for k in shares]
        groups.append(tuple(Term(found.names[k], share, values[row, k]) for k, share in terms))
    return tuple(groups)


# ---------------------------------------------------------------- composed from joint to joint
@dataclass(frozen=True)
class _Column:
    """A column by base parameters: formulas by row where all have one, and values, (p,)."""

    formulas: Shares
    values: Floats

    def times(self, factor: Expr, value: float) -> _Column:
        shares = {row: expand(factor * share) for row, share in self.formulas.items()}
        return _Column(shares, value * self.values)


def _columns(model: Model, found: Reduction, still: bool) -> list[_Column]:
    """Return each column by rows of base parameters."""
    base = {int(k): row for row, k in enumerate(found.base)}
    at = {int(full): k for k, full in enumerate(model.link_columns)}
    numbers = geometry(model.robot)
    rules: dict[int, dict[int, tuple[Expr, float]]] = {}
    for link, joint in enumerate(model.robot.joints):
        local = _passed(joint, link, model, still) if link else _of_first_link(model, still)
        for own, shares in local.items():
            if own in at and shares.keys() <= at.keys():
                rules[at[own]] = {
                    at[k]: (share, _value(share, numbers)) for k, share in shares.items()
                }
    columns = list[_Column]()
    for k, own in enumerate(found.K.T):
        if k in base:
            tried = [_Column({base[k]: ONE}, own)]
        else:
            tried = [
                _sum([columns[j].times(*factor) for j, factor in rules.get(k, {}).items()], own)
            ]
            tried += [column.times(Integer(sign), sign) for column in columns for sign in (1, -1)]
        nearness = {"rtol": 1e-7, "atol": 1e-7 * np.abs(own).max(initial=0.0)}
        same = (column for column in tried if np.allclose(column.values, own, **nearness))
        rows = np.flatnonzero(own).tolist() if np.allclose(own, np.round(own)) else ()
        whole = {row: Integer(round(own[row])) for row in rows}
        columns.append(next(same, _Column(whole, own)))
    return columns


def _sum(parts: Sequence[_Column], like: Floats) -> _Column:
    """Return the sum of columns; without formulas where one has none."""
    values, total = np.zeros_like(like), dict[int, Expr]()
    size = values.copy()
    for part in parts:
        values, size = values + part.values, size + np.abs(part.values)
        for row, share in part.formulas.items():
            total[row] = total.get(row, Integer(0)) + share
    values[np.abs(values) < tuning.CANCELLED * size] = 0.0
    named = all(len(part.formulas) == np.count_nonzero(part.values) for part in parts)
    rows = np.flatnonzero(values).tolist() if named else []
    return _Column({row: total[row] for row in rows}, values)


def _value(formula: Expr, numbers: Mapping[str, float]) -> float:
    return float(formula.subs({x: numbers[x.name] for x in formula.free_symbols}))


def _passed(joint: Joint, link: int, model: Model, still: bool) -> dict[int, Shares]:
    """Return the parameters of a link that pass through its joint, by those of it and of the link before."""
    twist, angle = right_angle(joint.twist), right_angle(joint.theta_offset)
    shape = (bool(joint.a), bool(joint.d), twist, None if joint.revolute else angle)
    symbols = {x: Symbol(f"{x.name}{link + 1}") for x in (A, D, CA, SA, C, S)}
    first = 11 * (link - 1)

    def full(k: int) -> int:
        return first + k + (k > 9)  # the eleventh parameter is no body's

    rules = _rules(joint.revolute, model.robot.convention, still, *shape)
    return {
        full(own): {full(k): share.xreplace(symbols) for k, share in shares}
        for own, shares in rules.items()
    }


@lru_cache(maxsize=64)
def _rules(
    revolute: bool,
    convention: str,
    still: bool,
    a: bool,
    d: bool,
    twist: tuple[int, int] | None,
    angle: tuple[int, int] | None,
) -> dict[int, list[tuple[int, Expr]]]:
    """Return the last parameters that a joint of this shape lets pass, by the others: 0-9 of the link before, 10-19."""
    ca, sa = map(Integer, twist) if twist else (CA, SA)
    length, offset = A if a else Integer(0), D if d else Integer(0)
    rows = []
    if revolute:
        along, here = Matrix([0, sa, ca, 0]), Matrix([-length, 0, 0, 1])
        before, there = Matrix([0, 0, 1, 0]), Matrix([0, 0, offset, 1])
        if convention == "modified":
            along, here = before, Matrix([0, 0, 0, 1])
            before, there = Matrix([0, -sa, ca, 0]), Matrix([length, -offset * sa, offset * ca, 1])
        for own, other in zip(_on_axis(along, here), _on_axis(before, there), strict=True):
            rows.append(_parameters(other) + [-x for x in _parameters(own)])
    else:
        turned = map(Integer, angle) if angle else (C, S)
        R = Matrix(dh_step(convention, tuple(turned), (ca, sa), 0, 0)[0])
        for i, j in TENSOR:
            own, other = zeros(4), zeros(4)
            own[i, j] = own[j, i] = 1
            other[:3, :3] = R * own[:3, :3] * R.T
            rows.append(_parameters(other) + [-x for x in _parameters(own)])
    if still:
        rows = [row[:4] + [0] * 6 + row[10:14] + [0] * 6 for row in rows]
    # Why from the right: the last parameters of the link are those that others express.
    reduced, pivots = Matrix([row[::-1] for row in rows]).rref(simplify=cancel)
    return {
        19 - pivot: [
            (19 - k, _short(-reduced[row, k])) for k in range(19, pivot, -1) if reduced[row, k] != 0
        ]
        for row, pivot in enumerate(pivots)
    }


def _on_axis(along: Matrix, point: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Return the pseudo-inertias of a rod, a first moment and a mass on an axis."""
    return along * along.T, along * point.T + point * along.T, point * point.T


def _parameters(J: Matrix) -> list[Expr]:
    """Return the ten parameters of a body with a pseudo-inertia, (4, 4)."""
    inertia = [
        J[(i + 1) % 3, (i + 1) % 3] + J[(i + 2) % 3, (i + 2) % 3] if i == j else -J[i, j]
        for i, j in TENSOR
    ]
    return [J[3, 3], J[0, 3], J[1, 3], J[2, 3], *map(_short, inertia)]


def _short(formula: Expr) -> Expr:
    """Return the shortest form that cos^2 + sin^2 = 1 allows."""
    forms = [expand(formula)]
    for c, s in ((CA, SA), (C, S)):
        forms += [expand(forms[0].subs(x**2, 1 - y**2)) for x, y in ((c, s), (s, c))]
    return min(forms, key=lambda form: len(form.as_ordered_terms()))


def _of_first_link(model: Model, still: bool) -> dict[int, Shares]:
    """Return the parameters of the first link by those before: it turns about an axis that does not move."""
    robot, joint = model.robot, model.robot.joints[0]
    if not joint.revolute:
        return {}
    values, exact = geometry(robot), right_angle(joint.twist)
    c, s = map(Integer, exact) if exact else (Symbol("ca1"), Symbol("sa1"))
    a = Symbol("a1") if joint.a else Integer(0)
    axis, upright = np.array([0, 0, 1.0]), robot.convention == "modified"
    if upright:
        axis, c, s, a = np.array([0, -values["sa1"], values["ca1"]]), ONE, Integer(0), Integer(0)
    rows = []
    if not still:  # inertia about the axis, with the rotor's
        rows.append([a**2, 2 * a, 0, 0, 0, 0, 0, s**2, 2 * s * c, c**2, 1])
    if np.linalg.norm(np.cross(axis, robot.gravity)) > tuning.ROUNDING_SHARE:
        rows += [[a, 1, *[0] * 9], [0, 0, c, -s, *[0] * 7]]
    if not rows:
        return {}
    reduced, pivots = Matrix(rows).rref()
    return {
        k: {p: reduced[row, k] for row, p in enumerate(pivots) if reduced[row, k] != 0}
        for k in range(11)
        if k not in pivots
    }


# ---------------------------------------------------------------- text, JSON and LaTeX
def base_name(relation: Relation) -> str:
    """Return the name of a base parameter: a combination is called after its representative with an R, ``Ixx2R``."""
    return relation[0].name + ("R" if len(relation) > 1 else "")


def formula_text(formula: Expr) -> str:
    """Return a formula as text, such as ``2*ca4*d3``."""
    parts = []
    for sign, size in _monomials(formula):
        factor, rest = size.as_coeff_Mul()
        powers = sorted(
            (x.name, int(power)) for x, power in rest.as_powers_dict().items() if x != 1
        )
        names = [name if power == 1 else f"{name}^{power}" for name, power in powers]
        parts.append((sign, "*".join([str(factor)] * (factor != 1 or not names) + names)))
    return _joined(parts)


def _monomials(formula: Expr) -> list[tuple[str, Expr]]:
    """Return sign and size of each term, in rising degree."""
    found = []
    for term in expand(formula).as_ordered_terms():
        negative = term.as_coeff_Mul()[0] < 0
        found.append(("-" if negative else "+", -term if negative else term))
    return sorted(found, key=lambda part: (_degree(part[1]), str(part[1])))


def _degree(formula: Expr) -> int:
    terms = expand(formula).as_ordered_terms()
    return max(
        sum(abs(int(power)) for symbol, power in term.as_powers_dict().items() if symbol.is_Symbol)
        for term in terms
    )


def _joined(parts: list[tuple[str, str]]) -> str:
    """Join signed terms: the first without a plus sign, the others with spaces round the sign."""
    text = " ".join(f"{sign} {body}" for sign, body in parts)
    return text.removeprefix("+ ") if text[0] == "+" else "-" + text[2:]


def relation_text(relation: Relation) -> str:
    """Return one relation as text, such as ``mcz2R = mcz2 - mcy3 + d3*(m3+m4)``."""
    parts = []
    for terms in _factored(relation):
        names = "+".join(term.name for term in terms)
        body = f"({names})" if len(terms) > 1 else names
        sign, size, count = _factor(terms[0], formula_text)
        factor = f"({size})" if count > 1 else size
        parts.append((sign, f"{factor}*{body}" if factor else body))
    return f"{base_name(relation)} = {_joined(parts)}"


def relations_text(relations: tuple[Relation, ...], *, alone: bool = False) -> str:
    """Return all relations as text with the numbers behind their coefficients; those that stand alone too if wanted."""
    lines = []
    for relation in relations:
        if len(relation) > 1 or alone:
            values = {
                formula_text(terms[0].formula): terms[0].value
                for terms in _factored(relation)
                if terms[0].formula is not None and not terms[0].formula.is_Number
            }
            shown = ", ".join(f"{text} = {value:.6g}" for text, value in values.items())
            lines.append(relation_text(relation) + (f"    [{shown}]" if values else ""))
    if missing := unnamed(relations):
        lines.append(f"{missing} coefficients have no formula and are given as numbers only")
    return "\n".join(lines)


def unnamed(relations: tuple[Relation, ...]) -> int:
    """Return the number of coefficients that have no formula."""
    return sum(term.formula is None for relation in relations for term in relation)


def relations_json(model: Model, relations: tuple[Relation, ...]) -> dict[str, Any]:
    """Return relations as data: each with its ``terms``, their ``formulas`` (null if none was found) and ``text``."""
    groups = [
        {
            "name": base_name(relation),
            "terms": {term.name: term.value for term in relation},
            "formulas": {
                term.name: None if term.formula is None else formula_text(term.formula)
                for term in relation
            },
            "text": relation_text(relation),
        }
        for relation in relations
    ]
    alone = [relation[0].name for relation in relations if len(relation) == 1]
    used = {term.name for relation in relations for term in relation}
    names, values = model.parameter_names[: model.plain_size], geometry(model.robot)
    return {
        "rank": len(relations),
        "classes": {
            "alone": alone,
            "none": [name for name in names if name not in used],
            "combined": [name for name in names if name in used.difference(alone)],
        },
        "symbols": {name: values[name] for name in model.rigid.inputs if name in values},
        "unnamed": unnamed(relations),
        "groups": groups,
    }


def relations_latex(relations: tuple[Relation, ...]) -> str:
    """Return the relations of all combinations as a LaTeX ``align*`` environment."""
    rows = []
    for relation in relations:
        if len(relation) > 1:
            parts = []
            for terms in _factored(relation):
                names = " + ".join(_latex_symbol(term.name) for term in terms)
                body = rf"\left({names}\right)" if len(terms) > 1 else names
                sign, size, count = _factor(terms[0], _latex)
                factor = rf"\left({size}\right)" if count > 1 else size
                parts.append((sign, f"{factor} {body}".strip()))
            rows.append(rf"  {_latex_symbol(relation[0].name)}^{{R}} &= {_joined(parts)}")
    return "\n".join([r"\begin{align*}", " \\\\\n".join(rows), r"\end{align*}"])


def _factored(relation: Relation) -> list[tuple[Term, ...]]:
    """Return the terms of a relation gathered by equal coefficient: plain ones first and one by one, then by degree."""
    gathered: dict[object, list[Term]] = {}
    for term in relation:
        plain = term.formula is None or term.formula in (1, -1)
        gathered.setdefault(term.name if plain else term.formula, []).append(term)
    groups = [tuple(terms) for terms in gathered.values()]
    return sorted(
        groups, key=lambda terms: 99 if terms[0].formula is None else _degree(terms[0].formula)
    )


def _factor(term: Term, written: Callable[[Expr], str]) -> tuple[str, str, int]:
    """Return sign and size of a coefficient, which is empty for 1, and of how many terms it is a sum."""
    if term.formula is None:
        return "-" if term.value < 0 else "+", f"{abs(term.value):.9g}", 1
    (sign, size), *more = _monomials(term.formula)
    if more:
        return "+", written(term.formula), 1 + len(more)
    return sign, "" if size == 1 else written(size), 1


def _latex(formula: Expr) -> str:
    names = {symbol: _latex_symbol(symbol.name) for symbol in formula.free_symbols}
    return _joined([(sign, latex(size, symbol_names=names)) for sign, size in _monomials(formula)])


def _latex_symbol(name: str) -> str:
    """Return a DH symbol or a parameter's name in LaTeX: ``d_{3}`` for ``d3``, ``mc_{3,x}`` for ``mcx3``."""
    kind = name.rstrip("0123456789")
    number = name[len(kind) :]
    if kind in ("ca", "sa", "c", "s"):
        return rf"{kind[0]}_{{\{'alpha' if len(kind) > 1 else 'theta'} {number}}}"
    head = "mc" if kind.startswith("mc") else kind[0]
    tail = kind[len(head) :]
    return rf"{head}_{{{number}{',' * bool(tail)}{tail}}}"
