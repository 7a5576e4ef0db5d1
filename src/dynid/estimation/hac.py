"""Covariance that allows for coloured residuals, for least squares, Huber weights and instruments alike."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.observation_rows import ObservationRows, joined, runs
from dynid.estimation.robust import HUBER
from dynid.estimation.small_sample import LONGEST, short_log_factor
from dynid.estimation.uncertainty import automatic_lags, long_run_variance, scores

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class HonestCovariance:
    """A HAC covariance.

    Attributes:
        covariance: of the parameters, (p, p).
        lags: memory of the residuals that it allows for, in samples.
    """

    covariance: Floats
    lags: int


def hac_covariance(
    segments: Iterable[ObservationRows],
    theta: Floats,
    noise: Floats,
    lags: int | None = None,
    *,
    robust: bool = False,
    bread: Floats | None = None,
) -> HonestCovariance:
    """Return the covariance of an estimate whose residuals are coloured and correlated between joints.

    Args:
        segments: conditioned rows; instruments are used where they come with them.
        theta: the estimate, (p,).
        noise: standard deviation of each joint that the estimator divided by, (n,) [N m].
        lags: memory of the residuals in samples; None to find it from the scores.
        robust: whether the estimate had Huber weights.
        bread: sensitivity of the estimate to the scores, (p, p), where it was made from more than these rows.

    Returns:
        The covariance and the lags used.
    """
    sensitivity: Floats | float = 0.0
    # Why arrays that grow in place: of a long log, pieces and joined scores would not fit into memory together.
    pulls: list[array[float]] = []
    short: list[ObservationRows] = []
    instants = 0
    for segment in segments:
        residual = segment.residual(theta)
        Z = segment.W if segment.Z is None else segment.Z
        inside = segment.mask & (np.abs(residual) <= HUBER * noise) if robust else segment.mask
        left = (Z * (inside / noise**2)[:, :, None]).reshape(-1, len(theta))
        sensitivity = sensitivity + left.T @ segment.W.reshape(-1, len(theta))
        if not (segment.follows and pulls):
            pulls.append(array("d"))
        bounded = np.clip(residual, -HUBER * noise, HUBER * noise) if robust else residual
        pulls[-1].frombytes(scores(Z, bounded, noise).tobytes())
        instants += len(residual)
        short = [*short, replace(segment, usable=inside)] if instants <= LONGEST else []
    series = [np.frombuffer(pull).reshape(-1, len(theta)) for pull in pulls]
    lags = automatic_lags(series) if lags is None else lags
    scale = 1.0 / np.sqrt(np.abs(np.diagonal(sensitivity)))
    if bread is None:
        bread = scale[:, None] * np.linalg.inv(scale[:, None] * np.asarray(sensitivity) * scale) * scale
    covariance = bread @ long_run_variance(series, lags) @ bread.T
    if instants <= LONGEST:
        factor = short_log_factor([joined(run) for run in runs(short)], bread, noise, lags)
        covariance = covariance * np.outer(factor, factor)
    return HonestCovariance(covariance, lags)
