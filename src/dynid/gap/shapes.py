"""An effect over all its shapes, everything else being integrated out: sums on a lattice that closes in on likely ones.

A parabola about the best shape does not do: near reversals there are several peaks, and one says nothing of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.special import softmax

from dynid.arrays import Floats
from dynid.gap import tuning
from dynid.gap.candidates import Candidate, Gains, Place, candidate, gains
from dynid.gap.evidence import Evidence, EvidenceRows
from dynid.model.effects.interface import Effect

#: Beyond the grid, in first steps, that a shape may be.
BEYOND = 1.0
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


@dataclass(frozen=True)
class OverShapes:
    """An effect over its shapes.

    Attributes:
        log_odds: log Bayes factor of all of them.
        best: the best one.
        scale: of the prior of amplitudes there.
        shape: each refined parameter at its mean, in the logarithm where it is refined by factors.
        shape_errors: their errors about it, by name.
        amplitudes: means, (k,).
        covariance: of them, (k, k).
    """

    log_odds: float
    best: dict[str, float]
    scale: float
    shape: dict[str, float]
    shape_errors: dict[str, float]
    amplitudes: Floats
    covariance: Floats


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


def ends_of(effect: Effect, grid: Sequence[dict[str, float]]) -> tuple[Floats, Floats]:
    """Return between what the refined parameters of an effect may be, in units of their first steps, (d,) each.

    Why of its grid: a range belongs to the effect, and does not grow with the shapes that were tried.
    """
    at = np.array([in_steps(effect, each) for each in grid])
    low, high = at.min(axis=0) - BEYOND, at.max(axis=0) + BEYOND
    for k, name in enumerate(effect.steps):
        for end, x in zip((low, high), tuning.RANGES.get((effect.name, name), ()), strict=False):
            end[k] = in_steps(effect, grid[0] | {name: x})[k]
    return low, high


def closer(steps: Floats, wide: Floats, spread: Floats) -> Floats:
    """Return the steps of a lattice along the principal axes of a covariance, (d, d), that lies closer.

    Why along those: speed and sharpness of a hump go together, and points along each of them alone miss the ridge.
    """
    variances, axes = np.linalg.eigh(spread / np.outer(wide, wide))
    least = CLOSER * np.linalg.norm(axes.T @ (steps / wide[:, None]), axis=1)
    half = np.maximum(WIDE * np.sqrt(np.maximum(variances, 0.0)), least)
    return wide[:, None] * axes * (half / HALF)


def resolves(steps: Floats, spread: Floats) -> bool:
    """Return whether the points of a lattice lie close beside a covariance, (d, d), and reach beyond it."""
    within = np.linalg.solve(steps, np.linalg.solve(steps, spread).T)
    close, inside = np.linalg.eigvalsh(within) > RESOLVED**2, np.diag(within) < (HALF / REACH) ** 2
    return bool(close.all() and inside.all())


def over_shapes(
    evidence: Evidence,
    rows: EvidenceRows,
    place: Place,
    best: dict[str, float],
) -> OverShapes:
    """Return an effect over its shapes: those of its grid, or of a lattice where they are refined.

    Args:
        evidence: everything else, sizes of the rest as they are with the effect.
        rows: what is common and the rest.
        place: the effect and where it sits.
        best: its best shape so far.
    """
    effect, names = place.effect, [*place.effect.amplitudes(best)]
    grid = effect.grid(rows.rows.motion, place.joints)
    shapes = [each for each in grid if [*effect.amplitudes(each)] == names]
    low, high = ends_of(effect, grid)
    wide, center = high - low, (low + high) / 2
    # From one point of the lattice to the next, a column for each axis.
    steps = np.diag(wide) / (POINTS - 1)
    lattice = np.array(list(product(np.linspace(-HALF, HALF, POINTS), repeat=len(low))))
    for closing in range(CLOSINGS):
        if effect.steps:
            x = center + lattice @ steps.T
            inside = np.all(np.abs(x - (low + high) / 2) <= wide * (0.5 + 1e-9), axis=1)
            # Why the best shape too: a lattice that is too wide for the peak has no point near it.
            shapes = [*(from_steps(effect, best, y) for y in x[inside]), best]
        gained = gains(evidence, candidate(rows, place, shapes))
        odds = gained.log_odds
        g = int(np.argmax(odds))
        between = odds[-1] > odds[:-1].max(initial=-np.inf) + BETWEEN
        best, count = shapes[g], len(shapes) - bool(effect.steps and not between)
        likely = softmax(odds[:count])
        x = np.array([in_steps(effect, each) for each in shapes[:count]])
        mean = likely @ x
        spread = (x - mean).T @ ((x - mean) * likely[:, None])
        if not effect.steps or closing == CLOSINGS - 1 or (not between and resolves(steps, spread)):
            break
        center, steps = mean, closer(steps, wide, spread)
    # How many of these lie within all that may be.
    points = 1.0 / abs(np.linalg.det(steps / wide[:, None])) if effect.steps else count
    shape, errors = from_steps(effect, best, mean), {}
    for name in effect.steps:
        away = [each[name] - shape[name] for each in shapes[:count]]
        errors[name] = float(np.sqrt(likely @ np.square(away)))
    amplitudes, covariance = mixed(likely, gained)
    return OverShapes(
        log_odds=float(np.logaddexp.reduce(odds[:count]) - np.log(points)),
        best=best,
        scale=float(gained.scale[g]),
        shape=shape,
        shape_errors=errors,
        amplitudes=amplitudes,
        covariance=covariance,
    )


def mixed(weights: Floats, gained: Gains) -> tuple[Floats, Floats]:
    """Return mean and covariance of amplitudes, (k,) and (k, k), of a mixture over shapes with weights, (G,)."""
    sizes, spreads = (x[: len(weights)] for x in (gained.amplitudes, gained.covariance))
    mean = weights @ sizes
    off = sizes - mean
    spread = np.tensordot(weights, spreads, 1) + (off * weights[:, None]).T @ off
    return mean, spread


def integrated(
    evidence: Evidence, rows: EvidenceRows, one: Candidate
) -> tuple[float, dict[str, float], float]:
    """Return the log Bayes factor of an effect over all its shapes, its best shape, and the scale of its prior there.

    Args:
        evidence: what is beside it, its sizes fixed.
        rows: what is common and the rest.
        one: the effect on its grid.
    """
    on_grid, steps = gains(evidence, one), one.place.effect.steps
    best = int(np.argmax(on_grid.log_odds))
    mean = float(np.logaddexp.reduce(on_grid.log_odds) - np.log(len(one.shapes)))
    if not steps or on_grid.log_odds[best] < -1e8:
        return mean, one.shapes[best], float(on_grid.scale[best])
    closed = over_shapes(evidence, rows, one.place, one.shapes[best])
    other = len({tuple(v for name, v in s.items() if name not in steps) for s in one.shapes})
    return max(mean, closed.log_odds - float(np.log(other))), closed.best, closed.scale
