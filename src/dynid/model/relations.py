"""How base parameters are made of all parameters, with coefficients in the symbols of the DH table.

A joint cannot tell on which side mass on its axis belongs (a sliding one: where rotational inertia
belongs). This gives relations between the parameters of two neighbouring links, in any arm; put
into one another from the base outwards they give the relations of the arm, each checked against
the numbers. Source: Gautier & Khalil 1990; pseudo-inertia as in Wensing 2018.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from sympy import (  # noqa: TID253
    Add,
    Expr,
    Float,
    Integer,
    Matrix,
    Symbol,
    cancel,
    expand,
    sstr,
    total_degree,
    zeros,
)

from dynid.arrays import Floats
from dynid.errors import ReductionsDisagree
from dynid.model import tuning
from dynid.model.kinematics import dh_step, geometry, right_angle
from dynid.model.parameters import TENSOR
from dynid.model.reduce import Reduction, reduce, with_added
from dynid.model.regressor import Model

#: A column as a combination of others, by their places; shares without a formula are plain numbers.
Shares = dict[int, Expr]

#: Length, offset, cosine and sine of the twist, cosine and sine of a prismatic joint's angle.
A, D, CA, SA, C, S = map(Symbol, ("a", "d", "ca", "sa", "c", "s"))
ZERO, ONE = Integer(0), Integer(1)


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

    Args: as for ``reduce``.

    Raises:
        ReductionsDisagree: the singular values leave the rank open.
    """
    reduction = reduce(model, samples=samples, seed=seed, tolerance=tolerance)
    values, rank = reduction.singular_values / reduction.singular_values[0], reduction.rank
    if rank < len(values) and values[rank] > tuning.ROUNDED_VALUE:
        shown = ", ".join(f"{k}: {values[k - 1]:.1e}" for k in range(rank - 1, rank + 3))
        raise ReductionsDisagree(
            f"whether there are {rank} base parameters or more is open; singular values relative to the largest "
            f"are {shown}"
        )
    relations, K = relations_of(model, reduction), np.zeros_like(reduction.K)
    at = {name: k for k, name in enumerate(reduction.names)}
    for row, relation in zip(K, relations, strict=True):
        row[[at[term.name] for term in relation]] = [term.value for term in relation]
    return with_added(replace(reduction, K=K, formulas=tuple(map(_spelled, relations))), model)


def relations_of(
    model: Model, reduction: Reduction | None = None, *, still: bool = False
) -> tuple[Relation, ...]:
    """Return what each base parameter is made of.

    Args:
        model: the model.
        reduction: its base parameters by numbers, without those of added effects; None finds them.
        still: whether they are those of the torques at rest.
    """
    reduction = reduction or reduce(model, still=still)
    rules, numbers = _rules(model, still), geometry(model.robot)
    base, columns, values = reduction.base.tolist(), list[Shares](), list[Floats]()
    for k, own in enumerate(reduction.K.T):
        composed = {base.index(k): ONE} if k in base else _composed(rules.get(k, {}), columns)
        value = np.zeros(reduction.rank)
        for row, share in composed.items():
            value[row] = _value(share, numbers)
        composed = {row: share for row, share in composed.items() if value[row]}
        tried = [(composed, value)]
        for column, size in zip(columns, values, strict=True):
            tried += [(column, size), ({row: -share for row, share in column.items()}, -size)]
        integers = np.allclose(own, np.round(own))
        known = (Integer(round(x)) if integers else Float(x) for x in own)
        tried.append(({row: x for row, x in enumerate(known) if x}, own))
        near = 1e-7 * np.abs(own).max(initial=0.0)
        shares, value = next(one for one in tried if np.allclose(one[1], own, 1e-7, near))
        columns.append(shares)
        values.append(value)
    groups = []
    for row, first in enumerate(base):
        order = [first, *(k for k, x in enumerate(columns) if row in x and k != first)]
        formulas = [columns[k][row] for k in order]
        groups.append(
            tuple(
                Term(reduction.names[k], None if x.has(Float) else x, float(values[k][row]))
                for k, x in zip(order, formulas, strict=True)
            )
        )
    return tuple(groups)


