"""MJCF, the format of MuJoCo: it has a place for rotor inertia (armature) and joint friction."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.exporters.engines import mujoco, part, pinocchio
from dynid.exporters.full_model import joint_poses, moving_bodies, numbers, world_gravity
from dynid.exporters.interface import Format, IdentifiedArm, Loaded
from dynid.exporters.simulated import Simulated, simulated
from dynid.exporters.urdf import beyond_joints
from dynid.model.kinematics import fixed_poses
from dynid.model.parameters import cylinders_of, link_cylinders
from dynid.robot import Body, Joint
from dynid.text import xml, xml_comment

Floats = NDArray[np.float64]


def text(arm: IdentifiedArm) -> str:
    """Return the MJCF."""
    found, robot = simulated(arm), arm.robot
    full = found.full
    root = ET.Element("mujoco", model=xml(robot.slug))
    root.append(ET.Comment(xml_comment(arm.head(str))))
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    ET.SubElement(root, "option", gravity=numbers(world_gravity(robot)))
    world = ET.SubElement(root, "worldbody")
    # Why no body for the base: Pinocchio's reader loses the pose of a body without a joint.
    parent, poses, shapes = world, joint_poses(robot), link_cylinders(robot)
    fv, fc = full.joint_friction("fv"), full.joint_friction("fc")
    for each in found.bristles:
        fc[each.joint] -= each.size
    for i, (joint, body) in enumerate(
        zip(robot.joints, moving_bodies(robot, full.bodies), strict=True)
    ):
        parent.append(ET.Comment(xml_comment(f"link {i + 1}: {full.origin_of_link(i + 1)}")))
        parent = ET.SubElement(parent, "body", {"name": f"link_{i + 1}", **_place(poses[i])})
        _inertial(parent, body)
        drive = {
            "armature": full.rotor_inertia[i],
            "damping": float(fv[i]),
            "frictionloss": float(fc[i]),
        }
        _joint(parent, joint, found.springs.get(i), drive)
        _shape(
            parent, shapes[i], cylinders_of(robot).radius, fixed_poses(joint, robot.convention)[1]
        )
    _passive_motors(root, found, tuple(map(xml, robot.joint_names)))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    """Return what an MJCF has no place for."""
    full = simulated(arm).full
    gone = []
    if any(full.joint_friction("fo")):
        gone.append("torque offsets fo")
    if any(full.joint_friction("fc")):
        gone.append(
            "the smooth start of Coulomb friction: frictionloss has only its size and is a soft constraint"
        )
    negative = negative_numbers(arm)
    if negative:
        gone.append(f"{', '.join(negative)}: negative, which MuJoCo refuses; written as zero")
    return (*gone, *beyond_joints(arm, mjcf=True))


def loaded(path: Path, arm: IdentifiedArm) -> Iterator[Loaded]:
    """Load it in MuJoCo and Pinocchio."""
    names, gravity, model = (
        tuple(map(xml, arm.robot.joint_names)),
        world_gravity(arm.robot),
        arm.base.model,
    )
    here = simulated(arm)
    # Why: what is negative was written as zero, so that the torques cannot agree.
    found = mujoco(path, names, gravity)
    if found and not negative_numbers(arm):
        alone = part(model, here.full, rotors=True, viscous=True)
        what = "rigid body, rotors, viscous friction"
        what += ", springs" * bool(here.springs) + ", waves" * bool(here.waves)
        yield Loaded(found[0], what, found[1], lambda *s: alone(*s) + _elements(here, s[0]))
    found = pinocchio(path, names, gravity, mjcf=True)
    if found and not any(rotor < 0 for rotor in here.full.rotor_inertia):
        yield Loaded(found[0], "rigid body, rotors", found[1], part(model, here.full, rotors=True))


def _elements(here: Simulated, q: Floats) -> Floats:
    """Return the torques of springs and waves, (N, n) [N m or N]."""
    tau = np.zeros_like(q)
    for joint, (stiffness, slack) in here.springs.items():
        tau[:, joint] += sum(
            k * (q[:, joint] - slack) ** power for power, k in enumerate(stiffness, start=1)
        )
    for wave in here.waves:
        tau[:, wave.joint] -= wave.amplitude * np.sin(wave.poles * q[:, wave.joint] + wave.phase)
    return tau


def negative_numbers(arm: IdentifiedArm) -> list[str]:
    """Return the names of numbers that MuJoCo refuses."""
    return [name for name, value in _drive_numbers(arm) if value < 0]


def _drive_numbers(arm: IdentifiedArm) -> list[tuple[str, float]]:
    full = simulated(arm).full
    rows = {
        "Im": full.rotor_inertia,
        "fv": full.joint_friction("fv"),
        "fc": full.joint_friction("fc"),
    }
    return [
        (f"{prefix}{i}", float(value))
        for prefix, row in rows.items()
        for i, value in enumerate(row, start=1)
    ]


def _passive_motors(root: ET.Element, found: Simulated, names: tuple[str, ...]) -> None:
    """Add motors without an input: cogging, and friction of bristles."""
    if not (found.waves or found.bristles):
        return
    actuators = ET.SubElement(root, "actuator")
    # Why a resistance and a constant: MuJoCo asks for them; so small a one damps by 1e-18 N m s/rad.
    motor = {"input": "none", "resistance": "1", "motorconst": "1e-9"}
    for wave in found.waves:
        cogging = numbers([wave.amplitude, wave.poles, wave.phase])
        ET.SubElement(
            actuators, "dcmotor", {"joint": names[wave.joint], **motor, "cogging": cogging}
        )
    for each in found.bristles:
        lugre = numbers([each.size / each.length, 0.0, each.size, each.size, 1.0])
        ET.SubElement(actuators, "dcmotor", {"joint": names[each.joint], **motor, "lugre": lugre})


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


def _joint(
    parent: ET.Element, joint: Joint, spring: tuple[Floats, float] | None, drive: dict[str, float]
) -> None:
    limits = joint.limits
    facts = {
        "name": xml(joint.name),
        "type": "hinge" if joint.revolute else "slide",
        "axis": "0 0 1",
    }
    if limits.position:
        facts["range"] = numbers(limits.position)
    if limits.torque:
        facts["actuatorfrcrange"] = numbers([-limits.torque, limits.torque])
    if drive["frictionloss"] > 0.0:
        # Why so hard: MuJoCo's default lets light wrists slide as in oil, up to 0.3 rad/s.
        facts["solimpfriction"] = "0.999 0.999 0.001"
    if spring is not None:
        facts |= {"stiffness": numbers(spring[0]), "springref": repr(spring[1])}
    ET.SubElement(
        parent, "joint", facts | {key: repr(max(0.0, value)) for key, value in drive.items()}
    )


def _shape(parent: ET.Element, ends: Floats, radius: float, to_dh: Floats) -> None:
    """Add a cylinder for the eye; it has no mass and touches nothing."""
    placed = [to_dh[:3, :3] @ end + to_dh[:3, 3] for end in ends]
    look = {"mass": "0", "contype": "0", "conaffinity": "0", "group": "1", "rgba": "0.6 0.65 0.7 1"}
    shape = {"type": "cylinder", "size": repr(radius), "fromto": numbers(placed)}
    ET.SubElement(parent, "geom", shape | look)


MJCF = Format("mjcf", ".xml", text, leaves_out, loaded)
