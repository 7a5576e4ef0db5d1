"""Everything that may be named, with all its shapes, as products with what is common and each joint's rest."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynid.arrays import Floats
from dynid.estimation.factor import of_unit_diagonal
from dynid.gap import tuning
from dynid.gap.evidence import Evidence, EvidenceRows, forward, lower_root
from dynid.gap.gap_rows import EffectColumns
from dynid.gap.problem import GapProblem
from dynid.gap.selected_effects import Key
from dynid.model.effects.catalogue import CATALOGUE, DELAY
from dynid.model.effects.interface import Effect
from dynid.model.effects.motion import Joints

#: Log Bayes factor of what cannot be.
NEVER = -1e9
#: Rms of a column beside the effect's largest below which it is rounding: a force along an axis turns no joint.
ROUNDING = 1e-9


@dataclass(frozen=True)
class SelectionOptions:
    """What is searched.

    Attributes:
        effects: identifiers; all when empty.
        joints: 0-based joints; all when empty.
        sure: probability against what has no name from which something is named.
        most: largest number of effects that are added.
        barred: effects that were refused, and their joints if nothing else is named there.
    """

    effects: tuple[str, ...] = ()
    joints: tuple[int, ...] = ()
    sure: float = 0.99
    most: int = 3
    barred: Set[Joints | Key] = frozenset()


@dataclass(frozen=True)
class Place:
    """What may be named, and where.

    Attributes:
        effect: the effect.
        joints: the joint that it acts on, with the one that it follows for a pair; () for the whole arm.
        always: whether it acts in earlier logs too, where what has changed since is looked for.
    """

    effect: Effect
    joints: Joints
    always: bool = False

    @property
    def key(self) -> Key:
        """Identifier and joints."""
        return self.effect.name, self.joints

    @property
    def at(self) -> tuple[Key, bool]:
        """What tells it from all others."""
        return self.key, self.always


@dataclass(frozen=True)
class Candidate:
    """One effect at one place with all its shapes that have the same number of columns.

    Attributes:
        place: the effect and where it sits.
        shapes: those that are tried, G of them.
        columns: {joint: (G, k, F)}.
        own: for each joint, products of its columns with each other, {joint: (B, G, k, k)}.
        others: and with [R, torque, T], {joint: (B, G k, s)}.
        rms: of its columns on the joint that shows each most, in units of the noise, (G, k).
        groups: how many candidates of other numbers of columns there are at its place, this one included.
    """

    place: Place
    shapes: list[dict[str, float]]
    columns: dict[int, Floats]
    own: dict[int, Floats]
    others: dict[int, Floats]
    rms: Floats
    groups: int

    def beside(self, rows: EvidenceRows) -> Candidate:
        """Return the candidate with its products with the columns of names that are not among them yet."""
        others = {}
        for j, C in self.columns.items():
            names, flat = rows.own[j][self.others[j].shape[2] :], C.reshape(-1, C.shape[-1])
            more = rows.bands.products(flat, names)
            others[j] = np.concatenate([self.others[j], more], axis=2)
        return replace(self, others=others)

    def at(self, g: int) -> Candidate:
        """Return the candidate with one of its shapes."""
        k = self.rms.shape[1]
        return replace(
            self,
            shapes=self.shapes[g : g + 1],
            columns={j: C[g : g + 1] for j, C in self.columns.items()},
            own={j: own[:, g : g + 1] for j, own in self.own.items()},
            others={j: other[:, g * k : g * k + k] for j, other in self.others.items()},
            rms=self.rms[g : g + 1],
        )

    @cached_property
    def alike(self) -> Floats:
        """How alike its columns are: correlations, (G, k, k).

        The prior of amplitudes has them, so that it is about torques and not about columns (Zellner 1986): q, q^2 and
        q^3 on one side of zero are nearly one column, and three priors of it would make a line dearer than a cubic.
        """
        own = np.sum([each.sum(axis=0) for each in self.own.values()], axis=0)
        size = np.sqrt(np.maximum(np.diagonal(own, axis1=1, axis2=2), 1e-300))
        correlation = own / size[..., None] / size[..., None, :]
        return np.where(np.eye(own.shape[-1], dtype=bool), 1.0 + tuning.ALIKE, correlation)

    def among(self, evidence: Evidence, scale: float) -> Evidence:
        """Return an evidence with the columns of the only shape among T; prior sizes in units of the noise."""
        products = {j: (own[:, 0], self.others[j]) for j, own in self.own.items()}
        strength = np.where(self.rms[0] > 0, self.rms[0], 1.0) / scale
        return evidence.with_columns(products, self.alike[0] * np.outer(strength, strength))


def candidate(
    rows: EvidenceRows,
    place: Place,
    shapes: list[dict[str, float]],
    groups: int = 1,
    raw: EffectColumns | None = None,
) -> Candidate:
    """Return a candidate with shapes that have the same number of columns.

    Args:
        rows: what is common and the rest.
        place: the effect and where it sits.
        shapes: to try.
        groups: how many candidates the effect has there.
        raw: its filtered columns, where they are at hand.
    """
    raw = raw or rows.rows.columns(place.effect, place.joints, shapes, always=place.always)
    columns = {j: rows.bands.transformed(j, C) for j, C in raw.items()}
    largest: Floats = np.max([np.abs(C).max(axis=2, initial=0.0) for C in columns.values()], axis=0)
    kept = largest > ROUNDING * largest.max()
    columns = {j: C * kept[..., None] for j, C in columns.items() if C.any()}
    own, others, power = {}, {}, np.zeros(largest.shape)
    for j, C in columns.items():
        own[j], others[j] = rows.products(j, C)
        count = max(float(rows.bands.counts(j, always=place.always).sum()), 1.0)
        power = np.maximum(power, np.einsum("bgkk->gk", own[j]) / count)
    return Candidate(place, shapes, columns, own, others, np.sqrt(power), groups)


def candidates_of(rows: EvidenceRows, places: Sequence[Place]) -> list[Candidate]:
    """Return the candidates of an effect on its grid: one for each number of columns that its shapes have.

    Args:
        rows: what is common and the rest.
        places: where it sits, since new logs, always, or both.
    """
    place, made = places[-1], list[Candidate]()
    groups: dict[int, list[dict[str, float]]] = {}
    for shape in place.effect.grid(rows.rows.motion, place.joints):
        ranges = ((x, tuning.RANGES.get((place.effect.name, name))) for name, x in shape.items())
        if all(ends is None or ends[0] <= x <= ends[1] for x, ends in ranges):
            groups.setdefault(len(place.effect.amplitudes(shape)), []).append(shape)
    for some in groups.values():
        raw = rows.rows.columns(place.effect, place.joints, some, always=place.always)
        for one in places:
            own = raw if one.always else {j: C * rows.rows.is_new for j, C in raw.items()}
            made.append(candidate(rows, one, some, groups=len(groups), raw=own))
    return [one for one in made if one.own and one.rms.any()]


def places_of(problem: GapProblem, options: SelectionOptions, *, delay: bool) -> list[Place]:
    """Return every effect that is worth a look, with every joint, pair of joints or arm that it may sit on.

    What may have changed stands beside what may always have been missing.

    Args:
        problem: what is searched.
        options: which effects are tried, and where.
        delay: whether a delay is tried.
    """
    moves = np.asarray(problem.rows.use.any(axis=0))
    return [
        Place(effect, joints, always)
        for effect in CATALOGUE.values()
        if not options.effects or effect.name in options.effects
        for joints in effect.candidate_joints(problem.base.robot.n)
        if not joints or ((not options.joints or joints[0] in options.joints) and moves[joints[0]])
        for always in ((False, True) if problem.rows.compared else (False,))
        if (delay and not always) or effect.name != DELAY
        if ("frozen" if problem.since and not always else "refit") in effect.uses
        if not _in_model(effect, joints, problem, refit=always or not problem.since)
    ]


def _in_model(effect: Effect, joints: Joints, problem: GapProblem, *, refit: bool) -> bool:
    """Return whether the baseline has it already, or has not what should have changed."""
    if not joints:
        return False
    joint = problem.base.robot.joints[joints[0]]
    has = {
        "torque_offset": refit and "offset" in joint.friction,
        "viscous": "viscous" in joint.friction,
        "coulomb": "coulomb" in joint.friction,
        "motor_inertia": refit and joint.motor_inertia,
        "coulomb_change": "coulomb" not in joint.friction,
        "viscous_change": "viscous" not in joint.friction,
    }
    return has.get(effect.name, False)


def visible_share(evidence: Evidence, one: Candidate, base: int) -> float:
    """Return the largest share of its power that base parameters cannot absorb, over all shapes.

    Args:
        evidence: without any name.
        one: the candidate.
        base: number of base parameters, the first columns of T.
    """
    count, k = one.rms.shape
    gram, sides, own = np.zeros((base, base)), np.zeros((count * k, base)), np.zeros((count, k, k))
    for model in evidence.joints:
        gram += model.plain[model.own + 1 :, model.own + 1 :][:base, :base]
    for j, products in one.own.items():
        own += products.sum(axis=0)
        sides += one.others[j].sum(axis=0)[:, evidence.joints[j].own + 1 :][:, :base]
    return float(np.max(visible(own, sides.reshape(count, k, base), gram), initial=0.0))


def visible(own: Floats, sides: Floats, gram: Floats) -> Floats:
    """Return the largest share of the power of columns that others cannot absorb, (...).

    Args:
        own: products of the columns with each other, (..., k, k).
        sides: and with p others, (..., k, p).
        gram: products of these, (p, p).
    """
    scaled, unit = of_unit_diagonal(gram)
    root = lower_root(scaled + 1e-12 * np.eye(len(unit)))
    Z = forward(root, (sides * unit).reshape(-1, len(unit)).T).T.reshape(sides.shape)
    scale = np.sqrt(np.maximum(np.diagonal(own, axis1=-2, axis2=-1), 1e-300))
    left = (own - Z @ Z.swapaxes(-1, -2)) / scale[..., None] / scale[..., None, :]
    return np.asarray(np.linalg.eigvalsh(left)[..., -1])


@dataclass(frozen=True)
class Gains:
    """What a candidate brings at each of its shapes, everything else being integrated out.

    Attributes:
        log_odds: log Bayes factor, a mixture over sizes, (G,).
        scale: prior size of the part of that mixture with the most evidence, (G,).
        amplitudes: as they are most likely with that prior size, (G, k).
        covariance: of them, (G, k, k).
    """

    log_odds: Floats
    scale: Floats
    amplitudes: Floats
    covariance: Floats


def squares(columns: Floats) -> Floats:
    """Return products of the k columns of each shape with each other, (G, k, k), of (m, G, k)."""
    each = columns.transpose(1, 2, 0)
    return each @ each.swapaxes(1, 2)


def gains(evidence: Evidence, one: Candidate) -> Gains:
    """Return what a candidate brings beside everything in ``evidence``."""
    count, k = one.rms.shape
    t = evidence.width
    U, Q = np.zeros((count, k, k)), np.zeros((count * k, t + 1))
    for j, own in one.own.items():
        model = evidence.joints[j]
        products = np.tensordot(model.weights, one.others[j], 1)
        X = forward(model.root, products[:, : model.own].T)
        U += np.tensordot(model.weights, own, 1) - squares(X.reshape(-1, count, k))
        Q += products[:, model.own :] - X.T @ model.towards
    root, right = evidence.whole
    Z = forward(root, Q[:, 1:].T)
    q = (Q[:, 0] - Z.T @ right).reshape(count, k)
    U -= squares(Z.reshape(t, count, k))
    scales, there = np.array(tuning.SCALES), one.rms > 0
    size = scales[:, None, None] * there / np.where(there, one.rms, 1.0)
    square = size[..., None] * size[..., None, :]
    W = U * square + one.alike
    inverse, v = np.linalg.inv(W), q * size
    best = (inverse @ v[..., None])[..., 0]
    volume = np.linalg.slogdet(W)[1] - np.linalg.slogdet(one.alike)[1]
    odds = 0.5 * np.sum(v * best, axis=2) - 0.5 * volume
    mixed = np.logaddexp.reduce(odds) - np.log(len(scales))
    possible = there.any(axis=1) & ((q[:, 0] > 0) | (not one.place.effect.positive))
    chosen = np.argmax(odds, axis=0), np.arange(count)
    return Gains(
        np.where(possible, mixed, NEVER),
        scales[chosen[0]],
        (size * best)[chosen],
        (inverse * square)[chosen],
    )
