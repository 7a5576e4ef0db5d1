"""Families of motions that are linear in their coefficients and at rest at both ends: q(t) = Phi(t) c.

Quintic segments through waypoints (Paper Eqs. 17-18), and quintic B-splines as their smoothest part.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from dynid.trajectory import tuning

Floats = NDArray[np.float64]

#: Value, first and second derivative of (s^5, s^4, s^3, s^2, s, 1) at s = 0 and at s = 1 (Paper Eq. 18).
_ENDS = np.array(
    [
        [0, 0, 0, 0, 0, 1],
        [0, 0, 0, 0, 1, 0],
        [0, 0, 0, 2, 0, 0],
        [1, 1, 1, 1, 1, 1],
        [5, 4, 3, 2, 1, 0],
        [20, 12, 6, 2, 0, 0],
    ],
    dtype=float,
)
#: Coefficients of the six polynomials that have one of those numbers 1 and the others 0, (6 powers, 6).
HERMITE = np.linalg.inv(_ENDS)


def _falling(order: int) -> Floats:
    """Return the factors that differentiation of (s^5 ... 1) brings, (6,)."""
    powers = np.arange(5, -1, -1)
    return np.array([np.prod([float(p - k) for k in range(order)]) for p in powers])


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
    def _jumps(self) -> Floats:
        """Jumps of the third and fourth derivative at the inner waypoints, as functions of the node values."""
        rows = []
        for j, (before, after) in enumerate(pairwise(np.diff(self.knots))):
            for order in (3, 4):
                row = np.zeros(3 * len(self.knots))
                for segment, length, s, sign in ((j, before, 1.0, 1), (j + 1, after, 0.0, -1)):
                    values = (
                        _powers(np.array([s]), order)[0]
                        @ HERMITE
                        * np.tile([1, length, length**2], 2)
                    )
                    row[3 * segment : 3 * segment + 6] += (
                        sign * values * (self._unit / length) ** order
                    )
                rows.append(row)
        return np.array(rows).reshape(-1, 3 * len(self.knots))

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
        segment, s, length = self._locate(t)
        values = (_powers(s, order) @ HERMITE) / length[:, None] ** order
        scaled = values * np.stack([np.ones_like(length), length, length**2] * 2, axis=1)
        nodes = np.zeros((len(t), 3 * len(self.knots)))
        nodes[np.arange(len(t))[:, None], 3 * segment[:, None] + np.arange(6)] = scaled
        return nodes @ self._free

    def _locate(self, t: Floats) -> tuple[NDArray[np.intp], Floats, Floats]:
        """Return segment, place within it (0 to 1) and the segment's length for each time."""
        knots = np.array(self.knots)
        segment = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
        length = np.diff(knots)[segment]
        return segment, (t - knots[segment]) / length, length

    def stationary(self, c: Floats, order: int = 0) -> list[Floats]:
        """Return the knots and all roots of the next derivative, joint by joint, (times,) [s], from c, (size, n)."""
        knots = np.array(self.knots)
        nodes = (self._free @ c).reshape(len(knots), 3, -1)
        lengths = np.diff(knots)[:, None, None] ** np.arange(3)[None, :, None]
        # The segments' polynomials in s = 0 ... 1, highest power first, (segments, 6, n).
        polynomials = HERMITE @ np.concatenate([nodes[:-1] * lengths, nodes[1:] * lengths], axis=1)
        slopes = (polynomials * _falling(order + 1)[None, :, None])[:, : 5 - order]
        found = []
        for j in range(c.shape[1]):
            times = [knots]
            for start, length, polynomial in zip(
                knots, np.diff(knots), slopes[:, :, j], strict=False
            ):
                roots = np.roots(polynomial)
                # Why: a double root comes out as a pair with small imaginary parts; a spare time does no harm.
                s = np.clip(roots.real[np.abs(roots.imag) < 1e-3], 0.0, 1.0)
                times.append(start + length * s)
            found.append(np.concatenate(times))
        return found


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
        found: Floats = np.hstack([still, np.cos(angle) * w**order, np.sin(angle) * w**order]) @ (
            null_space(rest / weight) / weight[:, None]
        )
        return found


def basis_from(facts: dict[str, Any]) -> Quintic:
    """Make a family of motions again from its ``facts``, which may come from a file.

    Raises:
        ValueError: no motion has such knots, or so many of them.
        TypeError: they are of another kind.
        KeyError: something is missing.
    """
    knots = np.array([float(t) for t in facts["knots"]])
    apart, short = np.diff(knots) > tuning.NEAREST_KNOTS_S, np.abs(knots) < tuning.LONGEST_MOTION_S
    if not (1 < len(knots) < tuning.MOST_KNOTS and np.all(apart) and np.all(short)):
        raise ValueError("its knots do not increase, or are too close together")
    return Quintic(tuple(knots.tolist()), facts["kind"] == "spline")


def _powers(s: Floats, order: int) -> Floats:
    """Return the derivative of an order of (s^5 ... 1), (N, 6)."""
    exponents = np.maximum(np.arange(5, -1, -1) - order, 0)
    found: Floats = s[:, None] ** exponents * _falling(order)
    return found
