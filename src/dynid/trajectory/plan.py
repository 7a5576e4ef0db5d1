"""The noun Trajectory: a motion as coefficients of a family, run at a speed factor alpha (Paper Eq. 19)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.arrays import Floats
from dynid.errors import WrongUsage
from dynid.motion import Motion
from dynid.trajectory import tuning
from dynid.trajectory.basis import Quintic
from dynid.trajectory.feasible import Bounds

#: Samples evaluated at once: Phi of a long motion at 1 kHz would not fit into memory comfortably.
BLOCK = 4096
#: Largest speed and acceleration of a quintic from rest to rest, times T and T^2 over the distance.
_REST_SPEED, _REST_ACCELERATION = 1.875, 10 / np.sqrt(3)


@dataclass(frozen=True)
class Trajectory:
    """A planned motion, at rest at both ends.

    Attributes:
        basis: family of motions.
        coefficients: (k, n).
        alpha: speed factor; the planned motion itself has 1.
    """

    basis: Quintic
    coefficients: Floats
    alpha: float = 1.0

    def __post_init__(self) -> None:
        """Check the speed factor."""
        if not 0 < self.alpha <= 1:
            raise WrongUsage(f"alpha = {self.alpha:g}", why="alpha slows a plan down, to above 0")

    @property
    def duration(self) -> float:
        """Length of the motion as it will run, T / alpha [s]."""
        return self.basis.duration / self.alpha

    def slowed(self, alpha: float) -> Trajectory:
        """Return the same path at another speed factor."""
        return replace(self, alpha=alpha)

    def motion(self, t: Floats) -> Motion:
        """Return the motion at times of the run, (N,) [s]; before and after it the arm rests at its ends.

        Source: Paper Eq. 19 in its right form, q = p(alpha t), qd = alpha p', qdd = alpha^2 p''.
        """
        s = np.clip(self.alpha * t, 0.0, self.basis.duration)
        values = np.empty((3, len(t), self.coefficients.shape[1]))
        for part in (slice(k, k + BLOCK) for k in range(0, len(t), BLOCK)):
            for order in range(3):
                values[order, part] = (
                    self.basis.matrix(s[part], order) @ self.coefficients * self.alpha**order
                )
        return Motion(t, *values)

    def sampled(self, rate: float) -> Motion:
        """Return the motion from its beginning to its end at a sample rate [Hz]."""
        return self.motion(np.arange(int(np.ceil(self.duration * rate - 1e-9)) + 1) / rate)

    def stationary(self, order: int) -> list[tuple[Floats, Floats]]:
        """Return when q (0), qd (1) or qdd (2) of each joint may be extreme, times [s], and its values then."""
        points = self.basis.stationary(self.coefficients, order)
        return [(t / self.alpha, values * self.alpha**order) for t, values in points]


def through_waypoints(waypoints: Floats, limits: Bounds, times: Floats | None = None) -> Trajectory:
    """Join waypoints by quintic segments of least jerk and lengthen the intervals that would break a rate limit.

    Args:
        waypoints: positions, (K, n) [rad or m].
        limits: velocity and acceleration limits.
        times: wanted times, (K,) [s]; as fast as the limits let the arm go from rest to rest when None.

    Source: the rule for Delta T_j after Paper Eq. 16. Among all motions through the points with those times and rest at
        the ends, the quintic spline has the least mean square jerk, so no rates at waypoints have to be invented.
    """
    step = np.abs(np.diff(waypoints, axis=0))
    shortest = rest_time(step, limits.velocity, limits.acceleration).max(axis=1)
    lengths = np.maximum(shortest, 1e-2) if times is None else np.diff(times)
    best = np.full(len(lengths), np.inf)
    for _ in range(tuning.STRETCH_ROUNDS):
        trajectory = _spline(waypoints, lengths)
        stretch = _needed(trajectory, limits)
        if stretch.max() <= 1:
            return trajectory
        # All intervals alike make every rate fit: the motion need not become longer than that.
        best = min(best, lengths * stretch.max() * (1 + 1e-9), key=np.sum)
        lengths = lengths * np.maximum(stretch, 1.0) * (1 + 1e-6)
        # Why: a long interval lets the spline swing in its neighbours, which may drive each other up without end.
        if lengths.sum() >= best.sum():
            break
    return _spline(waypoints, best)


def rest_time(distance: Floats, velocity: Floats, acceleration: Floats) -> Floats:
    """Return how long quintics from rest to rest take over distances, (..., n) [s], within these limits, (n,)."""
    fast, hard = _REST_SPEED * distance / velocity, _REST_ACCELERATION * distance / acceleration
    return np.maximum(fast, np.sqrt(hard))


def _spline(waypoints: Floats, lengths: Floats) -> Trajectory:
    knots = np.concatenate([[0.0], np.cumsum(lengths)])
    basis = Quintic(tuple(knots.tolist()), smooth=True)
    return Trajectory(basis, np.linalg.solve(basis.matrix(knots), waypoints).astype(np.float64))


def _needed(trajectory: Trajectory, limits: Bounds) -> Floats:
    """Return the factor by which each interval has to grow for its peak rates, (K - 1,); at most 1 when fine."""
    knots = trajectory.basis.knots
    factor = np.zeros(len(knots) - 1)
    for order, limit in ((1, limits.velocity), (2, limits.acceleration)):
        for j, (times, values) in enumerate(trajectory.stationary(order)):
            # Why: a peak at a waypoint belongs to both of its intervals.
            for side in ("left", "right"):
                segment = np.clip(np.searchsorted(knots, times, side=side) - 1, 0, len(knots) - 2)
                np.maximum.at(factor, segment, (np.abs(values) / limit[j]) ** (1 / order))
    return factor
