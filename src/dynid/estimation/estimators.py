"""The estimators behind ``dynid identify --method``: a stack in, parameters with error bars out, as a ``Fit``.

Spikes get little weight (Huber) where the residuals of a first fit have them. Encoder noise biases least squares: they
correlate the regressor's own noise with the torque's. Instruments Z are the same regressor on the commanded motion,
which knows no measurement noise:

    theta = (Z^T S W)^-1 Z^T S tau,   S = 1 / noise^2 of each joint

Source: Gautier 1997 (weighted least squares per joint); Huber 1981; Janot, Vandanjon, Gautier 2014, "A generic
instrumental variable approach for industrial robot identification" (IV).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynid.arrays import Floats
from dynid.errors import RankDeficient, WrongUsage
from dynid.estimation import tuning
from dynid.estimation.factor import of_unit_diagonal, triangle
from dynid.estimation.least_squares import (
    Fit,
    hac_covariance,
    merge,
    ordinary,
    solve,
    widened,
)
from dynid.estimation.rows import Rows, robust_noise
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel

#: A prior base parameter is trusted to this share of itself by ``ridge``, of one that is at least this share of the
#: largest: published inertias of one arm differ by as much. evidence: none, round numbers.
RIDGE_SPREAD, RIDGE_LEAST = 0.5, 0.1


# ---------------------------------------------------------------- spikes
def has_spikes(rows: Rows, theta: Floats) -> bool:
    """Return whether the residuals of a first fit, (p,), have such spikes that the robust fit is worth its price.

    That is a small loss of efficiency: heavy tails at one joint.
    """
    residual, count = rows.residual(theta), np.maximum(rows.counts, 1)
    centred = np.where(rows.use, residual - residual.sum(axis=0) / count, 0.0)
    square, fourth = (np.sum(centred**power, axis=0) / count for power in (2, 4))
    return bool(np.any(fourth > tuning.SPIKE_KURTOSIS * np.maximum(square**2, 1e-300)))


def reweighted(rows: Rows, start: Fit, method: str) -> Fit:
    """Fit with weights min(1, 1.345 sigma / |residual|), iterated (Huber 1981).

    Args:
        rows: observation rows.
        start: plain fit of the same rows, whose factors and covariance the result keeps.
        method: ``"irls"``, or ``"iv"`` with the instruments of the rows.

    Returns:
        The fit, with the robust standard deviation of each joint.

    Raises:
        RankDeficient: the instruments do not move with the regressor.
    """
    theta, few = start.theta, start.counts < tuning.NOISE_LEAST_ROWS
    for _ in range(tuning.FIT_ROUNDS):
        noise = np.where(few, start.noise, robust_noise(rows, theta))
        far = np.abs(rows.residual(theta) / noise) / tuning.HUBER
        weight, before = 1.0 / np.maximum(far, 1.0), theta
        if method == "iv":
            theta = _by_instruments(rows, rows.use * weight / noise**2)
        else:
            theta = solve(merge(rows.factors(np.sqrt(weight)), 1.0 / noise)).theta
        # Why not each parameter by its error: of those that the rows leave open both are rounding.
        moved = np.linalg.norm(merge(start.factors, 1.0 / noise)[:-1, :-1] @ (theta - before))
        if moved < tuning.HUBER_SETTLED * np.sqrt(max(1, start.solution.rank)):
            break
    return replace(start, method=method, theta=theta, noise=noise)


def _by_instruments(rows: Rows, weight: Floats) -> Floats:
    """Return (Z^T S W)^-1 Z^T S tau, (p,), with weights of the rows, (M, n)."""
    Z = rows.instruments * weight[:, :, None]
    ZW, Ztau = (np.tensordot(Z, x, axes=((0, 1), (0, 1))) for x in (rows.W, rows.tau))
    scaled, scale = of_unit_diagonal(ZW)
    condition = float(np.linalg.cond(scaled))
    if not condition < tuning.INSTRUMENTS_WORST_CONDITION:
        raise RankDeficient(
            f"the commanded motion does not follow the measured one: condition number {condition:.1e}",
            fix="use --method wls, or check that the log's commanded positions belong to this recording",
        )
    return scale * np.linalg.solve(scaled, scale * Ztau)


# ---------------------------------------------------------------- the estimators
def near_prior(fit: Fit, base: BaseModel) -> Fit:
    """Return a weighted fit pulled towards the prior: the weighted pseudo-inverse with prior data."""
    prior = base.prior()
    known = np.nan_to_num(prior)
    size = np.abs(known)
    spread = RIDGE_SPREAD * np.maximum(size, RIDGE_LEAST * size.max())
    rows = np.column_stack([np.eye(len(known)), known]) / spread[:, None]
    pulled = triangle(np.vstack([fit.whitened, rows[np.isfinite(prior)]]))
    return replace(fit, method="ridge", theta=solve(pulled).theta)


def fitted(stack: Stack, method: str) -> Fit:
    """Return what an estimator makes of a stack, with a covariance that allows for coloured residuals.

    Args:
        stack: the stacked logs.
        method: ``"wls"`` with one noise level per joint, ``"ols"`` (the paper's choice, Eq. 24), ``"irls"`` with little
            weight for spikes, ``"ridge"`` near the prior (the paper's last remark on estimation), or ``"iv"`` with the
            commanded motion as instruments, which knows nothing of the encoders' noise.
    """
    rows, earlier, robust = stack.rows, stack.earlier, method in ("irls", "iv")
    if method == "iv":
        if not all(each.command_q.size for log in stack.logs for each in log.segments):
            raise WrongUsage(
                "--method iv needs the commanded motion, and the log has none (q_ref)",
                fix="use --method wls, or a log recorded by dynid record",
            )
        rows = stack.instrumented
    fit = ordinary(stack.factors, stack.counts) if method == "ols" else stack.first_fit
    fit = reweighted(rows, fit, method) if robust else fit
    fit = near_prior(fit, stack.base) if method == "ridge" else fit
    inverse = fit.solution.inverse
    if earlier is not None:
        # The scores of old and new logs vary independently.
        R = earlier.whitened[:-1, :-1]
        sensitivity = inverse @ R.T @ R
        new = hac_covariance(rows, fit.theta, fit.noise, bread=inverse)
        return replace(fit, covariance=sensitivity @ earlier.covariance @ sensitivity.T + new)
    # Why a pseudo-inverse where the rank is short: what coloured residuals are worth shows in the other directions.
    unique = not fit.open.any()
    bread = None if robust and unique else inverse
    covariance = hac_covariance(rows, fit.theta, fit.noise, robust=robust, bread=bread)
    wide = widened(rows, fit, covariance) if unique else inverse
    return replace(fit, covariance=wide, uncorrected=covariance)


def choose(stack: Stack) -> tuple[str, str]:
    """Return the name of the estimator that the residuals ask for, and why."""
    if stack.earlier is not None:
        return "wls", "the earlier result that is updated keeps triangular factors, not single rows"
    if has_spikes(stack.rows, stack.first_fit.theta):
        return "irls", "the residual has spikes, which get little weight"
    return "wls", "no spikes in the residual"
