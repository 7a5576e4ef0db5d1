"""The one home of forward kinematics: the DH transform of a joint, and where it puts the link frames.

``dh_step`` is written once for every kind of number: floats and arrays of samples here, symbols in
``model/dynamics.py`` and ``model/relations.py``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dynid.arrays import Floats
from dynid.robot import Joint, Robot, rotation_rpy


def dh_step(
    convention: str,
    angle: tuple[Any, Any],
    twist: tuple[Any, Any],
    a: Any,  # noqa: ANN401 - any kind of number
    d: Any,  # noqa: ANN401
) -> tuple[list[list[Any]], list[Any]]:
    """Return the transform of one joint, from the link's frame to the previous one.

    Args:
        convention: ``"standard"``, Rot_z(theta) Trans_z(d) Trans_x(a) Rot_x(twist), or ``"modified"``, Rot_x(twist)
            Trans_x(a) Rot_z(theta) Trans_z(d).
        angle: cosine and sine of theta.
        twist: cosine and sine of the twist.
        a: link length [m].
        d: link offset [m].

    Returns:
        Rotation, 3 x 3, and the link's origin in the previous frame, 3 [m]; a plain 0 where an entry is always zero.

    Source: Paper Eqs. 10-12; the 1 in the first row of the printed Eq. 11 must be a 0.
    """
    (ct, st), (ca, sa) = angle, twist
    if convention == "standard":
        rows = [[ct, -ca * st, sa * st], [st, ca * ct, -sa * ct], [0, sa, ca]]
        return rows, [a * ct, a * st, d]
    rows = [[ct, -st, 0], [ca * st, ca * ct, -sa], [sa * st, sa * ct, ca]]
    return rows, [a, -d * sa, d * ca]


@dataclass(frozen=True)
class LinkFrames:
    """Where the links are.

    Attributes:
        R: rotation of each link's DH frame, (..., n, 3, 3).
        p: its origin, (..., n, 3) [m].
        axis: direction of each joint, (..., n, 3).
        point: a point on it, (..., n, 3) [m].
    """

    R: Floats
    p: Floats
    axis: Floats
    point: Floats

    @property
    def poses(self) -> Floats:
        """Homogeneous transforms of the link frames, (..., n, 4, 4)."""
        return pose_of(self.R, self.p)


def link_frames(robot: Robot, q: Floats, *, world: bool = False) -> LinkFrames:
    """Return the poses of all link frames.

    Args:
        robot: the arm.
        q: joint positions, (..., n) [rad or m].
        world: whether the poses are wanted in the world instead of frame 0.
    """
    batch, q = q.shape[:-1], np.reshape(q, (-1, robot.n))
    count, n = q.shape
    base = base_pose(robot) if world else np.eye(4)
    # Why samples last: every operation runs along them.
    R, p = (np.repeat(part[..., None], count, axis=-1) for part in (base[:3, :3], base[:3, 3]))
    rotations, (origins, axes, points) = np.empty((n, 3, 3, count)), np.empty((3, n, 3, count))
    step, shift = np.empty((3, 3, count)), np.empty((3, count))
    for i, joint in enumerate(robot.joints):
        theta = joint.theta_offset + q[:, i] * joint.revolute
        twist = math.cos(joint.twist), math.sin(joint.twist)
        d = joint.d + q[:, i] * (not joint.revolute)
        rows, along = dh_step(robot.convention, (np.cos(theta), np.sin(theta)), twist, joint.a, d)
        for j in range(3):
            shift[j] = along[j]
            for k in range(3):
                step[j, k] = rows[j][k]
        if robot.convention == "standard":
            axes[i], points[i] = R[:, 2], p
        p = p + np.einsum("ijn,jn->in", R, shift)
        R = np.einsum("ijn,jkn->ikn", R, step)
        if robot.convention == "modified":
            axes[i], points[i] = R[:, 2], p
        rotations[i], origins[i] = R, p
    parts = (
        np.moveaxis(x, -1, 0).reshape(*batch, *x.shape[:-1])
        for x in (rotations, origins, axes, points)
    )
    return LinkFrames(*parts)


def tip_jacobian(robot: Robot, where: LinkFrames) -> Floats:
    """Return the velocity of the last frame's origin per unit of each joint's velocity, (..., n, 3) [m or 1]."""
    return np.where(
        robot.turning[:, None], np.cross(where.axis, where.p[..., -1:, :] - where.point), where.axis
    )


def base_pose(robot: Robot) -> Floats:
    """Return the pose of frame 0 in the world, (4, 4)."""
    return pose_of(rotation_rpy(robot.base_rpy), robot.base_xyz)


def tool_pose(robot: Robot, q: Floats) -> Floats:
    """Return the pose of the last frame in the world at joint positions (..., n) [rad or m], (..., 4, 4)."""
    return link_frames(robot, q, world=True).poses[..., -1, :, :]


def fixed_poses(joint: Joint, convention: str) -> tuple[Floats, Floats]:
    """Return what does not move in a joint's transform: the parts before and after its own motion about or along z.

    Returns:
        Pose at q = 0 of the joint's moving frame in the previous DH frame, (4, 4); pose of the DH frame in the joint's
        moving frame, (4, 4).
    """
    d_before, d_after = (0.0, joint.d) if joint.revolute else (joint.d, 0.0)
    turned, still = (math.cos(joint.theta_offset), math.sin(joint.theta_offset)), (1.0, 0.0)
    none, bent = (still, 0.0), ((math.cos(joint.twist), math.sin(joint.twist)), joint.a)
    before, after = (none, bent) if convention == "standard" else (bent, none)
    return (
        pose_of(*dh_step(convention, turned, *before, d_before)),
        pose_of(*dh_step(convention, still, *after, d_after)),
    )


def pose_of(R: ArrayLike, p: ArrayLike) -> Floats:
    """Return the homogeneous transforms of rotations, (..., 3, 3), and origins, (..., 3) [m]; (..., 4, 4)."""
    pose = np.zeros((*np.shape(p)[:-1], 4, 4))
    pose[..., :3, :3], pose[..., :3, 3], pose[..., 3, 3] = R, p, 1.0
    return pose


def right_angle(angle: float) -> tuple[int, int] | None:
    """Return exact cosine and sine of a multiple of 90 degrees."""
    quarter = angle / (math.pi / 2)
    if abs(quarter - round(quarter)) > 1e-12:
        return None
    return ((1, 0), (0, 1), (-1, 0), (0, -1))[round(quarter) % 4]


def geometry(robot: Robot) -> dict[str, float]:
    """Return the number behind every geometric symbol by its name: ``d3`` [m], ``ca3``, ``gz`` [m/s^2] and so on."""
    values = {f"g{x}": g for x, g in zip("xyz", robot.gravity, strict=True)}
    for i, joint in enumerate(robot.joints, start=1):
        values |= {
            f"a{i}": joint.a,
            f"d{i}": joint.d,
            f"ca{i}": math.cos(joint.twist),
            f"sa{i}": math.sin(joint.twist),
        }
        if not joint.revolute:
            values |= {f"c{i}": math.cos(joint.theta_offset), f"s{i}": math.sin(joint.theta_offset)}
    return values
