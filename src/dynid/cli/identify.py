"""``dynid identify ROBOT [LOG...]``: base parameters from logs, with robust errors and a held-out figure."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.cli.arguments import NumberInRange, options_from, options_of, robot_argument
from dynid.cli.judged import show_judgement, show_next
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import may_write
from dynid.cli.report import write_report
from dynid.cli.runfile import write_run
from dynid.errors import ExitStatus, WrongUsage
from dynid.text import closest
from dynid.workflows.options import Extras, IdentifyOptions

if TYPE_CHECKING:
    from dynid.estimation.drive_gains import Gains
    from dynid.estimation.payload import IdentifiedPayload
    from dynid.estimation.result import Identification
    from dynid.model.base_model import BaseModel
    from dynid.robot import Robot


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
@click.argument("logs", nargs=-1, type=click.Path(path_type=Path), metavar="[LOG...]")
@options_from(IdentifyOptions)
@click.option(
    "--payload-from",
    type=click.Path(path_type=Path),
    metavar="RESULT",
    help="Result without the load: find mass, centre and inertia of the load that the arm of the LOG carries.",
)
@click.option(
    "--report/--no-report",
    default=True,
    show_default=True,
    help="Write report.html and summary.md as well.",
)
@click.option("--open", "open_report", is_flag=True, help="Open report.html in the browser.")
@click.option(
    "--loaded",
    type=click.Path(path_type=Path),
    metavar="LOG",
    help="Log of motor currents with a load of known mass: find the gains of all drives.",
)
@click.option(
    "--load-mass",
    type=NumberInRange(min=0, min_open=True),
    metavar="KG",
    help="Mass of the load in the log given with --loaded [kg].",
)
@click.option(
    "--update",
    type=click.Path(path_type=Path),
    metavar="RESULT",
    help="Add the LOG to this result; its own logs are not needed. It may be overwritten.",
)
@click.option(
    "--fail-if",
    metavar="EXPR",
    multiple=True,
    help="Exit 1 if the condition is true, such as 'max_rms_nm > 1.5'.",
)
def command(
    common: Common,
    robot: str,
    logs: tuple[Path, ...],
    fail_if: tuple[str, ...],
    report: bool,
    open_report: bool,
    **values: Any,  # noqa: ANN401
) -> ExitStatus:
    """Identify the base parameters of an arm by least squares."""
    limits = [parsed_limit(text) for text in fail_if]
    options = options_of(IdentifyOptions, values)
    extras = Extras(**{each.name: values[each.name] for each in fields(Extras)})
    facts = run_identify(common, robot, logs, options, extras, report=report or open_report)
    write_run(facts["folder"], facts["inputs"])
    if open_report:
        click.launch(str((facts["folder"] / "report.html").resolve()))
    failed = sum(broken(common, facts, *limit) for limit in limits)
    return ExitStatus.LIMIT_NOT_MET if failed else ExitStatus.DONE


def run_identify(
    common: Common,
    robot: str,
    logs: tuple[Path, ...],
    options: IdentifyOptions | None = None,
    extras: Extras = Extras(),
    *,
    report: bool = False,
    show: bool = True,
    final: bool = True,
) -> dict[str, Any]:
    """Identify, write the results, print them, and return the JSON answer.

    Args:
        common: the common options.
        robot: name or path of the robot file.
        logs: recordings; () for the observations that ``dynid parameters`` wrote.
        options: how to identify.
        extras: what is asked besides.
        report: write report.html and summary.md beside the results, where they are new or have none.
        show: print the tables.
        final: print the JSON answer and the next command as well; not when another command goes on.
    """
    arm, terminal = dynid.load_robot(robot), common.terminal
    terminal.findings(arm.findings)
    models = common.folder(arm.slug)
    folder = models if extras.payload_from is None else models.with_name(f"{models.name}_loaded")
    with terminal.progress() as progress:

        def allowed(path: Path, inputs: Mapping[str, str]) -> bool:
            progress.pause()
            return may_write(common, path, inputs)

        run = workflows.identify_run.identify_run(
            arm,
            logs,
            options or IdentifyOptions(),
            common.out or folder,
            extras,
            models=models,
            may_write=allowed,
            header=common.header,
            progress=progress,
        )
    terminal.wrote(*run.beside, *run.wrote)
    facts = run.facts()
    if report and (run.wrote or not (run.folder / "report.html").is_file()):
        facts["wrote"] += write_report(common, run.result.path, run.base)[1]
    if run.gains is not None:
        show_gains(common, run.base.robot, run.gains)
    if show:
        show_result(common, run.base, run.result)
    if run.payload is not None:
        show_payload(common, run.payload)
    if show and final:
        terminal.emit_json(workflows.drive_gains.in_amperes(facts, run.base.robot))
        show_next(common, run.result.judgement)
    return facts


# ---------------------------------------------------------------- printing
USED = {"physical": "the physical parameters", "plain": "the plain estimate"}


def show_payload(common: Common, payload: IdentifiedPayload) -> None:
    """Print the load."""
    common.terminal.findings(payload.findings())
    names = ("mass", "com x", "com y", "com z", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
    units = ("kg", *("m",) * 3, *("kg m^2",) * 6)
    common.terminal.answer()
    common.terminal.answer("load on the last link, in its frame (inertia about the centre of mass)")
    rows = [
        [name, f"{value:.4g}", f"{low:.4g} to {high:.4g}", unit]
        for name, value, (low, high), unit in zip(
            names, payload.numbers, payload.intervals, units, strict=True
        )
    ]
    common.terminal.table(["load", "value", "95 % interval", "unit"], rows)


#: Relative standard error of a gain from which on it is called uncertain.
UNCERTAIN = 0.1


def show_gains(common: Common, robot: Robot, found: Gains) -> None:
    """Print the gains."""
    unit = "ratio" if found.relative else "N m/A"
    rows = [
        [joint, f"{gain:.4g}", f"{error:.2g}" if error else "given", unit]
        for joint, gain, error in zip(robot.joint_names, found.gain, found.std_error, strict=True)
    ]
    if not common.json:
        common.terminal.table(["joint", "gain", "std error", "unit"], rows)
    if found.relative:
        common.terminal.say(
            "amperes    the size of the gains is unknown, so results are in A; see --loaded"
        )
    worst = int((found.std_error / found.gain).argmax())
    if found.std_error[worst] > UNCERTAIN * found.gain[worst]:
        percent = 100 * found.std_error[worst] / found.gain[worst]
        common.terminal.say(
            f"uncertain  the gain of {robot.joint_names[worst]} is known to {percent:.0f} % only"
        )


def show_result(common: Common, base: BaseModel, found: Identification) -> None:
    """Print the answer, why, and the table of joints; with -v what is used, and every parameter."""
    terminal = common.terminal
    show_judgement(common, found.judgement)
    torque = base.robot.torque
    units = ["A" if torque.relative else joint.torque_unit for joint in base.robot.joints]
    sizes = torque.gain if torque.relative and torque.gain else (1.0,) * base.robot.n
    floors = found.header.get("noise_floor_nm") or (None,) * base.robot.n
    rows = []
    for quality, unit, size, floor in zip(found.joints, units, sizes, floors, strict=True):
        if not quality.torque_rms:
            rows.append([quality.joint, *"-----"])
            continue
        errors = (quality.rms, floor, quality.torque_rms, quality.heldout_rms)
        rms, noise, whole, held = (
            "-" if x is None else f"{x / (size or 1.0):.3g} {unit}" for x in errors
        )
        rows.append([quality.joint, rms, noise, whole, f"{quality.relative_percent:.1f} %", held])
    bound = "" if found.header.get("noise_repeats_s") else " >="
    terminal.table(
        ["joint", "rms error", f"noise{bound}", "torque rms", "unexplained", "held out"], rows
    )
    held_total = found.heldout_relative_error_percent
    total = f"total relative error {found.relative_error_percent:.2f} %"
    held_text = f", held out {held_total:.2f} % ({found.heldout})" if held_total is not None else ""
    terminal.sentence(total + held_text)
    if not common.verbose:
        return
    terminal.answer()
    terminal.fact("used", f"{USED[found.in_force]} for predictions")
    for line in found.expectation():
        terminal.fact(
            "expected" if line.startswith("expected") else "residual",
            line.removeprefix("expected "),
        )
    mass = sum(link["mass_kg"] for link in found.links())
    known = "masses are unknown without motor gains" if torque.relative else f"{mass:.3g} kg in all"
    terminal.fact("physical", f"links with mass, centre and inertia in parameters.npz, {known}")
    terminal.answer()
    from dynid.reports.tables import parameter_rows  # here: help must be fast

    heads = ("name", "value", "error", "unit", "class", "known", "prior")
    rows = [[row[head] or "-" for head in heads] for row in parameter_rows(found)]
    terminal.table(["parameter", "value", "std error", *heads[3:]], rows)


LIMIT = re.compile(r"\s*([a-z_]+)\s*(<=|>=|<|>)\s*([-+0-9.eE]+)\s*")
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


def parsed_limit(text: str) -> tuple[str, str, float]:
    """Read a limit such as ``max_rms_nm > 1.5``."""
    match = LIMIT.fullmatch(text)
    try:
        if match is None:
            raise ValueError
        name, sign, limit = match[1], match[2], float(match[3])
    except ValueError:
        raise WrongUsage(
            f"--fail-if '{text}' is not NAME > NUMBER", fix="such as --fail-if 'max_rms_nm > 1.5'"
        ) from None
    if name not in FIGURES:
        raise WrongUsage(
            f"--fail-if: no figure '{name}'{closest(name, FIGURES)}",
            fix=f"one of {', '.join(FIGURES)}",
        )
    return name, sign, limit


def broken(common: Common, facts: dict[str, Any], name: str, sign: str, limit: float) -> bool:
    """Return whether a limit is broken, and say so."""
    held = [
        joint["heldout_rms_nm"] for joint in facts["joints"] if joint["heldout_rms_nm"] is not None
    ]
    values = {
        **facts,
        "max_rms_nm": max(joint["rms_nm"] for joint in facts["joints"]),
        "max_heldout_rms_nm": max(held, default=None),
    }
    value = values[name]
    if value is None:
        raise WrongUsage(
            f"--fail-if: nothing is held out, so there is no {name}", fix="--holdout 20%"
        )
    holds = bool(
        {"<": value < limit, ">": value > limit, "<=": value <= limit, ">=": value >= limit}[sign]
    )
    if holds:
        common.terminal.say(f"limit      {name} = {value:.4g} {sign} {limit:g}")
    return holds
