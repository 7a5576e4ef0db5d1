"""Everything that may be named, with all its shapes, as products with what is common and each joint's rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.gap import tuning
from dynid.gap.evidence import Evidence, EvidenceRows, forward, lower_root
from dynid.gap.significance import Key, whitened_columns
from dynid.gap.whitened_regression import EffectColumns
from dynid.model.effects.interface import Effect, Floats, Joints

#: Log Bayes factor of what cannot be.
NEVER = -1e9
#: Rms of a column beside the effect's largest below which it is rounding: a force along an axis turns no joint.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Candidate:
    """One effect at one place with all its shapes that have the same number of columns.

    Attributes:
        effect: the effect.
        joints: where it sits.
        shapes: those that are tried, G of them.
        own: for each joint, products of its columns with each other, {joint: (G, k, k)}.
        others: and with [T, R, torque], {joint: (G k, t + r + 1)}.
        rms: of its columns on the joint that shows each most, in units of the noise, (G, k).
        groups: how many candidates of other numbers of columns there are at its place, this one included.
        columns: whitened columns, {joint: (G, k, M)}; none where they are not kept.
    """

    effect: Effect
    joints: Joints
    shapes: list[dict[str, float]]
    own: dict[int, Floats]
    others: dict[int, Floats]
    rms: Floats
    groups: int
    columns: dict[int, Floats]

    def beside(self, columns: EffectColumns, at: int) -> Candidate:
        """Return the candidate with its products with further columns of T, at their place."""
        others = {}
        for j, products in self.others.items():
            C = self.columns[j].reshape(len(products), -1)
            more = (
                C @ columns[j].T
                if j in columns
                else np.zeros((len(products), len(next(iter(columns.values())))))
            )
            others[j] = np.concatenate([products[:, :at], more, products[:, at:]], axis=1)
        return replace(self, others=others)

    def without(self, first: int, last: int) -> Candidate:
        """Return the candidate without its products with some columns of T."""
        return replace(
            self,
            others={j: np.delete(x, np.s_[first:last], axis=1) for j, x in self.others.items()},
        )

    def at(self, g: int) -> tuple[dict[int, tuple[Floats, Floats]], Floats]:
        """Return products of the columns of one shape, {joint: (own, others)}, and their rms, 1 for none, (k,)."""
        count, k = self.rms.shape
        found = {
            j: (own[g], self.others[j].reshape(count, k, -1)[g]) for j, own in self.own.items()
        }
        return found, np.where(self.rms[g] > 0, self.rms[g], 1.0)

    def and_also(self, other: Candidate) -> Candidate:
        """Return the candidate with the shapes of another one of the same effect at the same place."""
        return replace(
            self,
            shapes=[*self.shapes, *other.shapes],
            own={j: np.concatenate([own, other.own[j]]) for j, own in self.own.items()},
            others={j: np.concatenate([x, other.others[j]]) for j, x in self.others.items()},
            rms=np.concatenate([self.rms, other.rms]),
            columns={j: np.concatenate([C, other.columns[j]]) for j, C in self.columns.items()},
        )

    @property
    def key(self) -> Key:
        """Identifier and joints."""
        return self.effect.name, self.joints


def candidate(
    rows: EvidenceRows,
    effect: Effect,
    joints: Joints,
    shapes: list[dict[str, float]],
    added: Sequence[EffectColumns] = (),
    groups: int = 1,
    *,
    keep: bool = False,
) -> Candidate:
    """Return a candidate with shapes that have the same number of columns.

    Args:
        rows: what is common and the rest.
        effect: the effect.
        joints: where it sits.
        shapes: to try.
        added: columns that have been added to T, one effect after the other.
        groups: how many candidates the effect has there.
        keep: whether its columns are kept.
    """
    regression = rows.regression
    columns = without_rounding(whitened_columns(regression, effect, joints, shapes))
    count, k = len(shapes), len(effect.amplitudes(shapes[0]))
    own, others, kept = {}, {}, {}
    power = np.zeros((count, k))
    for j, C in columns.items():
        flat = C.reshape(count * k, -1)
        if not flat.shape[1] or not flat.any():
            continue
        own[j] = C @ C.transpose(0, 2, 1)
        more = [
            flat @ one[j].T if j in one else np.zeros((len(flat), len(next(iter(one.values())))))
            for one in added
        ]
        y = (flat @ regression.joints[j].y)[:, None]
        others[j] = np.concatenate([flat @ rows.T[j], *more, flat @ rows.R[j], y], axis=1)
        if keep:
            kept[j] = C
        power = np.maximum(power, np.einsum("gkk->gk", own[j]) / flat.shape[1])
    return Candidate(effect, joints, shapes, own, others, np.sqrt(power), groups, kept)


def without_rounding(columns: dict[int, Floats]) -> dict[int, Floats]:
    """Return columns of shapes, {joint: (G, k, M)}, those that are nothing but rounding as zeros."""
    largest = np.max([np.abs(C).max(axis=2, initial=0.0) for C in columns.values()], axis=0)
    kept = largest > ROUNDING * largest.max()
    return columns if kept.all() else {j: C * kept[:, :, None] for j, C in columns.items()}


def in_range(effect: Effect, shape: Mapping[str, float]) -> bool:
    """Return whether a shape is one that is judged."""
    ranges = ((value, tuning.RANGES.get((effect.name, name))) for name, value in shape.items())
    return all(ends is None or ends[0] <= value <= ends[1] for value, ends in ranges)


def candidates_of(rows: EvidenceRows, wanted: Sequence[tuple[Effect, Joints]]) -> list[Candidate]:
    """Return all candidates that the rows show at all, each on its grid."""
    found = []
    for effect, joints in wanted:
        groups: dict[int, list[dict[str, float]]] = {}
        for shape in effect.grid(rows.regression.motion, joints):
            if in_range(effect, shape):
                groups.setdefault(len(effect.amplitudes(shape)), []).append(shape)
        made = [
            candidate(rows, effect, joints, some, (), len(groups), keep=True)
            for some in groups.values()
        ]
        found += [one for one in made if one.own and one.rms.any()]
    return found


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
    P = np.asarray(sum(products[:, :base] for products in one.others.values())) / size
    Z = forward(root, P.T).reshape(base, count, k)
    raw = np.asarray(sum(one.own.values()))
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
    raw = np.zeros((count, k, k))
    for j, own in one.own.items():
        part, products = evidence.parts[j], one.others[j]
        r = len(part.root)
        X = forward(part.root, part.scale * products[:, t : t + r].T)
        Xs = X.reshape(r, count, k)
        raw += part.scale * own
        U -= np.einsum("mgk,mgl->gkl", Xs, Xs)
        Q += part.scale * products[:, np.r_[0:t, t + r]] - X.T @ part.towards
    root, right = evidence.whole
    Z = forward(root, Q[:, :-1].T)
    q = (Q[:, -1] - Z.T @ right).reshape(count, k)
    Z = Z.reshape(t, count, k)
    U = U + raw - np.einsum("mgk,mgl->gkl", Z, Z)
    there = np.any(one.rms > 0, axis=1)
    unit = np.where(one.rms > 0, 1.0 / np.where(one.rms > 0, one.rms, 1.0), 0.0)
    alike = likeness(np.asarray(sum(one.own.values())))
    volume = np.linalg.slogdet(alike)[1]
    odds = np.full((len(tuning.SCALES), count), NEVER)
    found, spread = (
        np.zeros((len(tuning.SCALES), count, k)),
        np.zeros((len(tuning.SCALES), count, k, k)),
    )
    for s, scale in enumerate(tuning.SCALES):
        size = scale * unit
        W = U * size[:, :, None] * size[:, None, :] + alike
        v = q * size
        inverse = np.linalg.inv(W)
        best = np.einsum("gkl,gl->gk", inverse, v)
        found[s], spread[s] = size * best, inverse * size[:, :, None] * size[:, None, :]
        odds[s] = 0.5 * np.sum(v * best, axis=1) - 0.5 * (np.linalg.slogdet(W)[1] - volume)
    possible = there & ((q[:, 0] > 0) if one.effect.positive else True)
    top = odds.max(axis=0)
    mixed = top + np.log(np.mean(np.exp(odds - top), axis=0))
    chosen = odds.argmax(axis=0), np.arange(count)
    scales = np.array(tuning.SCALES)[chosen[0]]
    return Gains(np.where(possible, mixed, NEVER), scales, found[chosen], spread[chosen])
