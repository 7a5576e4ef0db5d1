"""Where the simulators' frames lie: joint poses, bodies in moving frames, shapes; all at q = 0."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid.model.kinematics import base_pose, fixed_poses
from dynid.model.parameters import moved
from dynid.robot import Body, Robot, rotation_rpy

Floats = NDArray[np.float64]


def world_gravity(robot: Robot) -> Floats:
    """Return gravity in the world frame, (3,)."""
    return np.asarray(rotation_rpy(robot.base_rpy) @ np.array(robot.gravity))


def joint_poses(robot: Robot) -> tuple[Floats, ...]:
    """Return each joint's pose at q = 0 in the frame of the joint before, in the world for the first, n of (4, 4)."""
    previous, poses = base_pose(robot), []
    for joint in robot.joints:
        before, after = fixed_poses(joint, robot.convention)
        poses.append(previous @ before)
        previous = after
    return tuple(poses)


def moving_bodies(robot: Robot, bodies: tuple[Body, ...]) -> tuple[Body, ...]:
    """Return the bodies in the moving frames of their joints instead of the DH frames."""
    joints = zip(bodies, robot.joints, strict=True)
    return tuple(moved(body, fixed_poses(joint, robot.convention)[1]) for body, joint in joints)


def numbers(values: object) -> str:
    """Return numbers with all their digits, separated by spaces."""
    return " ".join(repr(float(value)) for value in np.ravel(np.asarray(values, dtype=float)))
