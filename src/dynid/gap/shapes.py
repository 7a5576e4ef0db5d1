"""Shapes of an effect are integrated out with its amplitudes: over the grid, or about the best shape (Laplace)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.arrays import Floats
from dynid.gap import tuning
from dynid.gap.candidates import Candidate, candidate, gains
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
