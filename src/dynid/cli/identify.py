"""``dynid identify ROBOT [LOG...]``: base parameters from logs, with robust errors and a held-out figure."""

from __future__ import annotations

import re
from dataclasses import asdict, replace
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
from dynid.disk import write_text
from dynid.errors import ExitStatus, Finding, WrongUsage
from dynid.text import closest, yaml_text
from dynid.workflows.options import IdentifyOptions

if TYPE_CHECKING:
    from dynid.estimation.drive_gains import Gains
    from dynid.estimation.payload import IdentifiedPayload
    from dynid.estimation.result import Identification
    from dynid.log import Log
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
    "--explain",
    "explained",
    is_flag=True,
    help="Show how the parameters change with the cut-off and the delay; needs a LOG.",
)
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
    extras = {
        key: values.pop(key)
        for key in ("explained", "payload_from", "loaded", "load_mass", "update")
    }
    report = report or open_report
    facts = run_identify(
        common, robot, logs, options_of(IdentifyOptions, values), report=report, **extras
    )
    write_run(Path(facts["folder"]), facts["inputs"])
    if open_report:
        click.launch(str((Path(facts["folder"]) / "report.html").resolve()))
    return (
        ExitStatus.LIMIT_NOT_MET
        if sum(broken(common, facts, *limit) for limit in limits)
        else ExitStatus.DONE
    )


