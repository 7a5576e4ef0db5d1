"""Rows in time order, for estimators that need residual series and not only triangular factors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.identify.least_squares import accumulate
from dynid.identify.stack import Stack

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Segment:
    """Conditioned rows of one stretch of time. Pass them as a list, or as any object that can be walked many times.

    Attributes:
        W: base regressor, (N, n, p).
        tau: torques, (N, n) [N m].
        Z: instruments, (N, n, p): the regressor on a motion that does not know the measurement noise; or None.
        usable: rows that count, (N, n); None for all.
        follows: whether its first row follows the last row of the segment before it without a gap.
    """

    W: Floats
    tau: Floats
    Z: Floats | None = None
    usable: Mask | None = None
    follows: bool = False

    @property
    def mask(self) -> Mask:
        """Rows that count, (N, n)."""
        return np.ones(self.tau.shape, dtype=bool) if self.usable is None else self.usable

    def residual(self, theta: Floats) -> Floats:
        """Return tau - W theta, (N, n) [N m]; zero where rows do not count."""
        return np.where(self.mask, self.tau - self.W @ theta, 0.0)


@dataclass(frozen=True)
class StackSegments:
    """The rows of a stack as segments, made anew on each walk where the stack did not keep them.

    Attributes:
        stack: the stacked logs.
    """

    stack: Stack

    def __iter__(self) -> Iterator[Segment]:
        """Walk over the rows of all logs in order of time."""
        for log in range(len(self.stack.sources)):
            for part in self.stack.rows_of_log(log):
                yield Segment(part.W, part.tau, usable=part.usable, follows=not part.starts_segment)


def joint_factors(segments: Iterable[Segment]) -> tuple[Floats, Ints]:
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


def root_mean_square(segments: Iterable[Segment], theta: Floats) -> Floats:
    """Return the root mean square of each joint's residual, (n,) [N m]; never quite zero."""
    squares: Floats | float = 0.0
    rows: Ints | int = 0
    largest = 0.0
    for segment in segments:
        squares = squares + np.sum(segment.residual(theta) ** 2, axis=0)
        rows = rows + segment.mask.sum(axis=0)
        largest = max(largest, float(np.abs(segment.tau).max(initial=0.0)))
    return np.asarray(np.maximum(np.sqrt(squares / np.maximum(rows, 1)), 1e-12 * max(largest, 1e-18)))


def robust_noise(segments: Iterable[Segment], theta: Floats) -> Floats:
    """Return the standard deviation that the middle of each joint's residuals suggests, (n,) [N m]."""
    residuals, masks = zip(*((segment.residual(theta), segment.mask) for segment in segments), strict=True)
    residual, mask = np.concatenate(residuals), np.concatenate(masks)
    spread = [
        1.4826 * float(np.median(np.abs(e[good]))) if good.any() else 0.0
        for e, good in zip(residual.T, mask.T, strict=True)
    ]
    return np.asarray(np.maximum(spread, 1e-12 * max(float(np.abs(residual).max(initial=0.0)), 1e-18)))
