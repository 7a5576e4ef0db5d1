"""``dynid import arm.urdf``: a robot file from a URDF, checked by forward kinematics."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.options import Common, dynid_command
from dynid.errors import ExitStatus

if TYPE_CHECKING:
    from dynid.model.from_urdf import Imported


@dynid_command(
    "import",
    examples=(
        "dynid import ur5.urdf                                          writes out/ur5/ur5.yaml",
        "dynid import tiago.urdf --base torso_lift_link --tip arm_7_link    one arm of many",
        "dynid import panda.urdf --convention modified",
    ),
)
@click.argument("urdf", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--base", metavar="LINK", help="First link of the arm (default: the root).")
@click.option("--tip", metavar="LINK", help="Last link of the arm (default: where the chain ends or forks).")
@click.option(
    "--convention",
    type=click.Choice(["standard", "modified"]),
    default="standard",
    show_default=True,
    help="DH convention.",
)
@click.option("--name", metavar="NAME", help="Name of the robot (default: the URDF's).")
def command(common: Common, urdf: Path, **options: Any) -> ExitStatus:  # noqa: ANN401
    """Make a robot file from a URDF: DH table, limits, inertias as prior."""
    from dynid.cli.prompt import may_write
    from dynid.files.artifact import write_text
    from dynid.files.robotfile import robot_text
    from dynid.files.urdffile import read_urdf
    from dynid.model.from_urdf import import_arm

    found = import_arm(read_urdf(urdf), read_urdf(urdf, exact=True), **options)
    common.terminal.findings(found.findings)
    path = common.folder(urdf.stem) / f"{urdf.stem}.yaml"
    text = robot_text(found.robot, head(found, urdf))
    if path.is_file() and path.read_bytes() == text.encode() and not common.force:
        common.terminal.stage("reused", f"{path}       (the same bytes)")
    elif may_write(common, path, {}):
        write_text(path, text)
        common.terminal.wrote(path)
    common.terminal.emit_json(answer(found, path))
    show(common, found)
    common.terminal.next(f"dynid check {path}")
    return ExitStatus.DONE


def head(found: Imported, urdf: Path) -> str:
    """Return the first lines of the robot file: where it comes from and where the tip lies."""
    xyz, rpy = tip(found)
    return (
        f"Made by dynid import from {urdf.name}, link {found.base} to {found.tip}; joint values are the URDF's.\n"
        f"The frame of {found.tip} in the last DH frame: xyz {xyz}, rpy {rpy} [m, rad].\n"
        f"Forward kinematics agree with the URDF to {found.largest:.1e} m and rad."
    )


def tip(found: Imported) -> tuple[list[float], list[float]]:
    """Return position and roll, pitch, yaw of the tip in the last DH frame, rounding noise taken off."""
    from dynid.robot import roll_pitch_yaw

    pose = found.tip_pose
    rows = (pose[:3, 3].tolist(), roll_pitch_yaw(pose[:3, :3]))
    xyz, rpy = ([round(float(value), 12) + 0.0 for value in row] for row in rows)
    return xyz, rpy


def answer(found: Imported, path: Path) -> dict[str, Any]:
    """Return the JSON answer."""
    xyz, rpy = tip(found)
    robot = found.robot
    joints = [
        {
            "joint": j.name,
            "type": j.type,
            "a_m": j.a,
            "twist_rad": j.twist,
            "d_m": j.d,
            "theta_offset_rad": j.theta_offset,
        }
        for j in robot.joints
    ]
    return {
        "schema": "dynid/import/1",
        "robot": robot.name,
        "n_joints": robot.n,
        "convention": robot.convention,
        "base": found.base,
        "tip": found.tip,
        "joints": joints,
        "tip_in_last_frame": {"xyz_m": xyz, "rpy_rad": rpy},
        "kinematics_largest_difference": found.largest,
        "mass_kg": sum(body.mass for body in robot.prior.links) if robot.prior else None,
        "findings": [asdict(finding) for finding in found.findings],
        "wrote": [path],
    }


def show(common: Common, found: Imported) -> None:
    """Print the table."""
    from math import degrees

    robot = found.robot
    rows = [
        [j.name, j.type, f"{j.a:.6g}", f"{degrees(j.twist):.6g}", f"{j.d:.6g}", f"{degrees(j.theta_offset):.6g}"]
        for j in robot.joints
    ]
    common.terminal.fact(
        "robot", f"{robot.name}, {robot.n} joints from {found.base} to {found.tip}, {robot.convention} DH"
    )
    common.terminal.table(["joint", "type", "a [m]", "twist [deg]", "d [m]", "theta offset [deg]"], rows)
    common.terminal.fact("check", f"forward kinematics agree with the URDF to {found.largest:.1e} m and rad")
    if robot.prior:
        masses = ", ".join(f"{body.mass:.3g}" for body in robot.prior.links)
        common.terminal.fact("prior", f"masses {masses} kg, inertias moved into the DH frames")
