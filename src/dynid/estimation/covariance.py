"""Error bars that hold: covariance of estimates whose residuals are coloured and correlated between joints (HAC).

Textbook errors assume white residuals; those of a robot are coloured by friction and filters, and textbook 95 %
intervals then cover 47 to 69 %. Here the spread of the scores (the gradient that each instant's residual contributes)
is summed over the lags that their memory asks for. In a log of seconds even that is too small: ``widened`` has a floor,
and Student's t.

Source: Newey, West 1987; Andrews 1991 (lag length).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from statistics import NormalDist

import numpy as np

from dynid.arrays import Floats
from dynid.estimation import tuning
from dynid.estimation.least_squares import Fit, symmetric_root
from dynid.estimation.rows import Rows
from dynid.signals.filters import lowpass_kernel

#: Relative standard error from which on zero lies inside the 95 % interval.
ZERO_INSIDE = 1 / 1.96
#: Words for how well a parameter is known: within a tenth of its value; zero as far as the torques can tell; within a
#: third; or the log says nothing about it.
WORDS = KNOWN_WELL, NEGLIGIBLE, KNOWN_ROUGHLY, NOT_DETERMINED = (
    "well",
    "negligible",
    "roughly",
    "not determined",
)


def hac_covariance(
    rows: Rows,
    theta: Floats,
    noise: Floats,
    *,
    robust: bool = False,
    bread: Floats | None = None,
) -> Floats:
    """Return the covariance of an estimate, allowing for coloured residuals, (p, p).

    Args:
        rows: observation rows; instruments are used where they come with them.
        theta: the estimate, (p,).
        noise: standard deviation of each joint that the estimator divided by, (n,) [N m or N].
        robust: whether the estimate had Huber weights.
        bread: sensitivity of the estimate to the scores, (p, p), where it was made from more than these rows.
    """
    residual = rows.residual(theta)
    limit = tuning.HUBER * noise if robust else np.full(len(noise), np.inf)
    weight = (rows.use & (np.abs(residual) <= limit)) / noise**2
    bounded = np.clip(residual, -limit, limit) / noise**2
    scores, sensitivity = np.zeros((len(residual), rows.size)), np.zeros((rows.size, rows.size))
    for j in range(len(noise)):
        Z = rows.instruments(j)
        scores += Z * bounded[:, [j]]
        if bread is None:
            sensitivity += (Z * weight[:, [j]]).T @ rows.W[:, j]
    series = [scores[run] for run in rows.runs]
    if bread is None:
        scale = 1.0 / np.sqrt(np.abs(np.diagonal(sensitivity)))
        bread = scale[:, None] * np.linalg.inv(scale[:, None] * sensitivity * scale) * scale
    # Why by a root: of parameters that the log hardly tells the product of three would be no covariance, by rounding.
    spread = bread @ symmetric_root(long_run_variance(series, automatic_lags(series)))
    return spread @ spread.T


def widened(rows: Rows, fit: Fit, covariance: Floats) -> Floats:
    """Return a covariance after which 1.96 standard errors are a 95 % interval in a short log, too, (p, p).

    A fit takes from the residuals just what the covariance asks them for: errors as slow as the columns. The variance
    is at least that of white noise behind the filter of the rows; and a quantile of Student's t allows for few
    independent rows.

    Args:
        rows: observation rows.
        fit: the estimate, of p parameters.
        covariance: its covariance without this correction, (p, p).
    """
    from scipy.special import stdtrit  # here: its import takes as long as a fit

    memory = _memory(rows)
    independent = int(rows.use.sum()) / memory
    freedom = max(independent - len(fit.theta), tuning.LEAST_FREEDOM)
    quantile = float(stdtrit(freedom, 0.975)) / normal_quantile(0.975)
    least = memory * np.diagonal(fit.solution.inverse)
    least = least / np.maximum(np.diagonal(covariance), np.finfo(float).tiny)
    factor = quantile * np.sqrt(np.maximum(1.0, least))
    return covariance * np.outer(factor, factor)


def _memory(rows: Rows) -> float:
    """Return how many rows tell as much as one independent one of noise that was white before their filter."""
    t = max((rows.t[run] for run in rows.runs), key=len)
    if rows.cutoff == 0.0 or len(t) < 2:
        return 1.0
    kernel = lowpass_kernel(rows.cutoff, (len(t) - 1) / float(t[-1] - t[0]))
    return 1.0 / float(np.sum(kernel**2))


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
        sums = np.stack([np.convolve(column, np.ones(width)) for column in one.T])
        total = total + sums @ sums.T / width
    return np.asarray(total)


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
    size = np.abs(theta)
    known = harmless | (std_error <= tuning.WELL_ERROR * size)
    levels = [
        known & (std_error <= ZERO_INSIDE * size),
        known,
        std_error <= tuning.ROUGH_ERROR * size,
    ]
    return tuple(np.select(levels, WORDS[:3], NOT_DETERMINED).tolist())


def counted(knowledge: tuple[str, ...]) -> str:
    """Return how many parameters are known how well, such as ``"57 well, 5 negligible, 2 roughly"``."""
    return ", ".join(f"{knowledge.count(word)} {word}" for word in WORDS if word in knowledge)


def normal_quantile(p: float) -> float:
    """Return what a standard normal number stays below with a probability."""
    return NormalDist().inv_cdf(p) if 0.0 < p < 1.0 else math.copysign(math.inf, p - 0.5)
