"""Instrumental variables: parameters without the bias that encoder noise gives to least squares.

Least squares correlates the regressor's own noise with the torque's and shrinks the parameters. Instruments Z are the
same regressor on a motion that knows no measurement noise: the commanded one (IV-ref), or a simulated one (IDIM-IV).

    theta = (Z^T S W)^-1 Z^T S tau,   S = 1 / noise^2 of each joint

Source: Janot, Vandanjon, Gautier 2014, "A generic instrumental variable approach for industrial robot identification".
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import RankDeficient
from dynid.estimation import tuning
from dynid.estimation.covariance import hac_covariances
from dynid.estimation.least_squares import Fit
from dynid.estimation.observation_rows import ObservationRows, robust_noise, root_mean_square
from dynid.estimation.robust import huber_weight

Floats = NDArray[np.float64]


def instrumental(
    rows: Iterable[ObservationRows],
    plain: Fit,
    lags: int | None = None,
    *,
    robust: bool = False,
    max_rounds: int = 50,
) -> Fit:
    """Estimate with the instruments that come with the rows.

    Args:
        rows: observation rows with instruments; walked twice per round.
        plain: plain fit of the same rows, whose factors the result keeps.
        lags: memory of the residuals in samples, for example 0.1 s of them; None to find it from the scores.
        robust: give spikes little weight (Huber).
        max_rounds: limit of the iteration for noise and weights.

    Returns:
        The estimate; its covariance allows for coloured residuals.

    Raises:
        RankDeficient: the instruments do not move with the regressor.
    """
    noise, theta, weigh = np.ones(len(plain.noise)), np.zeros(0), False
    for _ in range(max_rounds):
        bread, right = _normal_equations(rows, noise, theta if weigh else None)
        before, theta = noise, bread @ right
        noise = (robust_noise if robust else root_mean_square)(rows, theta)
        if weigh == robust and np.all(np.abs(noise - before) <= 1e-4 * before):
            break
        weigh = robust
    covariance, uncorrected = hac_covariances(rows, theta, noise, lags, robust=robust)
    return replace(plain, method="iv", theta=theta, noise=noise, covariance=covariance, uncorrected=uncorrected)


def _normal_equations(rows: Iterable[ObservationRows], noise: Floats, theta: Floats | None) -> tuple[Floats, Floats]:
    """Return (Z^T S W)^-1, (p, p), and Z^T S tau, (p,); Huber weights where theta is given."""
    left, right = np.zeros((0, 0)), np.zeros(0)
    for part in rows:
        left, right = (left, right) if left.size else (np.zeros((part.size, part.size)), np.zeros(part.size))
        weight = _weights(part, noise, theta)
        for j in range(len(noise)):
            (columns, W), (_, Z) = part.of_joint(j), part.instruments.of_joint(j)
            left[np.ix_(columns, columns)] += (Z * weight[:, j]) @ W.T
            right[columns] += (Z * weight[:, j]) @ part.tau[:, j]
    scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diagonal(left)), np.finfo(float).tiny))
    scaled = scale[:, None] * left * scale
    condition = float(np.linalg.cond(scaled))
    if not condition < tuning.INSTRUMENTS_WORST_CONDITION:
        raise RankDeficient(
            f"the commanded motion does not follow the measured one: condition number {condition:.1e}",
            fix="use --method wls, or check that the log's commanded positions belong to this recording",
        )
    return scale[:, None] * np.linalg.inv(scaled) * scale, right


def _weights(rows: ObservationRows, noise: Floats, theta: Floats | None) -> Floats:
    """Return the weight of each row, (M, n)."""
    weight = rows.mask / noise**2
    if theta is not None:
        weight = weight * huber_weight(rows.residual(theta), noise)
    return weight
