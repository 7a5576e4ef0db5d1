"""Roughly the torques of an arm, before anything is identified: point masses half-way between the DH frames.

Where the robot file gives bodies, they are used. The answer only has to know which joint carries weight in which pose.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dynid.model.kinematics import link_frames
from dynid.robot import Robot

Floats = NDArray[np.float64]

#: Mass of a link about which nothing is known [kg].
UNKNOWN_MASS = 1.0


def expected_torque(q: Floats, robot: Robot) -> Floats:
    """Return roughly the torques that hold the arm against gravity, (N, n) [N m or N].

    Args:
        q: joint positions, (N, n) [rad or m].
        robot: the arm.
    """
    return carried(q, robot, lambda points: -np.broadcast_to(np.array(robot.gravity), points.shape))


def carried(q: Floats, robot: Robot, accelerations: Callable[[Floats], Floats], some: slice = slice(None)) -> Floats:
    """Return the torques that accelerate point masses, (N, n), from a function of their places, (N, n, 3).

    Only those at some of the samples are worked out.
    """
    frames = link_frames(robot, q)
    masses, offsets = _masses(robot)
    before = np.concatenate([np.zeros((len(q), 1, 3)), frames.p[:, :-1]], axis=1)
    points = 0.5 * (before + frames.p)
    for k, offset in enumerate(offsets):
        if offset is not None:
            points[:, k] = frames.p[:, k] + frames.R[:, k] @ offset
    pushed, points = accelerations(points)[some], points[some]
    axes, places = frames.axis[some], frames.point[some]
    torque = np.zeros(points.shape[:2])
    for i, joint in enumerate(robot.joints):
        for k in range(i, robot.n):
            axis, lever = axes[:, i], points[:, k] - places[:, i]
            velocity = np.cross(axis, lever) if joint.revolute else axis
            torque[:, i] += masses[k] * np.sum(velocity * pushed[:, k], axis=1)
    return torque


def _masses(robot: Robot) -> tuple[list[float], list[Floats | None]]:
    """Return a mass for each link, and its centre in the link frame where the robot file gives it."""
    if robot.prior is not None and robot.prior.links:
        return [body.mass for body in robot.prior.links], [np.array(body.com) for body in robot.prior.links]
    cylinders = robot.prior.cylinders if robot.prior is not None else None
    total = UNKNOWN_MASS * robot.n
    lengths = np.array([np.hypot(joint.a, joint.d) for joint in robot.joints])
    if cylinders is not None and cylinders.mass is not None:
        total = cylinders.mass
    elif cylinders is not None and cylinders.density is not None:
        total = cylinders.density * np.pi * cylinders.radius**2 * float(lengths.sum())
    share = (lengths + 0.1 * lengths.sum()) / np.sum(lengths + 0.1 * lengths.sum()) if lengths.any() else lengths
    return list(total * share), [None] * robot.n
