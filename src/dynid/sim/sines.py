"""A motion that excites every joint: sums of sines under a window, inside the limits and above the floor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly

from dynid.arrays import Floats
from dynid.errors import LimitBroken
from dynid.model.kinematics import link_frames
from dynid.motion import Motion
from dynid.robot import Robot
from dynid.sim import tuning

#: Values over time with their first two derivatives, (N,) each.
Curve = tuple[Floats, Floats, Floats]
_STEP = BPoly.from_derivatives([0.0, 1.0], [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True)
class SineSpec:
    """What a motion of sines may use.

    Attributes:
        duration: [s].
        period: of the lowest sine [s].
        reach: share of the position limits.
        speed: share of the velocity limits.
        acceleration: share of the acceleration limits.
        floor: height in the world that no joint or tool goes below [m].
    """

    duration: float
    period: float
    reach: float
    speed: float
    acceleration: float
    floor: float


def sines(robot: Robot, spec: SineSpec, dt: float, rng: np.random.Generator) -> Motion:
    """Return a random motion at rest at both ends, sampled every ``dt`` seconds.

    Raises:
        LimitBroken: none of many tries stays above the floor.
    """
    t, coarse = np.arange(0.0, spec.duration, dt), max(1, round(0.05 / dt))
    window = _window(t, spec.duration)
    turn, slide = tuning.FREE_TURN_RAD, tuning.FREE_SLIDE_M
    lower, upper = robot.travel((-turn, turn), (-slide, slide))
    allowed = (
        spec.reach * (upper - lower) / 2,
        spec.speed * robot.limits("velocity"),
        spec.acceleration * robot.limits("acceleration"),
    )
    for _ in range(tuning.RANDOM_MOTIONS):
        shapes = [_shape(t, window, spec.period, rng) for _ in robot.joints]
        motion = [np.column_stack(parts) for parts in zip(*shapes, strict=True)]
        # Each joint goes to the first limit that it meets, about the middle of its travel.
        pairs = zip(allowed, motion, strict=True)
        scale = np.min([limit / np.abs(part).max(axis=0) for limit, part in pairs], axis=0)
        q, qd, qdd = (scale * part for part in motion)
        q += (lower + upper) / 2
        if lowest_point(robot, q[::coarse]) > spec.floor:
            return Motion(t, q, qd, qdd)
    raise LimitBroken(
        f"{tuning.RANDOM_MOTIONS} random motions all went below {spec.floor:g} m",
        fix="lower the floor or the reach",
    )


def _window(t: Floats, duration: float) -> Curve:
    """Return a smooth 0-1-0 window with its first two derivatives, (N,) each."""
    rising = np.clip((t - tuning.WINDOW_REST_S) / tuning.WINDOW_RISE_S, 0.0, 1.0)
    falling = np.clip((duration - tuning.WINDOW_REST_S - t) / tuning.WINDOW_RISE_S, 0.0, 1.0)
    sign = np.where(rising < falling, 1.0, -1.0)
    value, slope, curvature = rest_to_rest(np.minimum(rising, falling), tuning.WINDOW_RISE_S)
    return value, sign * slope, curvature


def rest_to_rest(s: Floats, duration: float) -> tuple[Floats, ...]:
    """Return a quintic from 0 to 1, at rest at both ends, with its first two derivatives, at shares of its duration."""
    return tuple(_STEP(s, order) / duration**order for order in range(3))


def _shape(t: Floats, window: Curve, period: float, rng: np.random.Generator) -> Curve:
    """Return one windowed sum of sines of arbitrary size with its derivatives, (N,) each."""
    count = tuning.SINES_A_JOINT
    harmonics = 1 + rng.choice(tuning.HIGHEST_HARMONIC, count, replace=False)
    omega = 2 * np.pi / period * harmonics
    size = rng.uniform(0.3, 1.0, count) / omega
    phase = np.outer(t, omega) + rng.uniform(0, 2 * np.pi, count)
    sine, cosine = np.sin(phase), np.cos(phase)
    s, sd, sdd = sine @ size, cosine @ (size * omega), -sine @ (size * omega**2)
    w, wd, wdd = window
    return w * s, wd * s + w * sd, wdd * s + 2 * wd * sd + w * sdd


def lowest_point(robot: Robot, q: Floats) -> float:
    """Return the smallest height in the world of any link's origin but the first over a motion, (N, n) -> [m]."""
    heights = link_frames(robot, q, world=True).p[:, 1:, 2]
    return float(heights.min(initial=math.inf))
