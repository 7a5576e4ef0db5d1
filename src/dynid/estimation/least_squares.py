"""Ordinary and weighted least squares from small triangular factors (Paper Eq. 24), with error bars that hold.

Any number of rows ``[W tau]`` is represented by the R factor of their QR decomposition, (p + 1, p + 1): same solution,
same residual sum of squares, and factors of several blocks or logs are merged by another QR. One factor per joint is
kept, because joints differ in noise. Recursive least squares merges an old factor with new ones.

Textbook errors assume white residuals; those of a robot are coloured by friction and filters, and textbook 95 %
intervals then cover 47 to 69 %. Here the spread of the scores (the gradient that each instant's residual contributes)
is summed over the lags that their memory asks for, also between joints (HAC). In a log of seconds even that is too
small: ``widened`` has a floor, and Student's t.

Source: Demmel et al. 2012, "Communication-optimal parallel and sequential QR" (TSQR); Newey, West 1987; Andrews 1991
(lag length).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynid.arrays import Floats, Ints, Mask
from dynid.errors import LogTooShort, RankDeficient
from dynid.estimation import tuning
from dynid.estimation.factor import of_unit_diagonal, triangle
from dynid.estimation.rows import Rows
from dynid.signals.filters import lowpass_kernel

#: Length of a column, relative to the longest, that is nothing but rounding.
ROUNDING = 1e-15


@contextmanager
def solvable() -> Iterator[None]:
    """Turn a system that cannot be solved into a mistake of the numbers that it was made of; also a decorator.

    Raises:
        RankDeficient: they are so far apart, or so small, that double precision holds nothing of the others.
    """
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise RankDeficient(
            f"the equations from these logs cannot be solved ({error})",
            why="values differ by too many orders of magnitude, all torques are zero, or given masses are far off",
            fix="look at the log: dynid check LOG --robot ROBOT",
        ) from error


def merge(factors: Floats, weights: Floats | None = None) -> Floats:
    """Merge factors into the factor of all their rows, each multiplied by its weight.

    Args:
        factors: (B, p + 1, p + 1) [N m or N].
        weights: (B,), such as 1 / noise [1/(N m)], which makes the result a number; None for ones.

    Returns:
        (p + 1, p + 1) upper triangular.
    """
    scaled = factors if weights is None else factors * weights[:, None, None]
    return triangle(scaled.reshape(-1, factors.shape[-1]))


def symmetric_root(matrix: Floats) -> Floats:
    """Return L with L L^T = matrix, (p, p); eigenvalues below zero are rounding and count as zero.

    Args:
        matrix: symmetric, never negative, such as a covariance or an information, (p, p); where it knows nothing of a
            parameter, row and column are zero, and so are those of L.
    """
    scaled, unit = of_unit_diagonal(matrix)
    value, vector = np.linalg.eigh(scaled)
    return vector / unit[:, None] * np.sqrt(np.maximum(value, 0.0))


@dataclass(frozen=True)
class Solution:
    """The least-squares solution of one factor.

    Attributes:
        theta: parameters, (p,), each in its unit; the shortest in normalised columns where the rank is short.
        root: A with A A^T the inverse of W^T W, (p, rank); its columns are the directions that the rows excite.
        residual: sum of squares that remains.
        rank: number of directions that the rows excite.
        condition_number_scaled: of W with columns of unit length.
        weak: directions that the rows leave open, columns in parameter space, (p, p - rank).
    """

    theta: Floats
    root: Floats
    residual: float
    rank: int
    condition_number_scaled: float
    weak: Floats

    @property
    def condition_number(self) -> float:
        """Condition number of W, columns as they are; infinite where the rank is short."""
        return float(np.linalg.cond(self.root)) if self.rank == len(self.theta) else math.inf

    @cached_property
    def inverse(self) -> Floats:
        """Inverse of W^T W, (p, p); of whitened rows the covariance, in products of the parameters' units."""
        return self.root @ self.root.T


