"""Error bars that hold: covariance under autocorrelated residuals, simultaneous intervals, tests, what is unknown.

Textbook errors assume white residuals; those of a robot are coloured by friction and filters, and textbook 95 %
intervals then cover 47 to 69 %. Reads score series or per-block factors; writes covariances and judgements.

Source: Newey, West 1987; Andrews 1991 (lag length); Efron, Tibshirani 1993 (jackknife, bootstrap).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.least_squares import solve

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Memory of the residuals that is always enough for arms [s]; longer than one period of any friction transient.
DEFAULT_MEMORY = 0.1
#: Samples whose sums over lags are made together.
PIECE = 8192
#: Relative standard error up to which a parameter is known well, and up to which roughly.
WELL, ROUGHLY = 0.10, 0.30
#: Change of torque, in standard deviations of a single sample, that nobody would notice.
HARMLESS = 0.05


def scores(W: Floats, residual: Floats, noise: Floats) -> Floats:
    """Return each sample's pull on the parameters, summed over joints.

    Args:
        W: rows of the regressor, or instruments, of one contiguous stretch, (N, n, p).
        residual: torque residuals, (N, n) [N m].
        noise: standard deviation of each joint, (n,) [N m].

    Returns:
        (N, p); joints are summed because their residuals are correlated at the same instant.
    """
    return np.asarray((W.swapaxes(1, 2) @ (residual / noise**2)[:, :, None])[:, :, 0])


def long_run_variance(series: Iterable[Floats], lags: int) -> Floats:
    """Return the Bartlett-weighted sum of autocovariances of score series (Newey-West), times their length.

    Why moving sums: the mean outer product of sums over lags + 1 samples is the same thing for one pass over the data.

    Args:
        series: one score series for each contiguous stretch, (N_k, p); lags never reach across stretches.
        lags: last lag with a weight.

    Returns:
        (p, p), positive semidefinite.
    """
    total: Floats | float = 0.0
    for one in series:
        width = min(lags + 1, len(one))
        # Why in pieces: the sums of a long log would need as much memory again as its scores.
        for first in range(0, len(one) + width - 1, PIECE):
            last = min(first + PIECE, len(one) + width - 1)
            inside = one[max(0, first - width + 1) : last]
            ends = (max(0, width - 1 - first), max(0, last - len(one)))
            sums = moving_sums(inside, width, ends)
            total = total + sums.T @ sums / width
    return np.asarray(total)


def moving_sums(series: Floats, width: int, ends: tuple[int, int] | None = None) -> Floats:
    """Return the sums over all windows of a series, (N, p); it counts as zero beyond its ends.

    Args:
        series: (N, p).
        width: samples in a window.
        ends: how far windows reach beyond either end; None for all that touch the series.
    """
    running = np.cumsum(np.pad(series, (ends or (width - 1, width - 1), (0, 0))), axis=0)
    sums: Floats = running[width - 1 :].copy()
    sums[1:] -= running[:-width]
    return sums


def automatic_lags(series: Sequence[Floats]) -> int:
    """Return the lag length that suits the memory of the scores (Andrews 1991, AR(1) plug-in, Bartlett).

    Args:
        series: score series of contiguous stretches, (N_k, p).

    Returns:
        Lags in samples.
    """
    length = sum(len(one) for one in series)
    power = np.sum([np.einsum("kp,kp->p", one[:-1], one[:-1]) for one in series], axis=0)
    together = np.sum([np.einsum("kp,kp->p", one[:-1], one[1:]) for one in series], axis=0)
    rho = together / np.where(power > 0.0, power, 1.0)
    rho = np.clip(rho, -0.97, 0.97)  # Andrews, Monahan 1992: a unit root would ask for infinitely many lags
    innovation = 1.0 - rho**2  # columns scaled to unit variance
    top = np.sum(4 * rho**2 * innovation**2 / ((1 - rho) ** 6 * (1 + rho) ** 2))
    bottom = np.sum(innovation**2 / (1 - rho) ** 4)
    bandwidth = 1.1447 * (top / bottom * length) ** (1 / 3)
    return int(min(np.ceil(bandwidth), max(1, length // 4)))


def effective_samples(residual: Floats) -> float:
    """Return how many independent samples a residual series is worth.

    Args:
        residual: (N, n), one column a joint.

    Returns:
        N / (1 + 2 sum of autocorrelations), the smallest over the joints, at most N.
    """
    centred = residual - residual.mean(axis=0)
    lags = automatic_lags([centred])
    variance = np.mean(centred**2, axis=0)
    longrun = [float(long_run_variance([centred[:, [j]]], lags)[0, 0]) / len(centred) for j in range(centred.shape[1])]
    inflation = np.array(longrun) / np.where(variance > 0.0, variance, 1.0)
    return float(len(residual) / max(1.0, float(inflation.max(initial=1.0))))


def jackknife(factors: Floats, noise: Floats) -> Floats:
    """Return the covariance from leaving out one time block after the other.

    Args:
        factors: factors of [W tau], joints by blocks, (n, B, p + 1, p + 1).
        noise: standard deviation of each joint, (n,) [N m].

    Returns:
        (p, p).
    """
    gram, scale = _block_grams(factors, noise)
    blocks = len(gram)
    left = _solve_grams(gram.sum(axis=0) - gram) / scale
    spread = left - left.mean(axis=0)
    return np.asarray(spread.T @ spread) * (blocks - 1) / blocks


def block_bootstrap(factors: Floats, noise: Floats, draws: int = 500, seed: int = 0) -> Floats:
    """Return parameters fitted to blocks drawn with replacement.

    Args:
        factors: factors of [W tau], joints by blocks, (n, B, p + 1, p + 1); blocks longer than the residuals' memory.
        noise: standard deviation of each joint, (n,) [N m].
        draws: number of fits.
        seed: of the random draws.

    Returns:
        (draws, p).
    """
    gram, scale = _block_grams(factors, noise)
    blocks = len(gram)
    counts = np.random.default_rng(seed).multinomial(blocks, np.full(blocks, 1.0 / blocks), size=draws)
    fitted = [_solve_grams(np.tensordot(some, gram, axes=1)) for some in np.array_split(counts, max(1, draws // 50))]
    return np.concatenate(fitted) / scale


def _block_grams(factors: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """Return each block's Gram matrix in normalised columns, (B, p + 1, p + 1), and the column lengths, (p,)."""
    whitened = factors / noise[:, None, None, None]
    length = np.sqrt(np.einsum("jbac,jbac->c", whitened, whitened))
    length = np.where(length > 0.0, length, 1.0)
    whitened = whitened / length
    return np.einsum("jbac,jbad->bcd", whitened, whitened, optimize=True), length[:-1] / length[-1]


