"""The estimators behind ``dynid identify --method``: rows of logs in, parameters with honest errors out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.errors import WrongUsage
from dynid.estimation.closed_loop import Simulated, simulated
from dynid.estimation.didim import direct
from dynid.estimation.hac import hac_covariance
from dynid.estimation.idim_iv import simulated_instruments
from dynid.estimation.instrumental import instrumental
from dynid.estimation.least_squares import Solution, joint_rms, merge, ordinary, ridge, solve, weighted
from dynid.estimation.observation_rows import Rows
from dynid.estimation.robust import huber, look_for_spikes
from dynid.estimation.stack import Earlier, Stack
from dynid.estimation.velocity_reversal import Settled, settled
from dynid.robot import Controller

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: A prior base parameter is believed to this share of itself by ``ridge``, and never better than this share of the
#: largest of its kind: published inertias of one arm differ by as much between sources.
RIDGE_BELIEF, RIDGE_FLOOR = 0.5, 0.05


@dataclass(frozen=True)
class Part:
    """Some blocks of time of a stack, to be walked many times.

    Attributes:
        stack: the stacked logs.
        blocks: which of its blocks, (B,).
        controller: what followed the commands, where it is known, and the columns are the whole arm.
    """

    stack: Stack
    blocks: Mask
    controller: Controller | None = None

    def __iter__(self) -> Iterator[Rows]:
        """Walk over the rows of the chosen blocks in order of time."""
        return self.stack.rows_of_blocks(self.blocks)

    @cached_property
    def factors(self) -> tuple[Floats, NDArray[np.int64]]:
        """One triangular factor a joint and its number of rows."""
        return self.stack.whole if self.blocks.all() else self.stack.joint_factors(self.blocks)

    @cached_property
    def settled(self) -> Iterable[Rows]:
        """The rows, with no more trust in what happens at reversals than it deserves; of an update, as they are."""
        return self if self.stack.earlier is not None else settled(self, *self.factors)

    @property
    def commanded(self) -> bool:
        """Whether every log says what was commanded."""
        return all(segment.command is not None for log in self.stack.logs for segment in log.segments)


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


def ols(part: Part, prior: Floats) -> Estimate:
    """Ordinary least squares, the paper's choice (Eq. 24)."""
    fit = ordinary(*part.factors)
    return _estimate("ols", part, fit.theta, fit.noise)


def wls(part: Part, prior: Floats) -> Estimate:
    """Least squares with one noise level a joint."""
    rows = part.settled
    factors, counts = part.factors
    fit = weighted(rows.factors(factors) if isinstance(rows, Settled) else factors, counts)
    return _estimate("wls", part, fit.theta, fit.noise, rows=rows)


def irls(part: Part, prior: Floats) -> Estimate:
    """Least squares in which spikes have little weight (Huber)."""
    rows = part.settled
    fit = huber(rows, weighted(*part.factors).theta)
    return _estimate("irls", part, fit.theta, fit.noise, robust=True, rows=rows)


def iv(part: Part, prior: Floats) -> Estimate:
    """Instrumental variables from the commanded motion, which knows nothing of the encoders' noise."""
    if not part.commanded:
        raise WrongUsage(
            "--method iv needs the commanded motion, and the log has none (q_ref)",
            fix="use --method wls, or a log recorded by dynid record",
        )
    fit = instrumental(part.settled, robust=True)
    return _estimate("iv", part, fit.theta, fit.noise, covariance=fit.covariance)


def idim_iv(part: Part, prior: Floats) -> Estimate:
    """Instrumental variables from the arm simulated under its controller."""
    simulate, rows = _simulation(part, "idim-iv"), part.settled

    def alike(theta: Floats) -> Iterable[Rows]:
        again = simulate(theta)
        return replace(rows, rows=again) if isinstance(rows, Settled) else again

    fit = simulated_instruments(alike, instrumental(rows, robust=True))
    return _estimate("idim-iv", part, fit.theta, fit.noise, covariance=fit.covariance)