def solve(R: Floats) -> Solution:
    """Solve a triangular factor for the parameters.

    Args:
        R: factor of [W tau], (p + 1, p + 1).

    Returns:
        The solution. Columns are normalised first: slow motion would otherwise look like a lost rank.
    """
    A, b = R[:-1, :-1], R[:-1, -1]
    length = np.linalg.norm(A, axis=0)
    # Why not those of rounding: at unit length, what is left of a joint that stands still would look like motion.
    length = np.where(length > ROUNDING * length.max(initial=0.0), length, 1.0)
    U, sigma, Vt = np.linalg.svd(A / length)
    cutoff = tuning.RANK_TOLERANCE * sigma[0]
    rank = int(np.sum(sigma > cutoff))
    root = Vt[:rank].T / sigma[:rank] / length[:, None]
    projected = U.T @ b
    return Solution(
        theta=root @ projected[:rank],
        root=root,
        residual=float(R[-1, -1] ** 2 + projected[rank:] @ projected[rank:]),
        rank=rank,
        condition_number_scaled=float(sigma[0] / sigma[-1]) if rank == len(sigma) else math.inf,
        weak=Vt[rank:].T / length[:, None],
    )


@dataclass(frozen=True)
class Fit:
    """Base parameters from one estimator; p parameters, n joints.

    Attributes:
        method: name of the estimator.
        theta: base parameters, (p,), each in its unit.
        noise: standard deviation of each joint's residual that the rows were divided by, (n,) [N m or N].
        covariance: of theta, (p, p), in products of their units.
        factors: one triangular factor of [W tau] per joint, (n, p + 1, p + 1).
        counts: number of rows of each joint, (n,).
        uncorrected: covariance without correction for short logs, (p, p); None where there is none.
    """

    method: str
    theta: Floats
    noise: Floats
    covariance: Floats
    factors: Floats
    counts: Ints
    uncorrected: Floats | None = None

    @cached_property
    def whitened(self) -> Floats:
        """Factor of all rows divided by their noise, (p + 1, p + 1); 1/2 chi-square is its natural cost."""
        return merge(self.factors, 1.0 / self.noise)

    @cached_property
    def solution(self) -> Solution:
        """Rank and condition numbers of the whitened rows."""
        return solve(self.whitened)

    @property
    def robust(self) -> Floats | None:
        """Parameters from which large residuals are spikes, (p,); None where these got their whole weight."""
        return self.theta if self.method in ("irls", "iv") else None

    @property
    def open(self) -> Mask:
        """Parameters along which the rows leave a direction open, (p,)."""
        return np.abs(self.solution.weak).max(axis=1, initial=0.0) > 1e-9

    @property
    def effect(self) -> Floats:
        """Root mean square of each whitened column of the regressor, (p,): noise a unit of theta."""
        size = np.linalg.norm(self.whitened[:, :-1], axis=0)
        return size / np.sqrt(max(1, self.counts.sum()))

    @cached_property
    def inflation(self) -> float:
        """How many rows count as one independent row beside the prior; 1/2 chi-square of all is divided by it."""
        A = self.whitened[:-1, :-1]
        spread = self.covariance if self.uncorrected is None else self.uncorrected
        worth = tuning.HELD_BACK * np.sum((A @ spread) * A) / max(1, self.solution.rank)
        return float(np.clip(worth, 1.0, tuning.LARGEST_INFLATION))

    @cached_property
    def rms(self) -> Floats:
        """Root mean square of each joint's residual, (n,) [N m or N]."""
        return joint_rms(self.factors, self.counts, self.theta)


def ordinary(factors: Floats, counts: Ints) -> Fit:
    """Fit by ordinary least squares: every N m of every joint counts the same (Paper Eq. 24).

    Args:
        factors: one factor per joint, (n, p + 1, p + 1) [N m or N].
        counts: number of rows of each joint, (n,).

    Returns:
        The fit; the noise is the same for all joints, and the covariance is that of white residuals.
    """
    solution_of_all = solve(merge(factors))
    total = float(counts.sum())
    if total <= solution_of_all.rank:
        raise LogTooShort(
            f"{total:.0f} rows for {solution_of_all.rank} parameters", fix="record a longer motion"
        )
    noise = (solution_of_all.residual / (total - solution_of_all.rank)) ** 0.5
    noise = max(noise, _floor(factors, counts).min())
    same, covariance = np.full(len(counts), noise), noise**2 * solution_of_all.inverse
    return Fit("ols", solution_of_all.theta, same, covariance, factors, counts)


