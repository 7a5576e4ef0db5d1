"""MJCF, the format of MuJoCo: it has a place for rotor inertia (armature) and joint friction."""

from __future__ import annotations

import numpy as np

from dynid.exporters.code import rendered
from dynid.exporters.engines import mujoco, own_torques
from dynid.exporters.full_model import world_gravity
from dynid.exporters.interface import Floats, Format, IdentifiedArm, Loaded
from dynid.exporters.simulated import Simulated, numbers_of, simulated
from dynid.exporters.urdf import beyond_joints
from dynid.model.kinematics import base_pose, fixed_poses
from dynid.model.parameters import cylinders_of, link_cylinders, moved
from dynid.text import xml

#: What MuJoCo calls the numbers of a joint's drive.
DRIVE = {"Im": "armature", "fv": "damping", "fc": "frictionloss"}


def text(arm: IdentifiedArm) -> str:
    """Return the MJCF."""
    simulation, robot = simulated(arm), arm.robot
    # Why no body for the base: Pinocchio's reader loses the pose of a body without a joint.
    previous, links, drive, ends = base_pose(robot), [], _drive(simulation), link_cylinders(robot)
    for i, (joint, body) in enumerate(zip(robot.joints, simulation.full.bodies, strict=True)):
        before, to_dh = fixed_poses(joint, robot.convention)
        own = {DRIVE[kind]: repr(max(0.0, float(row[i]))) for kind, row in drive.items()}
        for one in simulation.native:
            if one.place == ("spring", i):
                own |= one.attributes
        links.append(
            {
                "joint": joint,
                "pos": (previous @ before)[:3, 3],
                "axes": (previous @ before)[:3, :2].T,
                "body": moved(body, to_dh),
                "ends": ends[i] @ to_dh[:3, :3].T + to_dh[:3, 3],
                "drive": own,
            }
        )
        previous = to_dh
    return rendered(
        "mjcf.xml",
        head=arm.head(str),
        robot=robot,
        full=simulation.full,
        gravity=world_gravity(robot),
        links=links,
        radius=cylinders_of(robot).radius,
        motors=[one for one in simulation.native if one.place[0] != "spring"],
    )


def _drive(simulation: Simulated) -> dict[str, Floats]:
    """Return rotor inertia and friction of all joints, (n,) each."""
    drive = {kind: simulation.full.of_joints(kind) for kind in DRIVE}
    for one in simulation.native:
        drive["fc"][one.place[1]] -= one.loss
    return drive


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


def loaded(text: str, arm: IdentifiedArm) -> Loaded | None:
    """Load it in MuJoCo; None where numbers had to be written as zero, so that torques cannot agree."""
    names, here = tuple(map(xml, arm.robot.joint_names)), simulated(arm)
    engine_and_torques = mujoco(text, names, world_gravity(arm.robot))
    if engine_and_torques is None or negative_numbers(arm):
        return None
    # Why not bristles: they only bend along a simulation.
    held = {c.name: size for c, size, native in here.columns if native and "z" not in c.signals}
    said = {attribute for one in here.native for attribute in one.attributes}
    what = "rigid body, rotors, viscous friction"
    what += ", springs" * ("stiffness" in said) + ", waves" * ("cogging" in said)
    engine, torques = engine_and_torques
    return Loaded(engine, what, torques, own_torques(arm, numbers_of(arm, "Im", "fv") | held))


MJCF = Format("mjcf", ".xml", text, leaves_out, loaded)
