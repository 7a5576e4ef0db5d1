"""How base parameters are made of all parameters, with coefficients in the symbols of the DH table.

A joint cannot tell on which side mass on its axis belongs (a sliding one: where rotational inertia
belongs). This gives relations between the parameters of two neighbouring links, in any arm; put
into one another from the base outwards they give the relations of the arm, each checked against
the numbers. Source: Gautier & Khalil 1990; pseudo-inertia as in Wensing 2018.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
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
    diag,
    expand,
    sstr,
    total_degree,
)

from dynid.arrays import Floats
from dynid.errors import ReductionsDisagree
from dynid.model import tuning
from dynid.model.kinematics import dh_step, geometry, right_angle
from dynid.model.parameters import BODY_PARAMETERS, TENSOR, representative_rank
from dynid.model.reduce import Reduction, reduce, representatives_first, with_added
from dynid.model.regressor import Model
from dynid.robot import LINK_PARAMETERS, Joint

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
    base, found = reduction.base.tolist(), dict[int, tuple[Shares, Floats]]()
    for k in representatives_first(model).tolist():
        own, value = reduction.K[:, k], np.zeros(reduction.rank)
        composed = {base.index(k): ONE} if k in base else _composed(rules.get(k, {}), found)
        for row, share in composed.items():
            value[row] = _value(share, numbers)
        tried = [({row: share for row, share in composed.items() if value[row]}, value)]
        for shares, size in found.values():
            tried += [(shares, size), ({row: -share for row, share in shares.items()}, -size)]
        number = Integer if np.allclose(own, np.round(own)) else Float
        tried.append(({row: number(own[row]) for row in np.flatnonzero(own)}, own))
        near = 1e-7 * np.abs(own).max()
        found[k] = next(one for one in tried if np.allclose(one[1], own, 1e-7, near))
    groups = []
    for row, first in enumerate(base):
        order = [first, *(k for k in sorted(found) if row in found[k][0] and k != first)]
        terms = []
        for k in order:
            formula, share = found[k][0][row], float(found[k][1][row])
            terms.append(Term(reduction.names[k], None if formula.has(Float) else formula, share))
        groups.append(tuple(terms))
    return tuple(groups)


# ---------------------------------------------------------------- composed from joint to joint
def _composed(rule: Shares, found: Mapping[int, tuple[Shares, Floats]]) -> Shares:
    """Return a column by rows of base parameters, of one by columns before it."""
    total: Shares = {}
    for k, factor in rule.items():
        for row, share in found[k][0].items():
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
            local = _passed(robot.convention, joint, still)
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
def _passed(convention: str, joint: Joint, still: bool) -> dict[int, Shares]:
    """Return the parameters that a joint lets pass, by the others: 0-9 of the link before, 10-19."""
    ca, sa = _turned(joint.twist, CA, SA)
    length, offset = A if joint.a else ZERO, D if joint.d else ZERO
    if joint.revolute:
        along, here = Matrix([0, sa, ca, 0]), Matrix([-length, 0, 0, 1])
        before, there = Matrix([0, 0, 1, 0]), Matrix([0, 0, offset, 1])
        if convention == "modified":
            along, here = before, Matrix([0, 0, 0, 1])
            before, there = Matrix([0, -sa, ca, 0]), Matrix([length, -offset * sa, offset * ca, 1])
        pairs = zip(_on_axis(along, here), _on_axis(before, there), strict=True)
    else:
        turned = _turned(joint.theta_offset, C, S)
        R = diag(Matrix(dh_step(convention, turned, (ca, sa), 0, 0)[0]), 0)
        axes = Matrix.eye(4)
        units = [axes[:, i] * axes[j, :] + axes[:, j] * axes[i, :] for i, j in TENSOR]
        pairs = zip(units, (R * unit * R.T for unit in units), strict=True)
    rows = [_parameters(other) + [-x for x in _parameters(own)] for own, other in pairs]
    if still:
        rows = [row[:4] + [0] * 6 + row[10:14] + [0] * 6 for row in rows]
    return _last_by_others(Matrix(rows), BODY_PARAMETERS * 2, convention, joint)


def _turned(angle: float, cosine: Symbol, sine: Symbol) -> tuple[Expr, Expr]:
    """Return cosine and sine of an angle: exact ones of a multiple of 90 degrees, else the symbols."""
    exact = right_angle(angle)
    return (Integer(exact[0]), Integer(exact[1])) if exact else (cosine, sine)


def _last_by_others(
    rows: Matrix, kinds: Sequence[str], convention: str, joint: Joint
) -> dict[int, Shares]:
    """Return columns by those that represent sums before them; each row is a combination that vanishes."""
    ranks = [representative_rank(convention, joint, kind) for kind in kinds]
    order = sorted(range(rows.cols), key=ranks.__getitem__)[::-1]
    reduced, pivots = rows[:, order].rref(simplify=cancel)
    return {
        order[own]: {
            order[k]: _short(-reduced[row, k])
            for k in range(own + 1, rows.cols)
            if reduced[row, k] != 0
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
    values, (c, s) = geometry(robot), _turned(joint.twist, CA, SA)
    a, axis = A if joint.a else ZERO, [0, 0, 1.0]
    if robot.convention == "modified":
        axis, c, s, a = [0, -values["sa1"], values["ca1"]], ONE, ZERO, ZERO
    # Inertia about the axis, with the rotor's.
    rows = [[a**2, 2 * a, 0, 0, 0, 0, 0, s**2, 2 * s * c, c**2, 1]] * (not still)
    if np.linalg.norm(np.cross(axis, robot.gravity)) > tuning.ROUNDING_SHARE:
        rows += [[a, 1, *[0] * 9], [0, 0, c, -s, *[0] * 7]]
    if not rows:
        return {}
    vanishing = Matrix.hstack(*Matrix(rows).nullspace()).T
    return _last_by_others(vanishing, LINK_PARAMETERS, robot.convention, joint)


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
        body = f"({body})" if len(terms) > 1 else body
        # Not commutative: parameters stand behind their coefficients.
        parts.append(share * Symbol(body, commutative=False))
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
