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
from dynid.text import printable

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
    root = ET.Element("robot", name=printable(robot.slug))
    base = ET.SubElement(root, "link", name="base")
    # Why: Bullet complains on standard output about a link without mass, which would break --json.
    _inertial(base, Body(1.0, inertia_com=(1.0, 0.0, 0.0, 1.0, 0.0, 1.0)), np.eye(4))
    previous = base_pose(robot)
    shapes, radius = link_cylinders(robot), cylinders_of(robot).radius
    for i, body in enumerate(prior_bodies(robot) if bodies is None else bodies):
        joint = robot.joints[i]
        before, to_dh = fixed_poses(joint, robot.convention)
        link = ET.SubElement(root, "link", name=f"link_{i + 1}")
        _inertial(link, body, to_dh)
        for tag in ("visual", "collision"):
            _shape(ET.SubElement(link, tag), shapes[i], radius, to_dh)
        _joint(root, joint, i, previous @ before)
        previous = to_dh
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _joint(root: ET.Element, joint: Joint, i: int, origin: Floats) -> None:
    limits = joint.limits
    turning = "revolute" if limits.position else "continuous"
    kind = turning if joint.revolute else "prismatic"
    element = ET.SubElement(root, "joint", name=printable(joint.name), type=kind)
    ET.SubElement(element, "parent", link=f"link_{i}" if i else "base")
    ET.SubElement(element, "child", link=f"link_{i + 1}")
    _origin(element, origin)
    ET.SubElement(element, "axis", xyz="0 0 1")
    bounds = {"effort": limits.torque or _NO_LIMIT, "velocity": limits.velocity or _NO_LIMIT}
    if kind != "continuous":
        bounds["lower"], bounds["upper"] = limits.position or (-_NO_TRAVEL, _NO_TRAVEL)
    ET.SubElement(element, "limit", {key: repr(float(value)) for key, value in bounds.items()})


def _inertial(link: ET.Element, body: Body, to_dh: Floats) -> None:
    """Add mass and inertia, given along its principal axes: Bullet finds those itself only to 1e-7."""
    moments, axes = np.linalg.eigh(body.tensor)
    element = ET.SubElement(link, "inertial")
    _origin(element, to_dh @ pose_of(axes * np.linalg.det(axes), body.com))
    ET.SubElement(element, "mass", value=repr(float(body.mass)))
    xx, yy, zz = (repr(float(moment)) for moment in moments)
    ET.SubElement(element, "inertia", ixx=xx, ixy="0", ixz="0", iyy=yy, iyz="0", izz=zz)


def _shape(element: ET.Element, ends: Floats, radius: float, to_dh: Floats) -> None:
    """Add a cylinder; that of a URDF lies along its own z axis about its middle."""
    length = float(np.linalg.norm(ends[1] - ends[0]))
    x, y, z = (ends[1] - ends[0]) / length
    turned = rotation_rpy((0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x)))
    _origin(element, to_dh @ pose_of(turned, ends.mean(axis=0)))
    geometry = ET.SubElement(element, "geometry")
    ET.SubElement(geometry, "cylinder", radius=repr(float(radius)), length=repr(length))


def _origin(element: ET.Element, pose: Floats) -> None:
    xyz = " ".join(repr(float(value)) for value in pose[:3, 3])
    rpy = " ".join(repr(value) for value in roll_pitch_yaw(pose[:3, :3]))
    ET.SubElement(element, "origin", xyz=xyz, rpy=rpy)
