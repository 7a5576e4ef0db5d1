"""MJCF, the format of MuJoCo: it has a place for rotor inertia (armature) and joint friction."""

from __future__ import annotations

import numpy as np

from dynid.exporters.code import rendered
from dynid.exporters.engines import in_mujoco
from dynid.exporters.interface import Format, IdentifiedArm, Loaded
from dynid.exporters.simulated import numbers_of, simulated
from dynid.model.kinematics import base_pose, fixed_poses
from dynid.model.parameters import cylinders_of, link_cylinders, moved
from dynid.text import printable

#: What MuJoCo calls the numbers of a joint's drive.
DRIVE = {"Im": "armature", "fv": "damping", "fc": "frictionloss"}


def text(arm: IdentifiedArm) -> str:
    """Return the MJCF."""
    simulation, robot = simulated(arm), arm.robot
    # Why no body for the base: Pinocchio's reader loses the pose of a body without a joint.
    previous, links, ends = base_pose(robot), [], link_cylinders(robot)
    drive = {name: simulation.full.of_joints(kind) for kind, name in DRIVE.items()}
    for i, (joint, body) in enumerate(zip(robot.joints, simulation.full.bodies, strict=True)):
        before, to_dh = fixed_poses(joint, robot.convention)
        frame = previous @ before
        links.append(
            {
                "joint": joint,
                "pos": frame[:3, 3],
                "axes": frame[:3, :2].T,
                "body": moved(body, to_dh),
                "ends": ends[i] @ to_dh[:3, :3].T + to_dh[:3, 3],
                "drive": {name: repr(max(0.0, float(row[i]))) for name, row in drive.items()},
            }
        )
        previous = to_dh
    return rendered(
        "mjcf.xml",
        head=arm.head(str),
        robot=robot,
        full=simulation.full,
        gravity=robot.world_gravity,
        links=links,
        radius=cylinders_of(robot).radius,
    )


def leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    """Return what an MJCF has no place for."""
    full, negative = simulated(arm).full, negative_numbers(arm)
    soft = "frictionloss has only its size and is a soft constraint"
    gone = {
        "torque offsets fo": any(full.of_joints("fo")),
        f"the smooth start of Coulomb friction: {soft}": any(full.of_joints("fc")),
        f"{', '.join(negative)}: negative, which MuJoCo refuses; written as zero": negative,
    }
    return (*filter(gone.get, gone), *simulated(arm).left_out)


def negative_numbers(arm: IdentifiedArm) -> list[str]:
    """Return the names of numbers that MuJoCo refuses, and that were written as zero."""
    full = simulated(arm).full
    return [f"{kind}{i + 1}" for kind in DRIVE for i in np.flatnonzero(full.of_joints(kind) < 0)]


def loaded(text: str, arm: IdentifiedArm) -> Loaded | None:
    """Load it in MuJoCo; None where numbers had to be written as zero, so that torques cannot agree."""
    if negative_numbers(arm):
        return None
    names = tuple(map(printable, arm.robot.joint_names))
    what = "rigid body, rotors, viscous friction"
    return in_mujoco(text, names, arm, what, numbers_of(arm, "Im", "fv"))


MJCF = Format("mjcf", ".xml", text, leaves_out, loaded)
