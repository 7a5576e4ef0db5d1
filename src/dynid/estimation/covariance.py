"""Error bars that hold: covariance of estimates whose residuals are coloured and correlated between joints (HAC).

Textbook errors assume white residuals; those of a robot are coloured by friction and filters, and textbook 95 %
intervals then cover 47 to 69 %. Here the spread of the scores (the gradient that each instant's residual contributes)
is summed over the lags that their memory asks for. In a log of seconds even that is too small, by a factor that is
found by simulation on the log's own rows.

Source: Newey, West 1987; Andrews 1991 (lag length); Bell, McCaffrey 2002 (correction under a working model, Student's t
with Satterthwaite's degrees of freedom).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.least_squares import symmetric_root
from dynid.estimation.rows import ObservationRows, joined, runs
from dynid.signals.filters import decimate, pulse, pulse_width

Floats = NDArray[np.float64]

#: Relative standard error from which on zero lies inside the 95 % interval.
ZERO_INSIDE = 1 / 1.96
#: Words for how well a parameter is known: within a tenth of its value; zero as far as the torques can tell; within a
#: third; or the log says nothing about it.
KNOWN_WELL, NEGLIGIBLE, KNOWN_ROUGHLY, NOT_DETERMINED = (
    "well",
    "negligible",
    "roughly",
    "not determined",
)
WORDS = (KNOWN_WELL, NEGLIGIBLE, KNOWN_ROUGHLY, NOT_DETERMINED)


def hac_covariances(
    rows: Iterable[ObservationRows],
    theta: Floats,
    noise: Floats,
    *,
    robust: bool = False,
    bread: Floats | None = None,
    basis: Floats | None = None,
    of: Sequence[int] | None = None,
    corrected: bool = True,
) -> tuple[Floats, Floats]:
    """Return the covariance of an estimate, allowing for coloured residuals, and without correction for short logs.

    Args:
        rows: observation rows; instruments are used where they come with them.
        theta: the estimate, (p,).
        noise: standard deviation of each joint that the estimator divided by, (n,) [N m or N].
        robust: whether the estimate had Huber weights.
        bread: sensitivity of the estimate to the scores, (p, p), where it was made from more than these rows.
        basis: what the columns of the rows are combined to before, (columns, p); None to take them as they are.
        of: numbers of the parameters whose covariance is wanted, k of them instead of p; None for all.
        corrected: whether the correction is wanted at all; without, the first covariance is the second.
    """
    given = theta if basis is None else basis @ theta
    sensitivity = np.zeros((len(given), len(given)))
    growing: list[list[Floats]] = []
    short: list[ObservationRows] = []
    instants = 0
    for part in rows:
        residual = part.residual(given)
        inside = part.mask & (np.abs(residual) <= tuning.HUBER * noise) if robust else part.mask
        if not (part.follows and growing):
            growing.append([])
        bounded = (
            np.clip(residual, -tuning.HUBER * noise, tuning.HUBER * noise) if robust else residual
        )
        scores = _scores(part, bounded / noise**2)
        if bread is None:
            _add_sensitivity(part, inside / noise**2, sensitivity)
        growing[-1].append(scores.T if basis is None else scores.T @ basis)
        instants += len(residual)
        short = (
            [*short, replace(part, usable=inside)] if instants <= tuning.SHORT_LOG_INSTANTS else []
        )
    if basis is not None:
        sensitivity, short = (
            basis.T @ sensitivity @ basis,
            [part.with_arrays(part.W @ basis, part.tau) for part in short],
        )
    series = [np.concatenate(each) for each in growing]
    lags = automatic_lags(series)
    if bread is None:
        scale = 1.0 / np.sqrt(np.abs(np.diagonal(sensitivity)))
        bread = scale[:, None] * np.linalg.inv(scale[:, None] * sensitivity * scale) * scale
    wanted = bread if of is None else bread[of]
    # Why by a root: of parameters that the log hardly tells the product of three would be no covariance, by rounding.
    spread = wanted @ symmetric_root(long_run_variance(series, lags))
    covariance = uncorrected = np.asarray(spread @ spread.T)
    if corrected and instants <= tuning.SHORT_LOG_INSTANTS:
        factor = short_log_factor([joined(run) for run in runs(short)], bread, noise, lags, of)
        covariance = covariance * np.outer(factor, factor)
    return covariance, uncorrected


def _scores(rows: ObservationRows, weighted: Floats) -> Floats:
    """Return the score of each instant, (p, M): Z^T S residual, summed over joints, whose residuals are correlated.

    Z is the regressor, or the instruments where there are any.

    Args:
        rows: observation rows.
        weighted: residuals over noise^2, (M, n) [1 / (N m)].
    """
    scores, Z = (
        np.zeros((rows.size, len(weighted))),
        rows if rows.command is None else rows.instruments,
    )
    for j, one in enumerate(np.ascontiguousarray(weighted.T)):
        columns, entries = Z.of_joint(j)
        scores[columns] += entries * one
    return scores


def _add_sensitivity(rows: ObservationRows, weight: Floats, sensitivity: Floats) -> None:
    """Add Z^T S W of rows to a sum, (p, p), in place; weight is 1 / noise^2 of the rows that weigh, (M, n)."""
    for j in range(weight.shape[1]):
        columns, W = rows.of_joint(j)
        Z = W if rows.command is None else rows.instruments.of_joint(j)[1]
        sensitivity[np.ix_(columns, columns)] += (Z * weight[:, j]) @ W.T


def long_run_variance(series: Iterable[Floats], lags: int) -> Floats:
    """Return the Bartlett-weighted sum of autocovariances of score series (Newey-West), times their length, (p, p).

    Why moving sums: the mean outer product of sums over lags + 1 samples is the same thing for one pass over the data.

    Args:
        series: one score series for each run without gaps, (M_k, p) [1 / unit of each parameter]; lags never reach
            across runs.
        lags: last lag with a weight, in samples.
    """
    total: Floats | float = 0.0
    for one in series:
        width = min(lags + 1, len(one))
        sums = _moving_sums(one, width)
        total = total + sums.T @ sums / width
    return np.asarray(total)


def _moving_sums(series: Floats, width: int) -> Floats:
    """Return the sums over all windows of so many samples of a series, (M, p); it is zero beyond its ends."""
    power = np.pad(series, ((width - 1, width - 1), (0, 0)))
    sums, begin, length = np.zeros((len(power) - width + 1, series.shape[1])), 0, 1
    # Why by doubling: running sums lose digits, and take three times as long.
    while length <= width:
        if width & length:
            sums += power[begin : begin + len(sums)]
            begin += length
        power, length = power[:-length] + power[length:], 2 * length
    return sums


def automatic_lags(series: Sequence[Floats]) -> int:
    """Return the lag length that suits the memory of the scores, in samples (Andrews 1991, AR(1) plug-in, Bartlett).

    Args:
        series: score series of runs without gaps, (M_k, p) [1 / unit of each parameter].
    """
    length = sum(len(one) for one in series)
    power, together = np.zeros((2, series[0].shape[1]))
    for one in series:
        power += np.sum(one[:-1] ** 2, axis=0)
        together += np.sum(one[:-1] * one[1:], axis=0)
    rho = together / np.where(power > 0.0, power, 1.0)
    rho = np.clip(
        rho, -0.97, 0.97
    )  # Andrews, Monahan 1992: a unit root would ask for infinitely many lags
    innovation = 1.0 - rho**2  # columns scaled to unit variance
    top = np.sum(4 * rho**2 * innovation**2 / ((1 - rho) ** 6 * (1 + rho) ** 2))
    bottom = np.sum(innovation**2 / (1 - rho) ** 4)
    bandwidth = 1.1447 * (top / bottom * length) ** (1 / 3)
    return int(min(np.ceil(bandwidth), max(1, length // 4)))


def autocorrelation_time(parts: Sequence[Floats]) -> float:
    """Return the integrated autocorrelation time in rows: how many rows tell as much as one independent one.

    The sum of autocorrelations ends at their first zero.

    Source: Geyer 1992, "Practical Markov chain Monte Carlo", for where to stop.
    """
    longest = max(len(x) for x in parts)
    size = 1 << (2 * longest).bit_length()
    power = sum(np.abs(np.fft.rfft(x, size)) ** 2 for x in parts)
    covariance = np.fft.irfft(np.asarray(power), size)[:longest]
    if covariance[0] <= 0:
        return 1.0
    ends = np.flatnonzero(covariance <= 0)
    return float(
        max(1.0, 2 * covariance[: ends[0] if len(ends) else longest].sum() / covariance[0] - 1)
    )


# ---------------------------------------------------------------- short logs
def short_log_factor(
    segments: Sequence[ObservationRows],
    bread: Floats,
    noise: Floats,
    lags: int,
    of: Sequence[int] | None = None,
) -> Floats:
    """Return the factor on each standard error after which 1.96 of them are a 95 % interval, (p,).

    A fit takes from the residuals just what the covariance asks them for: errors as slow as the columns. In 10 s of a
    seven-joint arm little is left of those, and a variance that is estimated from few slow waves is itself uncertain.
    For noise that passed the filter of the rows both effects are known: such noise is drawn, fitted and judged like the
    residuals, and what comes out is compared with the true variance of its errors.

    Args:
        segments: rows of each run without gaps; ``usable`` says which weigh in the estimate.
        bread: sensitivity of the estimate to the scores, (p, p).
        noise: standard deviation of each joint that the estimator divided by, (n,) [N m or N].
        lags: memory that the covariance allows for, in samples.
        of: numbers of the parameters whose factors are wanted; None for all.
    """
    instants = sum(len(rows.tau) for rows in segments)
    draws = int(
        np.clip(tuning.SHORT_LOG_WORK // max(instants, 1), tuning.LEAST_DRAWS, tuning.MOST_DRAWS)
    )
    rng = np.random.default_rng(0)
    whitened = [_whitened(rows, noise) for rows in segments]
    kernels = [_kernel(rows) for rows in segments]
    drawn = [
        _filtered(rng, (draws, len(noise), len(rows.tau)), kernel) * rows.mask[:, :, None]
        for rows, kernel in zip(segments, kernels, strict=True)
    ]
    scores = np.sum(
        [np.tensordot(Z, e, ((0, 1), (0, 1))) for Z, e in zip(whitened, drawn, strict=True)], axis=0
    )
    error, wanted = bread @ scores, bread if of is None else bread[of]
    true, judged = np.zeros(len(wanted)), np.zeros((draws, len(wanted)))
    for rows, Z, kernel, e in zip(segments, whitened, kernels, drawn, strict=True):
        influence = np.tensordot(Z, wanted.T, 1)
        true += _variance(influence, kernel)
        left = (e - np.tensordot(rows.W, error, 1) / noise[:, None]) * rows.mask[:, :, None]
        judged += _judged(influence, left, min(lags + 1, len(left)))
    return _factor(true, judged.T)


def _judged(influence: Floats, left: Floats, width: int) -> Floats:
    """Return the variance that residuals let expect of each parameter, (draws, p).

    Args:
        influence: what a residual of one standard deviation does to the parameters, (M, n, p).
        left: residuals of each draw, (M, n, draws).
        width: samples of a window.
    """
    (M, _, p), draws = influence.shape, left.shape[2]
    found = np.empty((draws, p))
    # Why some parameters at a time: the sums of all of them would leave the cache.
    some = max(1, tuning.SCORES_CACHED // (M * draws))
    for first in range(0, p, some):
        scores = left.swapaxes(1, 2) @ influence[:, :, first : first + some]
        sums = _moving_sums(scores.reshape(M, -1), width)
        found[:, first : first + some] = (
            np.einsum("tk,tk->k", sums, sums).reshape(draws, -1) / width
        )
    return found


def _factor(true: Floats, judged: Floats) -> Floats:
    from scipy.special import (
        stdtrit,
    )  # here: its import takes as long as an estimate from a long log

    mean = np.maximum(judged.mean(axis=1), np.finfo(float).tiny)
    freedom = 2.0 * mean**2 / np.maximum(judged.var(axis=1, ddof=1), np.finfo(float).tiny)
    quantile = stdtrit(np.maximum(freedom, tuning.LEAST_FREEDOM), 0.975) / normal_quantile(0.975)
    return np.asarray(np.sqrt(true / mean) * quantile)


def _whitened(rows: ObservationRows, noise: Floats) -> Floats:
    """Return the regressor, or the instruments where there are any, divided by the noise, (M, n, p)."""
    return (rows.W if rows.Z is None else rows.Z) * (rows.mask / noise)[:, :, None]


def _kernel(rows: ObservationRows) -> Floats:
    """Return what made the noise in the rows as coloured as it is, (K,), of unit length."""
    if rows.cutoff == 0.0 or len(rows.t) < 2:
        return np.ones(1)
    step = float(np.median(np.diff(rows.t)))
    half = int(pulse_width(rows.cutoff) / step)
    kernel = pulse(step * np.arange(-half, half + 1.0), rows.cutoff)
    return np.asarray(kernel / np.linalg.norm(kernel))


def _filtered(rng: np.random.Generator, shape: tuple[int, int, int], kernel: Floats) -> Floats:
    """Return coloured noise for draws, joints and instants, (M, n, draws)."""
    white = rng.standard_normal((*shape[:2], shape[2] + len(kernel) - 1))
    windows = np.lib.stride_tricks.sliding_window_view(white, len(kernel), axis=2)
    return np.ascontiguousarray((windows @ kernel).transpose(2, 1, 0))


def _variance(influence: Floats, kernel: Floats) -> Floats:
    """Return the variance that coloured noise gives the parameters, (p,)."""
    M, n, p = influence.shape
    ends = len(kernel) - 1
    (spread,) = decimate(
        np.pad(influence.reshape(M, n * p).T, ((0, 0), (ends, ends))), kernel[None], 1
    )
    return np.asarray(np.einsum("jpt,jpt->p", *2 * (spread.reshape(n, p, -1),)))


# ---------------------------------------------------------------- words
def judge(theta: Floats, std_error: Floats, effect: Floats) -> tuple[str, ...]:
    """Say how well each parameter is known.

    A parameter may be known although its relative error is large: a product of inertia that is zero is known when all
    values that the interval allows would change the torques by less than their noise. It is negligible when zero
    cannot be told from it.

    Args:
        theta: parameters, (p,), each in its unit.
        std_error: standard errors that allow for coloured residuals, (p,), in the same units; infinite where the rank
            is short.
        effect: root mean square of each whitened column of the regressor, (p,): noise a unit of theta.

    Returns:
        One of ``WORDS`` for each parameter.
    """
    harmless = (std_error * effect <= tuning.HARMLESS_TORQUE) & (effect > 0.0)
    judgement = []
    # Why no quotient: a parameter may be zero.
    for error, size, small in zip(std_error, np.abs(theta), harmless, strict=True):
        if error <= tuning.WELL_ERROR * size or small:
            judgement.append(KNOWN_WELL if error <= ZERO_INSIDE * size else NEGLIGIBLE)
        else:
            judgement.append(
                KNOWN_ROUGHLY if error <= tuning.ROUGH_ERROR * size else NOT_DETERMINED
            )
    return tuple(judgement)


def counted(knowledge: tuple[str, ...]) -> str:
    """Return how many parameters are known how well, such as ``"57 well, 5 negligible, 2 roughly"``."""
    return ", ".join(f"{knowledge.count(word)} {word}" for word in WORDS if word in knowledge)


def normal_quantile(p: float) -> float:
    """Return what a standard normal number stays below with a probability."""
    return NormalDist().inv_cdf(p) if 0.0 < p < 1.0 else math.copysign(math.inf, p - 0.5)
