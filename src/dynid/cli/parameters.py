"""``dynid parameters ROBOT LOG...``: the regressor on a log, before anything is identified."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.cli.arguments import options_from, options_of, robot_argument
from dynid.cli.identify import run_identify
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import Answer, ask, may_write
from dynid.cli.runfile import write_run
from dynid.options import LogOptions
from dynid.text import shell

if TYPE_CHECKING:
    from dynid.robot import Robot
    from dynid.workflows.parameters import Observations


@dynid_command(
    "parameters",
    repeatable=True,
    examples=(
        "dynid parameters kuka_lwr4plus run.bag             stack, ask, identify",
        "dynid parameters kuka_lwr4plus a.bag b.bag --cutoff 8",
    ),
)
@robot_argument
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="LOG...")
@options_from(LogOptions)
@click.option(
    "--identify/--no-identify",
    "identify_now",
    default=None,
    help="Identify afterwards without asking.",
)
def command(
    common: Common,
    robot: str,
    logs: tuple[Path, ...],
    identify_now: bool | None,
    **values: Any,  # noqa: ANN401
) -> None:
    """Filter logs, stack the base regressor over them, and say what they excite."""
    options = options_of(LogOptions, values)  # wrong words end here, before anything is read
    arm = dynid.load_robot(robot)
    common.terminal.findings(arm.findings)
    while True:
        common.terminal.emit_json(stack_and_write(common, arm, logs, options))
        answer = ask(common, "P5", given=identify_now)
        if answer is not Answer.RETRY:
            break
        cutoff = click.prompt("cut-off [Hz] or auto", default="auto", err=True)
        options = options_of(LogOptions, values, cutoff=cutoff)
        common = replace(common, force=True)
    if answer is Answer.YES:
        run_identify(common, robot, (), show=not common.json)
    else:
        common.terminal.next(shell("dynid", "identify", robot))


def stack_and_write(
    common: Common, robot: Robot, logs: tuple[Path, ...], options: LogOptions
) -> dict[str, Any]:
    """Stack logs, write fullnumericregressor.npz and estimatedmotion.npz, and return the answer."""
    folder = common.folder(robot.slug)
    path = folder / "fullnumericregressor.npz"
    inputs = workflows.inputs.log_inputs(robot, logs) | options.texts()
    with common.terminal.progress() as progress:
        base = workflows.model.base_model(robot, folder, progress)
    if not may_write(common, path, inputs):
        with common.terminal.progress() as progress:
            return {
                **tell(common, workflows.parameters.load_observations(path, base, progress)),
                "wrote": [],
            }
    with common.terminal.progress() as progress:
        progress.stage("read")
        read = [dynid.loading.read_log(log, robot, options) for log in logs]
        seen = workflows.parameters.observe(robot, read, options, base=base, progress=progress)
    wrote = seen.save(folder, common.header(inputs))
    common.terminal.wrote(*wrote)
    write_run(folder, inputs)
    return {**tell(common, seen), "wrote": wrote}


def tell(common: Common, seen: Observations) -> dict[str, Any]:
    """Say what the logs excite, and return the JSON answer."""
    facts = seen.facts()
    common.terminal.stage(
        "excites",
        f"rank {facts['rank']} of {facts['structural_rank']}, "
        f"condition number {facts['condition_number_scaled']:.3g} with normalised columns",
    )
    common.terminal.findings(seen.weakly_excited())
    return facts
