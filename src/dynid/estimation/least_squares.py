"""Ordinary and weighted least squares from small triangular factors (Paper Eq. 24).

Any number of rows ``[W tau]`` is represented by the R factor of their QR decomposition, (p + 1, p + 1): same solution,
same residual sum of squares, and factors of several blocks or logs are merged by another QR. One factor per joint is
kept, because joints differ in noise. Recursive least squares merges an old factor with new ones.

Source: Demmel et al. 2012, "Communication-optimal parallel and sequential QR" (TSQR).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynid.arrays import Floats, Ints, Mask
from dynid.errors import LogTooShort, RankDeficient
from dynid.estimation import tuning
from dynid.estimation.factor import triangle

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
            why="the values differ by too many orders of magnitude, or all torques are zero",
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
    rows = scaled.reshape(-1, factors.shape[-1])
    # Why: a joint has no rows for the links before it, which are nearly half of all.
    return triangle(rows[np.any(rows, axis=1)])


def symmetric_root(matrix: Floats) -> Floats:
    """Return L with L L^T = matrix, (p, p); eigenvalues below zero are rounding and count as zero.

    Args:
        matrix: symmetric, never negative, such as a covariance or an information, (p, p); where it knows nothing of a
            parameter, row and column are zero, and so are those of L.
    """
    diagonal = np.diagonal(matrix)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    value, vector = np.linalg.eigh(matrix / np.outer(scale, scale))
    return scale[:, None] * vector * np.sqrt(np.maximum(value, 0.0))


@dataclass(frozen=True)
class Solution:
    """The least-squares solution of one factor.

    Attributes:
        theta: parameters, (p,), each in its unit; the shortest in normalised columns where the rank is short.
        inverse: inverse of W^T W, (p, p); of whitened rows the covariance, in products of the parameters' units.
        residual: sum of squares that remains.
        rank: number of directions that the rows excite.
        condition_number_scaled: of W with columns of unit length.
        weak: directions that the rows leave open, columns in parameter space, (p, p - rank).
    """

    theta: Floats
    inverse: Floats
    residual: float
    rank: int
    condition_number_scaled: float
    weak: Floats


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
    V = Vt[:rank].T / sigma[:rank]
    projected = U.T @ b
    full = rank == len(sigma)
    return Solution(
        theta=(V @ projected[:rank]) / length,
        inverse=(V @ V.T) / np.outer(length, length),
        residual=float(R[-1, -1] ** 2 + projected[rank:] @ projected[rank:]),
        rank=rank,
        condition_number_scaled=float(sigma[0] / sigma[-1]) if full else float("inf"),
        weak=Vt[rank:].T / length[:, None],
    )


def condition_number(R: Floats, rank: int) -> float:
    """Return the condition number of W, columns as they are, of a factor of [W tau]; infinite where the rank is short.

    Args:
        R: factor, (p + 1, p + 1).
        rank: number of directions that the rows excite, from ``solve``.
    """
    if rank < R.shape[1] - 1:
        return float("inf")
    sigma = np.linalg.svd(R[:-1, :-1], compute_uv=False)
    return float(sigma[0] / sigma[-1])


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

    @property
    def leaves_open(self) -> bool:
        """Whether the rows leave parameters open, for which instruments have no answer."""
        return self.solution.rank < len(self.theta)

    @cached_property
    def inflation(self) -> float:
        """How many rows are worth one independent row; 1/2 chi-square of all rows is divided by it."""
        A, spread = (
            self.whitened[:-1, :-1],
            self.covariance if self.uncorrected is None else self.uncorrected,
        )
        worth = tuning.COLOUR_UNSEEN * float(np.sum((A @ spread) * A)) / max(1, self.solution.rank)
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
    same = np.full(len(counts), max(noise, _floor(factors, counts).min()))
    solution = solve(merge(factors, 1.0 / same))
    return Fit("ols", solution.theta, same, solution.inverse, factors, counts)


def weighted(factors: Floats, counts: Ints) -> Fit:
    """Fit with each joint divided by its own noise, found from the residuals and iterated.

    Args:
        factors: one factor per joint, (n, p + 1, p + 1) [N m or N].
        counts: number of rows of each joint, (n,).

    Returns:
        The fit; its covariance is that of white residuals.
    """
    first = ordinary(factors, counts)
    noise = _joint_noise(factors, counts, first.theta, first.noise, first.covariance)
    for _ in range(tuning.FIT_ROUNDS):
        solution, before = solve(merge(factors, 1.0 / noise)), noise
        noise = _joint_noise(factors, counts, solution.theta, noise, solution.inverse)
        if np.all(np.abs(noise - before) <= 1e-4 * before):
            break
    solution = solve(merge(factors, 1.0 / noise))
    return Fit("wls", solution.theta, noise, solution.inverse, factors, counts)


def joint_rms(factors: Floats, counts: Ints, theta: Floats) -> Floats:
    """Return the root mean square of each joint's residual for any parameters, (n,) [N m or N]."""
    residual = factors @ np.append(theta, -1.0)
    return np.sqrt(np.sum(residual**2, axis=-1) / np.maximum(counts, 1))


def relative_error(factors: Floats, theta: Floats) -> float:
    """Return 100 * |tau - W theta| / |tau| over all rows [%], of factors (n, p + 1, p + 1) and parameters (p,)."""
    residual = factors @ np.append(theta, -1.0)
    return float(100.0 * np.linalg.norm(residual) / np.linalg.norm(factors[..., -1]))


def _joint_noise(
    factors: Floats, counts: Ints, theta: Floats, noise: Floats, covariance: Floats
) -> Floats:
    """Return residual rms per joint, corrected for the parameters that each joint's own rows have spent."""
    scaled = factors[:, :, :-1] / noise[:, None, None]
    spent = np.einsum("jab,bc,jac->j", scaled, covariance, scaled, optimize=True)
    free = counts - spent
    # Why: what a joint's few rows leave of its noise says nothing once as many parameters were fitted to them.
    own = joint_rms(factors, counts, theta) * np.sqrt(
        counts / np.maximum(free, tuning.LEAST_ROWS_LEFT)
    )
    own = np.where(free > tuning.LEAST_ROWS_LEFT, own, noise)
    return np.maximum(own, _floor(factors, counts))


def _floor(factors: Floats, counts: Ints) -> Floats:
    """Return the rounding error of each joint's torque: noise-free simulations must not divide by zero."""
    torque = joint_rms(factors, counts, np.zeros(factors.shape[-1] - 1))
    return 1e-12 * np.maximum(torque, max(float(torque.max(initial=0.0)), 1e-30))
