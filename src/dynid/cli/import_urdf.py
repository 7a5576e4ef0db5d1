"""``dynid import arm.urdf``: a robot file from a URDF, checked by forward kinematics."""

from __future__ import annotations

from math import degrees
from pathlib import Path

import click

from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import INPUT, dynid_command, options_from
from dynid.cli.prompt import write_once
from dynid.cli.session import Session
from dynid.judgement.rules import Step
from dynid.table import Table
from dynid.text import shell
from dynid.workflows.options import ImportOptions


@dynid_command(
    "import",
    examples=(
        "dynid import ur5.urdf                                          writes out/ur5/ur5.yaml",
        "dynid import tiago.urdf --base torso_lift_link --tip arm_7_link    one arm of many",
        "dynid import panda.urdf --convention modified",
    ),
)
@click.argument("urdf", type=INPUT)
@options_from(ImportOptions)
def command(session: Session, urdf: Path, options: ImportOptions) -> Answer:
    """Make a robot file from a URDF: DH table, limits, inertias as prior."""
    imported = workflows.import_urdf.import_urdf(urdf, options)
    path, robot = session.folder(urdf.stem) / f"{urdf.stem}.yaml", imported.robot
    write_once(session, path, workflows.import_urdf.robot_file(imported, urdf))
    rows = [
        {"joint": joint.name, "type": joint.type}
        | {
            "a [m]": f"{joint.a:.6g}",
            "twist [deg]": f"{degrees(joint.twist):.6g}",
            "d [m]": f"{joint.d:.6g}",
            "theta offset [deg]": f"{degrees(joint.theta_offset):.6g}",
        }
        for joint in robot.joints
    ]
    chain = f"{robot.n} joints from {imported.base} to {imported.tip}, {robot.convention} DH"
    error = f"forward kinematics agree with the URDF to {imported.largest:.1e} m and rad"
    unknown = "a URDF does not say what the effort column of a log is; write `torque: {source: ...}` into the file"
    prior = []
    if robot.prior:
        masses = ", ".join(f"{body.mass:.3g}" for body in robot.prior.links)
        prior.append(("prior", f"masses {masses} kg, inertias moved into the DH frames"))
    return Answer(
        workflows.import_urdf.import_facts(imported, path),
        parts=(
            *imported.findings,
            ("robot", f"{robot.name}, {chain}"),
            Table(rows),
            ("check", error),
            ("torque", unknown),
            *prior,
        ),
        next=[Step("", shell("dynid", "check", path))],
    )
