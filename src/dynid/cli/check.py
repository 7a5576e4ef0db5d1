"""``dynid check PATH...``: look for mistakes in robot files, results and logs before anything is built on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.cli.arguments import ROBOT, options_from, options_of
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import input_hashes, may_write
from dynid.errors import ExitStatus
from dynid.options import LogOptions
from dynid.text import shell

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
    type=ROBOT,
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
    common: Common,
    paths: Sequence[str],
    robot: str | None,
    convert: bool,
    fix: bool,
    strict: bool,
    **values: Any,  # noqa: ANN401
) -> ExitStatus:
    """Look for mistakes in robot files, logs and results."""
    options = options_of(LogOptions, values)
    found = workflows.check.check(paths, dynid.load_robot(robot) if robot else None, options)
    chosen = {**{name: values[name] for name in sorted(values)}, "convert": convert, "fix": fix}
    wrote = [_written(common, each, chosen, fix) if convert or fix else () for each in found]
    return _show(common, found, wrote, strict)


#: What a file lacks, by the warning that tells it.
_MISSING = {
    "W330": "usable once `driver: columns:` names the columns",
    "W333": "not usable: no joint states",
}


def _written(
    common: Common, checked: Checked, chosen: dict[str, Any], fix: bool
) -> tuple[Path, ...]:
    """Write log.npz of a log where that is not done yet."""
    log = checked.log if fix else checked.raw
    if log is None or checked.robot is None:
        return ()
    target = common.folder(checked.robot.slug) / "log.npz"
    inputs = input_hashes({"log": Path(checked.path)}, chosen)
    if not may_write(common, target, inputs):
        return ()
    return (log.save(target, common.header(inputs)),)


def _show(
    common: Common, found: Sequence[Checked], wrote: Sequence[tuple[Path, ...]], strict: bool
) -> ExitStatus:
    terminal = common.terminal
    warnings = sum(checked.warnings for checked in found)
    missing = [
        _MISSING[finding.code]
        for one in found
        for finding in one.findings
        if finding.code in _MISSING
    ]
    terminal.answer(_answer(found, warnings, missing), style="bold", indent=2)
    for i, (checked, paths) in enumerate(zip(found, wrote, strict=True)):
        if i:
            terminal.answer()
        for label, text in checked.description:
            terminal.fact(label, text)
        terminal.findings(checked.findings)
        terminal.wrote(*paths)
    verdict = missing[0] if missing else "usable"
    terminal.fact(
        "verdict",
        verdict + (f", {warnings} warning{'s' if warnings > 1 else ''}" if warnings else ""),
    )
    terminal.emit_json(
        {
            "schema": "dynid/check/1",
            "checked": [
                {**one.answer(), "wrote": list(paths)}
                for one, paths in zip(found, wrote, strict=True)
            ],
            "findings": [asdict(finding) for checked in found for finding in checked.findings],
            "warnings": warnings,
            "usable": not missing,
            "wrote": [path for paths in wrote for path in paths],
        }
    )
    if step := _next(found, missing):
        terminal.next(*step)
    return ExitStatus.LIMIT_NOT_MET if strict and warnings else ExitStatus.DONE


def _answer(found: Sequence[Checked], warnings: int, missing: Sequence[str]) -> str:
    """Return whether the files can be used, in one sentence."""
    names = [Path(each.path).name for each in found]
    what = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    if missing:
        return f"{what}: {missing[0]}."
    if any(each.kind == "log" and each.robot is None for each in found):
        return f"{what} can be read; only a robot file tells whether the numbers are right."
    but = f", but see the warning{'s' * (warnings > 1)}" if warnings else ": no mistake was found"
    return f"{what} can be used{but}."


def _next(found: Sequence[Checked], missing: Sequence[str]) -> tuple[str, str] | None:
    """Return the next command and why; None where the files do not say."""
    logs = [each for each in found if each.kind == "log"]
    if missing:
        return None
    if logs and logs[0].robot is None:
        command = f"{shell('dynid', 'check', *(each.path for each in logs))} --robot ROBOT"
        return (
            command,
            "ROBOT is a robot file; the block above is the part of it that reads this recording.",
        )
    if logs and logs[0].robot is not None:
        command = shell("dynid", "identify", logs[0].robot.word, *(each.path for each in logs))
        return command, "Identify the arm from it." if len(
            logs
        ) == 1 else "Identify the arm from them."
    robots = [each.robot for each in found if each.robot is not None]
    if robots:
        return shell(
            "dynid", "model", robots[0].word
        ), "Find out which parameters of the arm torques show."
    return None