# ---------------------------------------------------------------- composed from joint to joint
def _composed(rule: Shares, columns: list[Shares]) -> Shares:
    """Return a column by rows of base parameters, of one by columns before it."""
    total: Shares = {}
    for k, factor in rule.items():
        for row, share in columns[k].items():
            total[row] = total.get(row, ZERO) + expand(factor * share)
    return total


def _value(formula: Expr, numbers: Mapping[str, float]) -> float:
    """Return the value of a formula; of terms that cancel each other zero, without their rounding."""
    known = {x: Float(numbers[x.name]) for x in formula.free_symbols}
    sizes = [float(term.xreplace(known)) for term in Add.make_args(formula)]
    total = sum(sizes)
    return total if abs(total) > tuning.CANCELLED * sum(map(abs, sizes)) else 0.0


def _rules(model: Model, still: bool) -> dict[int, Shares]:
    """Return columns of a link that pass through its joint, by those of it and of the link before."""
    robot, at = model.robot, {int(full): k for k, full in enumerate(model.link_columns)}
    rules = {}
    for link, joint in enumerate(robot.joints):
        places, number = list(range(11 * link, 11 * link + 11)), link + 1
        if link:
            twist, angle = right_angle(joint.twist), right_angle(joint.theta_offset)
            shape = (bool(joint.a), bool(joint.d), twist, None if joint.revolute else angle)
            local = _passed(robot.convention, joint.revolute, still, *shape)
            # The eleventh parameter is no body's.
            first = 11 * (link - 1)
            places = [first + k + (k > 9) for k in range(20)]
        else:
            local = _of_first_link(model, still)
        symbols = {x: Symbol(f"{x.name}{number}") for x in (A, D, CA, SA, C, S)}
        for own, shares in local.items():
            if places[own] in at and all(places[k] in at for k in shares):
                rule = {at[places[k]]: share.xreplace(symbols) for k, share in shares.items()}
                rules[at[places[own]]] = rule
    return rules


@lru_cache(maxsize=64)
def _passed(
    convention: str,
    revolute: bool,
    still: bool,
    a: bool,
    d: bool,
    twist: tuple[int, int] | None,
    angle: tuple[int, int] | None,
) -> dict[int, Shares]:
    """Return the last parameters that a joint of this shape lets pass, by the others: 0-9 of the link before, 10-19."""
    ca, sa = map(Integer, twist) if twist else (CA, SA)
    length, offset = A if a else ZERO, D if d else ZERO
    if revolute:
        along, here = Matrix([0, sa, ca, 0]), Matrix([-length, 0, 0, 1])
        before, there = Matrix([0, 0, 1, 0]), Matrix([0, 0, offset, 1])
        if convention == "modified":
            along, here = before, Matrix([0, 0, 0, 1])
            before, there = Matrix([0, -sa, ca, 0]), Matrix([length, -offset * sa, offset * ca, 1])
        pairs = zip(_on_axis(along, here), _on_axis(before, there), strict=True)
    else:
        turned = map(Integer, angle) if angle else (C, S)
        R = Matrix(dh_step(convention, tuple(turned), (ca, sa), 0, 0)[0]).row_join(zeros(3, 1))
        R = R.col_join(zeros(1, 4))
        units = [zeros(4) for _ in TENSOR]
        for unit, (i, j) in zip(units, TENSOR, strict=True):
            unit[i, j] = unit[j, i] = 1
        pairs = zip(units, (R * unit * R.T for unit in units), strict=True)
    rows = [_parameters(other) + [-x for x in _parameters(own)] for own, other in pairs]
    if still:
        rows = [row[:4] + [0] * 6 + row[10:14] + [0] * 6 for row in rows]
    return _last_by_others(Matrix(rows))


