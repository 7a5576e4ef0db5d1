"""``dynid identify ROBOT [LOG...]``: base parameters from logs, with robust errors and a held-out figure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import partial
from operator import ge, gt, le, lt
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid import workflows
from dynid.cli.options import PATH, Answered, dynid_command, options_from, robot_argument
from dynid.cli.prompt import may_write
from dynid.cli.report import write_report
from dynid.cli.runfile import write_run
from dynid.cli.session import Session
from dynid.errors import WrongUsage
from dynid.runs import RunFolder
from dynid.text import closest
from dynid.workflows.options import Extras, IdentifyOptions

if TYPE_CHECKING:
    from dynid.estimation.drive_gains import Gains
    from dynid.estimation.payload import IdentifiedPayload
    from dynid.estimation.result import Identification
    from dynid.robot import Robot

Limit = tuple[str, str, float]


@dynid_command(
    "identify",
    repeatable=True,
    examples=(
        "dynid identify kuka_lwr4plus run.bag",
        "dynid identify kuka_lwr4plus a.bag b.bag --holdout c.bag",
        "dynid identify kuka_lwr4plus loaded.bag --payload-from out/kuka_lwr4plus",
        "dynid identify kuka_lwr4plus new.bag --update out/kuka_lwr4plus",
        "dynid identify my_arm currents.npz --loaded loaded.npz --load-mass 2.5      gains of the drives",
        "dynid identify kuka_lwr4plus run.bag --fail-if 'max_rms_nm > 1.5'      for CI",
    ),
)
@robot_argument
@click.argument("logs", nargs=-1, type=PATH, metavar="[LOG...]")
@options_from(IdentifyOptions)
@options_from(Extras, "extras")
@click.option(
    "--report/--no-report",
    default=True,
    show_default=True,
    help="Write report.html and summary.md as well.",
)
@click.option("--open", is_flag=True, help="Open report.html in the browser.")
@click.option(
    "--fail-if",
    metavar="EXPR",
    multiple=True,
    help="Exit 1 if the condition is true, such as 'max_rms_nm > 1.5'.",
)
def command(
    session: Session,
    robot: Robot,
    logs: tuple[Path, ...],
    options: IdentifyOptions,
    extras: Extras,
    report: bool,
    open: bool,
    fail_if: tuple[str, ...],
) -> Answered:
    """Identify the base parameters of an arm by least squares."""
    limits = [parsed_limit(text) for text in fail_if]
    models = session.folder(robot.slug)
    folder = models if extras.payload_from is None else models.with_name(f"{models.name}_loaded")
    run = workflows.identify.identify_run(
        robot,
        logs,
        options,
        session.out or folder,
        extras,
        models=models,
        may_write=partial(may_write, session),
        header=session.header,
    )
    session.wrote(*run.beside, *run.wrote)
    facts, page = run.facts(), RunFolder(run.folder).report
    if (report or open) and (run.wrote or not page.is_file()):
        facts["wrote"] += write_report(session, run.result.path, run.folder, run.base)[1]
    if run.gains is not None:
        session.table(facts["gains"])
        show_gains(session, run.base.robot, run.gains)
    answer = workflows.drive_gains.in_amperes(facts, run.base.robot)
    show_result(session, run.base.robot, run.result, answer)
    if run.payload is not None:
        show_payload(session, run.payload)
    session.steps(*run.result.judgement.steps)
    write_run(run.folder, run.inputs)
    if open:
        click.launch(str(page.resolve()))
    broken = broken_limits(facts, limits)
    for text in broken:
        session.say(f"limit      {text}")
    return answer, bool(broken)


# ---------------------------------------------------------------- printing
#: Relative standard error of a gain from which on it is called uncertain.
UNCERTAIN = 0.1
#: Columns of the table of joints by what the JSON answer calls them.
COLUMNS = {
    "joint": "joint",
    "rms_{}": "rms error",
    "noise_floor_{}": "noise level",
    "torque_rms_{}": "torque rms",
    "relative_error_percent": "error %",
    "heldout_rms_{}": "held out",
}


def show_payload(session: Session, payload: IdentifiedPayload) -> None:
    """Print the load."""
    session.findings(payload.findings())
    names = ("mass", "com x", "com y", "com z", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
    units = ("kg", *("m",) * 3, *("kg m^2",) * 6)
    columns = names, payload.numbers, *payload.intervals.T, units
    heads = ("load", "value", "2.5 %", "97.5 %", "unit")
    session.answer("\nload on the last link, in its frame (inertia about the centre of mass)")
    rows = zip(*columns, strict=True)
    session.table([dict(zip(heads, row, strict=True)) for row in rows])


def show_gains(session: Session, robot: Robot, gains: Gains) -> None:
    """Say how far the gains are known."""
    if gains.relative:
        unknown = "the size of the gains is unknown, so results are in A; see --loaded"
        session.say(f"amperes    {unknown}")
    shares = gains.std_error / gains.gain
    worst = int(shares.argmax())
    if shares[worst] > UNCERTAIN:
        name = robot.joint_names[worst]
        session.say(f"uncertain  the gain of {name} is known to {100 * shares[worst]:.0f} % only")


def show_result(
    session: Session, robot: Robot, result: Identification, facts: Mapping[str, Any]
) -> None:
    """Print the answer, why, and the table of joints; with -v what is used, and every parameter."""
    session.judgement(result.judgement)
    session.lights(result.judgement)
    joints, relative = facts["joints"], robot.torque.relative
    unit = "a" if "rms_a" in joints[0] else "nm"
    measured = {"noise_floor_{}": "noise"} if result.header.get("noise_repeats_s") else {}
    columns = (COLUMNS | measured).items()
    rows = [{head: each[key.format(unit)] for key, head in columns} for each in joints]
    units = ["A" if relative else joint.torque_unit for joint in robot.joints]
    session.table([row | {"unit": each} for row, each in zip(rows, units, strict=True)])
    total, held = result.relative_error_percent, result.heldout_relative_error_percent
    held_out = "" if held is None else f", held out {held:.2f} % ({result.heldout})"
    session.sentences(f"total relative error {total:.2f} %{held_out}")
    if session.verbose:
        mass = sum(link["mass_kg"] for link in result.links())
        size = "masses are unknown without motor gains" if relative else f"{mass:.3g} kg in all"
        session.answer()
        session.sentences(*result.verdict(), f"links are in parameters.npz: {size}")
        session.answer()
        session.table(result.table())


# ---------------------------------------------------------------- --fail-if
LIMIT = re.compile(r"\s*([a-z_]+)\s*(<=|>=|<|>)\s*([-+0-9.eE]+)\s*")
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
    match = LIMIT.fullmatch(text)
    try:
        name, sign, limit = match.groups() if match else ("", "", "")
        number = float(limit)
    except ValueError:
        what = f"--fail-if '{text}' is not NAME > NUMBER"
        raise WrongUsage(what, fix="such as --fail-if 'max_rms_nm > 1.5'") from None
    if name not in FIGURES:
        what = f"--fail-if: no figure '{name}'{closest(name, FIGURES)}"
        raise WrongUsage(what, fix=f"one of {', '.join(FIGURES)}")
    return name, sign, number


def broken_limits(facts: Mapping[str, Any], limits: Sequence[Limit]) -> list[str]:
    """Return those limits that are broken, in words."""
    broken, joints = [], facts["joints"]
    for name, sign, limit in limits:
        # Why so: the largest figure of a joint is that of any joint that has one.
        key = name.removeprefix("max_")
        values = [facts[name]] if name in facts else [joint[key] for joint in joints]
        value = max((each for each in values if each is not None), default=None)
        if value is None:
            what = f"--fail-if: nothing is held out, so there is no {name}"
            raise WrongUsage(what, fix="--holdout 20%")
        if SIGNS[sign](value, limit):
            broken.append(f"{name} = {value:.4g} {sign} {limit:g}")
    return broken
