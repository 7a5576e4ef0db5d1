"""Shapes of an effect, integrated out with its amplitudes: over the grid, near the best one (Laplace), on a lattice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from dynid.arrays import Floats
from dynid.gap import tuning
from dynid.gap.candidates import Candidate, Place, candidate, gains
from dynid.gap.evidence import Evidence, EvidenceRows
from dynid.gap.gap_rows import EffectColumns
from dynid.model.effects.interface import Effect

#: Halvings of the step towards the best shape.
HALVINGS = 6
#: Beyond the grid, in first steps, that a shape may be.
BEYOND = 1.0


def in_steps(effect: Effect, shape: dict[str, float]) -> Floats:
    """Return the refined parameters of a shape in units of their first steps, (d,)."""
    return np.array(
        [
            shape[name] / size if kind == "plus" else np.log(shape[name]) / np.log(size)
            for name, (kind, size) in effect.steps.items()
        ]
    )


def from_steps(effect: Effect, shape: dict[str, float], x: Floats) -> dict[str, float]:
    """Return a shape with its refined parameters given in units of their first steps, (d,)."""
    pairs = zip(effect.steps.items(), x.tolist(), strict=True)
    return shape | {
        name: v * size if kind == "plus" else float(size**v) for (name, (kind, size)), v in pairs
    }


def ends_of(effect: Effect, shapes: Sequence[dict[str, float]]) -> tuple[Floats, Floats]:
    """Return between what the refined parameters of an effect may be, in units of their first steps, (d,) each."""
    grid = np.array([in_steps(effect, shape) for shape in shapes])
    low, high = grid.min(axis=0) - BEYOND, grid.max(axis=0) + BEYOND
    for k, name in enumerate(effect.steps):
        if (effect.name, name) in tuning.RANGES:
            low[k], high[k] = (
                in_steps(effect, shapes[0] | {name: x})[k] for x in tuning.RANGES[effect.name, name]
            )
    return low, high


def integrated(
    evidence: Evidence, rows: EvidenceRows, one: Candidate, added: Sequence[EffectColumns]
) -> tuple[float, dict[str, float], float]:
    """Return the log Bayes factor of an effect over all its shapes, its best shape, and the scale of its prior there.

    Args:
        evidence: what is beside it, its sizes fixed.
        rows: what is common and the rest.
        one: the effect on its grid.
        added: columns that have been added to T, one effect after the other.
    """
    on_grid, effect = gains(evidence, one), one.place.effect
    best = int(np.argmax(on_grid.log_odds))
    top, scale = float(on_grid.log_odds[best]), float(on_grid.scale[best])
    shape = dict(one.shapes[best])
    mean = top + float(np.log(np.mean(np.exp(on_grid.log_odds - top))))
    if not effect.steps or top < -1e8:
        return mean, shape, scale
    # Why of the grid: a range belongs to the effect, and does not grow with the shapes that were tried.
    low, high = ends_of(effect, effect.grid(rows.rows.motion, one.place.joints))
    if not np.all(np.isfinite(low) & np.isfinite(high)):
        return mean, shape, scale
    x, step = in_steps(effect, shape), 1.0
    # Directions in which a parabola is laid through what is near: each alone, and each pair together.
    d, curve = len(x), np.eye(len(x))
    moves = [*curve, *-curve, *(curve[a] + curve[b] for a in range(d) for b in range(a))]
    for _ in range(HALVINGS):
        tried = [np.clip(x + step * move, low, high) for move in moves]
        near = candidate(rows, one.place, [from_steps(effect, shape, y) for y in tried], added)
        if not near.own:
            break
        values = gains(evidence, near)
        odds = values.log_odds
        curve = _curvature(top, odds, d, step)
        k = int(np.argmax(odds))
        if odds[k] > top + 1e-3:
            top, x, scale = float(odds[k]), tried[k], float(values.scale[k])
            continue
        slope = (odds[:d] - odds[d : 2 * d]) / (2 * step)
        newton = np.clip(x + np.clip(np.linalg.solve(curve, slope), -step, step), low, high)
        better = gains(
            evidence, candidate(rows, one.place, [from_steps(effect, shape, newton)], added)
        )
        if better.log_odds[0] > top:
            top, x, scale = float(better.log_odds[0]), newton, float(better.scale[0])
        step *= 0.35
        if np.all(step * np.sqrt(np.diag(curve)) < 0.3):
            break
    volume = 0.5 * (d * np.log(2 * np.pi) - np.linalg.slogdet(curve)[1])
    volume -= np.log(high - low).sum()
    other = len({tuple(v for name, v in s.items() if name not in effect.steps) for s in one.shapes})
    peak = top + min(float(volume), 0.0) - float(np.log(other))
    return max(mean, peak), from_steps(effect, shape, x), scale


def _curvature(top: float, odds: Floats, d: int, step: float) -> Floats:
    """Return minus the second derivatives of log odds at their top, (d, d), positive definite."""
    odds = np.maximum(odds, max(top - 50.0, -1e8))
    up, down, both = odds[:d], odds[d : 2 * d], odds[2 * d :]
    H = np.diag((2 * top - up - down) / step**2)
    a, b = np.tril_indices(d, -1)
    H[a, b] = H[b, a] = (up[a] + up[b] - both - top) / step**2
    values, V = np.linalg.eigh(H)
    return np.asarray((V * np.maximum(values, 1e-2)) @ V.T)


# ---------------------------------------------------------------- how large an effect is
# Means and errors over all its shapes, on a lattice that closes in on those that are likely. A parabola about the best
# shape does not do: near reversals there are several peaks, and one says nothing of the others.
#: Points of a lattice along each axis, and half of what lies between the outermost, in spacings.
POINTS = 9
HALF = (POINTS - 1) / 2
#: Spread of the posterior in spacings of the lattice from which it is resolved; half the width of a lattice in spreads,
#: at least, and that of the next one. A sum over points 1.7 spreads apart is off by less than a percent.
RESOLVED, REACH, WIDE = 0.6, 2.5, 3.0
#: Log odds by which the best shape may beat all points of a lattice that is fine enough.
BETWEEN = 3.0
#: Half the width of the next lattice at least, in spacings of this one, and most lattices.
CLOSER, CLOSINGS = 0.5, 12
#: Shares of the width of reversals within which friction that is gone at speed may turn.
TURNS = (1.0, 0.63, 0.4, 0.25)


@dataclass(frozen=True)
class Sizes:
    """An effect's numbers, everything else being integrated out.

    Attributes:
        shape: its shape, each refined parameter at its mean, in the logarithm where it is refined by factors.
        shape_errors: their errors about it, by name.
        amplitudes: means, (k,).
        covariance: of them, (k, k).
    """

    shape: dict[str, float]
    shape_errors: dict[str, float]
    amplitudes: Floats
    covariance: Floats


@dataclass(frozen=True)
class Lattice:
    """Shapes at equal distances along the principal axes of what is known of them, in units of their first steps.

    Why along those: speed and sharpness of a hump go together, and points along each of them alone miss the ridge.

    Attributes:
        low: least values that the parameters may have, (d,).
        high: largest ones, (d,).
        center: of the lattice, (d,).
        steps: from one point to the next, a column for each axis, (d, d).
    """

    low: Floats
    high: Floats
    center: Floats
    steps: Floats

    def points(self) -> list[Floats]:
        """Return those of its points that may be, each (d,)."""
        along = np.linspace(-HALF, HALF, POINTS)
        every = self.center + np.array(list(product(along, repeat=len(self.center)))) @ self.steps.T
        margin = 1e-9 * (self.high - self.low)
        return [x for x in every if np.all((x >= self.low - margin) & (x <= self.high + margin))]

    def resolves(self, spread: Floats) -> bool:
        """Return whether points lie close beside a covariance, (d, d), in every direction, and reach beyond it."""
        inverse = np.linalg.inv(self.steps)
        within = inverse @ spread @ inverse.T
        return bool(
            np.linalg.eigvalsh(within)[0] > RESOLVED**2
            and np.all(np.diag(within) < (HALF / REACH) ** 2)
        )

    def closer(self, mean: Floats, spread: Floats) -> Lattice:
        """Return a lattice about a mean, (d,), along the axes of a covariance, (d, d)."""
        wide = self.high - self.low
        variances, axes = np.linalg.eigh(spread / np.outer(wide, wide))
        here = axes.T @ (self.steps / wide[:, None])
        half = np.maximum(
            WIDE * np.sqrt(np.maximum(variances, 0.0)), CLOSER * np.linalg.norm(here, axis=1)
        )
        return replace(self, center=mean, steps=wide[:, None] * axes * (half / HALF))


def sizes_of(
    evidence: Evidence,
    rows: EvidenceRows,
    place: Place,
    shape: dict[str, float],
    added: Sequence[EffectColumns],
) -> Sizes:
    """Return the numbers of an effect.

    Args:
        evidence: everything else, sizes of the rest as they are with the effect.
        rows: what is common and the rest.
        place: the effect and where it sits.
        shape: its best shape.
        added: columns of other names that have been added to T.
    """
    effect = place.effect
    ways = turning(rows) if "vs" in effect.steps else [rows]
    names, every = list(effect.amplitudes(shape)), effect.grid(rows.rows.motion, place.joints)
    points = [x for x in every if list(effect.amplitudes(x)) == names]
    lattice = None
    if effect.steps and points:
        low, high = ends_of(effect, points)
        if np.all(np.isfinite(low) & np.isfinite(high)):
            lattice = Lattice(low, high, (low + high) / 2, np.diag(high - low) / (POINTS - 1))
            points = [from_steps(effect, shape, x) for x in lattice.points()]
    for k in range(CLOSINGS):
        # Why the best shape too: a lattice that is too wide for the peak has no point near it.
        tried = [*points, shape]
        gained = [gains(evidence, candidate(way, place, tried, added)) for way in ways]
        odds = np.array([one.log_odds for one in gained])
        between = float(odds[:, -1].max() - odds[:, :-1].max()) > BETWEEN
        count = len(tried) - (lattice is not None and not between)
        points, odds = tried[:count], odds[:, :count]
        weights = np.exp(odds - odds.max())
        weights = weights / weights.sum()
        x = np.array([in_steps(effect, each) for each in points])
        likely = weights.sum(axis=0)
        mean = likely @ x
        spread = (x - mean).T @ ((x - mean) * likely[:, None])
        if lattice is None or (not between and lattice.resolves(spread)) or k == CLOSINGS - 1:
            break
        lattice = lattice.closer(mean, spread)
        points = [from_steps(effect, shape, y) for y in lattice.points()]
    amplitudes = np.array([one.amplitudes[:count] for one in gained])
    size = np.einsum("wg,wgk->k", weights, amplitudes)
    off = amplitudes - size
    covariance = np.array([one.covariance[:count] for one in gained])
    covariance = covariance + off[..., :, None] * off[..., None, :]
    mean_shape = from_steps(effect, shape, mean) if lattice else shape
    errors = {
        name: float(
            np.sqrt(likely @ (np.array([each[name] for each in points]) - mean_shape[name]) ** 2)
        )
        for name in (effect.steps if lattice else ())
    }
    return Sizes(mean_shape, errors, size, np.einsum("wg,wgkl->kl", weights, covariance))


def turning(rows: EvidenceRows) -> list[EvidenceRows]:
    """Return rows in which friction that is an effect turns as wide and as sharply as it may.

    Why not with the sign of the rows: it has been through a filter of the torques, and what is left of a reversal
    there, times a hump, is no filtered hump.
    """
    width = rows.rows.reversal

    def turned(share: float) -> EvidenceRows:
        motions = (
            replace(x, coulomb_sign=np.tanh(x.qd / (share * width))) for x in rows.rows.motions
        )
        return rows.with_rows(replace(rows.rows, motions=tuple(motions)))

    return [turned(share) for share in TURNS]
