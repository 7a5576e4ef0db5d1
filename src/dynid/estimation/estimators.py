"""The estimators behind ``dynid identify --method``: a stack in, parameters with error bars out, as a ``Fit``.

Spikes get little weight (Huber) where the residuals of a first fit have them. Encoder noise biases least squares: they
correlate the regressor's own noise with the torque's. Instruments Z are the same regressor on a motion that knows no
measurement noise, the commanded one (IV-ref) or a simulated one (IDIM-IV):

    theta = (Z^T S W)^-1 Z^T S tau,   S = 1 / noise^2 of each joint

Source: Gautier 1997 (weighted least squares per joint); Huber 1981; Janot, Vandanjon, Gautier 2014, "A generic
instrumental variable approach for industrial robot identification" (IDIM-IV); Gautier, Janot, Vandanjon 2013, "A new
closed-loop output error method for parameter identification of robot dynamics" (DIDIM); Stock, Yogo 2005 (weak
instruments).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dynid.errors import RankDeficient, WrongUsage
from dynid.estimation import tuning
from dynid.estimation.covariance import hac_covariances
from dynid.estimation.least_squares import Fit, merge, ordinary, ridge, solve, weighted
from dynid.estimation.rows import (
    ObservationRows,
    joint_factors,
    robust_noise,
    root_mean_square,
    whitened,
    whitened_factors,
)
from dynid.estimation.stack import Earlier, Stack
from dynid.robot import Controller
from dynid.signals.conditioned_log import driven_as_commanded

Floats = NDArray[np.float64]


# ---------------------------------------------------------------- spikes
def look_for_spikes(rows: Iterable[ObservationRows], theta: Floats) -> tuple[Floats, bool]:
    """Look at the residuals of a first fit.

    Args:
        rows: observation rows.
        theta: parameters of the first fit, (p,), each in its unit.

    Returns:
        Share of spikes of each joint, (n,), and whether the robust fit is worth its small loss of efficiency: many
        spikes and heavy tails at a joint.
    """
    noise, count = robust_noise(rows, theta), 0
    moments = np.zeros((5, len(noise)))
    for part in rows:
        scaled = np.ascontiguousarray(part.residual(theta).T) / noise[:, None]
        square = scaled * scaled
        powers = (
            scaled,
            square,
            square * scaled,
            square * square,
            np.abs(scaled) > tuning.SPIKE_ERRORS,
        )
        moments += [np.sum(each, axis=1) for each in powers]
        count = count + part.mask.sum(axis=0)
    one, two, three, four, beyond = moments / np.maximum(count, 1)
    variance = np.maximum(two - one**2, 1e-150)
    fourth = four - 4 * one * three + 6 * one**2 * two - 3 * one**4
    found = (beyond > tuning.SPIKE_SHARE) & (fourth / variance**2 > tuning.SPIKE_KURTOSIS)
    return beyond, bool(np.any(found))


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
        noise = np.where(
            start.counts < tuning.NOISE_LEAST_ROWS, start.noise, robust_noise(rows, theta)
        )
        factors, _ = joint_factors(_weighted(rows, theta, noise))
        R = merge(factors, 1.0 / noise)
        solution = solve(R)
        change, theta, rounds = solution.theta - theta, solution.theta, rounds + 1
        # Why not each parameter by its error: of those that the rows leave open both are rounding.
        moved = np.linalg.norm(R[:-1, :-1] @ change) / np.sqrt(max(1, solution.rank))
        if moved < tuning.HUBER_SETTLED or rounds == max_rounds:
            return replace(
                start, method="irls", theta=theta, noise=noise, covariance=solution.inverse
            )


def _weighted(
    rows: Iterable[ObservationRows], theta: Floats, noise: Floats
) -> Iterator[ObservationRows]:
    for part in rows:
        root = np.sqrt(huber_weight(part.residual(theta), noise))
        yield replace(
            part, entries=part.entries * root.T[part.joints], command=None, tau=part.tau * root
        )


def huber_weight(residual: Floats, noise: Floats) -> Floats:
    """Return min(1, 1.345 sigma / |residual|), (M, n), for residuals (M, n) and noise (n,) in the same unit."""
    return np.minimum(1.0, tuning.HUBER / np.maximum(np.abs(residual / noise), 1e-12))


# ---------------------------------------------------------------- instruments
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
    return replace(
        plain, method="iv", theta=theta, noise=noise, covariance=covariance, uncorrected=uncorrected
    )


@dataclass(frozen=True)
class InstrumentTest:
    """What the instruments of some rows are worth.

    Attributes:
        strength: first-stage F of the direction that the instruments tell least about; about 1 where they tell nothing.
        unseen: what instruments leave of rows that they were not fitted to, over what weighted least squares leaves.
    """

    strength: float
    unseen: float

    @property
    def weak(self) -> bool:
        """Whether estimates with these instruments would be worse than least squares."""
        return self.strength < tuning.INSTRUMENTS_STRONG or self.unseen > tuning.INSTRUMENTS_UNSEEN

    def said(self) -> str:
        """Return in words why instruments are weak."""
        if self.strength < tuning.INSTRUMENTS_STRONG:
            figures = f"first-stage F {self.strength:.2g}; {tuning.INSTRUMENTS_STRONG:g} is needed"
            return f"the arm follows its commands too badly for instruments ({figures})"
        return f"instruments explain rows that were not fitted {100 * self.unseen - 100:.0f} % worse than least squares"


def test_of_instruments(stack: Stack) -> InstrumentTest:
    """Ask whether the commanded motion tells enough about the measured one, and predicts rows that it has not seen.

    Instruments that hardly move with the regressor give estimates that are biased, vary wildly and seem certain. The
    statistic is that of Cragg and Donald for as many instruments as parameters: r is the least canonical correlation of
    the columns of W and Z in N independent rows,

        F = (N - p) / p * r^2 / (1 - r^2),

    and below 10 instruments count as weak (Staiger, Stock 1997). Beside it four parts of the logs are predicted from
    the other three.

    Source: Cragg, Donald 1993; Stock, Yogo 2005, "Testing for weak instruments in linear IV regression".

    Args:
        stack: logs with commands.
    """
    noise, p = stack.first_fit.noise, len(stack.names)
    blocks: dict[tuple[int, int], Floats] = {}
    for log in range(len(stack.rows)):
        for part in stack.rows_of_log(log):
            both = blocks.setdefault((log, part.block), np.zeros((2 * p + 1, 2 * p + 1)))
            weight = part.mask / noise
            for j in range(len(noise)):
                columns, W = part.of_joint(j)
                Z, place = (
                    part.instruments.of_joint(j)[1],
                    np.concatenate([columns, p + columns, [2 * p]]),
                )
                rows = np.vstack([W, Z, part.tau[:, j]]) * weight[:, j]
                both[np.ix_(place, place)] += rows @ rows.T
    split = np.array_split(np.array(list(blocks.values())), tuning.PARTS_OF_LOG)
    parts = [np.sum(some, axis=0) for some in split if len(some)]
    whole = np.sum(parts, axis=0)
    size = np.sqrt(np.maximum(np.diagonal(whole), np.finfo(float).tiny))
    parts, whole = [each / np.outer(size, size) for each in parts], whole / np.outer(size, size)
    roots = [_inverse_root(whole[own, own]) for own in (slice(0, p), slice(p, 2 * p))]
    least = float(
        np.linalg.svd(roots[0].T @ whole[:p, p:-1] @ roots[1], compute_uv=False).min(initial=1.0)
    )
    left = np.zeros(2)
    for each in parts:
        rest = whole - each
        seen = np.delete(np.delete(each, np.s_[p:-1], axis=0), np.s_[p:-1], axis=1)
        for k, by in enumerate((slice(0, p), slice(p, 2 * p))):
            theta = np.append(
                np.linalg.lstsq(rest[by, :p], rest[by, -1], rcond=tuning.RANK_TOLERANCE)[0], -1.0
            )
            left[k] += float(theta @ seen @ theta)
    independent = max(float(np.sum(stack.whole[1])) / tuning.COLOURED_ROWS - p, 1.0)
    strength = independent / p * least**2 / max(1.0 - least**2, np.finfo(float).eps)
    return InstrumentTest(
        strength, float(np.sqrt(max(left[1], 0.0) / max(left[0], np.finfo(float).tiny)))
    )


def _inverse_root(matrix: Floats) -> Floats:
    """Return B with B B^T = matrix^-1, (p, p), along what is no rounding."""
    value, vector = np.linalg.eigh(matrix)
    kept = value > tuning.RANK_TOLERANCE * value[-1]
    return np.asarray(vector[:, kept] / np.sqrt(value[kept]))


def _normal_equations(
    rows: Iterable[ObservationRows], noise: Floats, theta: Floats | None
) -> tuple[Floats, Floats]:
    """Return (Z^T S W)^-1, (p, p), and Z^T S tau, (p,); Huber weights where theta is given."""
    left, right = np.zeros((0, 0)), np.zeros(0)
    for part in rows:
        left, right = (
            (left, right) if left.size else (np.zeros((part.size, part.size)), np.zeros(part.size))
        )
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


# ---------------------------------------------------------------- the estimators
class Estimator(Protocol):
    """From rows to parameters with error bars."""

    def __call__(
        self,
        stack: Stack,
        prior: Floats,
        controller: Controller | None = None,
        *,
        corrected: bool = True,
    ) -> Fit:
        """Return the fit.

        Args:
            stack: the stacked logs.
            prior: the prior's base parameters, (p,), NaN where it says nothing.
            controller: position controller that followed the commands, where it is known.
            corrected: whether anybody asks for error bars that hold in a short log.
        """


def ols(
    stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True
) -> Fit:
    """Ordinary least squares, the paper's choice (Eq. 24)."""
    return _with_covariance(stack, ordinary(*stack.whole), stack, corrected=corrected)


