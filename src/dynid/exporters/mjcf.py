"""MJCF, the format of MuJoCo: it has a place for rotor inertia (armature) and joint friction."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.exporters.engines import RIGID, ROTORS, VISCOUS, mujoco, part, pinocchio
from dynid.exporters.full_model import joint_poses, moving_bodies, numbers, world_gravity
from dynid.exporters.interface import Format, IdentifiedArm, Loaded
from dynid.exporters.urdf import beyond_joints
from dynid.model.kinematics import fixed_poses
from dynid.model.parameters import cylinders_of, link_cylinders
from dynid.robot import Body, Joint
from dynid.text import xml, xml_comment

Floats = NDArray[np.float64]


def text(arm: IdentifiedArm) -> str:
    """Return the MJCF."""
    full, robot = arm.full, arm.robot
    root = ET.Element("mujoco", model=xml(robot.slug))
    root.append(ET.Comment(xml_comment(arm.head(str))))
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(root, "option", gravity=numbers(world_gravity(robot)))
    world = ET.SubElement(root, "worldbody")
    # Why no body for the base: Pinocchio's reader loses the pose of a body without a joint.
    parent, poses, shapes = world, joint_poses(robot), link_cylinders(robot)
    fv, fc = full.joint_friction("fv"), full.joint_friction("fc")
    for i, (joint, body) in enumerate(zip(robot.joints, moving_bodies(robot, full.bodies), strict=True)):
        parent.append(ET.Comment(xml_comment(f"link {i + 1}: {full.origin_of_link(i + 1)}")))
        parent = ET.SubElement(parent, "body", {"name": f"link_{i + 1}", **_place(poses[i])})
        _inertial(parent, body)
        _joint(parent, joint, armature=full.rotor_inertia[i], damping=float(fv[i]), frictionloss=float(fc[i]))
        _shape(parent, shapes[i], cylinders_of(robot).radius, fixed_poses(joint, robot.convention)[1])
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    """Return what an MJCF has no place for."""
    full = arm.full
    gone = []
    if any(full.joint_friction("fo")):
        gone.append("torque offsets fo")
    if any(full.joint_friction("fc")):
        gone.append("the smooth start of Coulomb friction: frictionloss has only its size and is a soft constraint")
    negative = [name for name, value in _drive_numbers(arm) if value < 0]
    if negative:
        gone.append(f"{', '.join(negative)}: negative, which MuJoCo refuses; written as zero")
    return (*gone, *beyond_joints(arm))


def loaded(path: Path, arm: IdentifiedArm) -> Iterator[Loaded]:
    """Load it in MuJoCo and Pinocchio."""
    names, gravity, model = tuple(map(xml, arm.robot.joint_names)), world_gravity(arm.robot), arm.base.model
    # Why: what is negative was written as zero, so that the torques cannot agree.
    found = mujoco(path, names, gravity)
    if found and not any(value < 0 for _, value in _drive_numbers(arm)):
        ours = part(model, arm.full, (*RIGID, *ROTORS, *VISCOUS))
        yield Loaded(found[0], "rigid body, rotors, viscous friction", found[1], ours)
    found = pinocchio(path, names, gravity, mjcf=True)
    if found and not any(rotor < 0 for rotor in arm.full.rotor_inertia):
        yield Loaded(found[0], "rigid body, rotors", found[1], part(model, arm.full, (*RIGID, *ROTORS)))


def _drive_numbers(arm: IdentifiedArm) -> list[tuple[str, float]]:
    full = arm.full
    rows = {"Im": full.rotor_inertia, "fv": full.joint_friction("fv"), "fc": full.joint_friction("fc")}
    return [(f"{prefix}{i}", float(value)) for prefix, row in rows.items() for i, value in enumerate(row, start=1)]


def _place(pose: Floats) -> dict[str, str]:
    return {"pos": numbers(pose[:3, 3]), "quat": numbers(quaternion(pose[:3, :3]))}


def quaternion(R: Floats) -> Floats:
    """Return the unit quaternion w, x, y, z of a rotation matrix, (4,)."""
    # Why: the eigenvector to the largest eigenvalue is exact to rounding for every angle (Bar-Itzhack 2000).
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R
    K = np.array(
        [
            [xx + yy + zz, zy - yz, xz - zx, yx - xy],
            [zy - yz, xx - yy - zz, yx + xy, zx + xz],
            [xz - zx, yx + xy, yy - xx - zz, zy + yz],
            [yx - xy, zx + xz, zy + yz, zz - xx - yy],
        ]
    )
    vector = np.linalg.eigh(K)[1][:, -1]
    return np.asarray(vector if vector[0] >= 0 else -vector)


def _inertial(parent: ET.Element, body: Body) -> None:
    xx, xy, xz, yy, yz, zz = body.inertia_com
    ET.SubElement(
        parent,
        "inertial",
        pos=numbers(body.com),
        mass=repr(float(body.mass)),
        fullinertia=numbers([xx, yy, zz, xy, xz, yz]),
    )


def _joint(parent: ET.Element, joint: Joint, **drive: float) -> None:
    limits = joint.limits
    facts = {"name": xml(joint.name), "type": "hinge" if joint.revolute else "slide", "axis": "0 0 1"}
    if limits.position:
        facts["range"] = numbers(limits.position)
    if limits.torque:
        facts["actuatorfrcrange"] = numbers([-limits.torque, limits.torque])
    ET.SubElement(parent, "joint", facts | {key: repr(max(0.0, value)) for key, value in drive.items()})


def _shape(parent: ET.Element, ends: Floats, radius: float, to_dh: Floats) -> None:
    """Add a cylinder for the eye; it has no mass and touches nothing."""
    placed = [to_dh[:3, :3] @ end + to_dh[:3, 3] for end in ends]
    look = {"mass": "0", "contype": "0", "conaffinity": "0", "group": "1", "rgba": "0.6 0.65 0.7 1"}
    shape = {"type": "cylinder", "size": repr(radius), "fromto": numbers(placed)}
    ET.SubElement(parent, "geom", shape | look)


MJCF = Format("mjcf", ".xml", text, leaves_out, loaded)
