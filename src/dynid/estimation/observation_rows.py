"""Rows in time order, for estimators that need residual series and not only triangular factors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.least_squares import accumulate

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Rows:
    """Filtered rows of one stretch of time. Pass them as a list, or as any object that can be walked many times.

    Attributes:
        W: base regressor after the parallel filter, (M, n, p).
        tau: torques after the parallel filter, (M, n) [N m].
        Z: instruments, (M, n, p): the regressor on a motion that does not know the measurement noise; or None.
        usable: rows that count, (M, n); None for all.
        follows: whether its first row follows the last row of the rows before it without a gap.
        t: time, (M,) [s].
        block: number of the block of time within its log.
        reversal_times: when each joint reverses [s]; empty where the Coulomb sign does not come with the log.
        cutoff: of the parallel filter [Hz].
    """

    W: Floats
    tau: Floats
    Z: Floats | None = None
    usable: Mask | None = None
    follows: bool = False
    t: Floats = field(default_factory=lambda: np.zeros(0))
    block: int = 0
    reversal_times: tuple[Floats, ...] = ()
    cutoff: float = 0.0

    @property
    def mask(self) -> Mask:
        """Rows that count, (M, n)."""
        return np.ones(self.tau.shape, dtype=bool) if self.usable is None else self.usable

    def residual(self, theta: Floats) -> Floats:
        """Return tau - W theta, (M, n) [N m]; zero where rows do not count."""
        return np.where(self.mask, self.tau - self.W @ theta, 0.0)


def runs(segments: Iterable[Rows], longest: int | None = None) -> Iterator[list[Rows]]:
    """Yield rows that follow each other together; a run ends before it would begin beyond a number of instants."""
    run: list[Rows] = []
    for segment in segments:
        full = longest is not None and sum(len(each.tau) for each in run) >= longest
        if run and (full or not segment.follows):
            yield run
            run = []
        run.append(segment)
    if run:
        yield run


def joined(run: Sequence[Rows]) -> Rows:
    """Return rows that follow each other as one."""
    first = run[0]
    return replace(
        first,
        W=np.concatenate([each.W for each in run]),
        tau=np.concatenate([each.tau for each in run]),
        Z=None if first.Z is None else np.concatenate([each.Z for each in run if each.Z is not None]),
        usable=np.concatenate([each.mask for each in run]),
        t=np.concatenate([each.t for each in run]),
    )


def joint_factors(segments: Iterable[Rows]) -> tuple[Floats, Ints]:
    """Return the triangular factor of each joint's rows, (n, p + 1, p + 1), and their number, (n,)."""
    factors: list[Floats | None] = []
    rows: Ints = np.zeros(0, dtype=np.int64)
    for segment in segments:
        n = segment.tau.shape[1]
        if not factors:
            factors, rows = [None for _ in range(n)], np.zeros(n, dtype=np.int64)
        for j in range(n):
            good = segment.mask[:, j]
            factors[j] = accumulate(factors[j], segment.W[good, j], segment.tau[good, j])
        rows = rows + segment.mask.sum(axis=0)
    return np.array(factors), rows


def root_mean_square(segments: Iterable[Rows], theta: Floats) -> Floats:
    """Return the root mean square of each joint's residual, (n,) [N m]; never quite zero."""
    squares: Floats | float = 0.0
    rows: Ints | int = 0
    largest = 0.0
    for segment in segments:
        squares = squares + np.sum(segment.residual(theta) ** 2, axis=0)
        rows = rows + segment.mask.sum(axis=0)
        largest = max(largest, float(np.abs(segment.tau).max(initial=0.0)))
    return np.asarray(np.maximum(np.sqrt(squares / np.maximum(rows, 1)), 1e-12 * max(largest, 1e-18)))


def robust_noise(segments: Iterable[Rows], theta: Floats) -> Floats:
    """Return the standard deviation that the middle of each joint's residuals suggests, (n,) [N m]."""
    residuals, masks = zip(*((segment.residual(theta), segment.mask) for segment in segments), strict=True)
    residual, mask = np.concatenate(residuals), np.concatenate(masks)
    spread = [
        1.4826 * float(np.median(np.abs(e[good]))) if good.any() else 0.0
        for e, good in zip(residual.T, mask.T, strict=True)
    ]
    return np.asarray(np.maximum(spread, 1e-12 * max(float(np.abs(residual).max(initial=0.0)), 1e-18)))