def _last_by_others(rows: Matrix) -> dict[int, Shares]:
    """Return columns by those before them, where each row is a combination of columns that vanishes."""
    last = rows.cols - 1
    reduced, pivots = rows[:, ::-1].rref(simplify=cancel)
    return {
        last - own: {
            last - k: _short(-reduced[row, k]) for k in range(last, own, -1) if reduced[row, k] != 0
        }
        for row, own in enumerate(pivots)
    }


def _on_axis(along: Matrix, point: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Return the pseudo-inertias of a rod, a first moment and a mass on an axis."""
    return along * along.T, along * point.T + point * along.T, point * point.T


def _parameters(J: Matrix) -> list[Expr]:
    """Return the ten parameters of a body with a pseudo-inertia, (4, 4)."""
    second = J[:3, :3]
    inertia = second.trace() * Matrix.eye(3) - second
    return [J[3, 3], *J[:3, 3], *(_short(inertia[i, j]) for i, j in TENSOR)]


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
    c, s = map(Integer, exact) if exact else (CA, SA)
    a, axis = A if joint.a else ZERO, [0, 0, 1.0]
    if robot.convention == "modified":
        axis, c, s, a = [0, -values["sa1"], values["ca1"]], ONE, ZERO, ZERO
    rows = []
    if not still:  # inertia about the axis, with the rotor's
        rows.append([a**2, 2 * a, 0, 0, 0, 0, 0, s**2, 2 * s * c, c**2, 1])
    if np.linalg.norm(np.cross(axis, robot.gravity)) > tuning.ROUNDING_SHARE:
        rows += [[a, 1, *[0] * 9], [0, 0, c, -s, *[0] * 7]]
    if not rows:
        return {}
    return _last_by_others(Matrix.hstack(*Matrix(rows).nullspace()).T)


# ---------------------------------------------------------------- text and JSON
def base_name(relation: Relation) -> str:
    """Return the name of a base parameter: a combination is called after its representative with an R, ``Ixx2R``."""
    return relation[0].name + ("R" if len(relation) > 1 else "")


def _gathered(relation: Relation) -> list[tuple[Expr, list[Term]]]:
    """Return the terms of a relation by coefficient: plain ones first and one by one, then by degree."""
    gathered: dict[tuple[Expr, str], list[Term]] = {}
    for term in relation:
        share = Float(f"{term.value:.9g}", 9) if term.formula is None else term.formula
        single = term.formula in (None, 1, -1)
        gathered.setdefault((share, term.name * single), []).append(term)

    def degree(share: Expr) -> float:
        return math.inf if share.is_Float else total_degree(share) if share.free_symbols else 0

    return sorted(
        ((share, x) for (share, _), x in gathered.items()), key=lambda one: degree(one[0])
    )


def _plain(formula: Expr) -> str:
    return str(sstr(formula, order="none")).replace("**", "^")


def _spelled(relation: Relation) -> str:
    """Return what a base parameter is made of, such as ``mcz2R = mcz2 - mcy3 + d3*(m3+m4)``."""
    parts = []
    for share, terms in _gathered(relation):
        body = "+".join(term.name for term in terms)
        # Not commutative: parameters stand behind their coefficients.
        parts.append(share * Symbol(f"({body})" if len(terms) > 1 else body, commutative=False))
    return f"{base_name(relation)} = {_plain(Add(*parts, evaluate=False))}"


def relations_text(relations: tuple[Relation, ...]) -> str:
    """Return all relations as text with the numbers behind their coefficients."""
    lines = []
    for relation in relations:
        values = {
            _plain(share): terms[0].value
            for share, terms in _gathered(relation)
            if not share.is_Number
        }
        shown = ", ".join(f"{text} = {value:.6g}" for text, value in values.items())
        lines.append(_spelled(relation) + (f"    [{shown}]" if values else ""))
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
                term.name: None if term.formula is None else _plain(term.formula)
                for term in relation
            },
            "text": _spelled(relation),
        }
        for relation in relations
    ]
    alone = [relation[0].name for relation in relations if len(relation) == 1]
    used = {term.name for relation in relations for term in relation}
    names, values = model.parameter_names[: model.size_without_effects], geometry(model.robot)
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