def wls(
    stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True
) -> Fit:
    """Least squares with one noise level per joint."""
    factors, counts = stack.whole
    fit = weighted(
        whitened_factors(factors, stack.reversals) if stack.reversals else factors, counts
    )
    return _with_covariance(stack, fit, _whitened(stack), corrected=corrected)


def irls(
    stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True
) -> Fit:
    """Least squares in which spikes have little weight (Huber)."""
    rows = _whitened(stack)
    return _with_covariance(
        stack, huber(rows, stack.first_fit), rows, robust=True, corrected=corrected
    )


def iv(
    stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True
) -> Fit:
    """Instrumental variables from the commanded motion, which knows nothing of the encoders' noise."""
    if not stack.commanded:
        raise WrongUsage(
            "--method iv needs the commanded motion, and the log has none (q_ref)",
            fix="use --method wls, or a log recorded by dynid record",
        )
    return instrumental(_whitened(stack), stack.first_fit, robust=True)


def idim_iv(
    stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True
) -> Fit:
    """Instrumental variables from the arm simulated under its controller.

    The simulated motion follows the measured one more closely than the command does, where friction or gravity make the
    arm lag, and it knows as little of the encoders' noise. Wrong gains weaken the instruments and bias nothing.
    """
    simulate, effects = _simulation(stack, controller, "idim-iv"), stack.reversals
    fit = instrumental(_whitened(stack), stack.first_fit, robust=True)
    for _ in range(tuning.IDIM_ROUNDS):
        again = simulate(fit.theta)
        before, fit = (
            fit.theta,
            instrumental(list(whitened(again, effects)) if effects else again, fit, robust=True),
        )
        if _settled(fit, before, tuning.IDIM_SETTLED):
            break
    return replace(fit, method="idim-iv")


