"""Families of motions that are linear in their coefficients and at rest at both ends: q(t) = Phi(t) c.

Quintic segments through waypoints (Paper Eqs. 17-18), and quintic B-splines as their smoothest part.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import BPoly, PPoly
from scipy.linalg import null_space

from dynid.arrays import Floats
from dynid.trajectory import tuning


@dataclass(frozen=True)
class Quintic:
    """Fifth-order polynomials between waypoints, with continuous position, velocity and acceleration.

    Attributes:
        knots: times of the waypoints, rising from 0 [s].
        smooth: also continuous in the third and fourth derivative, which makes it a quintic B-spline.
    """

    knots: tuple[float, ...]
    smooth: bool = False

    @classmethod
    def even(cls, duration: float, segments: int, *, smooth: bool = False) -> Quintic:
        """Return the family with equal intervals."""
        return cls(tuple((duration * np.arange(segments + 1) / segments).tolist()), smooth)

    @property
    def duration(self) -> float:
        """Length of the motion [s]."""
        return self.knots[-1]

    @cached_property
    def _unit(self) -> float:
        """Time that makes rates at the waypoints as large as positions."""
        return self.duration / (len(self.knots) - 1)

    @cached_property
    def _free(self) -> Floats:
        """Node values (q, qd, qdd of every waypoint) from the coefficients, (3 K, size)."""
        k = len(self.knots)
        moving = np.ones((k, 3), dtype=bool)
        moving[[0, -1], 1:] = False
        scale = np.tile([1.0, 1 / self._unit, 1 / self._unit**2], k)
        nodes = (np.eye(3 * k) * scale[:, None])[:, moving.ravel()]
        free: Floats = nodes @ null_space(self._jumps @ nodes) if self.smooth else nodes
        return free

    @cached_property
    def _nodes(self) -> BPoly:
        """The motions of which one node value is 1, (3 K,)."""
        size = 3 * len(self.knots)
        return BPoly.from_derivatives(self.knots, np.eye(size).reshape(-1, 3, size))

    @cached_property
    def _jumps(self) -> Floats:
        """Jumps of the third and fourth derivative at the inner waypoints, as functions of the node values."""
        rows = []
        for order in (3, 4):
            ends = self._nodes.derivative(order).c
            rows.append((ends[-1, :-1] - ends[0, 1:]) * self._unit**order)
        return np.stack(rows, axis=1).reshape(-1, 3 * len(self.knots))

    @property
    def size(self) -> int:
        """Number of coefficients per joint."""
        return int(self._free.shape[1])

    @cached_property
    def constant(self) -> Floats:
        """Coefficients of the motion that stays at 1, (size,) [rad or m]."""
        still = np.tile([1.0, 0.0, 0.0], len(self.knots))
        return np.asarray(np.linalg.lstsq(self._free, still, rcond=None)[0], dtype=np.float64)

    @property
    def facts(self) -> dict[str, Any]:
        """What ``basis_from`` needs to make it again."""
        return {"kind": "spline" if self.smooth else "quintic", "knots": list(self.knots)}

    def matrix(self, t: Floats, order: int = 0) -> Floats:
        """Return Phi, or its derivative of an order, at times (N,) [s]; (N, size) [1/s^order].

        Source: Paper Eqs. 17-18; the boundary rates have to be multiplied by T and T^2, the length of the segment.
        """
        return self._nodes.derivative(order)(t) @ self._free

    def stationary(self, c: Floats, order: int = 0) -> list[tuple[Floats, Floats]]:
        """Return where a derivative of each joint may be extreme, (times,) [s], and its values there.

        These are the knots and all roots of the next derivative.

        Args:
            c: coefficients, (size, n) [rad or m].
            order: of the derivative.
        """
        slopes = BPoly(self._nodes.c @ self._free @ c, self.knots).derivative(order + 1)
        roots = PPoly.from_bernstein_basis(slopes).roots(discontinuity=False, extrapolate=False)
        times = [np.concatenate([self.knots, each[np.isfinite(each)]]) for each in roots]
        return [(t, self.matrix(t, order) @ own) for t, own in zip(times, c.T, strict=True)]


@dataclass(frozen=True)
class Sines:
    """A Fourier series over its period, at rest where it begins and ends.

    Attributes:
        duration: the period [s].
        harmonics: number of harmonics.
    """

    duration: float
    harmonics: int

    @property
    def size(self) -> int:
        """Number of coefficients per joint."""
        return 2 * self.harmonics - 1

    def matrix(self, t: Floats, order: int = 0) -> Floats:
        """Return Phi, or its derivative of an order, at times (N,) [s]; (N, size) [1/s^order]."""
        k = np.arange(1.0, self.harmonics + 1)
        rest = np.block([[0.0, np.zeros(len(k)), k], [0.0, k**2, np.zeros(len(k))]])
        # Why: harmonics of equal acceleration rather than equal size, or the fast ones would rule a random start.
        weight = np.concatenate([[1.0], k, k])
        w = 2 * np.pi / self.duration * k
        angle = t[:, None] * w + order * np.pi / 2
        still = np.full((len(t), 1), float(order == 0))
        rows: Floats = np.hstack([still, np.cos(angle) * w**order, np.sin(angle) * w**order]) @ (
            null_space(rest / weight) / weight[:, None]
        )
        return rows


def basis_from(facts: dict[str, Any]) -> Quintic:
    """Make a family of motions again from its ``facts``, which may come from a file.

    Raises:
        ValueError: no motion has such knots.
        TypeError: they are of another kind.
        KeyError: something is missing.
    """
    knots = np.array([float(t) for t in facts["knots"]])
    if len(knots) < 2 or not np.all(np.diff(knots) > tuning.NEAREST_KNOTS_S):
        raise ValueError("its knots do not increase, or are too close together")
    return Quintic(tuple(knots.tolist()), facts["kind"] == "spline")
