"""Evidence for a candidate: what it explains beyond the model, at what penalty, and how sure that is.

Gains are drops of the whitened sum of squares after projection. Tests take their covariance from leaving out one block
of time after the other, because what an incomplete model leaves is anything but independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dynid.gap.whitened_regression import EffectColumns, Ints, WhitenedRegression, few
from dynid.model.effects.interface import Effect, Floats, Joints, Shape

#: Identifier and joints of a candidate.
Key = tuple[str, Joints]


@dataclass(frozen=True)
class EffectCandidate:
    """One effect on one joint, pair of joints or arm with all its shapes, whitened.

    Attributes:
        effect: the effect.
        joints: where it sits.
        shapes: those that are tried, G of them.
        columns: for each joint that it acts on, (G, k, M_j).
        gram: of the columns before projection, (G, k, k).
        products: of the columns with those of the baseline and with the torques, over all joints, (G, k, p + c + 1);
            they are the same whatever else is fitted.
    """

    effect: Effect
    joints: Joints
    shapes: list[dict[str, float]]
    columns: dict[int, Floats]
    gram: Floats
    products: Floats

    @property
    def key(self) -> Key:
        """Identifier and joints."""
        return self.effect.name, self.joints


@dataclass(frozen=True)
class CandidateScore:
    """How much one candidate explains at its best shape.

    Attributes:
        gain: drop of the whitened sum of squares.
        penalty: what its freedom costs (BIC), and the number of shapes that were tried.
        index: of the best shape.
        visibility: share of its power that the model cannot absorb.
    """

    gain: float
    penalty: float
    index: int
    visibility: float

    @property
    def score(self) -> float:
        """Gain less penalty."""
        return self.gain - self.penalty


def whitened_columns(
    regression: WhitenedRegression, effect: Effect, joints: Joints, shapes: Sequence[Shape]
) -> dict[int, Floats]:
    """Return whitened columns of an effect for several shapes, {joint: (G, k, M_j)}."""
    rows = effect.rows(joints, regression.segments[0].motion.n)
    parts = []
    for segment in regression.segments:
        # Why nothing where no row counts either: motion that is held out takes as long as motion that is searched.
        if not segment.is_new or not segment.use[:, list(rows)].any():
            count = len(effect.amplitudes(shapes[0]))
            parts.append(np.zeros((len(shapes), count, len(rows), len(segment))))
            continue
        raw = effect.tried(segment.motion, joints, shapes)
        shape, flat = (
            (len(shapes), len(raw[0]), len(rows), -1),
            [x.reshape(-1, len(segment.motion)) for x in raw],
        )
        # Why shape by shape where they are long: a filter takes five times the memory of what it is given.
        together = few(regression.segments)
        kept = (
            segment.filtered(np.concatenate(flat))
            if together
            else np.concatenate(list(map(segment.filtered, flat)))
        )
        parts.append(kept.reshape(shape))
    return {
        joint: regression.whiten(joint, [part[:, :, r] for part in parts])
        for r, joint in enumerate(rows)
    }


def candidate_of(
    regression: WhitenedRegression, effect: Effect, joints: Joints, shapes: list[dict[str, float]]
) -> EffectCandidate:
    """Return a candidate with shapes that have the same number of columns."""
    columns = whitened_columns(regression, effect, joints, shapes)
    gram = np.asarray(sum(np.einsum("gkm,glm->gkl", C, C) for C in columns.values()))
    products = np.zeros((*gram.shape[:2], regression.size + 1))
    for joint, C in columns.items():
        rows = regression.joints[joint]
        products[..., :-1] += (C.reshape(gram[..., 0].size, -1) @ rows.A).reshape(
            *gram.shape[:2], -1
        )
        products[..., -1] += C @ rows.y
    return EffectCandidate(effect, joints, shapes, columns, gram, products)


def candidates_at(
    regression: WhitenedRegression, effect: Effect, joints: Joints
) -> list[EffectCandidate]:
    """Return the candidates of an effect on its grid: one for each number of columns that its shapes have."""
    shapes = effect.grid(regression.motion, joints)
    groups: dict[int, list[dict[str, float]]] = {}
    for shape in shapes:
        groups.setdefault(len(effect.amplitudes(shape)), []).append(shape)
    return [candidate_of(regression, effect, joints, group) for group in groups.values()]


def score_candidate(regression: WhitenedRegression, candidate: EffectCandidate) -> CandidateScore:
    """Return how much the best of a candidate's shapes explains."""
    G, b = _projected(regression, candidate)
    gains, ranks, shares = _gains(
        G, b, candidate.gram, regression.absorbed, candidate.effect.positive
    )
    best = int(np.argmax(gains))
    samples = max(sum(len(regression.fit.e[j]) for j in candidate.columns), 2)
    penalty = (ranks[best] + len(candidate.effect.steps)) * np.log(samples) + 2 * np.log(
        len(candidate.shapes)
    )
    return CandidateScore(float(gains[best]), float(penalty), best, float(shares[best]))


