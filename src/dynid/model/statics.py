"""Forces on links as joint torques, for directions of gravity that the arm's own program does not know.

The regressor's program leaves out components of gravity that are zero, so a tilted base or a force on the tool is
computed here from the frames, vectorised over samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.robot import Robot

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Frames:
    """Poses over a motion, in frame 0.

    Attributes:
        R: rotation of each link's DH frame, (n, N, 3, 3).
        p: its origin, (n, N, 3).
        axis: direction of each joint, (n, N, 3).
        point: a point on it, (n, N, 3).
    """

    R: Floats
    p: Floats
    axis: Floats
    point: Floats


def frames(robot: Robot, q: Floats) -> Frames:
    """Return the poses of all links.

    Args:
        robot: the arm.
        q: positions, (N, n) [rad or m].
    """
    count = len(q)
    R, p = np.broadcast_to(np.eye(3), (count, 3, 3)), np.zeros((count, 3))
    found: list[tuple[Floats, Floats, Floats, Floats]] = []
    for i, joint in enumerate(robot.joints):
        c, s = math.cos(joint.twist), math.sin(joint.twist)
        twist = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        angle = q[:, i] + joint.theta_offset if joint.revolute else np.full(count, joint.theta_offset)
        along = np.full(count, joint.d) if joint.revolute else q[:, i] + joint.d
        turn = np.zeros((count, 3, 3))
        turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
        turn[:, 1, 0] = np.sin(angle)
        turn[:, 0, 1], turn[:, 2, 2] = -turn[:, 1, 0], 1.0
        if robot.convention == "modified":
            p = p + joint.a * R[:, :, 0]
            R = R @ twist @ turn
            axis, point = R[:, :, 2], p
            p = p + along[:, None] * axis
        else:
            axis, point = R[:, :, 2], p
            R = R @ turn
            p = p + along[:, None] * axis + joint.a * R[:, :, 0]
            R = R @ twist
        found.append((R, p, axis, point))
    return Frames(*(np.array(x) for x in zip(*found, strict=True)))


def holding_torque(robot: Robot, where: Frames, mass: Floats, moment: Floats, gravity: Floats) -> Floats:
    """Return the torques that hold the links under a gravity, (N, n) [N m or N].

    Args:
        robot: the arm.
        where: its poses.
        mass: of each link, (n,) [kg].
        moment: first moment of each link in its DH frame, (n, 3) [kg m].
        gravity: in frame 0, (3,) [m/s^2].
    """
    n, count = where.p.shape[:2]
    centres = mass[:, None, None] * where.p + np.einsum("kmij,kj->kmi", where.R, moment)
    # What a joint carries is everything from its own link outwards.
    carried, weight = np.cumsum(centres[::-1], axis=0)[::-1], np.cumsum(mass[::-1])[::-1]
    tau = np.empty((count, n))
    for j, joint in enumerate(robot.joints):
        if joint.revolute:
            lever = carried[j] - weight[j] * where.point[j]
            tau[:, j] = -np.einsum("mi,mi->m", where.axis[j], np.cross(lever, gravity))
        else:
            tau[:, j] = -weight[j] * where.axis[j] @ gravity
    return tau
