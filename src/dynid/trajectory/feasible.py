"""Motions that keep all joint limits by construction: each joint is scaled to its active limit and shifted.

Free variables are a shape and a place for each joint; any numbers give a motion inside the limits, and the gradient
goes through the scaling, so the search needs no penalties for positions, speeds and accelerations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.arrays import Floats, Ints
from dynid.robot import Robot
from dynid.trajectory import tuning
from dynid.trajectory.basis import Quintic, Sines


@dataclass(frozen=True)
class Bounds:
    """Limits that a plan must keep, margins already taken off.

    Attributes:
        lower: (n,) [rad or m].
        upper: (n,) [rad or m].
        velocity: (n,) [rad/s or m/s].
        acceleration: (n,) [rad/s^2 or m/s^2].
        torque: (n,) [N m or N]; infinity where none is given.
    """

    lower: Floats
    upper: Floats
    velocity: Floats
    acceleration: Floats
    torque: Floats


def assumed_limits(robot: Robot) -> tuple[str, ...]:
    """Say which limits the robot file leaves out and what a plan takes in their place, one sentence for each kind."""
    free = {joint.name: joint.revolute for joint in robot.joints if not joint.limits.position}
    slow = [joint.name for joint in robot.joints if joint.limits.velocity is None]
    soft = [joint.name for joint in robot.joints if joint.limits.acceleration is None]
    kinds = (
        (
            "position",
            [name for name in free if free[name]],
            "turning without end, two turns each way",
        ),
        (
            "travel",
            [name for name in free if not free[name]],
            f"{tuning.SLIDE_RANGE_M[1]:g} m each way",
        ),
        ("velocity", slow, f"{tuning.DEFAULT_VELOCITY:g} rad/s or m/s"),
        ("acceleration", soft, f"{tuning.DEFAULT_ACCELERATION:g} rad/s^2 or m/s^2"),
    )
    return tuple(
        f"{kind} of {'all joints' if len(joints) == robot.n else ', '.join(joints)}: {stand_in}"
        for kind, joints, stand_in in kinds
        if joints
    )


def unsafe_to_play(assumed: Sequence[str]) -> tuple[str, ...]:
    """Return the assumed limits with which no motion is played; a joint without end needs no range."""
    return tuple(text for text in assumed if not text.startswith("position"))


def position_range(robot: Robot) -> Floats:
    """Return the least and the greatest position of every joint, stand-ins included, (n,) each [rad or m]."""
    return robot.travel(tuning.ENDLESS_RANGE_RAD, tuning.SLIDE_RANGE_M)


def bounds(robot: Robot, margin: float = 0.0) -> Bounds:
    """Return the limits of a robot with margins.

    Args:
        robot: the arm.
        margin: share of every limit that is left free; of a range half at each end.
    """
    rest = 1 - margin
    lower, upper = position_range(robot)
    off = margin * (upper - lower) / 2
    velocity = robot.limits("velocity", tuning.DEFAULT_VELOCITY)
    acceleration = robot.limits("acceleration", tuning.DEFAULT_ACCELERATION)
    torque = robot.limits("torque")
    return Bounds(lower + off, upper - off, velocity * rest, acceleration * rest, torque * rest)


def random_variables(basis: Quintic | Sines, limits: Bounds, rng: np.random.Generator) -> Floats:
    """Return free variables of a random motion, ((basis.size + 1) n,), without unit."""
    n = len(limits.lower)
    return np.concatenate([rng.standard_normal(basis.size * n), rng.normal(0.0, 0.5, n)])


class Shaping:
    """From free variables to a motion inside the limits, and back with gradients.

    Args:
        basis: family of motions.
        limits: the limits.
        t: times at which the motion is wanted, (N,) [s].
        refinement: points of the grid for limits for each of those times.
    """

    def __init__(
        self, basis: Quintic | Sines, limits: Bounds, t: Floats, refinement: int = 5
    ) -> None:
        self._limits = limits
        grid = np.linspace(0.0, basis.duration, refinement * len(t))
        self._wanted = [basis.matrix(t, order) for order in range(3)]
        self._fine = [basis.matrix(grid, order) for order in range(3)]
        self._n = len(limits.lower)

    def motion(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Return q, qd, qdd at the wanted times, (N, n) each [rad, rad/s, rad/s^2]; ``gradient`` refers to them.

        Args:
            x: free variables, (size,).
        """
        c, self._offset = _split(x, self._n)
        U, Ud, Udd = (phi @ c for phi in self._fine)
        self._at = U.argmax(0), U.argmin(0), np.abs(Ud).argmax(0), np.abs(Udd).argmax(0)
        high, low, fast, hard = (
            values[at, np.arange(self._n)]
            for values, at in zip((U, U, Ud, Udd), self._at, strict=True)
        )
        self._peaks = fast, hard
        self._fit = fitted(self._limits, low, high, np.abs(fast), np.abs(hard), self._offset)
        self._path = [phi @ c for phi in self._wanted]
        u, ud, udd = self._path
        scale = self._fit.scale
        return scale * u + self._fit.shift, scale * ud, scale * udd

    def gradient(self, gq: Floats, gqd: Floats, gqdd: Floats) -> Floats:
        """Return a cost's gradient by the free variables of the last motion, (size,), from that by its samples.

        Args:
            gq: gradient by the positions, (N, n) [1/rad or 1/m].
            gqd: by the velocities, (N, n) [s/rad or s/m].
            gqdd: by the accelerations, (N, n) [s^2/rad or s^2/m].
        """
        fit, offset, scale = self._fit, self._offset, self._fit.scale
        u, ud, udd = self._path
        total = gq.sum(axis=0)
        d_room = total * offset * (fit.room > 0)
        d_scale = (
            np.sum(gq * (u - fit.middle) + gqd * ud + gqdd * udd, axis=0) - d_room * fit.span / 2
        )
        d_span = -d_room * scale / 2 - np.where(fit.active == 0, d_scale * scale / fit.span, 0.0)
        d_middle = -scale * total
        gradient = sum(
            phi.T @ (g * scale) for phi, g in zip(self._wanted, (gq, gqd, gqdd), strict=True)
        )
        high, low, *rates = self._at
        gradient += self._fine[0][high].T * (d_span + d_middle / 2) + self._fine[0][low].T * (
            d_middle / 2 - d_span
        )
        for order, at, peak in zip((1, 2), rates, self._peaks, strict=True):
            slope = np.where(fit.active == order, -d_scale * scale / peak, 0.0)
            gradient += self._fine[order][at].T * slope
        return np.concatenate([gradient.ravel(), total * fit.room * (1 - offset**2)])


