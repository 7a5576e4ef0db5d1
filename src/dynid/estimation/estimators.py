"""The estimators behind ``dynid identify --method``: rows of logs in, parameters with honest errors out."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.errors import WrongUsage
from dynid.estimation.closed_loop import simulated
from dynid.estimation.didim import direct
from dynid.estimation.hac import hac_covariance
from dynid.estimation.idim_iv import simulated_instruments
from dynid.estimation.instrumental import instrumental
from dynid.estimation.least_squares import Solution, joint_rms, merge, ordinary, ridge, solve, weighted
from dynid.estimation.observation_rows import ObservationRows
from dynid.estimation.robust import huber, look_for_spikes
from dynid.estimation.stack import Earlier, Stack
from dynid.robot import Controller

Floats = NDArray[np.float64]

#: A prior base parameter is believed to this share of itself by ``ridge``, and never better than this share of the
#: largest of its kind: published inertias of one arm differ by as much between sources.
RIDGE_BELIEF, RIDGE_FLOOR = 0.5, 0.05


@dataclass(frozen=True)
class Estimate:
    """Base parameters from one estimator.

    Attributes:
        method: its name.
        theta: base parameters, (p,).
        noise: standard deviation of each joint's residual, (n,) [N m].
        rms: root mean square of each joint's residual, (n,) [N m].
        covariance: of theta, allowing for coloured residuals, (p, p).
        whitened: triangular factor of all rows divided by their noise, (p + 1, p + 1).
        solution: rank and condition numbers of the whitened rows.
        why: one sentence on the choice, for people.
    """

    method: str
    theta: Floats
    noise: Floats
    rms: Floats
    covariance: Floats
    whitened: Floats
    solution: Solution
    why: str = ""


Estimator = Callable[[Stack, Floats, Controller | None], Estimate]


def ols(stack: Stack, prior: Floats, controller: Controller | None = None) -> Estimate:
    """Ordinary least squares, the paper's choice (Eq. 24)."""
    fit = ordinary(*stack.whole)
    return _estimate("ols", stack, fit.theta, fit.noise)


def wls(stack: Stack, prior: Floats, controller: Controller | None = None) -> Estimate:
    """Least squares with one noise level per joint."""
    factors, counts = stack.whole
    fit = weighted(stack.reversals.factors(factors) if stack.reversals else factors, counts)
    return _estimate("wls", stack, fit.theta, fit.noise, rows=_whitened(stack))


def irls(stack: Stack, prior: Floats, controller: Controller | None = None) -> Estimate:
    """Least squares in which spikes have little weight (Huber)."""
    rows = _whitened(stack)
    fit = huber(rows, weighted(*stack.whole).theta)
    return _estimate("irls", stack, fit.theta, fit.noise, robust=True, rows=rows)


def iv(stack: Stack, prior: Floats, controller: Controller | None = None) -> Estimate:
    """Instrumental variables from the commanded motion, which knows nothing of the encoders' noise."""
    if not stack.commanded:
        raise WrongUsage(
            "--method iv needs the commanded motion, and the log has none (q_ref)",
            fix="use --method wls, or a log recorded by dynid record",
        )
    fit = instrumental(_whitened(stack), robust=True)
    return _estimate("iv", stack, fit.theta, fit.noise, covariance=fit.covariance)


def idim_iv(stack: Stack, prior: Floats, controller: Controller | None = None) -> Estimate:
    """Instrumental variables from the arm simulated under its controller."""
    simulate, effects = _simulation(stack, controller, "idim-iv"), stack.reversals

    def alike(theta: Floats) -> Iterable[ObservationRows]:
        again = simulate(theta)
        return effects.whitened(again) if effects else again

    fit = simulated_instruments(alike, instrumental(_whitened(stack), robust=True))
    return _estimate("idim-iv", stack, fit.theta, fit.noise, covariance=fit.covariance)


def didim(stack: Stack, prior: Floats, controller: Controller | None = None) -> Estimate:
    """Direct and inverse model: the torques of the simulated arm are fitted to the measured ones."""
    simulate = _simulation(stack, controller, "didim")
    fit = direct(simulate, instrumental(_whitened(stack), robust=True).theta)
    return _estimate("didim", stack, fit.theta, fit.noise, covariance=fit.covariance)


