"""The noun Motion: joint positions with their first two derivatives on a time grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.arrays import Floats
from dynid.errors import LogLayout

_SHAPES = "dynid.Motion(t, q, qd, qdd) with t (N,) and the others (N, joints)"


@dataclass(frozen=True)
class Motion:
    """A sampled motion in DH quantities.

    Arrays may be anything NumPy makes an array of.

    Attributes:
        t: time, (N,) [s].
        q: joint positions, (N, n) [rad or m].
        qd: joint velocities, (N, n) [rad/s or m/s].
        qdd: joint accelerations, (N, n) [rad/s^2 or m/s^2].

    Raises:
        LogLayout: an array has another shape, or holds no numbers.
    """

    t: Floats
    q: Floats
    qd: Floats
    qdd: Floats

    def __post_init__(self) -> None:
        """Make arrays of what was given, and check their shapes."""
        for name in ("t", "q", "qd", "qdd"):
            try:
                array = np.asarray(getattr(self, name), dtype=np.float64)
            except (TypeError, ValueError):
                raise LogLayout(f"{name} of the motion holds no numbers", fix=_SHAPES) from None
            object.__setattr__(self, name, array)
        if self.t.ndim != 1:
            raise LogLayout(f"t of the motion is {self.t.shape}, expected (N,)", fix=_SHAPES)
        for name in ("q", "qd", "qdd"):
            shape = getattr(self, name).shape
            if len(shape) != 2 or shape[0] != len(self.t) or shape != self.q.shape:
                raise LogLayout(
                    f"{name} of the motion is {shape}, expected ({len(self.t)}, joints)",
                    fix=_SHAPES,
                )

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.t)

    def at_speed(self, share: float) -> Motion:
        """Return the same path at a share of its speed (Paper Eq. 19)."""
        return Motion(self.t / share, self.q, self.qd * share, self.qdd * share**2)