def run_identify(
    common: Common,
    robot: str,
    logs: tuple[Path, ...],
    options: IdentifyOptions | None = None,
    *,
    explained: bool = False,
    payload_from: Path | None = None,
    loaded: Path | None = None,
    load_mass: float | None = None,
    update: Path | None = None,
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
        explained: also show how the parameters depend on cut-off and delay.
        payload_from: result without a load; the load is found.
        loaded: log of currents with a load of known mass.
        load_mass: that mass [kg].
        update: result that the logs are added to.
        report: write report.html and summary.md beside the results, where they are new or have none.
        show: print the tables.
        final: print the JSON answer and the next command as well; not when another command goes on.
    """
    options = options or IdentifyOptions()
    arm = dynid.load_robot(robot)

    unloaded, earlier = (
        dynid.loading.load_run(path) if path else None for path in (payload_from, update)
    )
    files = {"loaded": loaded, "prior_file": options.prior, "holdout": options.holdout}
    files["update"] = earlier.path if earlier else None
    arm, options = workflows.identify.resolved(arm, options, unloaded or earlier)
    common.terminal.findings(arm.findings)
    folder = common.folder(arm.slug)
    if unloaded is not None:
        folder = common.out or folder.with_name(f"{folder.name}_loaded")
    recordings = Recordings(common, arm, logs, options)
    gains = recordings.gains(loaded, load_mass)
    facts: dict[str, Any] = {}
    if gains is not None:
        path, arm = workflows.drive_gains.write_robot(folder, arm, gains)
        common.terminal.wrote(path)
        show_gains(common, arm, gains)
        facts = workflows.drive_gains.gain_facts(arm, gains)
    inputs = workflows.inputs.identify_inputs(arm, folder, logs, options, files, load_mass)
    result, base, wrote = obtain_result(common, arm, folder, recordings, options, inputs, earlier)
    timing = {
        key: result.header.get(key) for key in ("delay_s", "delay_std_error_s", "delay_applied_s")
    }
    facts = {
        **workflows.results.answer_of(result),
        "wrote": wrote,
        **timing,
        **facts,
        "folder": folder,
        "inputs": inputs,
    }
    result = replace(result, path=folder / "parameters.npz")
    if report and (wrote or not (folder / "report.html").is_file()):
        facts["wrote"] = [*facts["wrote"], *write_report(common, result.path, base)[1]]
    if show:
        show_result(common, base, result)
    if unloaded is not None:
        add_payload(
            common,
            folder,
            workflows.identify.find_payload(recordings.with_rows(result, base), unloaded),
            facts,
        )
    if explained:
        facts["explain"] = explain(common, result, recordings, options, base)
    if show and final:
        common.terminal.emit_json(workflows.drive_gains.in_amperes(facts, arm))
        show_next(common, result.judgement)
    return facts


class Recordings:
    """The logs of a run, read from disk only once.

    Args:
        common: the common options.
        robot: the arm.
        paths: the logs.
        options: how they are read.
    """

    def __init__(
        self,
        common: Common,
        robot: Robot,
        paths: tuple[Path, ...],
        options: IdentifyOptions,
    ) -> None:
        self._common, self._robot, self._paths, self._options = common, robot, paths, options
        self._read: list[Log] | None = None

    def read(self) -> list[Log]:
        """Return the logs as read."""
        if self._read is None:
            with self._common.terminal.progress() as progress:
                progress.stage("read")
                self._read = [
                    dynid.loading.read_log(path, self._robot, self._options) for path in self._paths
                ]
        return self._read

    def with_rows(self, result: Identification, base: BaseModel) -> Identification:
        """Return a result with the rows that it was made from, which its file does not keep."""
        if result.stack is not None or not self._paths:
            return result
        options = replace(self._options, cutoff=result.cutoff, delay=result.delay)
        with self._common.terminal.progress() as progress:
            seen = workflows.parameters.observe(
                result.robot, self.read(), options, base=base, progress=progress
            )
        return replace(result, stack=seen.stack)

    def gains(self, loaded: Path | None, load_mass: float | None) -> Gains | None:
        """Return the gains of the drives where the logs hold currents and not all gains are known.

        Raises:
            WrongUsage: a load is given for logs that need none.
        """
        robot, options = self._robot, self._options
        if (
            robot.torque.complete
            or not self._paths
            or not workflows.drive_gains.needs_gains(robot, self.read()[0])
        ):
            if loaded:
                raise WrongUsage(
                    "--loaded is for logs of motor currents with unknown gains; these logs have torques or known gains",
                    fix="to identify a load: --payload-from RESULT",
                )
            return None
        second = dynid.loading.read_log(loaded, robot, options) if loaded else None
        folder = self._common.folder(robot.slug)
        with self._common.terminal.progress() as progress:
            return workflows.drive_gains.find_drive_gains(
                robot,
                self.read(),
                options,
                loaded=second,
                load_mass=load_mass,
                folder=folder,
                progress=progress,
            )


def obtain_result(
    common: Common,
    robot: Robot,
    folder: Path,
    recordings: Recordings,
    options: IdentifyOptions,
    inputs: dict[str, str],
    earlier: Identification | None,
) -> tuple[Identification, BaseModel, list[Path]]:
    """Return the result, its model and what was written: a new result, or the one that is there from equal inputs."""
    path = folder / "parameters.npz"
    terminal = common.terminal
    with terminal.progress() as progress:
        base = workflows.model.base_model(robot, common.folder(robot.slug), progress)
    overwrite = earlier is not None and path.exists() and path.samefile(earlier.path)
    if not may_write(replace(common, force=True) if overwrite else common, path, inputs):
        # Why: a result would derive the model that is here already.
        stored = replace(dynid.loading.load_run(path), rigid=base.model.rigid)
        terminal.findings(
            (*(Finding(**each) for each in stored.header.get("log_findings", [])), *stored.findings)
        )
        return stored, base, []
    logs = recordings.read()
    facts = common.header(inputs)
    with terminal.progress() as progress:
        if logs:
            seen = workflows.parameters.observe(robot, logs, options, base=base, progress=progress)
            terminal.wrote(
                seen.save_stack(folder, common.header(workflows.inputs.of_observations(inputs)))
            )
        else:
            seen = workflows.parameters.load_observations(
                folder / "fullnumericregressor.npz", base, progress
            )
        result = workflows.identify.identify(
            robot, seen, options, update=earlier, progress=progress
        )
    wrote = workflows.results.save_result(folder, result, facts)
    terminal.wrote(*wrote)
    return result, base, wrote


# ---------------------------------------------------------------- printing
USED = {"physical": "the physical parameters", "plain": "the plain estimate"}


def add_payload(
    common: Common, folder: Path, payload: IdentifiedPayload, facts: dict[str, Any]
) -> None:
    """Write payload.yaml, print the load, and add it to the JSON answer."""
    common.terminal.findings(payload.findings())
    facts["payload"] = payload.facts()
    facts["findings"] = [*facts["findings"], *(asdict(finding) for finding in payload.findings())]
    # Why these keys: the text is what `tool:` of a robot file holds.
    body = {"mass": payload.body.mass, "com": list(payload.body.com)}
    tool = {**body, "inertia_com": facts["payload"]["inertia_com_kg_m2"]}
    path = folder / "payload.yaml"
    write_text(path, yaml_text({"tool": tool}))
    common.terminal.wrote(path)
    facts["wrote"] = [*facts["wrote"], path]
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


def explain(
    common: Common,
    result: Identification,
    recordings: Recordings,
    options: IdentifyOptions,
    base: BaseModel,
) -> list[dict[str, Any]]:
    """Print and return how far the parameters move with other cut-offs and another delay.

    Raises:
        WrongUsage: no log was given.
    """
    logs = recordings.read()
    if not logs:
        raise WrongUsage(
            "--explain needs the log", fix=f"dynid identify {base.robot.word} LOG --explain"
        )
    with common.terminal.progress() as progress:
        progress.stage("explain")
        answer = workflows.identify.sensitivity(result, logs, options, base=base, progress=progress)
    show_sensitivity(common, answer, len(base.reduction.base_names))
    return answer


def show_sensitivity(common: Common, answer: list[dict[str, Any]], count: int) -> None:
    """Print how far the parameters move with other cut-offs and another delay."""
    rows = [
        [
            row["variant"],
            f"{row['relative_error_percent']:.2f} %",
            f"{row['heldout_relative_error_percent']:.2f} %",
            f"{row['beyond_two_std_errors']} of {count}",
            f"{row['most_changed']} {row['before']:.3g} -> {row['after']:.3g} ({row['std_errors']:+.1f} std errors)",
        ]
        for row in answer
    ]
    common.terminal.answer()
    common.terminal.table(
        ["variant", "unexplained", "held out", "moved over 2 std errors", "most changed"], rows
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
    terminal.show(found.table())


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
