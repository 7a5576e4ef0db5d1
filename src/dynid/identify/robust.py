"""Iteratively reweighted least squares (Huber) for torques with spikes, and the test that asks for it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.identify.least_squares import Solution, merge, solve
from dynid.identify.segments import Segment, joint_factors

Floats = NDArray[np.float64]

#: Residual, in robust standard deviations, from which on its weight falls; 95 % efficient without spikes (Huber 1981).
HUBER = 1.345
#: A residual beyond this many robust standard deviations is a spike; 2 in 10^9 of normal ones are.
SPIKE = 6.0
#: Share of spikes and kurtosis from which on the robust fit is used. Coloured but spike-free residuals of arms reach
#: a kurtosis of 5; one percent of spikes gives 20 and more.
SPIKE_SHARE, KURTOSIS = 1e-3, 8.0


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
        return bool(np.any((self.share > SPIKE_SHARE) & (self.kurtosis > KURTOSIS)))


@dataclass(frozen=True)
class RobustFit:
    """A fit in which spikes have little weight.

    Attributes:
        theta: parameters, (p,).
        noise: robust standard deviation of each joint, (n,) [N m].
        down_weighted: share of samples of each joint that lost weight, (n,).
        solution: rank and condition numbers of the weighted rows.
        rounds: number of reweightings.
    """

    theta: Floats
    noise: Floats
    down_weighted: Floats
    solution: Solution
    rounds: int


def look_for_spikes(segments: Iterable[Segment], theta: Floats) -> Spikes:
    """Look at the residuals of a first fit.

    Args:
        segments: conditioned rows.
        theta: parameters of the first fit, (p,).

    Returns:
        What they look like.
    """
    residual = np.concatenate([segment.residual(theta) for segment in segments])
    scaled = residual / robust_noise(residual)
    centred = residual - residual.mean(axis=0)
    variance = np.maximum(np.mean(centred**2, axis=0), np.finfo(float).tiny)
    return Spikes(np.mean(np.abs(scaled) > SPIKE, axis=0), np.mean(centred**4, axis=0) / variance**2)


def robust_noise(residual: Floats) -> Floats:
    """Return the standard deviation that the middle of each column suggests, (N, n) -> (n,)."""
    spread = 1.4826 * np.median(np.abs(residual), axis=0)
    return np.asarray(np.maximum(spread, 1e-12 * max(float(np.abs(residual).max(initial=0.0)), 1e-30)))


def huber(segments: Iterable[Segment], start: Floats, max_rounds: int = 50) -> RobustFit:
    """Fit with weights min(1, 1.345 sigma / |residual|), iterated.

    Args:
        segments: conditioned rows; walked once a round.
        start: parameters of a plain fit, (p,).
        max_rounds: limit of the iteration.

    Returns:
        The fit.
    """
    theta, rounds = np.array(start, dtype=float), 0
    while True:
        residuals = [segment.residual(theta) for segment in segments]
        noise = robust_noise(np.concatenate(residuals))
        weights = [np.minimum(1.0, HUBER / np.maximum(np.abs(e / noise), 1e-12)) for e in residuals]
        factors, _ = joint_factors(_weigh(segment, w) for segment, w in zip(segments, weights, strict=True))
        solution = solve(merge(factors, 1.0 / noise))
        change, theta, rounds = solution.theta - theta, solution.theta, rounds + 1
        moved = np.abs(change) / np.maximum(np.sqrt(np.diagonal(solution.inverse)), 1e-300)
        if moved.max() < 1e-3 or rounds == max_rounds:
            share = np.mean(np.concatenate(weights) < 1.0, axis=0)
            return RobustFit(theta, noise, np.asarray(share), solution, rounds)


def _weigh(segment: Segment, weight: Floats) -> Segment:
    root = np.sqrt(weight)
    return Segment(segment.W * root[:, :, None], segment.tau * root)
