"""Iteratively reweighted least squares (Huber) for torques with spikes, and the test that asks for it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.least_squares import Fit, merge, solve
from dynid.estimation.observation_rows import ObservationRows, joint_factors, robust_noise

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Spikes:
    """What the residuals of a first fit look like.

    Attributes:
        share: share of spikes of each joint, (n,).
        kurtosis: of each joint, 3 for normal residuals, (n,).
    """

    share: Floats
    kurtosis: Floats

    @property
    def found(self) -> bool:
        """Whether the robust fit is worth its small loss of efficiency: many spikes and heavy tails at a joint."""
        return bool(np.any((self.share > tuning.SPIKE_SHARE) & (self.kurtosis > tuning.SPIKE_KURTOSIS)))


def look_for_spikes(rows: Iterable[ObservationRows], theta: Floats) -> Spikes:
    """Look at the residuals of a first fit.

    Args:
        rows: observation rows.
        theta: parameters of the first fit, (p,), each in its unit.

    Returns:
        What they look like.
    """
    noise, count = robust_noise(rows, theta), 0
    moments = np.zeros((5, len(noise)))
    for part in rows:
        scaled = np.ascontiguousarray(part.residual(theta).T) / noise[:, None]
        square = scaled * scaled
        powers = scaled, square, square * scaled, square * square, np.abs(scaled) > tuning.SPIKE_ERRORS
        moments += [np.sum(each, axis=1) for each in powers]
        count = count + part.mask.sum(axis=0)
    one, two, three, four, beyond = moments / np.maximum(count, 1)
    variance = np.maximum(two - one**2, 1e-150)
    fourth = four - 4 * one * three + 6 * one**2 * two - 3 * one**4
    return Spikes(beyond, fourth / variance**2)


def huber(rows: Iterable[ObservationRows], start: Fit, max_rounds: int = 50) -> Fit:
    """Fit with weights min(1, 1.345 sigma / |residual|), iterated (Huber 1981).

    Args:
        rows: observation rows; walked twice per round.
        start: plain fit of the same rows.
        max_rounds: limit of the iteration.

    Returns:
        The fit, with the robust standard deviation of each joint; its covariance is that of white residuals.
    """
    theta, rounds = np.array(start.theta, dtype=float), 0
    while True:
        noise = np.where(start.counts < tuning.NOISE_LEAST_ROWS, start.noise, robust_noise(rows, theta))
        factors, _ = joint_factors(_weighted(rows, theta, noise))
        solution = solve(merge(factors, 1.0 / noise))
        change, theta, rounds = solution.theta - theta, solution.theta, rounds + 1
        moved = np.abs(change) / np.maximum(np.sqrt(np.diagonal(solution.inverse)), 1e-300)
        if moved.max() < 1e-3 or rounds == max_rounds:
            return replace(start, method="irls", theta=theta, noise=noise, covariance=solution.inverse)


def _weighted(rows: Iterable[ObservationRows], theta: Floats, noise: Floats) -> Iterator[ObservationRows]:
    for part in rows:
        root = np.sqrt(huber_weight(part.residual(theta), noise))
        yield replace(part, entries=part.entries * root.T[part.joints], command=None, tau=part.tau * root)


def huber_weight(residual: Floats, noise: Floats) -> Floats:
    """Return min(1, 1.345 sigma / |residual|), (M, n), for residuals (M, n) and noise (n,) in the same unit."""
    return np.minimum(1.0, tuning.HUBER / np.maximum(np.abs(residual / noise), 1e-12))
