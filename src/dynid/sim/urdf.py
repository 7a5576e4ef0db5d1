"""A URDF from the DH table and one body per link, for PyBullet and for pictures.

A URDF link's frame is its joint's frame, so link i of the URDF is DH frame i moved by a constant (``fixed_poses``); the
joint variable of the URDF is q of the robot file. Reads a ``Robot`` and bodies.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynid.arrays import Floats
from dynid.model.kinematics import base_pose, fixed_poses, pose_of
from dynid.model.parameters import cylinders_of, link_cylinders, prior_bodies
from dynid.robot import Body, Joint, Limits, Robot, roll_pitch_yaw, rotation_rpy
from dynid.text import html

#: Stand-ins for limits that the robot file leaves out; the URDF format demands numbers.
_NO_TRAVEL, _NO_LIMIT = 10.0, 1e3


def without_stops(robot: Robot) -> Robot:
    """Return the arm without limits: a mechanical stop would be a torque that no model here has."""
    return replace(robot, joints=tuple(replace(joint, limits=Limits()) for joint in robot.joints))


def urdf_text(robot: Robot, bodies: Sequence[Body] | None = None) -> str:
    """Return the URDF of an arm, whose root link ``base`` is the world.

    Args:
        robot: the arm; ``base_xyz`` and ``base_rpy`` place frame 0, the prior's radius gives the shapes.
        bodies: one body per link in its DH frame; the prior of the robot file when None.
    """
    # Why a mass: Bullet complains on standard output about a link without, which would break --json.
    still = _inertial(Body(1.0, inertia_com=(1.0, 0.0, 0.0, 1.0, 0.0, 1.0)), np.eye(4))
    parts, previous = [f'<link name="base">{still}</link>'], base_pose(robot)
    shapes, radius = link_cylinders(robot), cylinders_of(robot).radius
    for i, body in enumerate(prior_bodies(robot) if bodies is None else bodies):
        before, to_dh = fixed_poses(robot.joints[i], robot.convention)
        shape = _cylinder(shapes[i], radius, to_dh)
        parts.append(
            f'<link name="link_{i + 1}">{_inertial(body, to_dh)}'
            f"<visual>{shape}</visual><collision>{shape}</collision></link>"
        )
        parts.append(_joint(robot.joints[i], i, previous @ before))
        previous = to_dh
    root = ET.fromstring(f'<robot name="{html(robot.slug)}">{"".join(parts)}</robot>')
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _joint(joint: Joint, i: int, origin: Floats) -> str:
    limits, parent = joint.limits, f"link_{i}" if i else "base"
    kind, travel = "continuous", ""
    if limits.position or not joint.revolute:
        kind = "revolute" if joint.revolute else "prismatic"
        lower, upper = map(float, limits.position or (-_NO_TRAVEL, _NO_TRAVEL))
        travel = f' lower="{lower}" upper="{upper}"'
    effort, speed = float(limits.torque or _NO_LIMIT), float(limits.velocity or _NO_LIMIT)
    return (
        f'<joint name="{html(joint.name)}" type="{kind}">'
        f'<parent link="{parent}"/><child link="link_{i + 1}"/>{_origin(origin)}'
        f'<axis xyz="0 0 1"/><limit effort="{effort}" velocity="{speed}"{travel}/></joint>'
    )


def _inertial(body: Body, to_dh: Floats) -> str:
    """Return mass and inertia, given along its principal axes: Bullet finds those itself only to 1e-7."""
    moments, axes = np.linalg.eigh(body.tensor)
    (xx, yy, zz), mass = moments.tolist(), float(body.mass)
    origin = _origin(to_dh @ pose_of(axes * np.linalg.det(axes), body.com))
    return (
        f'<inertial>{origin}<mass value="{mass}"/>'
        f'<inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/></inertial>'
    )


def _cylinder(ends: Floats, radius: float, to_dh: Floats) -> str:
    """Return a cylinder; that of a URDF lies along its own z axis about its middle."""
    length = float(np.linalg.norm(ends[1] - ends[0]))
    x, y, z = (ends[1] - ends[0]) / length
    turned = rotation_rpy((0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x)))
    origin = _origin(to_dh @ pose_of(turned, ends.mean(axis=0)))
    size = f'radius="{float(radius)}" length="{length}"'
    return f"{origin}<geometry><cylinder {size}/></geometry>"


def _origin(pose: Floats) -> str:
    x, y, z = pose[:3, 3].tolist()
    roll, pitch, yaw = roll_pitch_yaw(pose[:3, :3])
    return f'<origin xyz="{x} {y} {z}" rpy="{roll} {pitch} {yaw}"/>'
