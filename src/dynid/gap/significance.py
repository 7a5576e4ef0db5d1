"""Evidence for a candidate: what it explains beyond the model, at what price, and how sure that is.

Gains are drops of the whitened sum of squares after projection. Tests take their covariance from leaving out one second
at a time, because what an incomplete model leaves is anything but independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.gap.whitened_regression import Board, Ints
from dynid.model.effects.catalogue import joined_motion
from dynid.model.effects.interface import Effect, Floats, Place, Shape

#: Share of a candidate's power that the model must leave; below, these logs cannot show it.
VISIBLE = 1e-5
#: Directions of a candidate's own columns weaker than this share count as absorbed.
ABSORBED = 1e-5


@dataclass
class Candidate:
    """One effect at one place with all its shapes, whitened.

    Attributes:
        effect: the effect.
        place: where.
        shapes: those that are tried, G of them.
        columns: for each joint that it acts on, (G, k, M_j).
        gram: of the columns before projection, (G, k, k).
    """

    effect: Effect
    place: Place
    shapes: list[dict[str, float]]
    columns: dict[int, Floats]
    gram: Floats

    @property
    def key(self) -> tuple[str, Place]:
        """Identifier and place."""
        return self.effect.name, self.place


@dataclass(frozen=True)
class Score:
    """How much one candidate explains at its best shape.

    Attributes:
        gain: drop of the whitened sum of squares.
        price: what its freedom costs.
        index: of the best shape.
        visibility: share of its power that the model cannot absorb.
    """

    gain: float
    price: float
    index: int
    visibility: float

    @property
    def net(self) -> float:
        """Gain after the price."""
        return self.gain - self.price


def columns_of(board: Board, effect: Effect, place: Place, shapes: Sequence[Shape]) -> dict[int, Floats]:
    """Return whitened columns of an effect for several shapes, {joint: (G, k, M_j)}."""
    n = board.stretches[0].motion.n
    rows = effect.rows(place, n)
    parts = []
    for stretch in board.stretches:
        raw = effect.tried(stretch.motion, place, shapes)
        size = [len(x) for x in raw]
        signals = np.concatenate([x.reshape(-1, len(stretch.motion)) for x in raw])
        parts.append(stretch.filtered(signals).reshape(len(shapes), size[0], len(rows), -1))
    return {joint: board.whiten(joint, [part[:, :, r] for part in parts]) for r, joint in enumerate(rows)}


def make_candidate(board: Board, effect: Effect, place: Place) -> list[Candidate]:
    """Return the candidates of an effect at a place: one for each number of columns that its shapes have."""
    shapes = effect.grid(joined_motion([s.motion for s in board.stretches]), place)
    groups: dict[int, list[dict[str, float]]] = {}
    for shape in shapes:
        groups.setdefault(len(effect.amplitudes(shape)), []).append(shape)
    made = []
    for group in groups.values():
        columns = columns_of(board, effect, place, group)
        gram = sum(np.einsum("gkm,glm->gkl", C, C) for C in columns.values())
        made.append(Candidate(effect, place, group, columns, np.asarray(gram)))
    return made


def score(board: Board, candidate: Candidate) -> Score:
    """Return the best of a candidate's shapes."""
    G, b = projected(board, candidate.columns, candidate.gram)
    gains, ranks, shares = _gains(G, b, candidate.gram, candidate.effect.positive)
    best = int(np.argmax(gains))
    samples = max(sum(len(board.e[j]) for j in candidate.columns), 2)
    price = (ranks[best] + len(candidate.effect.steps)) * np.log(samples) + 2 * np.log(len(candidate.shapes))
    return Score(float(gains[best]), float(price), best, float(shares[best]))


def projected(board: Board, columns: dict[int, Floats], gram: Floats) -> tuple[Floats, Floats]:
    """Return Gram matrices after projection, (G, k, k), and products with the residual, (G, k)."""
    count, k = gram.shape[:2]
    P = np.zeros((count * k, board.Q[0].shape[1]))
    b = np.zeros(count * k)
    for joint, C in columns.items():
        flat = C.reshape(count * k, -1)
        P += flat @ board.Q[joint]
        b += flat @ board.e[joint]
    P = P.reshape(count, k, -1)
    return gram - np.einsum("gkp,glp->gkl", P, P), b.reshape(count, k)


def _gains(G: Floats, b: Floats, raw: Floats, positive: bool) -> tuple[Floats, Floats, Floats]:
    """Return gain, number of directions and visible share of each shape, (G,) each."""
    size = np.sqrt(np.diagonal(raw, axis1=1, axis2=2))
    there = np.all(size > 0, axis=1)
    size = np.where(size > 0, size, 1.0)
    values, V = np.linalg.eigh(G / (size[:, :, None] * size[:, None, :]))
    kept = values > ABSORBED
    parts = np.einsum("gkv,gk->gv", V, b / size)
    gains = np.sum(np.where(kept, parts**2 / np.where(kept, values, 1.0), 0.0), axis=1)
    shares = np.where(there, np.maximum(values[:, -1], 0.0), 0.0)
    hopeless = (shares < VISIBLE) | ((b[:, 0] <= 0) if positive else False)
    return np.where(hopeless, 0.0, gains), np.maximum(kept.sum(axis=1), 1), shares


