"""Everything that may be named, with all its shapes, as products with what is common and each joint's rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.gap import tuning
from dynid.gap.evidence import Evidence, EvidenceRows, Products, forward, lower_root
from dynid.gap.problem import GapProblem
from dynid.gap.selected_effects import Key
from dynid.gap.whitened_regression import EffectColumns, filtered_columns
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.effects.interface import Effect, Floats, Joints

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
    """

    effects: tuple[str, ...] = ()
    joints: tuple[int, ...] = ()
    sure: float = 0.99
    most: int = 3


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

    def columns(self, rows: EvidenceRows, shapes: list[dict[str, float]]) -> dict[int, Floats]:
        """Return the columns of some shapes, {joint: (G, k, F)}, those that are nothing but rounding as zeros."""
        segments = rows.regression.segments
        parts = filtered_columns(segments, self.effect, self.joints, shapes, always=self.always)
        columns = {j: rows.bands.rows(j, part) for j, part in parts.items()}
        largest = np.max([np.abs(C).max(axis=2, initial=0.0) for C in columns.values()], axis=0)
        kept = largest > ROUNDING * largest.max()
        return {j: C * kept[:, :, None] for j, C in columns.items() if C.any()}


@dataclass(frozen=True)
class Candidate:
    """One effect at one place with all its shapes that have the same number of columns.

    Attributes:
        place: the effect and where it sits.
        shapes: those that are tried, G of them.
        own: for each joint, products of its columns with each other, {joint: (B, G, k, k)}.
        others: and with [T, R, torque], {joint: (B, G k, t + r + 1)}.
        rms: of its columns on the joint that shows each most, in units of the noise, (G, k).
        groups: how many candidates of other numbers of columns there are at its place, this one included.
        columns: {joint: (G, k, F)}.
    """

    place: Place
    shapes: list[dict[str, float]]
    own: dict[int, Floats]
    others: dict[int, Floats]
    rms: Floats
    groups: int
    columns: dict[int, Floats]

    def beside(self, rows: EvidenceRows, columns: EffectColumns, at: int) -> Candidate:
        """Return the candidate with its products with further columns of T, at their place."""
        count, others = len(next(iter(columns.values()))), {}
        for j, products in self.others.items():
            bands, flat, _ = products.shape
            more = np.zeros((bands, flat, count))
            if j in columns:
                more = rows.bands.products(self.columns[j].reshape(flat, -1), columns[j])
            others[j] = np.concatenate([products[..., :at], more, products[..., at:]], axis=2)
        return replace(self, others=others)

    def without(self, first: int, last: int) -> Candidate:
        """Return the candidate without its products with some columns of T."""
        others = {j: np.delete(x, np.s_[first:last], axis=2) for j, x in self.others.items()}
        return replace(self, others=others)

    def at(self, g: int) -> tuple[dict[int, Products], Floats]:
        """Return products of the columns of one shape, {joint: (own, others)}, and their rms, 1 for none, (k,)."""
        k = self.rms.shape[1]
        found = {
            j: (own[:, g], self.others[j][:, g * k : (g + 1) * k]) for j, own in self.own.items()
        }
        return found, np.where(self.rms[g] > 0, self.rms[g], 1.0)

    def and_also(self, other: Candidate) -> Candidate:
        """Return the candidate with the shapes of another one of the same effect at the same place."""
        return replace(
            self,
            shapes=[*self.shapes, *other.shapes],
            own={j: np.concatenate([x, other.own[j]], axis=1) for j, x in self.own.items()},
            others={
                j: np.concatenate([x, other.others[j]], axis=1) for j, x in self.others.items()
            },
            rms=np.concatenate([self.rms, other.rms]),
            columns={j: np.concatenate([C, other.columns[j]]) for j, C in self.columns.items()},
        )


def candidate(
    rows: EvidenceRows,
    place: Place,
    shapes: list[dict[str, float]],
    added: Sequence[EffectColumns] = (),
    groups: int = 1,
) -> Candidate:
    """Return a candidate with shapes that have the same number of columns.

    Args:
        rows: what is common and the rest.
        place: the effect and where it sits.
        shapes: to try.
        added: columns that have been added to T, one effect after the other.
        groups: how many candidates the effect has there.
    """
    columns, own, others = place.columns(rows, shapes), {}, {}
    power = np.zeros((len(shapes), len(place.effect.amplitudes(shapes[0]))))
    for j, C in columns.items():
        own[j], others[j] = rows.products(j, C, added)
        count = max(float(rows.bands.counts(j, always=place.always).sum()), 1.0)
        power = np.maximum(power, np.einsum("bgkk->gk", own[j]) / count)
    return Candidate(place, shapes, own, others, np.sqrt(power), groups, columns)


def in_range(effect: Effect, shape: Mapping[str, float]) -> bool:
    """Return whether a shape is one that is judged."""
    ranges = ((value, tuning.RANGES.get((effect.name, name))) for name, value in shape.items())
    return all(ends is None or ends[0] <= value <= ends[1] for value, ends in ranges)


def candidates_of(rows: EvidenceRows, place: Place) -> list[Candidate]:
    """Return the candidates of an effect on its grid: one for each number of columns that its shapes have."""
    groups: dict[int, list[dict[str, float]]] = {}
    for shape in place.effect.grid(rows.regression.motion, place.joints):
        if in_range(place.effect, shape):
            groups.setdefault(len(place.effect.amplitudes(shape)), []).append(shape)
    made = [candidate(rows, place, some, (), len(groups)) for some in groups.values()]
    return [one for one in made if one.own and one.rms.any()]


