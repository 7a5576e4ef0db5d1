"""``dynid convert LOG -o FILE``: a recording as .npz or .csv."""

from __future__ import annotations

from pathlib import Path

import click

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import FILE, PATH, dynid_command, options_from
from dynid.cli.session import Session
from dynid.errors import OutputExists, WrongUsage
from dynid.text import shell
from dynid.workflows.options import ConvertOptions


@dynid_command(
    "convert",
    examples=(
        "dynid convert recording/ -o run.csv                a folder of rosbag2 as a table",
        "dynid convert lab.csv --robot my_arm.yaml -o run.npz",
    ),
)
@click.argument("log", type=PATH)
@click.option(
    "--to",
    type=FILE,
    metavar="FILE",
    help="File to write: .npz or .csv; -o FILE is the same.",
)
@click.option(
    "--robot", metavar="ROBOT", help="The arm of the log, whose file names topic and columns."
)
@options_from(ConvertOptions)
def command(
    session: Session, log: Path, to: Path | None, robot: str | None, options: ConvertOptions
) -> Answer:
    """Write a recording as .npz or .csv; every number stays as it was recorded."""
    target = to or session.out
    if target is None:
        fix = shell("dynid", "convert", log, "-o", f"{log.stem}.npz")
        raise WrongUsage("no file to write is given", fix=fix)
    if target.exists() and not session.force:
        raise OutputExists(f"{target} exists", fix="--force, or another --to")
    arm = dynid.load_robot(robot) if robot else None
    return workflows.convert.convert(log, target, arm, options)
