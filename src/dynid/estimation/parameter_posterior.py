"""The posterior of a result as one value: parameters, residual model and noise. Loads and planned motions ask it.

``posterior.py`` finds it from rows; what is read here is a result, new or from its file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.body_prior import curvature
from dynid.estimation.least_squares import merge, symmetric_root
from dynid.estimation.physical_parameters import constraints_of, require_possible_prior
from dynid.estimation.posterior import exciting_states
from dynid.model.parameters import prior_base_parameters

if TYPE_CHECKING:
    from dynid.estimation.model_error import ModelError
    from dynid.estimation.result import Identification
    from dynid.model.base_model import BaseModel

Floats = NDArray[np.float64]

#: Variance, relative to the largest in columns of equal size, below which the inverse would be of rounding.
ROUNDING = 1e-13


@dataclass(frozen=True)
class ParameterPosterior:
    """What a result knows; p base parameters, n joints.

    Attributes:
        theta: mean of the base parameters, (p,).
        information: inverse of their covariance, zero along what nothing tells, (p, p).
        by_joint: information of each joint's rows, (n, p, p).
        error: the residual model for these parameters; None without.
        noise: of a row, whitened with which rows are worth one independent row each, (n,) [N m or N].
        rate: how many rows a second has [Hz]; 0 where that is not known.
    """

    theta: Floats
    information: Floats
    by_joint: Floats
    error: ModelError | None
    noise: Floats
    rate: float

    def sample_noise(self, rate: float) -> Floats:
        """Return the white noise of samples at a rate [Hz] that tell as much as the rows did, (n,) [N m or N]."""
        return self.noise * np.sqrt(rate / self.rate) if self.rate > 0.0 else self.noise

    def root(self) -> Floats:
        """Return R with R^T R the information, (p, p); parameters that it does not know have columns of zeros."""
        return symmetric_root(self.information).T


def parameter_posterior(found: Identification) -> ParameterPosterior:
    """Return what a result knows about its parameters.

    Args:
        found: a result; of the plain set nothing but its rows is known.
    """
    n, p = len(found.noise), len(found.theta)
    factors = found.factors if found.factors.size else np.zeros((n, p + 1, p + 1))
    A = merge(factors, 1.0 / found.noise)[:-1, :-1]
    if found.in_force == "physical" or not found.factors.size:
        worth, information = found.physical.inflation, _inverse(found.covariance)
    else:
        # Why not the inverse of the covariance: that is estimated from few independent samples, and where it happens
        # to be too small its inverse would trust the log most.
        worth = max(float(np.sum((A @ found.covariance) * A)) / max(1, found.rank), 1e-300)
        information = np.asarray(A.T @ A) / worth
    noise = found.noise * np.sqrt(worth)
    rows = factors[:, :, :-1] / noise[:, None, None]
    by_joint = rows.swapaxes(1, 2) @ rows
    return ParameterPosterior(found.theta, information, by_joint, found.model_error, noise, _rate(found))


def _rate(found: Identification) -> float:
    """Return how many rows of a second were fitted [Hz]."""
    if found.stack is not None and found.stack.logs:
        return float(found.stack.logs[0].filter.kept_rate)
    return float(found.header.get("kept_rate_hz") or 0.0)


def _inverse(covariance: Floats) -> Floats:
    """Return the inverse of a covariance, (p, p); variances below rounding count as rounding."""
    scale = np.sqrt(np.maximum(np.diagonal(covariance), 1e-300))
    values, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray((axes / np.maximum(values, ROUNDING * values[-1])) @ axes.T / np.outer(scale, scale))


def prior_information(base: BaseModel) -> Floats:
    """Return what is known of the base parameters before anything is measured, (p, p).

    Bodies are possible and resemble the prior's; nothing else of a joint (friction, rotor) needs more torque on an
    exciting motion than its bodies do.

    Args:
        base: model and base parameters.

    Raises:
        NotPhysical: a body of the prior cannot exist.
    """
    constraints, K = constraints_of(base), base.reduction.K
    require_possible_prior(constraints)
    q, qd, qdd = exciting_states(base)
    W = base.model.observer(base.reduction.base).dense(q, qd, qdd)
    theta = prior_base_parameters(base.model, base.reduction, unknown=0.0)
    torque = np.sqrt(np.mean((W @ theta) ** 2, axis=0))
    torque = np.maximum(torque, max(tuning.LEAST_TORQUE * float(torque.max()), 1e-6))
    covariance = np.zeros((K.shape[1], K.shape[1]))
    others = np.setdiff1d(np.arange(K.shape[1]), constraints.bodies)
    columns = base.model.observer(others).dense(q, qd, qdd) if len(others) else np.zeros((1, base.robot.n, 0))
    size = np.sqrt(np.mean(columns**2, axis=0)) / torque[:, None]
    covariance[others, others] = 1.0 / np.maximum(size.max(axis=0, initial=0.0), 1e-9) ** 2
    for columns_of_body, bent in zip(
        constraints.bodies, curvature(constraints, constraints.prior, tuning.PRIOR_WEIGHT), strict=True
    ):
        covariance[np.ix_(columns_of_body, columns_of_body)] = np.linalg.inv(tuning.PRIOR_COUNTED * bent)
    return _inverse(K @ covariance @ K.T)