def weighted(factors: Floats, counts: Ints) -> Fit:
    """Fit with each joint divided by its own noise, found from the residuals and iterated.

    Args:
        factors: one factor per joint, (n, p + 1, p + 1) [N m or N].
        counts: number of rows of each joint, (n,).

    Returns:
        The fit; its covariance is that of white residuals.
    """
    fit = replace(ordinary(factors, counts), method="wls")
    for _ in range(tuning.FIT_ROUNDS):
        noise = _joint_noise(fit)
        solution = solve(merge(factors, 1.0 / noise))
        settled = np.all(np.abs(noise - fit.noise) <= 1e-4 * fit.noise)
        fit = replace(fit, theta=solution.theta, noise=noise, covariance=solution.inverse)
        if settled:
            break
    return fit


def joint_rms(factors: Floats, counts: Ints, theta: Floats) -> Floats:
    """Return the root mean square of each joint's residual for any parameters, (n,) [N m or N]."""
    residual = factors @ np.append(theta, -1.0)
    return np.sqrt(np.sum(residual**2, axis=-1) / np.maximum(counts, 1))


def relative_error(factors: Floats, theta: Floats) -> float:
    """Return 100 * |tau - W theta| / |tau| over all rows [%], of factors (n, p + 1, p + 1) and parameters (p,)."""
    residual = factors @ np.append(theta, -1.0)
    return float(100.0 * np.linalg.norm(residual) / np.linalg.norm(factors[..., -1]))


def _joint_noise(fit: Fit) -> Floats:
    """Return residual rms per joint, corrected for the parameters that each joint's own rows have spent."""
    counts, scaled = fit.counts, fit.factors[:, :, :-1] / fit.noise[:, None, None]
    spent = np.einsum("jab,bc,jac->j", scaled, fit.covariance, scaled, optimize=True)
    free = counts - spent
    # Why: what a joint's few rows leave of its noise says nothing once as many parameters were fitted to them.
    own = fit.rms * np.sqrt(counts / np.maximum(free, tuning.LEAST_ROWS_LEFT))
    own = np.where(free > tuning.LEAST_ROWS_LEFT, own, fit.noise)
    return np.maximum(own, _floor(fit.factors, counts))


def _floor(factors: Floats, counts: Ints) -> Floats:
    """Return the rounding error of each joint's torque: noise-free simulations must not divide by zero."""
    torque = joint_rms(factors, counts, np.zeros(factors.shape[-1] - 1))
    return 1e-12 * np.maximum(torque, max(float(torque.max(initial=0.0)), 1e-30))


# ---------------------------------------------------------------- error bars that hold
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
    limit = noise * (tuning.HUBER if robust else np.inf)
    if bread is None:
        weight = (rows.use & (np.abs(residual) <= limit)) / noise**2
        of_joints = (x.swapaxes(0, 1) for x in (rows.instruments, rows.W))
        # Why joint by joint: products of all rows at once take the memory of several regressors.
        sensitivity = sum((Z.T * w) @ W for Z, W, w in zip(*of_joints, weight.T, strict=True))
        scaled, unit = of_unit_diagonal(np.asarray(sensitivity))
        bread = unit[:, None] * np.linalg.inv(scaled) * unit
    return coloured(rows, rows.scores(np.clip(residual, -limit, limit) / noise**2), bread)


def coloured(rows: Rows, scores: Floats, bread: Floats) -> Floats:
    """Return the covariance of an estimate from the scores of its rows, (M, p), and how it follows them, (p, p)."""
    series = [scores[run] for run in rows.runs]
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
    from scipy.special import ndtri, stdtrit  # here: their import takes as long as a fit

    memory = _memory(rows)
    independent = int(rows.use.sum()) / memory
    freedom = max(independent - len(fit.theta), tuning.LEAST_FREEDOM)
    quantile = stdtrit(freedom, 0.975) / ndtri(0.975)
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
    before, after = (
        np.concatenate([one[part] for one in series]) for part in (slice(-1), slice(1, None))
    )
    power = np.sum(before**2, axis=0)
    rho = np.sum(before * after, axis=0) / np.where(power > 0.0, power, 1.0)
    rho = np.clip(rho, -0.97, 0.97)  # Andrews, Monahan 1992: a unit root asks for no end of lags
    # Of columns scaled to unit variance, whose innovations have the variance 1 - rho^2.
    top = np.sum(4 * rho**2 / (1 - rho) ** 4)
    bottom = np.sum((1 + rho) ** 2 / (1 - rho) ** 2)
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