def didim(
    stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True
) -> Fit:
    """Direct and inverse model: the torques of the arm simulated under its controller are fitted to the measured ones.

    Measured positions take no part, so their noise cannot bias anything; wrong gains can. The simulated motion hardly
    depends on the parameters, because the controller holds it to the command: each round is a linear fit.
    """
    simulate = _simulation(stack, controller, "didim")
    fit = instrumental(_whitened(stack), stack.first_fit, robust=True)
    for _ in range(tuning.DIDIM_ROUNDS):
        simulated = simulate(fit.theta)
        rows, before = (
            simulated.with_logs([driven_as_commanded(log) for log in simulated.logs]),
            fit.theta,
        )
        found = weighted(*joint_factors(rows))
        _, robust = look_for_spikes(rows, found.theta)
        if robust:
            found = huber(rows, found)
        covariance, uncorrected = hac_covariances(rows, found.theta, found.noise, robust=robust)
        fit = replace(
            fit,
            theta=found.theta,
            noise=found.noise,
            covariance=covariance,
            uncorrected=uncorrected,
        )
        if _settled(fit, before, tuning.DIDIM_SETTLED):
            break
    return replace(fit, method="didim")


def ridge_to_prior(
    stack: Stack, prior: Floats, controller: Controller | None = None, *, corrected: bool = True
) -> Fit:
    """Weighted pseudo-inverse with prior data, in base parameters (the paper's last remark on estimation)."""
    known = np.nan_to_num(prior)
    spread = np.maximum(
        tuning.RIDGE_SPREAD * np.abs(known),
        tuning.RIDGE_FLOOR * max(1.0, float(np.abs(known).max())),
    )
    return ridge(
        *stack.whole, known, np.diag(np.where(np.isnan(prior), 1e3 * spread.max(), spread) ** 2)
    )


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