def places_of(problem: GapProblem, options: SelectionOptions, *, delay: bool) -> list[Place]:
    """Return every effect that is worth a look, with every joint, pair of joints or arm that it may sit on.

    What may have changed stands beside what may always have been missing.

    Args:
        problem: what is searched.
        options: which effects are tried, and where.
        delay: whether a delay is tried.
    """
    moves = np.sum([s.use.sum(axis=0) for s in problem.segments], axis=0) > 0
    earlier = not all(s.is_new for s in problem.segments)
    return [
        Place(effect, joints, always)
        for effect in CATALOGUE.values()
        if delay or effect.name != "torque_delay"
        for joints in effect.candidate_joints(problem.base.robot.n)
        for always in ((False, True) if earlier else (False,))
        if ("frozen" if problem.since and not always else "refit") in effect.uses
        if not always or effect.name != "torque_delay"
        if not options.effects or effect.name in options.effects
        if not joints or ((not options.joints or joints[0] in options.joints) and moves[joints[0]])
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
    gram = np.asarray(sum(model.gram[:base, :base] for model in evidence.joints))
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    root = lower_root(gram / np.outer(size, size) + 1e-12 * np.eye(base))
    P = np.asarray(sum(x[..., :base].sum(axis=0) for x in one.others.values())) / size
    Z = forward(root, P.T).reshape(base, count, k)
    raw = np.asarray(sum(x.sum(axis=0) for x in one.own.values()))
    own = np.sqrt(np.maximum(np.diagonal(raw, axis1=1, axis2=2), 1e-300))
    left = (raw - np.einsum("mgk,mgl->gkl", Z, Z)) / own[:, :, None] / own[:, None, :]
    return float(np.max(np.linalg.eigvalsh(left)[np.any(one.rms > 0, axis=1), -1], initial=0.0))


def likeness(own: Floats) -> Floats:
    """Return how alike the columns of an effect are: correlations of their products, (..., k, k).

    The prior of amplitudes has them, so that it is about torques and not about columns (Zellner 1986): q, q^2 and q^3
    on one side of zero are nearly one column, and three priors of it would make a line dearer than a cubic.
    """
    size = np.sqrt(np.maximum(np.diagonal(own, axis1=-2, axis2=-1), 1e-300))
    found = own / size[..., :, None] / size[..., None, :]
    return np.asarray(np.where(np.eye(own.shape[-1], dtype=bool), 1.0 + tuning.ALIKE, found))


def prior_precision(products: Mapping[int, Products], strength: Floats) -> Floats:
    """Return the prior precision of amplitudes, (k, k), of columns of so much rms over their prior size, (k,)."""
    whole = np.sum([own.sum(axis=0) for own, _ in products.values()], axis=0)
    return np.asarray(likeness(whole) * np.outer(strength, strength))


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


def gains(evidence: Evidence, one: Candidate) -> Gains:
    """Return what a candidate brings beside everything in ``evidence``."""
    count, k = one.rms.shape
    t = evidence.width
    U, Q = np.zeros((count, k, k)), np.zeros((count * k, t + 1))
    for j, own in one.own.items():
        part = evidence.parts[j]
        products = np.tensordot(part.weights, one.others[j], 1)
        r = len(part.root)
        X = forward(part.root, products[:, t : t + r].T)
        Xs = X.reshape(r, count, k)
        U += np.tensordot(part.weights, own, 1) - np.einsum("mgk,mgl->gkl", Xs, Xs)
        Q += products[:, np.r_[0:t, t + r]] - X.T @ part.towards
    root, right = evidence.whole
    Z = forward(root, Q[:, :-1].T)
    q = (Q[:, -1] - Z.T @ right).reshape(count, k)
    Z = Z.reshape(t, count, k)
    U = U - np.einsum("mgk,mgl->gkl", Z, Z)
    there = np.any(one.rms > 0, axis=1)
    unit = np.where(one.rms > 0, 1.0 / np.where(one.rms > 0, one.rms, 1.0), 0.0)
    alike = likeness(np.asarray(sum(own.sum(axis=0) for own in one.own.values())))
    volume = np.linalg.slogdet(alike)[1]
    odds = np.full((len(tuning.SCALES), count), NEVER)
    found = np.zeros((len(tuning.SCALES), count, k))
    spread = np.zeros((len(tuning.SCALES), count, k, k))
    for s, scale in enumerate(tuning.SCALES):
        size = scale * unit
        W = U * size[:, :, None] * size[:, None, :] + alike
        v = q * size
        inverse = np.linalg.inv(W)
        best = np.einsum("gkl,gl->gk", inverse, v)
        found[s], spread[s] = size * best, inverse * size[:, :, None] * size[:, None, :]
        odds[s] = 0.5 * np.sum(v * best, axis=1) - 0.5 * (np.linalg.slogdet(W)[1] - volume)
    possible = there & ((q[:, 0] > 0) if one.place.effect.positive else True)
    top = odds.max(axis=0)
    mixed = top + np.log(np.mean(np.exp(odds - top), axis=0))
    chosen = odds.argmax(axis=0), np.arange(count)
    scales = np.array(tuning.SCALES)[chosen[0]]
    return Gains(np.where(possible, mixed, NEVER), scales, found[chosen], spread[chosen])