def _projected(regression: WhitenedRegression, candidate: EffectCandidate) -> tuple[Floats, Floats]:
    """Return Gram matrices after projection, (G, k, k), and products with the residual, (G, k)."""
    fit = regression.fit
    count, k, width = candidate.products.shape
    flat = candidate.products.reshape(count * k, width)
    all_products = np.zeros((count * k, len(fit.theta)))
    all_products[:, : width - 1] = flat[:, :-1]
    if regression.effects:
        columns = {joint: C.reshape(count * k, -1) for joint, C in candidate.columns.items()}
        all_products = regression.with_products(all_products, columns)
    P = (all_products @ fit.root).reshape(count, k, -1)
    b = flat[:, -1] - all_products @ fit.theta
    return candidate.gram - P @ P.transpose(0, 2, 1), b.reshape(count, k)


def _gains(
    G: Floats, b: Floats, raw: Floats, absorbed: float, positive: bool
) -> tuple[Floats, Floats, Floats]:
    """Return gain, number of directions and visible share of each shape, (G,) each."""
    size = np.sqrt(np.diagonal(raw, axis1=1, axis2=2))
    there = np.all(size > 0, axis=1)
    size = np.where(size > 0, size, 1.0)
    values, V = np.linalg.eigh(G / (size[:, :, None] * size[:, None, :]))
    kept = values > absorbed
    parts = np.einsum("gkv,gk->gv", V, b / size)
    gains = np.sum(np.where(kept, parts**2 / np.where(kept, values, 1.0), 0.0), axis=1)
    shares = np.where(there, np.maximum(values[:, -1], 0.0), 0.0)
    hopeless = (shares < absorbed) | ((b[:, 0] <= 0) if positive else False)
    return np.where(hopeless, 0.0, gains), np.maximum(kept.sum(axis=1), 1), shares


@dataclass(frozen=True)
class SignificanceTest:
    """How sure a candidate is.

    Attributes:
        amplitudes: of its columns, (k,).
        covariance: of them, from leaving out blocks of time (jackknife), (k, k).
        p_value: chance of such amplitudes when there is no effect (Wald test with that covariance).
        chow_p_value: chance of such differences between halves of logs when the effect is the same in all.
        visible_rms: root mean square of what it explains on the joint that shows it most, in units of the noise.
        joint: that joint.
        gains: its gain in each block of time, (B,).
        known: its gain in rows of no time, those of a prior.
        open: covariance of the amplitudes that rows and prior together leave, (k, k).
    """

    amplitudes: Floats
    covariance: Floats
    p_value: float
    chow_p_value: float
    visible_rms: float
    joint: int
    gains: Floats
    known: float = 0.0
    open: Floats = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def gain(self) -> float:
        """Drop of the whitened sum of squares."""
        return float(self.gains.sum()) + self.known

    @property
    def gain_p_value(self) -> float:
        """Chance of such a gain when there is no effect and the rows are as noisy as they are taken for."""
        from scipy import special

        return float(special.chdtrc(len(self.amplitudes), max(self.gain, 0.0)))


