"""MJCF, the format of MuJoCo: it has a place for rotor inertia (armature) and joint friction."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from dynid.exporters.engines import mujoco, own_torques
from dynid.exporters.full_model import numbers, world_gravity
from dynid.exporters.interface import Floats, Format, IdentifiedArm, Loaded
from dynid.exporters.simulated import Simulated, numbers_of, simulated
from dynid.exporters.urdf import beyond_joints
from dynid.model.kinematics import base_pose, fixed_poses
from dynid.model.parameters import cylinders_of, link_cylinders, moved
from dynid.robot import Joint
from dynid.text import xml, xml_comment

#: What MuJoCo calls the numbers of a joint's drive.
DRIVE = {"Im": "armature", "fv": "damping", "fc": "frictionloss"}
#: A motor without an input. Why a resistance and a constant: MuJoCo asks for them; so small a one damps by 1e-18.
PASSIVE = {"input": "none", "resistance": "1", "motorconst": "1e-9"}
#: A cylinder for the eye; it has no mass and touches nothing.
LOOK = {"mass": "0", "contype": "0", "conaffinity": "0", "group": "1", "rgba": "0.6 0.65 0.7 1"}


def text(arm: IdentifiedArm) -> str:
    """Return the MJCF."""
    found, robot = simulated(arm), arm.robot
    root = ET.Element("mujoco", model=xml(robot.slug))
    root.append(ET.Comment(xml_comment(arm.head(str))))
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(root, "option", gravity=numbers(world_gravity(robot)))
    # Why no body for the base: Pinocchio's reader loses the pose of a body without a joint.
    parent, drive = ET.SubElement(root, "worldbody"), _drive(found)
    radius, shapes = repr(cylinders_of(robot).radius), link_cylinders(robot)
    previous = base_pose(robot)
    for i, (joint, own_body) in enumerate(zip(robot.joints, found.full.bodies, strict=True)):
        before, to_dh = fixed_poses(joint, robot.convention)
        pose, body, previous = previous @ before, moved(own_body, to_dh), to_dh
        parent.append(ET.Comment(xml_comment(f"link {i + 1}: {found.full.origin_of_link(i + 1)}")))
        place = {"pos": numbers(pose[:3, 3]), "xyaxes": numbers(pose[:3, :2].T)}
        parent = ET.SubElement(parent, "body", {"name": f"link_{i + 1}", **place})
        xx, xy, xz, yy, yz, zz = body.inertia_com
        inertia = {"mass": repr(float(body.mass)), "fullinertia": numbers([xx, yy, zz, xy, xz, yz])}
        ET.SubElement(parent, "inertial", {"pos": numbers(body.com), **inertia})
        own = {DRIVE[kind]: repr(float(max(0.0, row[i]))) for kind, row in drive.items()}
        springs = [
            one.attributes for one in found.native if (one.effect, one.joint) == ("spring", i)
        ]
        ET.SubElement(parent, "joint", _joint(joint) | own | dict(*springs))
        ends = numbers(shapes[i] @ to_dh[:3, :3].T + to_dh[:3, 3])
        ET.SubElement(parent, "geom", {"type": "cylinder", "size": radius, "fromto": ends, **LOOK})
    motors = [one for one in found.native if one.effect != "spring"]
    actuators = ET.SubElement(root, "actuator") if motors else root
    for one in motors:
        joint_name = {"joint": xml(robot.joint_names[one.joint])}
        ET.SubElement(actuators, "dcmotor", joint_name | PASSIVE | dict(one.attributes))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _drive(found: Simulated) -> dict[str, Floats]:
    """Return rotor inertia and friction of all joints, (n,) each."""
    drive = {kind: found.full.of_joints(kind) for kind in DRIVE}
    for one in found.native:
        drive["fc"][one.joint] -= one.loss
    return drive


def _joint(joint: Joint) -> dict[str, str]:
    """Return the attributes of a joint without its drive."""
    limits, kind = joint.limits, "hinge" if joint.revolute else "slide"
    facts = {"name": xml(joint.name), "type": kind, "axis": "0 0 1"}
    if limits.position:
        facts["range"] = numbers(limits.position)
    if limits.torque:
        facts["actuatorfrcrange"] = numbers([-limits.torque, limits.torque])
    # Why so hard: MuJoCo's default lets light wrists slide as in oil, up to 0.3 rad/s.
    return {**facts, "solimpfriction": "0.999 0.999 0.001"}


def leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    """Return what an MJCF has no place for."""
    full, negative = simulated(arm).full, negative_numbers(arm)
    soft = "frictionloss has only its size and is a soft constraint"
    gone = {
        "torque offsets fo": any(full.of_joints("fo")),
        f"the smooth start of Coulomb friction: {soft}": any(full.of_joints("fc")),
        f"{', '.join(negative)}: negative, which MuJoCo refuses; written as zero": negative,
    }
    return (*filter(gone.get, gone), *beyond_joints(arm, mjcf=True))


def negative_numbers(arm: IdentifiedArm) -> list[str]:
    """Return the names of numbers that MuJoCo refuses, and that were written as zero."""
    drive = _drive(simulated(arm))
    return [f"{kind}{i + 1}" for kind, row in drive.items() for i in np.flatnonzero(row < 0)]


def loaded(path: Path, arm: IdentifiedArm) -> Loaded | None:
    """Load it in MuJoCo; None where numbers had to be written as zero, so that torques cannot agree."""
    names, here = tuple(map(xml, arm.robot.joint_names)), simulated(arm)
    found = mujoco(path.read_text(encoding="utf-8"), names, world_gravity(arm.robot))
    if found is None or negative_numbers(arm):
        return None
    # Why not bristles: they only bend along a simulation.
    held = {c.name: size for c, size, native in here.columns if native and "z" not in c.signals}
    said = {attribute for one in here.native for attribute in one.attributes}
    what = "rigid body, rotors, viscous friction"
    what += ", springs" * ("stiffness" in said) + ", waves" * ("cogging" in said)
    engine, torques = found
    return Loaded(engine, what, torques, own_torques(arm, numbers_of(arm, "Im", "fv") | held))


MJCF = Format("mjcf", ".xml", text, leaves_out, loaded)
