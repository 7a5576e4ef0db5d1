"""What is played: a reviewed motion at a share of its speed, repeated, led in from where the arm really stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline, CubicHermiteSpline, make_interp_spline

from dynid.arrays import Floats
from dynid.drivers.command_port import Target
from dynid.motion import Motion
from dynid.record import tuning
from dynid.robot import Robot
from dynid.sim.sines import rest_to_rest
from dynid.trajectory.plan import rest_time


@dataclass(frozen=True)
class PlayedMotion:
    """A motion as it will be played.

    Attributes:
        motion: approach, motion, repetitions.
        approach: length of the approach at its beginning [s]; 0 without one.
        speed: share of the planned speed that it contains.
    """

    motion: Motion
    approach: float = 0.0
    speed: float = 1.0


def approach(robot: Robot, start: Floats, end: Floats) -> Motion:
    """Return a slow quintic from rest to rest between two poses, (n,) each [rad or m]."""
    distance = np.abs(end - start)
    velocity = robot.limits("velocity", tuning.APPROACH_VELOCITY)
    acceleration = robot.limits("acceleration", tuning.APPROACH_ACCELERATION)
    share = tuning.APPROACH_SHARE
    needed = float(rest_time(distance, share * velocity, share * acceleration).max())
    duration = max(tuning.SHORTEST_APPROACH_S, needed)
    t = np.linspace(0.0, duration, round(duration * tuning.APPROACH_RATE_HZ) + 1)
    shapes = rest_to_rest(t / duration, duration)
    q, qd, qdd = (np.outer(shape, end - start) for shape in shapes)
    return Motion(t, start + q, qd, qdd)


def joined(motions: Sequence[Motion]) -> Motion:
    """Return motions one after the other; each begins at rest where the last one ended."""
    parts, begin = [], 0.0
    for k, motion in enumerate(motions):
        t = motion.t - motion.t[0] + begin
        parts.append([x[min(k, 1) :] for x in (t, motion.q, motion.qd, motion.qdd)])
        begin = float(t[-1])
    t, q, qd, qdd = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return Motion(t, q, qd, qdd)


def repeated(robot: Robot, motion: Motion, times: int) -> Motion:
    """Return a motion played several times, with a slow way back to its start in between."""
    motions = [motion]
    for _ in range(times - 1):
        if np.abs(motion.q[-1] - motion.q[0]).max() > 1e-6:
            motions.append(approach(robot, motion.q[-1], motion.q[0]))
        motions.append(motion)
    return joined(motions)


def nearest_turn(robot: Robot, motion: Motion, measured: Floats) -> Motion:
    """Return the motion with joints that turn without end shifted by full turns to where the arm stands, (n,) [rad].

    Why: such a joint may have been turned by hand; its driver counts on, and the plan does not know.
    """
    endless = np.array([joint.revolute and joint.limits.position is None for joint in robot.joints])
    full_turns = np.where(endless, np.round((measured - motion.q[0]) / (2 * np.pi)), 0.0)
    return replace(motion, q=motion.q + 2 * np.pi * full_turns)


@dataclass(frozen=True)
class ReferenceMotion:
    """A motion as a function of time, from where the arm really stands.

    Attributes:
        motion: the motion.
        gap: measured minus planned first pose, (n,); it dies away within ``tuning.BLEND_S``.
    """

    motion: Motion
    gap: Floats

    @property
    def duration(self) -> float:
        """Length [s]."""
        return float(self.motion.t[-1])

    @cached_property
    def _curves(self) -> tuple[CubicHermiteSpline, CubicHermiteSpline, BSpline]:
        """Positions, velocities and accelerations as functions of time."""
        t, q, qd, qdd = self.motion.t, self.motion.q, self.motion.qd, self.motion.qdd
        return (
            CubicHermiteSpline(t, q, qd),
            CubicHermiteSpline(t, qd, qdd),
            make_interp_spline(t, qdd, 1),
        )

    def at(self, time: float) -> Target:
        """Return the target at a time since the start; before and after the motion the arm rests at its ends."""
        q, qd, qdd = (curve(np.clip(time, 0.0, self.duration)) for curve in self._curves)
        share = np.clip(time / tuning.BLEND_S, 0.0, 1.0)
        gone, speed, slowing = rest_to_rest(share, tuning.BLEND_S)
        return Target(q + (1 - gone) * self.gap, qd - speed * self.gap, qdd - slowing * self.gap)
