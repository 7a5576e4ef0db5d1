"""URDF: the user's own with its inertial blocks replaced, or one made from the DH table."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from dynid.exporters.engines import bullet, mapped, pinocchio
from dynid.exporters.frames import world_gravity
from dynid.exporters.interface import Exporter, Source, Torques
from dynid.exporters.torques import RIGID, part
from dynid.exporters.user_urdf import attached, rewritten
from dynid.robot import JointMap
from dynid.sim.urdf import urdf_text


class UrdfExporter(Exporter):
    """The format of ROS, PyBullet, Pinocchio and Drake."""

    suffix = ".urdf"
    help = "ROS, PyBullet, Pinocchio, Drake; with --urdf your own file with new inertial blocks"

    def text(self, source: Source) -> str:
        """Return the URDF."""
        full, robot = source.full, source.full.robot
        if source.urdf is not None:
            return rewritten(source.urdf, source)
        root = ET.fromstring(urdf_text(robot, full.bodies))
        joints = {joint.get("name"): joint for joint in root.findall("joint")}
        fv, fc = full.joint_friction("fv"), full.joint_friction("fc")
        for j, joint in enumerate(robot.joints):
            ET.SubElement(joints[joint.name], "dynamics", damping=repr(float(fv[j])), friction=repr(float(fc[j])))
        for i, link in enumerate(root.findall("link")):
            if i:
                link.insert(0, ET.Comment(f" {full.origin_of_link(i)} "))
        root.insert(0, ET.Comment(f" {source.made_from.replace('--', '- -')} "))
        ET.indent(root)
        return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"

    def leaves_out(self, source: Source) -> tuple[str, ...]:
        """Return what a URDF has no place for."""
        full = source.full
        gone = []
        if any(full.rotor_inertia):
            gone.append("rotor inertia: add it to the simulator (armature in MuJoCo, rotorInertia in Pinocchio)")
        if any(full.joint_friction("fo")):
            gone.append("torque offsets fo")
        if source.urdf is not None and (any(full.joint_friction("fv")) or any(full.joint_friction("fc"))):
            gone.append("friction: your file's <dynamics> stay as they are")
        elif any(full.joint_friction("fc")):
            gone.append("the smooth start of Coulomb friction: <dynamics friction> has only its size")
        return (*gone, *beyond_joints(source))

    def loaded(self, path: Path, source: Source) -> Iterator[tuple[str, str, Torques, Torques]]:
        """Load it in Pinocchio and PyBullet; rigid body only, they leave the rest out of inverse dynamics."""
        robot = source.full.robot
        names, mapping = robot.joint_names, JointMap((1.0,) * robot.n, (0.0,) * robot.n)
        if source.urdf is not None:
            place = attached(source.urdf, robot)
            names, mapping = place.names, place.mapping
        ours = part(source.base.model, source.full, RIGID)
        for engine in (pinocchio, bullet):
            found = engine(path, names, world_gravity(robot))
            if found:
                yield found[0], "rigid body", mapped(found[1], mapping), ours


def beyond_joints(source: Source) -> tuple[str, ...]:
    """Return what no simulator format holds: coupled motors and effects of the catalogue."""
    gone = [f"coupled motors' {name}" for name in source.full.friction if name[:3] in ("Imc", "fvc", "fcc")]
    gone += [f"effect {effect.effect} on {', '.join(effect.joints)}" for effect in source.full.robot.effects]
    return tuple(gone)
