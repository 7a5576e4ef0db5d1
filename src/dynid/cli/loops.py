"""Loops 1 and 3: model, from the DH table to base parameters; parameters and identify, least squares on logs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from operator import ge, gt, le, lt
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.arguments import no_such
from dynid.cli.options import dynid_command, invoke
from dynid.cli.prompt import ask, may_write
from dynid.cli.runfile import write_run
from dynid.cli.session import Session
from dynid.errors import StaleCache, WrongUsage
from dynid.files import typed
from dynid.judgement.rules import Step
from dynid.model.printing import as_latex, as_python
from dynid.options import LogOptions, option
from dynid.runs import RunFolder
from dynid.text import shell
from dynid.workflows.options import IdentifyRunOptions, ModelOptions

if TYPE_CHECKING:
    from dynid.robot import Robot
    from dynid.workflows.model import DerivedModel


@dynid_command("model")
@click.option(
    "--python", "--code", "python", is_flag=True, help="Print the regressor as a NumPy function."
)
def model_command(
    session: Session,
    *,
    robot: Robot,
    options: ModelOptions,
    reduce: bool | None = option(None, "Reduce to base parameters without asking."),
    rebuild: bool | None = option(
        None, "Rebuild a stored model without asking, or never.", off="--frozen"
    ),
    groups: str | None = option(
        None, "Print the relations of all base parameters.", choices=("json", "text")
    ),
    at_rest: bool = option(
        False, "With --groups: only what torques at rest show, as vendors publish it."
    ),
    latex: bool = option(False, "Print the regressor as LaTeX."),
    python: bool,
) -> Answer:
    """Derive the regressor of an arm from its DH table and group it into base parameters.

    Examples:
      dynid model kinova_gen2                      derive, ask, reduce
      dynid model my_arm.yaml --gravity 9.81,0,0   the same arm on a wall
      dynid model kuka_lwr4plus --json | jq .rank
    """
    while True:
        derived = derive(session, workflows.model.adapted(robot, options), rebuild)
        if latex or python or groups:
            break
        reply = ask(session, "P1", given=reduce)
        if reply == "yes":
            return reduced(session, derived, options)
        if reply == "no":
            why = "Find out which of its parameters are identifiable, alone or in linear combinations."
            steps = [Step(why, f"dynid model {robot.word} --reduce")]
            return replace(derived.answer(), next=steps)
        source = str(robot.path or robot.source)
        click.edit(filename=source)
        robot = dynid.load_robot(robot.source or source)
    model = derived.model
    if latex or python:
        text = as_latex(model) if latex else as_python(model)
        facts = {"robot": model.robot.name, "text": text}
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
        if ask(session, "P8", path=path) != "yes":
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


@dynid_command("parameters", repeatable=True)
def parameters_command(
    session: Session,
    *,
    robot: Robot,
    logs: tuple[Path, ...],
    options: LogOptions,
    identify: bool | None = option(None, "Identify afterwards without asking."),
) -> Answer:
    """Filter logs, stack the base regressor over them, and say what they excite.

    Examples:
      dynid parameters kuka_lwr4plus run.bag             stack, ask, identify
      dynid parameters kuka_lwr4plus a.bag b.bag --cutoff 8
    """
    again = False
    while True:
        answer = stacked(session, robot, logs, options, again=again)
        session.show(answer)
        reply = ask(session, "P5", given=identify)
        if reply != "retry":
            break
        cutoff: Any = click.prompt("cut-off [Hz] or auto", default="auto", err=True)
        options, again = replace(options, cutoff=cutoff), True
    folder = shell("-o", session.out) if session.out else ""
    steps = [Step("", f"dynid identify {robot.word} {folder}".rstrip())]
    if reply == "yes":
        out = session.folder(robot.slug)
        identified = invoke(session, "identify", robot.source, "-o", out)
        steps = [Step(**each) for each in identified["judgement"]["next"]]
    return Answer(answer.facts, next=steps)


def stacked(
    session: Session, robot: Robot, logs: tuple[Path, ...], options: LogOptions, *, again: bool
) -> Answer:
    """Stack logs, and write fullnumericregressor.npz and estimatedmotion.npz, again without asking."""
    folder, work = session.folder(robot.slug), workflows.parameters
    path, wrote = RunFolder(folder).stack, []
    inputs = work.log_inputs(robot, logs) | options.texts()
    base = dynid.base_model(robot, folder)
    if again or may_write(session, path, inputs):
        seen = work.observe(robot, logs, options, base=base)
        wrote = seen.save(folder, session.header(inputs))
        write_run(folder, inputs)
    else:
        seen = work.load_observations(path, base)
    return replace(seen.answer(), wrote=wrote)


Limit = tuple[str, str, float]


@dynid_command("identify", repeatable=True)
def identify_command(
    session: Session,
    *,
    robot: Robot,
    logs: tuple[Path, ...] = (),
    options: IdentifyRunOptions,
    report: bool = option(True, "Write report.html and summary.md as well."),
    open: bool = option(False, "Open report.html in the browser."),
    fail_if: tuple[str, ...] = option(
        (),
        "Exit 1 if the condition is true, such as 'max_rms_nm > 1.5'.",
        metavar="EXPR",
        repeatable=True,
    ),
) -> Answer:
    """Identify the base parameters of an arm by least squares.

    Examples:
      dynid identify kuka_lwr4plus run.bag
      dynid identify kuka_lwr4plus a.bag b.bag --holdout c.bag
      dynid identify kuka_lwr4plus loaded.bag --payload-from out/kuka_lwr4plus
      dynid identify kuka_lwr4plus new.bag --update out/kuka_lwr4plus
      dynid identify my_arm currents.npz --loaded loaded.npz --load-mass 2.5      gains of the drives
      dynid identify kuka_lwr4plus run.bag --fail-if 'max_rms_nm > 1.5'      for CI
    """
    limits = [parsed_limit(text) for text in fail_if]
    models = session.folder(robot.slug)
    folder = models if options.payload_from is None else models.with_name(f"{models.name}_loaded")
    folder = session.out or folder
    answer = workflows.identify.identify_run(
        robot,
        logs,
        options,
        folder,
        models=models,
        may_write=partial(may_write, session),
        header=session.header,
    )
    run = RunFolder(folder)
    new = (report or open) and (run.parameters in answer.wrote or not run.report.is_file())
    wrote = workflows.report.renewed(run.parameters, first=True) if new else []
    write_run(folder, answer.facts["inputs"])
    if open:
        click.launch(str(run.report.resolve()))
    return replace(
        answer, wrote=(*answer.wrote, *wrote), limits=broken_limits(answer.facts, limits)
    )


# ---------------------------------------------------------------- --fail-if
LIMIT = re.compile(r"\s*([a-z_]+)\s*(<=|>=|<|>)\s*([-+]?\d*\.?\d+(?:e[-+]?\d+)?)\s*")
SIGNS = {"<": lt, ">": gt, "<=": le, ">=": ge}
#: Figures that --fail-if may name.
FIGURES = (
    "condition_number",
    "condition_number_scaled",
    "heldout_relative_error_percent",
    "max_heldout_rms_nm",
    "max_rms_nm",
    "rank",
    "relative_error_percent",
    "samples",
)


def parsed_limit(text: str) -> Limit:
    """Read a limit such as ``max_rms_nm > 1.5``."""
    match = LIMIT.fullmatch(text.lower())
    if match is None:
        what = f"--fail-if '{text}' is not NAME > NUMBER"
        raise WrongUsage(what, fix="such as --fail-if 'max_rms_nm > 1.5'")
    name, sign, number = match.groups()
    if name not in FIGURES:
        raise no_such("--fail-if: no figure", name, FIGURES)
    return name, sign, float(number)


def broken_limits(facts: Mapping[str, Any], limits: Sequence[Limit]) -> list[str]:
    """Return those limits that are broken, in words."""
    broken, joints = [], facts["joints"]
    for name, sign, limit in limits:
        # Why so: the largest figure of a joint is that of any joint that has one.
        key = name.removeprefix("max_")
        if key not in joints[0]:  # amperes
            key = f"{key.removesuffix('nm')}a"
        values = [facts[name]] if name in facts else [joint[key] for joint in joints]
        value = max((each for each in values if each is not None), default=None)
        if value is None:
            raise WrongUsage(f"--fail-if: nothing is held out, so no {name}", fix="--holdout 20%")
        if SIGNS[sign](value, limit):
            broken.append(f"{name} = {value:.4g} {sign} {limit:g}")
    return broken
