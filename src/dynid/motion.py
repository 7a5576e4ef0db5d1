"""The noun Motion: joint positions with their first two derivatives on a time grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """A sampled motion in DH quantities.

    Attributes:
        t: time, (N,) [s].
        q: joint positions, (N, n) [rad or m].
        qd: joint velocities, (N, n) [rad/s or m/s].
        qdd: joint accelerations, (N, n) [rad/s^2 or m/s^2].
    """

    t: Floats
    q: Floats
    qd: Floats
    qdd: Floats

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.t)