def significance_test(regression: WhitenedRegression, columns: EffectColumns) -> SignificanceTest:
    """Test one candidate.

    Args:
        regression: the rows.
        columns: of one shape, {joint: (k, M_j)}.
    """
    from scipy import special

    fit = regression.fit
    k = len(next(iter(columns.values())))
    P = regression.products(columns) @ fit.root
    weights = fit.root @ P.T
    blocks: dict[int, list[Floats]] = {}
    halves: dict[int, list[Floats]] = {}
    projected = {}
    for j, rows in enumerate(regression.joints):
        C = -regression.combined(j, weights).T
        if j in columns:
            C += columns[j]
        products = np.concatenate(
            [np.einsum("km,lm->mkl", C, C).reshape(len(rows.y), k * k), (C * fit.e[j]).T], axis=1
        )
        projected[j] = C
        _add_sums(blocks, rows.block, products)
        _add_sums(halves, _halves(rows.log), products)
    G, b = _normal_equations([np.sum(blocks[key], axis=0) for key in sorted(blocks)], k)
    known = regression.prior_products(P)
    whole, right = G.sum(axis=0) + known[:, :k], b.sum(axis=0) + known[:, k]
    scale = np.sqrt(np.maximum(np.diagonal(whole), 1e-200))
    G, b, right = G / np.outer(scale, scale), b / scale, right / scale
    whole = whole / np.outer(scale, scale) + 1e-9 * np.eye(k)
    beta = np.linalg.solve(whole, right)
    # Why the prior always stays: it is no stretch of time.
    without = np.linalg.solve(whole - G, (right - b)[..., None])[..., 0]
    spread = without - without.mean(axis=0)
    count = len(without)
    covariance = spread.T @ spread * (count - 1) / count
    wald = (
        float(beta @ np.linalg.solve(covariance + 1e-12 * np.trace(covariance) * np.eye(k), beta))
        / k
    )
    p_value = float(special.fdtrc(k, max(count - k, 1), wald))
    parts = _normal_equations([np.sum(v, axis=0) for v in halves.values()], k)
    chow = _chow_p_value(
        parts[0] / np.outer(scale, scale), parts[1] / scale, beta, covariance, whole
    )
    amplitudes = beta / scale
    visible = {
        j: float(np.sqrt(regression.noise.count[j] * np.mean((amplitudes @ projected[j]) ** 2)))
        for j in (projected if regression.link_prior else columns)
        if len(fit.e[j])
    }
    joint = max(visible, key=lambda j: visible[j])
    gains = 2 * b @ beta - np.einsum("k,bkl,l->b", beta, G, beta)
    prior = 2 * known[:, k] @ amplitudes - amplitudes @ known[:, :k] @ amplitudes
    left = np.linalg.inv(whole) / np.outer(scale, scale)
    covariance = covariance / np.outer(scale, scale)
    return SignificanceTest(
        amplitudes,
        covariance,
        p_value,
        chow,
        visible[joint],
        joint,
        gains,
        float(prior),
        np.asarray(left),
    )


def _add_sums(sums: dict[int, list[Floats]], ids: Ints, products: Floats) -> None:
    """Add the sum of products over each run of equal numbers to those of the number."""
    if len(ids):
        starts = np.flatnonzero(np.diff(ids, prepend=ids[0] - 1))
        for key, value in zip(ids[starts].tolist(), np.add.reduceat(products, starts), strict=True):
            sums.setdefault(key, []).append(value)


def _halves(log: Ints) -> Ints:
    """Return numbers of the first and second half of each log, (M,)."""
    edges = np.searchsorted(log, np.arange(log[-1] + 2)) if len(log) else np.zeros(1, dtype=int)
    middle = (edges[:-1] + edges[1:]) // 2
    return 2 * log + (np.arange(len(log)) >= middle[log]) if len(log) else log


def _normal_equations(sums: Sequence[Floats], k: int) -> tuple[Floats, Floats]:
    """Return Gram matrices, (B, k, k), and products with the residual, (B, k), of sums that hold both."""
    stacked = np.array(sums)
    return stacked[:, : k * k].reshape(-1, k, k), stacked[:, k * k :]


def _chow_p_value(G: Floats, b: Floats, beta: Floats, covariance: Floats, total: Floats) -> float:
    """Return the chance of such differences between parts (Chow's test on the projected columns).

    The covariance of a part's own estimate is the common one, widened as its rows tell less about each amplitude.
    """
    from scipy import special

    if len(G) < 2:
        return 1.0
    statistic, freedom = 0.0, -len(beta)
    for one, product in zip(G, b, strict=True):
        values, V = np.linalg.eigh(one)
        kept = values > 0.02 * np.trace(total) / len(beta) / len(G)
        for value, v in zip(values[kept], V[:, kept].T, strict=True):
            estimate = float(v @ product) / value
            inflation = float(v @ covariance @ v) * float(v @ total @ v)
            statistic += (estimate - float(v @ beta)) ** 2 * value / max(inflation, 1.0)
            freedom += 1
    return float(special.chdtrc(freedom, statistic)) if freedom > 0 else 1.0
