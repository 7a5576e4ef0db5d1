"""``dynid import arm.urdf``: a robot file from a URDF, checked by forward kinematics."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid import workflows
from dynid.cli.arguments import options_from, options_of
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import write_once
from dynid.errors import ExitStatus
from dynid.text import shell
from dynid.workflows.options import ImportOptions

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
@options_from(ImportOptions)
def command(common: Common, urdf: Path, **values: Any) -> ExitStatus:  # noqa: ANN401
    """Make a robot file from a URDF: DH table, limits, inertias as prior."""
    found = workflows.import_urdf.import_urdf(urdf, options_of(ImportOptions, values))
    common.terminal.findings(found.findings)
    path = common.folder(urdf.stem) / f"{urdf.stem}.yaml"
    write_once(common, path, workflows.import_urdf.robot_file(found, urdf))
    common.terminal.emit_json(workflows.import_urdf.import_facts(found, path))
    show(common, found)
    common.terminal.next(shell("dynid", "check", path))
    return ExitStatus.DONE


def show(common: Common, found: Imported) -> None:
    """Print the table."""
    robot = found.robot
    rows = [
        [
            j.name,
            j.type,
            f"{j.a:.6g}",
            f"{degrees(j.twist):.6g}",
            f"{j.d:.6g}",
            f"{degrees(j.theta_offset):.6g}",
        ]
        for j in robot.joints
    ]
    common.terminal.fact(
        "robot",
        f"{robot.name}, {robot.n} joints from {found.base} to {found.tip}, {robot.convention} DH",
    )
    common.terminal.table(
        ["joint", "type", "a [m]", "twist [deg]", "d [m]", "theta offset [deg]"], rows
    )
    common.terminal.fact(
        "check", f"forward kinematics agree with the URDF to {found.largest:.1e} m and rad"
    )
    unknown = "a URDF does not say what the effort column of a log is; write `torque: {source: ...}` into the file"
    common.terminal.fact("torque", unknown)
    if robot.prior:
        masses = ", ".join(f"{body.mass:.3g}" for body in robot.prior.links)
        common.terminal.fact("prior", f"masses {masses} kg, inertias moved into the DH frames")