@dataclass(frozen=True)
class Proof:
    """How sure a candidate is.

    Attributes:
        beta: its amplitudes, (k,).
        covariance: of them, from leaving out blocks, (k, k).
        p_value: chance of such amplitudes when there is no effect.
        agreement: chance of such differences between halves of logs when the effect is the same in all.
        visible_rms: root mean square of what it explains on the joint that shows it most, in units of the noise.
        joint: that joint.
        gains: its gain in each block of time, (B,).
    """

    beta: Floats
    covariance: Floats
    p_value: float
    agreement: float
    visible_rms: float
    joint: int
    gains: Floats

    @property
    def chance(self) -> float:
        """Chance of such a gain when there is no effect and the rows are as noisy as they are taken for."""
        from scipy import special

        return float(special.chdtrc(len(self.beta), max(float(self.gains.sum()), 0.0)))


def prove(board: Board, columns: dict[int, Floats]) -> Proof:
    """Test one candidate.

    Args:
        board: the rows.
        columns: of one shape, {joint: (k, M_j)}.
    """
    from scipy import special

    k = len(next(iter(columns.values())))
    P = sum(C @ board.Q[j] for j, C in columns.items())
    blocks: dict[int, list[Floats]] = {}
    logs: dict[int, list[Floats]] = {}
    shares = {}
    pieces = {}
    for j, rows in enumerate(board.joints):
        C = columns.get(j, np.zeros((k, len(rows.y)))) - (board.Q[j] @ np.asarray(P).T).T
        products = np.concatenate(
            [np.einsum("km,lm->mkl", C, C).reshape(len(rows.y), k * k), (C * board.e[j]).T], axis=1
        )
        pieces[j] = C
        for ids, found in ((rows.block, blocks), (_halves(rows.log), logs)):
            if len(ids) == 0:
                continue
            starts = np.flatnonzero(np.diff(ids, prepend=ids[0] - 1))
            for key, value in zip(ids[starts].tolist(), np.add.reduceat(products, starts), strict=True):
                found.setdefault(key, []).append(value)
    G, b = _split([np.sum(blocks[key], axis=0) for key in sorted(blocks)], k)
    scale = np.sqrt(np.maximum(np.diagonal(G.sum(axis=0)), 1e-300))
    G, b = G / np.outer(scale, scale), b / scale
    ridge = 1e-9 * np.eye(k)
    beta = np.linalg.solve(G.sum(axis=0) + ridge, b.sum(axis=0))
    left = np.linalg.solve(G.sum(axis=0) - G + ridge, (b.sum(axis=0) - b)[..., None])[..., 0]
    spread = left - left.mean(axis=0)
    count = len(left)
    covariance = spread.T @ spread * (count - 1) / count
    wald = float(beta @ np.linalg.solve(covariance + 1e-12 * np.trace(covariance) * np.eye(k), beta)) / k
    p_value = float(special.fdtrc(k, max(count - k, 1), wald))
    agreement = _agreement([np.sum(v, axis=0) for v in logs.values()], k, scale, beta, covariance, G.sum(axis=0))
    amplitude = beta / scale
    for j in columns:
        if len(board.e[j]):
            shares[j] = float(np.sqrt(board.noise.count[j] * np.mean((amplitude @ pieces[j]) ** 2)))
    joint = max(shares, key=lambda j: shares[j])
    gains = 2 * b @ beta - np.einsum("k,bkl,l->b", beta, G, beta)
    return Proof(amplitude, covariance / np.outer(scale, scale), p_value, agreement, shares[joint], joint, gains)


def _halves(log: Ints) -> Ints:
    """Return numbers of the first and second half of each log, (M,)."""
    edges = np.searchsorted(log, np.arange(log[-1] + 2)) if len(log) else np.zeros(1, dtype=int)
    middle = (edges[:-1] + edges[1:]) // 2
    return 2 * log + (np.arange(len(log)) >= middle[log]) if len(log) else log


def _split(sums: Sequence[Floats], k: int) -> tuple[Floats, Floats]:
    stacked = np.array(sums)
    return stacked[:, : k * k].reshape(-1, k, k), stacked[:, k * k :]


def _agreement(sums: Sequence[Floats], k: int, scale: Floats, beta: Floats, covariance: Floats, total: Floats) -> float:
    """Return the chance of such differences between parts (Chow's test on the projected columns).

    The covariance of a part's own estimate is the common one, widened as its rows tell less about each amplitude.
    """
    from scipy import special

    if len(sums) < 2:
        return 1.0
    G, b = _split(sums, k)
    statistic, freedom = 0.0, 0
    for one, product in zip(G / np.outer(scale, scale), b / scale, strict=True):
        values, V = np.linalg.eigh(one)
        kept = values > 0.02 * np.trace(total) / k / len(sums)
        for value, v in zip(values[kept], V[:, kept].T, strict=True):
            estimate = float(v @ product) / value
            inflation = float(v @ covariance @ v) * float(v @ total @ v)
            statistic += (estimate - float(v @ beta)) ** 2 * value / max(inflation, 1.0)
            freedom += 1
    freedom -= k
    return float(special.chdtrc(freedom, statistic)) if freedom > 0 else 1.0
