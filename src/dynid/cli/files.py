"""Commands on files of others: check, convert, import."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import FILE, INPUT, PATH, dynid_command, options_from
from dynid.cli.prompt import input_hashes, may_write, write_once
from dynid.cli.session import Session
from dynid.errors import WrongUsage
from dynid.judgement.rules import Step
from dynid.options import LogOptions
from dynid.text import shell
from dynid.workflows.options import ImportOptions

if TYPE_CHECKING:
    from dynid.workflows.files import Checked


#: Options of reading logs that a check does not need: nothing is filtered.
FILTERING = ("cutoff", "velocity", "delay")


@dynid_command(
    "check",
    examples=(
        "dynid check my_arm.yaml                           a robot file",
        "dynid check log.bag --robot my_arm.yaml           a log of that arm",
        "dynid check log.bag --robot my_arm --convert      the same, and write out/my_arm/log.npz",
        "dynid check out/my_arm/parameters.npz             the header of a result",
    ),
)
@click.argument("paths", metavar="PATH...", nargs=-1, required=True)
@click.option(
    "--robot",
    metavar="ROBOT",
    help="The arm of the logs; by default the robot file among the paths.",
)
@options_from(LogOptions, without=FILTERING)
@click.option("--convert", is_flag=True, help="Write log.npz: all columns as they were recorded.")
@click.option(
    "--fix", is_flag=True, help="Write log.npz after the repairs that lose nothing, and list them."
)
@click.option("--strict", is_flag=True, help="Exit with 1 when there are warnings.")
def check_command(
    session: Session,
    paths: Sequence[str],
    robot: str | None,
    options: LogOptions,
    convert: bool,
    fix: bool,
    strict: bool,
) -> Answer:
    """Look for mistakes in robot files, logs and results."""
    arm = dynid.load_robot(robot) if robot else None
    checks = workflows.files.check(paths, arm, options)
    chosen = {**asdict(options), "convert": convert, "fix": fix}
    wrote = [written(session, each, chosen) if convert or fix else [] for each in checks]
    return workflows.files.checks_answer(checks, wrote, strict=strict)


def written(session: Session, checked: Checked, chosen: dict[str, object]) -> list[Path]:
    """Write log.npz of a log where that is not done yet."""
    log = checked.log if chosen["fix"] else checked.raw
    if log is None or checked.robot is None:
        return []
    target = session.folder(checked.robot.slug) / "log.npz"
    inputs = input_hashes({"log": Path(checked.path)}, chosen)
    if not may_write(session, target, inputs):
        return []
    return [log.save(target, session.header(inputs))]


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
@options_from(LogOptions, without=(*FILTERING, "exclude", "anyway", "sort_time"))
def convert_command(
    session: Session, log: Path, to: Path | None, robot: str | None, options: LogOptions
) -> Answer:
    """Write a recording as .npz or .csv; every number stays as it was recorded."""
    target = to or session.out
    if target is None:
        fix = shell("dynid", "convert", log, "-o", f"{log.stem}.npz")
        raise WrongUsage("no file to write is given", fix=fix)
    may_write(session, target, other="another --to")
    arm = dynid.load_robot(robot) if robot else None
    return workflows.files.convert(log, target, arm, options)


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
def import_command(session: Session, urdf: Path, options: ImportOptions) -> Answer:
    """Make a robot file from a URDF: DH table, limits, inertias as prior."""
    text, answer = workflows.files.import_urdf(urdf, options)
    path = session.folder(urdf.stem) / f"{urdf.stem}.yaml"
    write_once(session, path, text)
    facts = {**answer.facts, "wrote": [path]}
    return replace(answer, facts=facts, next=[Step("", shell("dynid", "check", path))])
