"""``dynid model ROBOT``: loop 1, from the DH table to the base regressor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.cli.arguments import options_from, options_of, robot_argument
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import Answer, ask
from dynid.errors import StaleCache
from dynid.files import typed
from dynid.model.base_model import key_of, paths
from dynid.model.printing import as_latex, as_python
from dynid.text import shell
from dynid.workflows.options import ModelOptions

if TYPE_CHECKING:
    from dynid.robot import Robot
    from dynid.workflows.model import DerivedModel, ReducedModel

STYLES = {"#": "bold green", "+": "", ".": "red", "": ""}


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
    "reduce_now",
    default=None,
    help="Reduce to base parameters without asking.",
)
@click.option(
    "--rebuild/--frozen",
    "rebuild",
    default=None,
    help="Rebuild a stored model without asking, or never.",
)
@click.option(
    "--groups",
    type=click.Choice(["json", "latex", "text"]),
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
def command(common: Common, robot: str, **values: Any) -> None:  # noqa: ANN401
    """Derive the regressor of an arm from its DH table and group it into base parameters."""
    options = options_of(ModelOptions, values)
    while True:
        arm = workflows.model.adapted(dynid.load_robot(robot), options)
        common.terminal.findings(arm.findings)
        derived = derive(common, arm, values["rebuild"])
        if values["latex"] or values["python"]:
            return show_code(common, derived, latex=values["latex"])
        if values["groups"]:
            return show_relations(common, derived, values["groups"], at_rest=values["at_rest"])
        answer = ask(common, "P1", given=values["reduce_now"])
        if answer is not Answer.RETRY:
            break
        click.edit(filename=str(arm.path or robot.partition("#")[0]))
    report(common, derived, reduce(common, derived, options) if answer is Answer.YES else None)


def derive(common: Common, robot: Robot, rebuild: bool | None = None) -> DerivedModel:
    """Return the stored model when it is this robot's, otherwise derive and store it."""
    terminal, folder = common.terminal, common.folder(robot.slug)
    path = paths(folder)[0]
    turning = sum(joint.revolute for joint in robot.joints)
    kinds = f"{robot.n} joints ({turning} revolute, {robot.n - turning} prismatic)"
    terminal.stage(
        "robot",
        f"{robot.name}, {kinds}, {robot.convention} DH, file {typed(robot.path) if robot.path else robot.source}",
    )
    changed = workflows.model.stored_differences(robot, folder)
    if changed is not None and rebuild is not True:
        if rebuild is False:
            raise StaleCache(
                f"{path} was made from an older robot file ({changed})", where=str(path)
            )
        terminal.stage(
            "noticed", f"{path} was made from another version of the robot file: {changed}"
        )
        if ask(common, "P8", path=path) is not Answer.YES:
            raise StaleCache(
                f"{path} belongs to an older robot file and was not rebuilt",
                fix="answer yes, or add --rebuild",
            )
    with terminal.progress() as progress:
        derived = workflows.model.derive_model(
            robot, folder, rebuild=rebuild is True, progress=progress
        )
    if not derived.derived:
        terminal.stage("reused", f"{path}       (key {key_of(robot)}; --rebuild derives it again)")
        return derived
    model = derived.model
    terminal.stage(
        "symbolic",
        f"Newton-Euler, {model.size} parameters, {model.rigid.flops} operations, {derived.seconds:.2f} s",
    )
    terminal.wrote(path, note=f"key {key_of(robot)}, reused until the robot file changes")
    return derived


def reduce(
    common: Common, derived: DerivedModel, options: ModelOptions | None = None
) -> ReducedModel:
    """Group the parameters into base parameters, and say what came out."""
    with common.terminal.progress() as progress:
        reduced = workflows.model.reduce_model(
            derived, options or ModelOptions(), seed=common.seed, progress=progress
        )
    if not reduced.found:
        common.terminal.stage("reused", str(reduced.path))
        return reduced
    found = reduced.base.reduction
    gap = f"gap between kept and dropped singular values {found.gap:.0e}, seed {common.seed}"
    common.terminal.stage(
        "reduced", f"{len(found.names)} -> {found.rank} columns, rank {found.rank}, {gap}"
    )
    common.terminal.wrote(reduced.path)
    return reduced


def report(common: Common, derived: DerivedModel, reduced: ReducedModel | None) -> None:
    """Print the answer: the table of classes and the relations, or JSON."""
    terminal, name = common.terminal, derived.model.robot.word
    terminal.emit_json(derived.facts(reduced))
    if reduced is None:
        terminal.answer(
            f"The equations of {derived.model.robot.name} are ready.", style="bold", indent=2
        )
        why = "Find out which of its parameters torques show, alone or in groups."
        terminal.next(shell("dynid", "model", name, "--reduce"), why)
        return
    base = reduced.base
    terminal.answer(base.sentence, style="bold", indent=2)
    terminal.answer()
    table = base.class_table()
    cells = [
        [(text, STYLES[text]) if k else text for k, text in enumerate(row.values())]
        for row in table
    ]
    terminal.table(list(table[0]), cells)
    terminal.answer(base.legend)
    for relation in base.relations.values():
        terminal.answer(f"  {relation}")
    terminal.answer(f"  {base.where}" if base.where else "")
    terminal.next(
        shell("dynid", "trajectory", name), "Plan a motion that shows these parameters well."
    )
    terminal.next(
        f"{shell('dynid', 'identify', name)} LOG",
        "Identify them, where there is a recording already.",
    )


def show_relations(common: Common, derived: DerivedModel, form: str, *, at_rest: bool) -> None:
    """Print the relations, so that a vendor's grouped numbers can be named."""
    facts, text = workflows.model.relations(derived.model, form, at_rest=at_rest)
    common.terminal.emit_json(facts)
    common.terminal.answer(text)


def show_code(common: Common, derived: DerivedModel, *, latex: bool) -> None:
    """Print the regressor for a person."""
    text = as_latex(derived.model) if latex else as_python(derived.model)
    common.terminal.emit_json(
        {"schema": "dynid/model/1", "robot": derived.model.robot.name, "text": text}
    )
    common.terminal.answer(text)