def _whitened(stack: Stack) -> Iterable[ObservationRows]:
    """Return the rows with no more trust in what happens at reversals than it deserves; of an update, as they are."""
    return stack.reversals.whitened(stack) if stack.reversals else stack


def _simulation(stack: Stack, controller: Controller | None, method: str) -> Callable[[Floats], Stack]:
    """Return what simulates the logs with given parameters."""
    if controller is None:
        raise WrongUsage(
            f"--method {method} needs the gains of the arm's position controller, and all links identified",
            fix="`controller: {kp: [...], kd: [...]}` in the robot file, or --method iv",
        )
    if not stack.commanded:
        raise WrongUsage(
            f"--method {method} needs the commanded motion, and the log has none (q_ref)",
            fix="use --method wls, or a log recorded by dynid record",
        )
    return lambda theta: simulated(stack, theta, controller)


def ridge_to_prior(stack: Stack, prior: Floats, controller: Controller | None = None) -> Estimate:
    """Weighted pseudo-inverse with prior data, in base parameters (the paper's last remark on estimation)."""
    known = np.nan_to_num(prior)
    spread = np.maximum(RIDGE_BELIEF * np.abs(known), RIDGE_FLOOR * max(1.0, float(np.abs(known).max())))
    fit = ridge(*stack.whole, known, np.diag(np.where(np.isnan(prior), 1e3 * spread.max(), spread) ** 2))
    return _estimate("ridge", stack, fit.theta, fit.noise, covariance=fit.covariance)


#: The estimators by name. Each takes the stacked logs, the prior's base parameters (p,), NaN where it says nothing,
#: and the position controller that followed the commands, where it is known.
METHODS: dict[str, Estimator] = {
    "wls": wls,
    "ols": ols,
    "irls": irls,
    "iv": iv,
    "idim-iv": idim_iv,
    "didim": didim,
    "ridge": ridge_to_prior,
}


def choose(stack: Stack) -> tuple[str, str]:
    """Choose the estimator from what the logs offer.

    Returns:
        Its name, and why.
    """
    if stack.earlier is not None:
        return "wls", "an earlier result is updated, which keeps triangular factors and no single rows"
    if stack.commanded:
        return "iv", "the log holds the commanded motion, whose instruments are free of encoder noise"
    spikes = look_for_spikes(stack, weighted(*stack.whole).theta)
    if spikes.found:
        share = 100 * float(np.max(spikes.share))
        return "irls", f"the residual has spikes (up to {share:.1f} % of a joint's samples), which get little weight"
    return "wls", "no commanded motion in the log and no spikes in the residual"


def _estimate(
    method: str,
    stack: Stack,
    theta: Floats,
    noise: Floats,
    *,
    rows: Iterable[ObservationRows] | None = None,
    robust: bool = False,
    covariance: Floats | None = None,
) -> Estimate:
    factors, counts = stack.whole
    whitened = merge(factors, 1.0 / noise)
    solution = solve(whitened)
    if covariance is None and solution.rank < len(theta):
        covariance = solution.inverse
    if covariance is None and stack.earlier is not None:
        covariance = _with_earlier(stack, stack.earlier, theta, noise, solution.inverse)
    if covariance is None:
        covariance = hac_covariance(stack if rows is None else rows, theta, noise, robust=robust).covariance
    return Estimate(method, theta, noise, joint_rms(factors, counts, theta), covariance, whitened, solution)


def _with_earlier(stack: Stack, earlier: Earlier, theta: Floats, noise: Floats, bread: Floats) -> Floats:
    """Return the covariance of an updated estimate: the scores of old and new logs vary independently."""
    old = merge(earlier.factors, 1.0 / earlier.noise)[:-1, :-1]
    pulled = bread @ old.T @ old
    new = hac_covariance(stack, theta, noise, bread=bread).covariance
    return np.asarray(pulled @ earlier.covariance @ pulled.T + new)
