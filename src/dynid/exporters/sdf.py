"""SDF, the format of Gazebo and Drake."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.exporters.engines import bullet, part
from dynid.exporters.full_model import joint_poses, moving_bodies, numbers, world_gravity
from dynid.exporters.interface import Format, IdentifiedArm, Loaded
from dynid.exporters.simulated import simulated
from dynid.exporters.urdf import beyond_joints
from dynid.robot import Body, Joint, roll_pitch_yaw
from dynid.scratch import scratch_folder
from dynid.text import xml, xml_comment

Floats = NDArray[np.float64]

#: Stand-in for a limit that the robot file leaves out; Gazebo's own.
_NO_LIMIT = 1e16


def text(arm: IdentifiedArm) -> str:
    """Return the SDF: link poses at q = 0 in the model's frame, joints in the frames of their links."""
    full, robot = simulated(arm).full, arm.robot
    root = ET.Element("sdf", version="1.6")
    root.append(ET.Comment(xml_comment(arm.head(str))))
    model = ET.SubElement(root, "model", name=xml(robot.slug))
    base = ET.SubElement(model, "link", name="base")
    _inertial(base, Body(1.0, inertia_com=(1.0, 0.0, 0.0, 1.0, 0.0, 1.0)))
    fixed = ET.SubElement(model, "joint", name="world_to_base", type="fixed")
    ET.SubElement(fixed, "parent").text, ET.SubElement(fixed, "child").text = "world", "base"
    pose, step = np.eye(4), joint_poses(robot)
    fv, fc = full.joint_friction("fv"), full.joint_friction("fc")
    for i, (joint, body) in enumerate(
        zip(robot.joints, moving_bodies(robot, full.bodies), strict=True)
    ):
        pose = pose @ step[i]
        model.append(ET.Comment(xml_comment(f"link {i + 1}: {full.origin_of_link(i + 1)}")))
        link = ET.SubElement(model, "link", name=f"link_{i + 1}")
        ET.SubElement(link, "pose").text = _six(pose)
        _inertial(link, body)
        _joint(model, joint, i, float(fv[i]), float(fc[i]))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    """Return what an SDF has no place for."""
    full = simulated(arm).full
    gone = []
    if any(full.rotor_inertia):
        gone.append("rotor inertia")
    if any(full.joint_friction("fo")):
        gone.append("torque offsets fo")
    if any(full.joint_friction("fc")):
        gone.append("the smooth start of Coulomb friction: <friction> has only its size")
    gone.append(f"gravity, which belongs to the world: {numbers(world_gravity(full.robot))} m/s^2")
    return (*gone, *beyond_joints(arm))


def loaded(path: Path, arm: IdentifiedArm) -> Iterator[Loaded]:
    """Load it in PyBullet, whose reader knows no link called world: a base without mass is fixed there."""
    robot = arm.robot
    root = ET.parse(path).getroot()
    for model in root.iter("model"):
        model.remove(
            next(joint for joint in model.findall("joint") if joint.get("type") == "fixed")
        )
        mass = model.find("link/inertial/mass")
        assert mass is not None
        mass.text = "0"
    with scratch_folder() as folder:
        moments = {
            str(link.get("name")): [
                float(str(link.findtext(f"inertial/inertia/{key}")))
                for key in ("ixx", "iyy", "izz")
            ]
            for link in root.iter("link")
        }
        copy = Path(folder) / "arm.sdf"
        ET.ElementTree(root).write(copy)
        found = bullet(copy, tuple(map(xml, robot.joint_names)), world_gravity(robot), moments)
    if found:
        yield Loaded(found[0], "rigid body", found[1], part(arm.base.model, simulated(arm).full))


def _six(pose: Floats) -> str:
    return numbers([*pose[:3, 3], *roll_pitch_yaw(pose[:3, :3])])


def _inertial(link: ET.Element, body: Body) -> None:
    element = ET.SubElement(link, "inertial")
    moments, axes = np.linalg.eigh(body.tensor)
    pose = np.eye(4)
    # Why principal axes: Bullet's reader takes only the diagonal of the tensor.
    pose[:3, :3], pose[:3, 3] = axes * np.linalg.det(axes), body.com
    ET.SubElement(element, "pose").text = _six(pose)
    ET.SubElement(element, "mass").text = repr(float(body.mass))
    tensor = ET.SubElement(element, "inertia")
    for name, value in zip(
        ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
        (moments[0], 0, 0, moments[1], 0, moments[2]),
        strict=True,
    ):
        ET.SubElement(tensor, name).text = repr(float(value))


def _joint(model: ET.Element, joint: Joint, i: int, damping: float, friction: float) -> None:
    element = ET.SubElement(
        model, "joint", name=xml(joint.name), type="revolute" if joint.revolute else "prismatic"
    )
    ET.SubElement(element, "parent").text = f"link_{i}" if i else "base"
    ET.SubElement(element, "child").text = f"link_{i + 1}"
    axis = ET.SubElement(element, "axis")
    ET.SubElement(axis, "xyz").text = "0 0 1"
    limits = ET.SubElement(axis, "limit")
    lower, upper = joint.limits.position or (-_NO_LIMIT, _NO_LIMIT)
    sizes = {
        "lower": lower,
        "upper": upper,
        "effort": joint.limits.torque or -1.0,
        "velocity": joint.limits.velocity or -1.0,
    }
    for name, value in sizes.items():
        ET.SubElement(limits, name).text = repr(float(value))
    dynamics = ET.SubElement(axis, "dynamics")
    for name, value in (("damping", damping), ("friction", friction)):
        ET.SubElement(dynamics, name).text = repr(value)


SDF = Format("sdf", ".sdf", text, leaves_out, loaded)
