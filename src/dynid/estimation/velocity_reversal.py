"""What friction does while a joint reverses, as random effects that take weight from the rows around it.

A joint that reverses creeps and sticks for some milliseconds, at velocities below the encoder's noise. The Coulomb
column is wrong there, each time in the same way, and friction and inertia pay for it. The filter over the rows is much
longer than a reversal: whatever happened, what is left of it in the rows is, to second order, the filter's kernel at
that time and the kernel's slope, of unknown sizes. These are random effects: their variance is found from the
residuals, and rows are weighted by the inverse of the covariance that they make. Where encoders are good enough, little
is taken. Reads rows and the times at which joints reverse. Source: Harville 1977 (variance components).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.least_squares import triangle, weighted
from dynid.estimation.observation_rows import ObservationRows, RowWalk, joined, robust_noise, runs
from dynid.longarrays import median
from dynid.signals.filters import pulse, pulse_slope, pulse_width

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class ReversalSubspace:
    """What reversals may leave in the rows of one joint over one run of rows: M instants, k shapes.

    Attributes:
        basis: orthonormal shapes, (M, k).
        size: length of a reversal's effect along each, of those that are one long, (k,).
        seen: the rows [W tau] along each, (k, p + 1).
    """

    basis: Floats
    size: Floats
    seen: Floats


@dataclass(frozen=True)
class ReversalEffects:
    """What velocity reversals leave in the rows of a log, as random effects with variances.

    Attributes:
        subspaces: of each run of rows and joint.
        strength: variance of a reversal's effect over the variance of the noise there, for each joint, (n,).
    """

    subspaces: tuple[tuple[ReversalSubspace, ...], ...]
    strength: Floats

    def whitened(self, rows: Iterable[ObservationRows]) -> RowWalk:
        """Return the rows times the inverse root of the covariance that noise and reversals give them.

        Args:
            rows: the rows that the effects were found in, or others of the same instants.
        """
        return RowWalk(
            lambda: (_whitened(run, each, self.strength) for run, each in zip(_runs(rows), self.subspaces, strict=True))
        )

    def factors(self, factors: Floats) -> Floats:
        """Return the factors of the whitened rows from those of the rows, (n, p + 1, p + 1) [N m or N]."""
        return np.array(
            [_less(R, [each[j] for each in self.subspaces], self.strength[j]) for j, R in enumerate(factors)]
        )


def reversal_effects(rows: Iterable[ObservationRows], factors: Floats, counts: Ints) -> ReversalEffects | None:
    """Find how much reversals disturb the rows of each joint.

    Args:
        rows: filtered rows.
        factors: their factors, one per joint, (n, p + 1, p + 1) [N m or N].
        counts: number of rows of each joint, (n,).

    Returns:
        The random effects; None when the rows do not say where joints reverse, or are too many.
    """
    first = next(iter(rows), None)
    if first is None or not first.reversal_times or counts.max() > tuning.REVERSALS_LONGEST:
        return None
    subspaces = tuple(tuple(_subspace(run, j) for j in range(len(counts))) for run in _runs(rows))
    flat = max(1.0, 0.5 / (_step(first) * first.cutoff))
    without = ReversalEffects(subspaces, np.full(len(counts), np.inf))
    taken = np.array([sum(len(each[j].size) for each in subspaces) for j in range(len(counts))])
    rest = np.maximum(counts - taken, 1)
    theta = weighted(without.factors(factors), rest).theta
    noise = robust_noise(without.whitened(rows), theta) * np.sqrt(counts / rest)
    return replace(without, strength=_strength(subspaces, theta, noise * np.sqrt(flat)))


def _strength(subspaces: tuple[tuple[ReversalSubspace, ...], ...], theta: Floats, noise: Floats) -> Floats:
    """Return how much larger residuals are in the shapes of reversals than noise makes them, by moments, (n,).

    Args:
        subspaces: of each run of rows and joint.
        theta: parameters that reversals had no part in, (p,).
        noise: along any of the shapes; filtered noise has all its power where they have theirs, (n,) [N m].
    """
    excess, sizes = np.zeros_like(noise), np.zeros_like(noise)
    for run in subspaces:
        for j, each in enumerate(run):
            left = each.seen @ np.append(theta, -1.0) / noise[j]
            excess[j] += float(np.sum(left**2 - 1.0))
            sizes[j] += float(np.sum(each.size**2))
    return np.asarray(np.maximum(excess, 0.0) / np.maximum(sizes, 1e-12))


def _runs(rows: Iterable[ObservationRows]) -> Iterator[ObservationRows]:
    return (joined(run) for run in runs(rows, tuning.REVERSALS_TOGETHER))


def _step(rows: ObservationRows) -> float:
    return float(median(np.diff(rows.t))) if len(rows.t) > 1 else 0.5 / rows.cutoff


def _subspace(rows: ObservationRows, joint: int) -> ReversalSubspace:
    half, times = pulse_width(rows.cutoff), rows.reversal_times[joint]
    times = times[(times > rows.t[0] - half) & (times < rows.t[-1] + half)]
    whole = np.arange(-half, half, _step(rows))
    good, lag = rows.mask[:, joint], rows.t[:, None] - times
    effects = np.hstack([
        shape(lag, rows.cutoff) / np.linalg.norm(shape(whole, rows.cutoff)) for shape in (pulse, pulse_slope)
    ]) * good[:, None]  # fmt: skip
    square, vector = np.linalg.eigh(effects.T @ effects)
    size = np.sqrt(np.maximum(square, 0.0))
    vector, size = vector[:, size > tuning.REVERSALS_SAME], size[size > tuning.REVERSALS_SAME]
    basis = effects @ (vector / size)
    seen, (columns, entries) = np.zeros((len(size), rows.size + 1)), rows.of_joint(joint)
    seen[:, columns], seen[:, -1] = (entries @ basis).T, rows.tau[:, joint] @ basis
    return ReversalSubspace(basis, size, seen)


def _trusted(each: ReversalSubspace, strength: float) -> Floats:
    """Return the share of the rows' weight along each shape that is left, (k,)."""
    return 1.0 / (1.0 + strength * each.size**2)


def _less(R: Floats, subspaces: list[ReversalSubspace], strength: float) -> Floats:
    taken = np.concatenate([each.seen * np.sqrt(1.0 - _trusted(each, strength))[:, None] for each in subspaces])
    length = np.linalg.norm(R, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    scaled, taken = R / length, taken / length
    value, vector = np.linalg.eigh(scaled.T @ scaled - taken.T @ taken)
    return triangle(np.sqrt(np.maximum(value, 0.0))[:, None] * vector.T * length)


def _whitened(rows: ObservationRows, subspaces: tuple[ReversalSubspace, ...], strength: Floats) -> ObservationRows:
    """Multiply the rows by the inverse root of the covariance that noise and reversals give them."""
    tau, counts = np.where(rows.mask, rows.tau, 0.0), rows.mask.T[rows.joints]
    entries, command = (None if x is None else np.where(counts, x, 0.0) for x in (rows.entries, rows.command))
    assert entries is not None
    for j, each in enumerate(subspaces):
        if strength[j] > 0.0 and len(each.size):
            less, own = each.basis * (1.0 - np.sqrt(_trusted(each, strength[j]))), rows.joints == j
            tau[:, j] -= less @ (each.basis.T @ tau[:, j])
            for x in (entries,) if command is None else (entries, command):
                x[own] -= (x[own] @ each.basis) @ less.T
    return replace(rows, entries=entries, command=command, tau=tau)
