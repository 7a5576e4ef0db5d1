"""A robot file from a URDF: DH table, limits and bodies, checked by forward kinematics."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from dynid.answer import picked
from dynid.files.robotfile import robot_text
from dynid.files.urdffile import read_urdf
from dynid.model.from_urdf import Imported, import_arm
from dynid.robot import roll_pitch_yaw
from dynid.workflows.options import ImportOptions


def import_urdf(path: Path, options: ImportOptions = ImportOptions()) -> Imported:
    """Return the robot that a chain of a URDF describes, with what is worth knowing about it.

    Args:
        path: the URDF.
        options: which chain.

    Raises:
        WrongUrdf: there is no such chain, or it has joints that a DH table cannot describe.
    """
    return import_arm(
        read_urdf(path),
        read_urdf(path, exact=True),
        base=options.base,
        tip=options.tip,
        convention=options.convention,
        name=options.name,
    )


def robot_file(imported: Imported, urdf: Path) -> str:
    """Return the text of the robot file; its first lines say where it comes from and where the tip lies."""
    xyz, rpy = _tip(imported)
    head = (
        f"Made by dynid import from {urdf.name}, link {imported.base} to {imported.tip}; joint values are the URDF's.\n"
        f"The frame of {imported.tip} in the last DH frame: xyz {xyz}, rpy {rpy} [m, rad].\n"
        f"Forward kinematics agree with the URDF to {imported.largest:.1e} m and rad.\n"
        "What the effort column of your logs is, a URDF does not say. Write one of these:\n"
        "torque: {source: joint_sensor}     sensors behind the gears, as on KUKA LWR and iiwa, Franka\n"
        "torque: {source: motor_torque}     from the motors' currents, in N m, as on UR and most industrial arms\n"
        "torque: {source: motor_current}    in A, or in a unit that nobody knows (then with relative: true)"
    )
    return robot_text(imported.robot, head)


def import_facts(imported: Imported, wrote: Path) -> dict[str, Any]:
    """Return what the JSON answer of ``dynid import`` says."""
    xyz, rpy = _tip(imported)
    robot = imported.robot
    lengths = {"a_m": "a", "twist_rad": "twist", "d_m": "d", "theta_offset_rad": "theta_offset"}
    return {
        "schema": "dynid/import/1",
        **picked(robot, "convention", robot="name", n_joints="n"),
        **picked(imported, "base", "tip", kinematics_largest_difference="largest"),
        "joints": [picked(joint, "type", joint="name", **lengths) for joint in robot.joints],
        "tip_in_last_frame": {"xyz_m": xyz, "rpy_rad": rpy},
        "mass_kg": sum(body.mass for body in robot.prior.links) if robot.prior else None,
        "findings": [asdict(finding) for finding in imported.findings],
        "wrote": [wrote],
    }


def _tip(imported: Imported) -> tuple[list[float], list[float]]:
    """Return position [m] and roll, pitch, yaw [rad] of the tip in the last DH frame, rounding noise taken off."""
    pose = imported.tip_pose
    rows = (pose[:3, 3].tolist(), roll_pitch_yaw(pose[:3, :3]))
    xyz, rpy = ([round(float(value), 12) + 0.0 for value in row] for row in rows)
    return xyz, rpy
