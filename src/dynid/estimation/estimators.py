"""The estimators behind ``dynid identify --method``: rows of logs in, parameters with error bars out.

``Fit`` is what each of them returns: base parameters with a covariance that allows for coloured residuals.

Source: Gautier 1997 (weighted least squares per joint); Huber 1981; Janot, Vandanjon, Gautier 2014, "A generic
instrumental variable approach for industrial robot identification" (IDIM-IV); Gautier, Janot, Vandanjon 2013, "A new
closed-loop output error method for parameter identification of robot dynamics" (DIDIM).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dynid.errors import WrongUsage
from dynid.estimation import tuning
from dynid.estimation.covariance import hac_covariance, hac_covariances
from dynid.estimation.instrumental import instrumental
from dynid.estimation.least_squares import Fit, merge, ordinary, ridge, weighted
from dynid.estimation.observation_rows import ObservationRows, RowWalk, joint_factors
from dynid.estimation.robust import huber, look_for_spikes
from dynid.estimation.stack import Earlier, Stack
from dynid.robot import Controller

Floats = NDArray[np.float64]


class Estimator(Protocol):
    """From rows to parameters with error bars."""

    def __call__(
        self, stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True
    ) -> Fit:
        """Return the fit.

        Args:
            stack: the stacked logs.
            prior: the prior's base parameters, (p,), NaN where it says nothing.
            controller: position controller that followed the commands, where it is known.
            corrected: whether anybody asks for error bars that hold in a short log.
        """


def ols(stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True) -> Fit:
    """Ordinary least squares, the paper's choice (Eq. 24)."""
    return _with_covariance(stack, ordinary(*stack.whole), stack, corrected=corrected)


def wls(stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True) -> Fit:
    """Least squares with one noise level per joint."""
    factors, counts = stack.whole
    fit = weighted(stack.reversals.factors(factors) if stack.reversals else factors, counts)
    return _with_covariance(stack, fit, _whitened(stack), corrected=corrected)


def irls(stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True) -> Fit:
    """Least squares in which spikes have little weight (Huber)."""
    rows = _whitened(stack)
    return _with_covariance(stack, huber(rows, stack.first_fit), rows, robust=True, corrected=corrected)


def iv(stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True) -> Fit:
    """Instrumental variables from the commanded motion, which knows nothing of the encoders' noise."""
    if not stack.commanded:
        raise WrongUsage(
            "--method iv needs the commanded motion, and the log has none (q_ref)",
            fix="use --method wls, or a log recorded by dynid record",
        )
    return instrumental(_whitened(stack), stack.first_fit, robust=True)


def idim_iv(stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True) -> Fit:
    """Instrumental variables from the arm simulated under its controller.

    The simulated motion follows the measured one more closely than the command does, where friction or gravity make the
    arm lag, and it knows as little of the encoders' noise. Wrong gains weaken the instruments and bias nothing.
    """
    simulate, effects = _simulation(stack, controller, "idim-iv"), stack.reversals
    fit = instrumental(_whitened(stack), stack.first_fit, robust=True)
    for _ in range(tuning.IDIM_ROUNDS):
        again = simulate(fit.theta)
        before, fit = fit.theta, instrumental(effects.whitened(again) if effects else again, fit, robust=True)
        if _settled(fit, before, tuning.IDIM_SETTLED):
            break
    return replace(fit, method="idim-iv")


def didim(stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True) -> Fit:
    """Direct and inverse model: the torques of the arm simulated under its controller are fitted to the measured ones.

    Measured positions take no part, so their noise cannot bias anything; wrong gains can. The simulated motion hardly
    depends on the parameters, because the controller holds it to the command: each round is a linear fit.
    """
    simulate = _simulation(stack, controller, "didim")
    fit = instrumental(_whitened(stack), stack.first_fit, robust=True)
    for _ in range(tuning.DIDIM_ROUNDS):
        rows, before = _of_simulation(simulate(fit.theta)), fit.theta
        found = weighted(*joint_factors(rows))
        robust = look_for_spikes(rows, found.theta).found
        if robust:
            found = huber(rows, found)
        covariance, uncorrected = hac_covariances(rows, found.theta, found.noise, robust=robust)
        fit = replace(fit, theta=found.theta, noise=found.noise, covariance=covariance, uncorrected=uncorrected)
        if _settled(fit, before, tuning.DIDIM_SETTLED):
            break
    return replace(fit, method="didim")


def ridge_to_prior(stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True) -> Fit:
    """Weighted pseudo-inverse with prior data, in base parameters (the paper's last remark on estimation)."""
    known = np.nan_to_num(prior)
    spread = np.maximum(tuning.RIDGE_SPREAD * np.abs(known), tuning.RIDGE_FLOOR * max(1.0, float(np.abs(known).max())))
    return ridge(*stack.whole, known, np.diag(np.where(np.isnan(prior), 1e3 * spread.max(), spread) ** 2))


#: The estimators by name.
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
    spikes = look_for_spikes(stack, stack.first_fit.theta)
    if spikes.found:
        share = 100 * float(np.max(spikes.share))
        return "irls", f"the residual has spikes (up to {share:.1f} % of a joint's samples), which get little weight"
    return "wls", "no commanded motion in the log and no spikes in the residual"


def _with_covariance(
    stack: Stack, fit: Fit, rows: Iterable[ObservationRows], *, robust: bool = False, corrected: bool = True
) -> Fit:
    """Return a fit with the factors of all rows as they are, and a covariance that allows for coloured residuals."""
    factors, counts = stack.whole
    fit = replace(fit, factors=factors, counts=counts)
    if stack.earlier is not None:
        return replace(fit, covariance=_with_earlier(stack, stack.earlier, fit))
    # Why a pseudo-inverse where the rank is short: what coloured residuals are worth shows in the other directions.
    open_ = fit.solution.rank < len(fit.theta)
    same = rows is stack and not robust and not stack.commanded
    bread = fit.solution.inverse if open_ or same else None
    covariance, uncorrected = hac_covariances(
        rows, fit.theta, fit.noise, robust=robust, bread=bread, corrected=corrected
    )
    return replace(fit, covariance=fit.solution.inverse if open_ else covariance, uncorrected=uncorrected)


def _with_earlier(stack: Stack, earlier: Earlier, fit: Fit) -> Floats:
    """Return the covariance of an updated estimate: the scores of old and new logs vary independently."""
    bread = fit.solution.inverse
    old = merge(earlier.factors, 1.0 / earlier.noise)[:-1, :-1]
    sensitivity = bread @ old.T @ old
    if not stack.logs:
        return np.asarray(sensitivity @ earlier.covariance @ sensitivity.T)
    new = hac_covariance(stack, fit.theta, fit.noise, bread=bread)
    return np.asarray(sensitivity @ earlier.covariance @ sensitivity.T + new)


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
    from dynid.estimation.closed_loop import simulated  # here: the usual estimator simulates nothing

    return lambda theta: simulated(stack, theta, controller)


def _of_simulation(rows: Iterable[ObservationRows]) -> RowWalk:
    """Return the rows with the regressor itself on the simulated motion."""
    return RowWalk(
        lambda: (replace(each, entries=each.command, command=None) for each in rows if each.command is not None)
    )


def _settled(fit: Fit, before: Floats, errors: float) -> bool:
    """Return whether the parameters moved by less than so many standard errors."""
    return bool(np.all(np.abs(fit.theta - before) <= errors * np.sqrt(np.diagonal(fit.covariance))))