def _solve_grams(gram: Floats) -> Floats:
    return np.asarray(np.linalg.solve(gram[:, :-1, :-1], gram[:, :-1, -1:])[:, :, 0])


def simultaneous_factor(
    covariance: Floats, level: float = 0.95, method: str = "max_t", freedom: float = np.inf
) -> float:
    """Return the factor on standard errors for intervals that hold for all parameters at once.

    Args:
        covariance: of the parameters that are judged together, (p, p).
        level: probability that all intervals hold.
        method: ``"single"`` (one parameter alone), ``"bonferroni"``, ``"scheffe"`` (all their combinations) or
            ``"max_t"`` (these parameters, their correlation used).
        freedom: degrees of freedom of the variance estimate.

    Returns:
        Half width of an interval over its standard error.
    """
    from scipy import special

    p = len(covariance)
    if method == "scheffe":
        quantile = 2 * special.gammaincinv(p / 2, level) / p if np.isinf(freedom) else special.fdtri(p, freedom, level)
        return float((p * quantile) ** 0.5)
    if method == "max_t":
        return _max_t(covariance, level, freedom)
    tail = (1.0 - level) / (2.0 if method == "single" else 2.0 * p)
    return float(-special.ndtri(tail) if np.isinf(freedom) else -special.stdtrit(freedom, tail))


