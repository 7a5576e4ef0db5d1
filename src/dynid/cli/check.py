"""``dynid check PATH...``: look for mistakes in robot files, results and logs before anything is built on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

import dynid
from dynid import workflows
from dynid.answer import Answer, Part
from dynid.cli.options import ROBOTS, dynid_command, options_from
from dynid.cli.prompt import input_hashes, may_write
from dynid.cli.session import Session
from dynid.judgement.rules import Step
from dynid.options import LogOptions
from dynid.text import shell

if TYPE_CHECKING:
    from dynid.workflows.check import Checked

#: Options of reading logs that a check does not need: nothing is filtered.
FILTERING = ("cutoff", "velocity", "delay")
#: What a file lacks, by the warning that tells it.
MISSING = {
    "W330": "usable once `driver: columns:` names the columns",
    "W333": "not usable: no joint states",
}


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
    checks = workflows.check.check(paths, dynid.load_robot(robot) if robot else None, options)
    chosen = {**asdict(options), "convert": convert, "fix": fix}
    wrote = [written(session, each, chosen) if convert or fix else [] for each in checks]
    findings = [finding for each in checks for finding in each.findings]
    missing = [MISSING[each.code] for each in findings if each.code in MISSING]
    warnings = sum(each.warnings for each in checks)
    parts = list[Part]()
    for each in checks:
        parts += [*[""] * bool(parts), *each.description, *each.findings]
    count = f", {warnings} warning{'s' * (warnings > 1)}" if warnings else ""
    parts.append(("verdict", f"{missing[0] if missing else 'usable'}{count}"))
    checked = [
        {**each.all_facts(), "wrote": files} for each, files in zip(checks, wrote, strict=True)
    ]
    facts = {
        "schema": "dynid/check/1",
        "checked": checked,
        "findings": [asdict(each) for each in findings],
        "warnings": warnings,
        "usable": not missing,
    }
    return Answer(
        facts,
        sentence(checks, warnings, missing),
        parts,
        wrote=[path for files in wrote for path in files],
        next=[] if missing else steps(checks),
        status=strict and warnings > 0,
    )


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


def sentence(checks: Sequence[Checked], warnings: int, missing: Sequence[str]) -> str:
    """Return whether the files can be used, in one sentence."""
    *names, what = (Path(each.path).name for each in checks)
    what = f"{', '.join(names)} and {what}" if names else what
    if missing:
        return f"{what}: {missing[0]}."
    if any(each.kind == "log" and each.robot is None for each in checks):
        return f"{what} can be read; checking the numbers needs a robot file."
    but = f", but see the warning{'s' * (warnings > 1)}" if warnings else ": no mistake was found"
    return f"{what} can be used{but}."


def steps(checks: Sequence[Checked]) -> list[Step]:
    """Return the next command and why, where the files tell it."""
    robot = next((each.robot for each in checks if each.robot is not None), None)
    logs = [each.path for each in checks if each.kind == "log"]
    if logs and robot is None:
        why = "ROBOT is a robot file; the block above is the part of it that reads this recording."
        return [Step(why, f"{shell('dynid', 'check', *logs)} --robot ROBOT")]
    if robot is not None and logs:
        why = f"Identify the arm from {'it' if len(logs) == 1 else 'them'}."
        return [Step(why, f"dynid identify {robot.word} {shell(*logs)}")]
    if robot is not None:
        why = "Find out which parameters of the arm are identifiable."
        return [Step(why, f"dynid model {robot.word}")]
    return []
