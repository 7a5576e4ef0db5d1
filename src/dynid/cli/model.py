"""``dynid model ROBOT``: loop 1, from the DH table to the base regressor."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import click

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import dynid_command, options_from, robot_argument
from dynid.cli.prompt import Reply, ask
from dynid.cli.session import Session
from dynid.errors import StaleCache
from dynid.files import typed
from dynid.judgement.rules import Step
from dynid.model.printing import as_latex, as_python
from dynid.runs import RunFolder
from dynid.workflows.options import ModelOptions

if TYPE_CHECKING:
    from dynid.robot import Robot
    from dynid.workflows.model import DerivedModel


@dynid_command(
    "model",
    examples=(
        "dynid model kinova_gen2                      derive, ask, reduce",
        "dynid model my_arm.yaml --gravity 9.81,0,0   the same arm on a wall",
        "dynid model kuka_lwr4plus --json | jq .rank",
    ),
)
@robot_argument
@options_from(ModelOptions)
@click.option(
    "--reduce/--no-reduce",
    default=None,
    help="Reduce to base parameters without asking.",
)
@click.option(
    "--rebuild/--frozen", default=None, help="Rebuild a stored model without asking, or never."
)
@click.option(
    "--groups",
    type=click.Choice(["json", "text"]),
    help="Print the relations of all base parameters.",
)
@click.option(
    "--at-rest",
    is_flag=True,
    help="With --groups: only what torques at rest show, as vendors publish it.",
)
@click.option("--latex", is_flag=True, help="Print the regressor as LaTeX.")
@click.option(
    "--python", "--code", "python", is_flag=True, help="Print the regressor as a NumPy function."
)
def command(
    session: Session,
    robot: Robot,
    options: ModelOptions,
    reduce: bool | None,
    rebuild: bool | None,
    groups: str | None,
    at_rest: bool,
    latex: bool,
    python: bool,
) -> Answer:
    """Derive the regressor of an arm from its DH table and group it into base parameters."""
    while True:
        derived = derive(session, workflows.model.adapted(robot, options), rebuild)
        if latex or python or groups:
            break
        reply = ask(session, "P1", given=reduce)
        if reply is Reply.YES:
            return reduced(session, derived, options)
        if reply is Reply.NO:
            why = "Find out which of its parameters are identifiable, alone or in linear combinations."
            step = Step(why, f"dynid model {robot.word} --reduce")
            return replace(derived.answer(), next=[step])
        source = str(robot.path or robot.source)
        click.edit(filename=source)
        robot = dynid.load_robot(robot.source or source)
        session.findings(robot.findings)
    model = derived.model
    if latex or python:
        text = as_latex(model) if latex else as_python(model)
        facts = {"schema": "dynid/model/1", "robot": model.robot.name, "text": text}
    else:
        facts, text = workflows.model.relations(model, str(groups), at_rest=at_rest)
    session.answer(text)
    return Answer(facts)


def derive(session: Session, robot: Robot, rebuild: bool | None) -> DerivedModel:
    """Return the stored model when it is this robot's, otherwise derive and store it."""
    folder = session.folder(robot.slug)
    path = RunFolder(folder).model[0]
    file = typed(robot.path) if robot.path else robot.source
    session.stage("robot", f"{robot.name}, {robot.n} joints, {robot.convention} DH, file {file}")
    changed = workflows.model.stored_differences(robot, folder)
    if changed is not None and rebuild is not True:
        what = f"{path} was made from an older robot file ({changed})"
        if rebuild is False:
            raise StaleCache(what, where=path)
        session.stage("noticed", what)
        if ask(session, "P8", path=path) is not Reply.YES:
            raise StaleCache(what, fix="answer yes, or add --rebuild")
    derived = workflows.model.derive_model(robot, folder, rebuild=rebuild is True)
    if not derived.wrote:
        session.stage("reused", f"{path}       (--rebuild derives it again)")
        return derived
    session.wrote(path, note="reused until the robot file changes")
    return derived


def reduced(session: Session, derived: DerivedModel, options: ModelOptions) -> Answer:
    """Group the parameters into base parameters, and answer with their classes and relations."""
    path, name = RunFolder(derived.folder).model[1], derived.model.robot.word
    made = workflows.model.reduce_model(derived, options, seed=session.seed)
    if path in made.wrote:
        session.wrote(path)
    else:
        session.stage("reused", str(path))
    return replace(
        made.answer(),
        next=(
            Step("Plan a motion that shows these parameters well.", f"dynid trajectory {name}"),
            Step(
                "Identify them, where there is a recording already.", f"dynid identify {name} LOG"
            ),
        ),
    )
