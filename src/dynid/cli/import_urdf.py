"""``dynid import arm.urdf``: a robot file from a URDF, checked by forward kinematics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import INPUT, dynid_command, options_from
from dynid.cli.prompt import write_once
from dynid.cli.session import Session
from dynid.judgement.rules import Step
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
    text, answer = workflows.import_urdf.import_urdf(urdf, options)
    path = session.folder(urdf.stem) / f"{urdf.stem}.yaml"
    write_once(session, path, text)
    facts = {**answer.facts, "wrote": [path]}
    return replace(answer, facts=facts, next=[Step("", shell("dynid", "check", path))])
