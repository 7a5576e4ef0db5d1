"""Rows in time order, for estimators that need residual series and not only triangular factors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.identify.least_squares import accumulate

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Segment:
    """One contiguous stretch of conditioned rows. Pass segments as a list, or as any object that can be walked twice.

    Attributes:
        W: base regressor, (N, n, p).
        tau: torques, (N, n) [N m].
        Z: instruments, (N, n, p): the regressor on a motion that does not know the measurement noise; or None.
    """

    W: Floats
    tau: Floats
    Z: Floats | None = None

    def residual(self, theta: Floats) -> Floats:
        """Return tau - W theta, (N, n) [N m]."""
        return np.asarray(self.tau - self.W @ theta)


def joint_factors(segments: Iterable[Segment]) -> tuple[Floats, Ints]:
    """Return the triangular factor of each joint's rows, (n, p + 1, p + 1), and their number, (n,)."""
    factors: list[Floats | None] = []
    count = 0
    for segment in segments:
        factors = factors or [None] * segment.W.shape[1]
        factors = [accumulate(R, segment.W[:, j], segment.tau[:, j]) for j, R in enumerate(factors)]
        count += len(segment.W)
    return np.array(factors), np.full(len(factors), count)