@dataclass(frozen=True)
class Fit:
    """How a motion of any size is fitted into the limits, joint by joint, (n,) each.

    Attributes:
        scale: factor on the motion.
        shift: what is added to it then [rad or m].
        span: of its positions before [rad or m].
        middle: of these [rad or m].
        room: distance to the limits on each side [rad or m].
        active: derivative whose limit the motion reaches.
    """

    scale: Floats
    shift: Floats
    span: Floats
    middle: Floats
    room: Floats
    active: Ints


def fitted(
    limits: Bounds,
    low: Floats,
    high: Floats,
    fast: Floats,
    hard: Floats,
    offset: Floats,
    share: float = 1.0,
) -> Fit:
    """Fit a motion with these extrema, (n,) each, into a share of the limits, at a place of -1 to 1 in the range."""
    reach, span = limits.upper - limits.lower, np.maximum(high - low, 1e-12)
    candidates = np.stack(
        [
            reach / span,
            limits.velocity / np.maximum(fast, 1e-12),
            limits.acceleration / np.maximum(hard, 1e-12),
        ]
    )
    active = candidates.argmin(axis=0)
    scale, middle = share * candidates.min(axis=0), (high + low) / 2
    room = np.maximum(reach - scale * span, 0.0) / 2
    shift = (limits.upper + limits.lower) / 2 + room * offset - scale * middle
    return Fit(scale, shift, span, middle, room, active)


def _split(x: Floats, n: int) -> tuple[Floats, Floats]:
    """Return the shapes, (k, n), and the places, (n,), that free variables mean."""
    return x[:-n].reshape(-1, n), np.tanh(x[-n:])


def coefficients(basis: Quintic, limits: Bounds, x: Floats) -> Floats:
    """Return a motion's coefficients, (k, n) [rad or m], scaled as by ``Shaping`` with exact extrema.

    Args:
        basis: family of motions.
        limits: the limits.
        x: free variables, (size,).
    """
    c, offset = _split(x, len(limits.lower))
    low, high = extrema(basis, c, 0)
    fast, hard = (np.abs(extrema(basis, c, order)).max(axis=0) for order in (1, 2))
    # Why: a relative margin of rounding size, so that the limit itself is never exceeded.
    fit = fitted(limits, low, high, fast, hard, offset, 1 - 1e-9)
    return fit.scale * c + np.outer(basis.constant, fit.shift)


def extrema(basis: Quintic, c: Floats, order: int) -> Floats:
    """Return the exact extrema of a derivative of every joint, (2, n) [rad/s^order], for c, (size, n) [rad]."""
    values = [values for _, values in basis.stationary(c, order)]
    return np.array([[v.min() for v in values], [v.max() for v in values]])
