"""``dynid parameters ROBOT LOG...``: the regressor on a log, before anything is identified."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import PATH, dynid_command, invoke, options_from, robot_argument
from dynid.cli.prompt import Reply, ask, may_write
from dynid.cli.runfile import write_run
from dynid.cli.session import Session
from dynid.judgement.rules import Step
from dynid.options import LogOptions
from dynid.runs import RunFolder

if TYPE_CHECKING:
    from dynid.robot import Robot


@dynid_command(
    "parameters",
    repeatable=True,
    examples=(
        "dynid parameters kuka_lwr4plus run.bag             stack, ask, identify",
        "dynid parameters kuka_lwr4plus a.bag b.bag --cutoff 8",
    ),
)
@robot_argument
@click.argument("logs", nargs=-1, required=True, type=PATH, metavar="LOG...")
@options_from(LogOptions)
@click.option(
    "--identify/--no-identify",
    default=None,
    help="Identify afterwards without asking.",
)
def command(
    session: Session,
    robot: Robot,
    logs: tuple[Path, ...],
    options: LogOptions,
    identify: bool | None,
) -> Answer:
    """Filter logs, stack the base regressor over them, and say what they excite."""
    while True:
        answer = stacked(session, robot, logs, options)
        session.show(answer)
        reply = ask(session, "P5", given=identify)
        if reply is not Reply.RETRY:
            break
        cutoff: Any = click.prompt("cut-off [Hz] or auto", default="auto", err=True)
        options, session = replace(options, cutoff=cutoff), replace(session, force=True)
    steps = [Step("", f"dynid identify {robot.word}")]
    if reply is Reply.YES:
        out = session.folder(robot.slug)
        identified = invoke(session, "identify", robot.source, "-o", out)
        steps = [Step(**each) for each in identified["judgement"]["next"]]
    return Answer({**answer.facts, "wrote": answer.wrote}, next=steps)


def stacked(session: Session, robot: Robot, logs: tuple[Path, ...], options: LogOptions) -> Answer:
    """Stack logs, and write fullnumericregressor.npz and estimatedmotion.npz."""
    folder, work = session.folder(robot.slug), workflows.parameters
    path, wrote = RunFolder(folder).stack, []
    inputs = workflows.parameters.log_inputs(robot, logs) | options.texts()
    base = workflows.model.base_model(robot, folder)
    if may_write(session, path, inputs):
        seen = work.observe(robot, logs, options, base=base)
        wrote = seen.save(folder, session.header(inputs))
        write_run(folder, inputs)
    else:
        seen = work.load_observations(path, base)
    return replace(seen.answer(), wrote=wrote)
