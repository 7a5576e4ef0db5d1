"""URDF: the user's own with its inertial blocks replaced, or one made from the DH table."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from dynid.exporters.engines import bullet, mapped, part, pinocchio
from dynid.exporters.full_model import world_gravity
from dynid.exporters.interface import Format, IdentifiedArm, Loaded
from dynid.exporters.simulated import simulated
from dynid.exporters.user_urdf import attached, rewritten
from dynid.robot import JointMap
from dynid.sim.urdf import urdf_text
from dynid.text import xml, xml_comment


def text(arm: IdentifiedArm) -> str:
    """Return the URDF."""
    full, robot = simulated(arm).full, arm.robot
    if arm.urdf is not None:
        return rewritten(arm.urdf, arm, full)
    root = ET.fromstring(urdf_text(robot, full.bodies))
    friction = zip(full.joint_friction("fv"), full.joint_friction("fc"), strict=True)
    for joint, (fv, fc) in zip(root.findall("joint"), friction, strict=True):
        ET.SubElement(joint, "dynamics", damping=repr(float(fv)), friction=repr(float(fc)))
    for i, link in enumerate(root.findall("link")):
        if i:
            link.insert(0, ET.Comment(xml_comment(full.origin_of_link(i))))
    root.insert(0, ET.Comment(xml_comment(arm.head(str))))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    """Return what a URDF has no place for."""
    full = simulated(arm).full
    gone = []
    if any(full.rotor_inertia):
        gone.append(
            "rotor inertia: add it to the simulator (armature in MuJoCo, rotorInertia in Pinocchio)"
        )
    if any(full.joint_friction("fo")):
        gone.append("torque offsets fo")
    if arm.urdf is not None and (any(full.joint_friction("fv")) or any(full.joint_friction("fc"))):
        gone.append("friction: your file's <dynamics> stay as they are")
    elif any(full.joint_friction("fc")):
        gone.append("the smooth start of Coulomb friction: <dynamics friction> has only its size")
    return (*gone, *beyond_joints(arm))


def loaded(path: Path, arm: IdentifiedArm) -> Iterator[Loaded]:
    """Load it in Pinocchio and PyBullet; rigid body only, they leave the rest out of inverse dynamics."""
    robot = arm.robot
    names, mapping = (
        tuple(map(xml, robot.joint_names)),
        JointMap((1.0,) * robot.n, (0.0,) * robot.n),
    )
    if arm.urdf is not None:
        place = attached(arm.urdf, robot)
        names, mapping = place.names, place.mapping
    ours = part(arm.base.model, simulated(arm).full)
    for engine in (pinocchio, bullet):
        found = engine(path, names, world_gravity(robot))
        if found:
            yield Loaded(found[0], "rigid body", mapped(found[1], mapping), ours)


def beyond_joints(arm: IdentifiedArm, *, mjcf: bool = False) -> tuple[str, ...]:
    """Return what a simulator's format does not hold: coupled motors and effects of the catalogue."""
    found, names = simulated(arm), arm.robot.joint_names
    beside = [f"effect {phrase}" for phrase in found.effects_beside(mjcf=mjcf, names=names)]
    return (*coupled_left_out(arm), *beside, *found.left, *residual_left_out(arm))


def coupled_left_out(arm: IdentifiedArm) -> tuple[str, ...]:
    """Return the parameters of motors that drive several joints, for which no simulator has a place."""
    return tuple(
        f"coupled motors' {name}" for name in arm.full.friction if name[:3] in ("Imc", "fvc", "fcc")
    )


def residual_left_out(arm: IdentifiedArm) -> tuple[str, ...]:
    """Return the residual model where the result has one."""
    return (
        ()
        if arm.model_error is None
        else ("the residual model: the file predicts by the parameters alone",)
    )


URDF = Format("urdf", ".urdf", text, leaves_out, loaded)