def didim(part: Part, prior: Floats) -> Estimate:
    """Direct and inverse model: the torques of the simulated arm are fitted to the measured ones."""
    simulate = _simulation(part, "didim")
    fit = direct(simulate, instrumental(part.settled, robust=True).theta)
    return _estimate("didim", part, fit.theta, fit.noise, covariance=fit.covariance)


def _simulation(part: Part, method: str) -> Callable[[Floats], Simulated]:
    """Return what simulates the logs with given parameters."""
    controller = part.controller
    if controller is None:
        raise WrongUsage(
            f"--method {method} needs the gains of the arm's position controller, and all links identified",
            fix="`controller: {kp: [...], kd: [...]}` in the robot file, or --method iv",
        )
    if not part.commanded:
        raise WrongUsage(
            f"--method {method} needs the commanded motion, and the log has none (q_ref)",
            fix="use --method wls, or a log recorded by dynid record",
        )
    return lambda theta: simulated(part.stack, part.blocks, theta, controller)


def ridge_to_prior(part: Part, prior: Floats) -> Estimate:
    """Weighted pseudo-inverse with prior data, in base parameters (the paper's last remark on estimation)."""
    known = np.nan_to_num(prior)
    spread = np.maximum(RIDGE_BELIEF * np.abs(known), RIDGE_FLOOR * max(1.0, float(np.abs(known).max())))
    fit = ridge(*part.factors, known, np.diag(np.where(np.isnan(prior), 1e3 * spread.max(), spread) ** 2))
    return _estimate("ridge", part, fit.theta, fit.noise, covariance=fit.covariance)


METHODS: dict[str, Callable[[Part, Floats], Estimate]] = {
    "wls": wls,
    "ols": ols,
    "irls": irls,
    "iv": iv,
    "idim-iv": idim_iv,
    "didim": didim,
    "ridge": ridge_to_prior,
}


def choose(part: Part) -> tuple[str, str]:
    """Choose the estimator from what the logs offer.

    Returns:
        Its name, and why.
    """
    if part.stack.earlier is not None:
        return "wls", "an earlier result is updated, which keeps triangular factors and no single rows"
    if part.commanded:
        return "iv", "the log holds the commanded motion, whose instruments are free of encoder noise"
    spikes = look_for_spikes(part, weighted(*part.factors).theta)
    if spikes.found:
        share = 100 * float(np.max(spikes.share))
        return "irls", f"the residual has spikes (up to {share:.1f} % of a joint's samples), which get little weight"
    return "wls", "no commanded motion in the log and no spikes in the residual"


def _estimate(
    method: str,
    part: Part,
    theta: Floats,
    noise: Floats,
    *,
    rows: Iterable[Rows] | None = None,
    robust: bool = False,
    covariance: Floats | None = None,
) -> Estimate:
    factors, counts = part.factors
    whitened = merge(factors, 1.0 / noise)
    solution = solve(whitened)
    if covariance is None and solution.rank < len(theta):
        covariance = solution.inverse
    if covariance is None and part.stack.earlier is not None:
        covariance = _with_earlier(part, part.stack.earlier, theta, noise, solution.inverse)
    if covariance is None:
        covariance = hac_covariance(part if rows is None else rows, theta, noise, robust=robust).covariance
    return Estimate(method, theta, noise, joint_rms(factors, counts, theta), covariance, whitened, solution)


def _with_earlier(part: Part, earlier: Earlier, theta: Floats, noise: Floats, bread: Floats) -> Floats:
    """Return the covariance of an updated estimate: the scores of old and new logs vary independently."""
    old = merge(earlier.factors, 1.0 / earlier.noise)[:-1, :-1]
    pulled = bread @ old.T @ old
    new = hac_covariance(part, theta, noise, bread=bread).covariance
    return np.asarray(pulled @ earlier.covariance @ pulled.T + new)
