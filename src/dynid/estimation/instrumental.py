"""Instrumental variables: parameters without the bias that encoder noise gives to least squares.

Least squares correlates the regressor's own noise with the torque's and shrinks the parameters. Instruments Z are the
same regressor on a motion that knows no measurement noise: the commanded one (IV-ref), or a simulated one (IDIM-IV).

    theta = (Z^T S W)^-1 Z^T S tau,   S = 1 / noise^2 of each joint

Source: Janot, Vandanjon, Gautier 2014, "A generic instrumental variable approach for industrial robot identification".
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.errors import RankDeficient
from dynid.estimation.hac import hac_covariance
from dynid.estimation.observation_rows import ObservationRows, robust_noise, root_mean_square
from dynid.estimation.robust import huber_weight

Floats = NDArray[np.float64]

#: Condition number of the column-normalised Z^T S W beyond which the instruments say nothing.
WORST_CONDITION = 1e12


@dataclass(frozen=True)
class InstrumentalFit:
    """An instrumental-variable estimate with honest errors.

    Attributes:
        theta: parameters, (p,).
        covariance: HAC covariance, (p, p).
        noise: standard deviation of each joint's residual, (n,) [N m].
        lags: memory of the residuals that the covariance allows for, in samples.
        condition_number_scaled: of Z^T S W with normalised rows and columns; about the square of that of W.
    """

    theta: Floats
    covariance: Floats
    noise: Floats
    lags: int
    condition_number_scaled: float


def instrumental(
    segments: Iterable[ObservationRows], lags: int | None = None, *, robust: bool = False, max_rounds: int = 50
) -> InstrumentalFit:
    """Estimate with the instruments that come with the segments.

    Args:
        segments: conditioned rows with instruments, filtered and decimated in the same way; walked once a round.
        lags: memory of the residuals in samples, for example 0.1 s of them; None to find it from the scores.
        robust: give spikes little weight (Huber).
        max_rounds: limit of the iteration for noise and weights.

    Returns:
        The estimate.

    Raises:
        RankDeficient: the instruments do not move with the regressor.
    """
    n = next(iter(segments)).tau.shape[1]
    noise, theta, weigh = np.ones(n), np.zeros(0), False
    for _ in range(max_rounds):
        bread, right, condition = _normal_equations(segments, noise, theta if weigh else None)
        before, theta = noise, bread @ right
        noise = (robust_noise if robust else root_mean_square)(segments, theta)
        if weigh == robust and np.all(np.abs(noise - before) <= 1e-4 * before):
            break
        weigh = robust
    honest = hac_covariance(segments, theta, noise, lags, robust=robust)
    return InstrumentalFit(theta, honest.covariance, noise, honest.lags, condition)


def _normal_equations(
    segments: Iterable[ObservationRows], noise: Floats, theta: Floats | None
) -> tuple[Floats, Floats, float]:
    """Return (Z^T S W)^-1, Z^T S tau and the scaled condition number; Huber weights where theta is given."""
    left: Floats | float = 0.0
    right: Floats | float = 0.0
    for segment in segments:
        Z = _weighted_instruments(segment, noise, theta)
        p = Z.shape[2]
        left = left + Z.reshape(-1, p).T @ segment.W.reshape(-1, p)
        right = right + Z.reshape(-1, p).T @ segment.tau.ravel()
    left = np.asarray(left)
    scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diagonal(left)), np.finfo(float).tiny))
    scaled = scale[:, None] * left * scale
    condition = float(np.linalg.cond(scaled))
    if not condition < WORST_CONDITION:
        raise RankDeficient(
            f"the commanded motion does not follow the measured one: condition number {condition:.1e}",
            fix="use --method wls, or check that the log's commanded positions belong to this recording",
        )
    return scale[:, None] * np.linalg.inv(scaled) * scale, np.asarray(right), condition


def _weighted_instruments(segment: ObservationRows, noise: Floats, theta: Floats | None) -> Floats:
    assert segment.Z is not None
    weight = segment.mask / noise**2
    if theta is not None:
        weight = weight * huber_weight(segment.residual(theta), noise)
    return segment.Z * weight[:, :, None]
