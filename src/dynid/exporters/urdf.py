"""URDF: the user's own with its inertial blocks replaced, or one made from the DH table."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from dynid.exporters.engines import bare_urdf, in_mujoco
from dynid.exporters.interface import Format, IdentifiedArm, Loaded
from dynid.exporters.simulated import numbers_of, simulated
from dynid.exporters.user_urdf import rewritten
from dynid.model.attached import attached
from dynid.robot import JointMap, Robot
from dynid.sim.urdf import urdf_text
from dynid.text import printable, xml_comment


def text(arm: IdentifiedArm) -> str:
    """Return the URDF."""
    full, robot = simulated(arm).full, arm.robot
    head = f"{arm.head(str)}; {own_gravity(robot)}".rstrip("; ")
    if arm.urdf is not None:
        return rewritten(arm.urdf, robot, full, head)
    root = ET.fromstring(urdf_text(robot, full.bodies))
    friction = zip(full.of_joints("fv"), full.of_joints("fc"), strict=True)
    for joint, (fv, fc) in zip(root.findall("joint"), friction, strict=True):
        ET.SubElement(joint, "dynamics", damping=repr(float(fv)), friction=repr(float(fc)))
    for i, link in enumerate(root.findall("link")[1:], start=1):
        link.insert(0, ET.Comment(xml_comment(full.origin_of_link(i))))
    root.insert(0, ET.Comment(xml_comment(head)))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def own_gravity(robot: Robot) -> str:
    """Return that the gravity has to be set in a simulator; "" where it points along -z, as simulators take it."""
    x, y, z = robot.world_gravity
    text = f"gravity {x:.4g}, {y:.4g}, {z:.4g} m/s^2: set it in the simulator"
    return text if abs(x) + abs(y) >= -1e-3 * z else ""


def leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    """Return what a URDF has no place for."""
    Im, fv, fc, fo = (any(simulated(arm).full.of_joints(kind)) for kind in ("Im", "fv", "fc", "fo"))
    own, gravity = arm.urdf is not None, own_gravity(arm.robot)
    gone = {
        gravity: gravity,
        "rotor inertia: add it to the simulator (armature in MuJoCo, rotorInertia in Pinocchio)": Im,
        "torque offsets fo": fo,
        "friction: your file's <dynamics> stay as they are": own and (fv or fc),
        "the smooth start of Coulomb friction: <dynamics friction> has only its size": fc
        and not own,
    }
    return (*filter(gone.get, gone), *simulated(arm).left_out)


def loaded(text: str, arm: IdentifiedArm) -> Loaded | None:
    """Load the bodies in MuJoCo; None where they cannot exist, which it refuses and a URDF may hold.

    None also where MuJoCo refuses the user's own file, such as for what hangs on the arm.
    """
    if simulated(arm).full.impossible_links():
        return None
    names, mapping = joints_of(arm)
    try:
        return in_mujoco(bare_urdf(text), names, arm, "rigid body", numbers_of(arm), mapping)
    except ValueError:
        if arm.urdf is None:
            raise
        return None


def joints_of(arm: IdentifiedArm) -> tuple[tuple[str, ...], JointMap]:
    """Return names of the joints in the URDF, and how its joint values follow from the robot file's."""
    robot = arm.robot
    if arm.urdf is not None:
        place = attached(arm.urdf, robot)
        return tuple(map(printable, place.names)), place.mapping
    return tuple(map(printable, robot.joint_names)), JointMap((1.0,) * robot.n, (0.0,) * robot.n)


URDF = Format("urdf", ".urdf", text, leaves_out, loaded)
