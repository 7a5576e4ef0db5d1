"""``dynid check PATH...``: look for mistakes in robot files, results and logs before anything is built on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import ROBOTS, dynid_command, options_from
from dynid.cli.prompt import input_hashes, may_write
from dynid.cli.session import Session
from dynid.options import LogOptions

if TYPE_CHECKING:
    from dynid.workflows.check import Checked

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
    shell_complete=ROBOTS,
    metavar="ROBOT",
    help="The arm of the logs; by default the robot file among the paths.",
)
@options_from(LogOptions, without=FILTERING)
@click.option("--convert", is_flag=True, help="Write log.npz: all columns as they were recorded.")
@click.option(
    "--fix", is_flag=True, help="Write log.npz after the repairs that lose nothing, and list them."
)
@click.option("--strict", is_flag=True, help="Exit with 1 when there are warnings.")
def command(
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
    checks = workflows.check.check(paths, arm, options)
    chosen = {**asdict(options), "convert": convert, "fix": fix}
    wrote = [written(session, each, chosen) if convert or fix else [] for each in checks]
    return workflows.check.checks_answer(checks, wrote, strict=strict)


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