#: Those that take what the arm was commanded to do as instruments, or simulate it.
INSTRUMENTAL = ("iv", "idim-iv", "didim")


def choose(stack: Stack) -> tuple[str, str]:
    """Choose the estimator from what the logs offer.

    Returns:
        Its name, and why.
    """
    if stack.earlier is not None:
        return "wls", "the earlier result that is updated keeps triangular factors, not single rows"
    without = "no commanded motion in the log"
    if stack.first_fit.leaves_open:
        without = "the rows leave parameters open"
    elif stack.commanded:
        test = test_of_instruments(stack)
        if not test.weak:
            return "iv", "the log holds the commanded motion, which has no encoder noise"
        without = test.said()
    shares, spiky = look_for_spikes(stack, stack.first_fit.theta)
    if spiky:
        share = f"up to {100 * float(np.max(shares)):.1f} % of a joint's samples"
        also = f"; {without}" if stack.commanded else ""
        return "irls", f"the residual has spikes ({share}), which get little weight{also}"
    return "wls", f"{without} and no spikes in the residual"


def _with_covariance(
    stack: Stack,
    fit: Fit,
    rows: Iterable[ObservationRows],
    *,
    robust: bool = False,
    corrected: bool = True,
) -> Fit:
    """Return a fit with the factors of all rows as they are, and a covariance that allows for coloured residuals."""
    factors, counts = stack.whole
    fit = replace(fit, factors=factors, counts=counts)
    if stack.earlier is not None:
        return replace(fit, covariance=_with_earlier(stack, stack.earlier, fit))
    # Why a pseudo-inverse where the rank is short: what coloured residuals are worth shows in the other directions.
    same = rows is stack and not robust
    bread = fit.solution.inverse if fit.leaves_open or same else None
    covariance, uncorrected = hac_covariances(
        _measured(rows), fit.theta, fit.noise, robust=robust, bread=bread, corrected=corrected
    )
    return replace(
        fit,
        covariance=fit.solution.inverse if fit.leaves_open else covariance,
        uncorrected=uncorrected,
    )


def _with_earlier(stack: Stack, earlier: Earlier, fit: Fit) -> Floats:
    """Return the covariance of an updated estimate: the scores of old and new logs vary independently."""
    bread = fit.solution.inverse
    old = merge(earlier.factors, 1.0 / earlier.noise)[:-1, :-1]
    sensitivity = bread @ old.T @ old
    if not stack.logs:
        return np.asarray(sensitivity @ earlier.covariance @ sensitivity.T)
    new = hac_covariances(_measured(stack), fit.theta, fit.noise, bread=bread)[0]
    return np.asarray(sensitivity @ earlier.covariance @ sensitivity.T + new)


def _measured(rows: Iterable[ObservationRows]) -> Iterator[ObservationRows]:
    """Yield rows without their instruments: least squares takes its scores from the measured motion alone."""
    return (replace(part, command=None) for part in rows)


def _whitened(stack: Stack) -> Iterable[ObservationRows]:
    """Return the rows with no more trust in what happens at reversals than it deserves; of an update, as they are."""
    # Why a list: only rows that are few have reversals, and estimators walk over them many times.
    return list(whitened(stack, stack.reversals)) if stack.reversals else stack


def _simulation(
    stack: Stack, controller: Controller | None, method: str
) -> Callable[[Floats], Stack]:
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
    from dynid.estimation.closed_loop import (
        simulated,
    )  # here: the usual estimator simulates nothing

    return lambda theta: simulated(stack, theta, controller)


def _settled(fit: Fit, before: Floats, errors: float) -> bool:
    """Return whether the parameters moved by less than so many standard errors."""
    return bool(np.all(np.abs(fit.theta - before) <= errors * np.sqrt(np.diagonal(fit.covariance))))