def _max_t(covariance: Floats, level: float, freedom: float) -> float:
    sigma = np.sqrt(np.diagonal(covariance))
    value, vector = np.linalg.eigh(covariance / np.outer(sigma, sigma))
    rng = np.random.default_rng(0)
    normal = rng.standard_normal((20000, len(value))) @ (vector * np.sqrt(np.maximum(value, 0.0))).T
    if np.isfinite(freedom):
        normal /= np.sqrt(rng.chisquare(freedom, (len(normal), 1)) / freedom)
    return float(np.quantile(np.abs(normal).max(axis=1), level))


@dataclass(frozen=True)
class GroupTest:
    """Whether a group of parameters can be left out.

    Attributes:
        statistic: F or Wald statistic over its degrees of freedom.
        p_value: chance of such a statistic if the group is zero.
    """

    statistic: float
    p_value: float


def wald_test(theta: Floats, covariance: Floats, group: Ints, freedom: float = np.inf) -> GroupTest:
    """Test whether a group of parameters is zero, with an honest covariance.

    Args:
        theta: parameters, (p,).
        covariance: HAC or bootstrap, (p, p).
        group: columns of the group, (k,).
        freedom: degrees of freedom of the variance estimate.

    Returns:
        The test.
    """
    from scipy import special

    k, part = len(group), theta[group]
    statistic = float(part @ np.linalg.solve(covariance[np.ix_(group, group)], part)) / k
    tail = special.chdtrc(k, k * statistic) if np.isinf(freedom) else special.fdtrc(k, freedom, statistic)
    return GroupTest(statistic, float(tail))


def f_test(whitened: Floats, group: Ints, rows: int, effective: float | None = None) -> GroupTest:
    """Test whether columns can be dropped, by the growth of the residual.

    Args:
        whitened: factor of rows divided by their noise, (p + 1, p + 1).
        group: columns of the group, (k,).
        rows: number of rows.
        effective: how many independent rows they are worth; None for all.

    Returns:
        The test. Coloured residuals make the growth larger by rows / effective, which is divided out.
    """
    from scipy import special

    effective = float(rows) if effective is None else effective
    p, k = whitened.shape[1] - 1, len(group)
    keep = np.setdiff1d(np.arange(p + 1), group)
    full = solve(whitened).residual
    growth = solve(np.asarray(np.linalg.qr(whitened[:, keep], mode="r"))).residual - full
    statistic = growth / k / (full / (rows - p)) * effective / rows
    return GroupTest(float(statistic), float(special.fdtrc(k, max(effective - p, 1.0), statistic)))


class Knowledge(Enum):
    """How well a parameter is known."""

    WELL = "well"
    ROUGHLY = "roughly"
    NOT_DETERMINED = "not determined"


def judge(theta: Floats, std_error: Floats, effect: Floats) -> tuple[Knowledge, ...]:
    """Say how well each parameter is known.

    A parameter may be well known although its relative error is large: a product of inertia that is zero is known
    when all values that the interval allows would change the torques by less than their noise.

    Args:
        theta: parameters, (p,).
        std_error: honest standard errors, (p,); infinite where the rank is short.
        effect: root mean square of each whitened column of the regressor, (p,): noise a unit of theta.

    Returns:
        One judgement a parameter.
    """
    relative = std_error / np.where(theta != 0.0, np.abs(theta), np.finfo(float).tiny)
    harmless = (std_error * effect <= HARMLESS) & (effect > 0.0)
    judgement = []
    for error, small in zip(relative, harmless, strict=True):
        if error <= WELL or small:
            judgement.append(Knowledge.WELL)
        else:
            judgement.append(Knowledge.ROUGHLY if error <= ROUGHLY else Knowledge.NOT_DETERMINED)
    return tuple(judgement)
