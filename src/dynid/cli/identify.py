"""``dynid identify ROBOT [LOG...]``: base parameters from logs, with honest errors and a held-out figure."""

from __future__ import annotations

import re
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.log_options import (
    READING_DEFAULTS,
    base_model,
    hashes,
    option_texts,
    percent,
    read_sources,
    reading_of,
    reading_options,
    reading_part,
    stack_logs,
    stack_sources,
)
from dynid.cli.options import Common, dynid_command
from dynid.cli.prior_options import BELIEF_DEFAULTS, belief_options, believing
from dynid.cli.prompt import input_hashes, may_write
from dynid.cli.runfile import write_run
from dynid.errors import ExitStatus, LogNotFound, WrongUsage

if TYPE_CHECKING:
    from dynid.estimation.estimate import HoldOut
    from dynid.estimation.result import Identification, StoredResult
    from dynid.estimation.stack import Stack
    from dynid.model.store import BaseModel
    from dynid.robot import Robot

DEFAULTS: dict[str, Any] = READING_DEFAULTS | {
    "method": "auto",
    "holdout": "20%",
    "drop_weak": False,
    "feasible": None,
    **BELIEF_DEFAULTS,
    "explained": False,
    "payload_from": None,
    "update": None,
    "loaded": None,
    "load_mass": None,
}
#: Options that do not change the parameters, or that count through the file they name.
BESIDE = ("explained", "payload_from", "update")
#: Methods that depend on the controller of the robot file.
SIMULATED = ("idim-iv", "didim")


@dynid_command(
    "identify",
    repeatable=True,
    examples=(
        "dynid identify kuka_lwr4plus run.bag",
        "dynid identify kuka_lwr4plus a.bag b.bag --holdout c.bag",
        "dynid identify kuka_lwr4plus loaded.bag --payload-from out/kuka_lwr4plus/parameters.npz",
        "dynid identify kuka_lwr4plus new.bag --update out/kuka_lwr4plus/parameters.npz",
        "dynid identify my_arm currents.npz --loaded loaded.npz --load-mass 2.5      gains of the drives",
        "dynid identify kuka_lwr4plus run.bag --fail-if 'max_rms_nm > 1.5'      for CI",
    ),
)
@click.argument("robot")
@click.argument("logs", nargs=-1, type=click.Path(path_type=Path), metavar="[LOG...]")
@click.option(
    "--method",
    type=click.Choice(["auto", "wls", "ols", "irls", "iv", "idim-iv", "didim", "ridge"]),
    default="auto",
    show_default=True,
    help="Estimator; auto takes what the log offers and says why.",
)
@click.option(
    "--feasible/--no-feasible",
    default=None,
    help="Put the physically possible set in force, or the plain estimate (default: by prior and held-out rows).",
)
@click.option(
    "--holdout", metavar="SHARE|LOG|none", default=DEFAULTS["holdout"], show_default=True, help="Rows kept back."
)
@click.option("--drop-weak", is_flag=True, help="Go on when the log does not determine all parameters, or only just.")
@click.option(
    "--explain", "explained", is_flag=True, help="Show how cut-off and delay change the parameters; needs a LOG."
)
@click.option(
    "--payload-from",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="RESULT",
    help="parameters.npz without the load: find the body that the LOG has in addition on the last link.",
)
@click.option("--report/--no-report", default=False, show_default=True, help="Write report.html as well.")
@click.option(
    "--loaded",
    type=click.Path(path_type=Path),
    metavar="LOG",
    help="Motor currents with a load of known mass: find the gains of all drives.",
)
@click.option("--load-mass", type=click.FloatRange(min=0, min_open=True), metavar="KG", help="Of that load.")
@click.option(
    "--update",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="RESULT",
    help="Add the LOG to this parameters.npz, whose own logs are not needed; it may be overwritten.",
)
@belief_options
@click.option("--fail-if", metavar="EXPR", multiple=True, help="Exit 1 when it holds, such as 'max_rms_nm > 1.5'.")
@reading_options
def command(
    common: Common,
    robot: str,
    logs: tuple[Path, ...],
    fail_if: tuple[str, ...],
    report: bool,
    **options: Any,  # noqa: ANN401
) -> ExitStatus:
    """Identify the base parameters of an arm by least squares."""
    limits = [parsed_limit(text) for text in fail_if]
    facts = run_identify(common, robot, logs, **options)
    write_run(Path(facts["folder"]), facts["inputs"])
    if report:
        from dynid.cli.report import write_report

        write_report(common, Path(facts["folder"]) / "parameters.npz")
    return ExitStatus.LIMIT_NOT_MET if sum(broken(common, facts, *limit) for limit in limits) else ExitStatus.DONE


def run_identify(
    common: Common,
    robot: str,
    logs: tuple[Path, ...],
    *,
    show: bool = True,
    final: bool = True,
    **given: Any,  # noqa: ANN401
) -> dict[str, Any]:
    """Identify, write the results, print them, and return the JSON answer.

    Args:
        common: the common options.
        robot: name or path of the robot file.
        logs: recordings; () for the stack that ``dynid parameters`` wrote.
        show: print the tables.
        final: print the JSON answer and the next command as well; not when another command goes on.
        given: options, as on the command line.
    """
    from dynid.cli.drive_gains import in_amperes, with_gains
    from dynid.cli.payload import add_payload, as_before
    from dynid.cli.sensitivity import explain
    from dynid.estimation import result as results
    from dynid.files.robotfile import load_robot

    options = DEFAULTS | given
    check_words(options)
    unloaded, earlier = (results.load(options[key]) if options[key] else None for key in ("payload_from", "update"))
    if before := unloaded or earlier:
        options = as_before(options, before)
    arm = believing(load_robot(robot), options)
    common.terminal.findings(arm.findings)
    folder = common.folder(arm.slug)
    if unloaded is not None:
        folder = common.out or folder.with_name(f"{folder.name}_loaded")
    arm, gains = with_gains(common, arm, folder, logs, options)
    if arm.torque.relative and options["feasible"] is None:
        # Why: a prior in kg cannot be put beside parameters whose size is unknown.
        options = {**options, "feasible": False}
    inputs = needed_inputs(arm, folder, logs, options)
    base = base_model(common, arm)
    path = folder / "parameters.npz"
    found, wrote, header = obtain_result(common, base, folder, logs, options, inputs, earlier)
    timing = {key: header.get(key) for key in TIMING}
    facts = {**answer_of(base, found, wrote), **timing, **gains, "folder": folder, "inputs": inputs}
    if show:
        show_result(common, base, found)
    if unloaded is not None:
        add_payload(common, folder, found, unloaded, facts)
    if options["explained"]:
        if not logs:
            raise WrongUsage("--explain needs the log", fix=f"dynid identify {robot} LOG --explain")
        facts["explain"] = explain(common, base, logs, options, found, header)
    if show and final:
        common.terminal.emit_json(in_amperes(facts, arm))
        common.terminal.next(f"dynid validate {path} LOG      (a log that was not used here)")
    return facts


def obtain_result(
    common: Common,
    base: BaseModel,
    folder: Path,
    logs: tuple[Path, ...],
    options: dict[str, Any],
    inputs: dict[str, str],
    earlier: StoredResult | None,
) -> tuple[Identification, list[Path], dict[str, Any]]:
    """Return the result with what was written and its header: a new one, or the one that is there from equal inputs."""
    from dynid.estimation import result as results

    path = folder / "parameters.npz"
    overwrite = earlier is not None and path.exists() and path.samefile(earlier.path)
    if not may_write(replace(common, force=True) if overwrite else common, path, inputs):
        stored = results.load(path)
        return stored.identification, [], stored.header
    stack, header = obtain_stack(common, base, folder, logs, options, inputs)
    if earlier is not None:
        stack, header = updated(stack, header, earlier, options)
    found = fitted(common, base, stack, {**options, "delay": repr(header.get("delay_applied_s") or 0.0)})
    return found, write_results(common, folder, base, stack, found, {**common.header(inputs), **header}), header


def updated(
    stack: Stack, header: dict[str, Any], earlier: StoredResult, options: dict[str, Any]
) -> tuple[Stack, dict[str, Any]]:
    """Return the new logs' stack and header with what an earlier result was made from."""
    from dynid.estimation.recursive import UPDATABLE, with_earlier

    if options["method"] not in ("auto", *UPDATABLE):
        raise WrongUsage(
            f"--method {options['method']} needs the single rows of the earlier log, which a result does not keep",
            fix=f"one of {', '.join(UPDATABLE)}; or identify from all logs at once",
        )
    again = set(header["log_sha256"]) & set(earlier.log_sha256)
    if again:
        raise WrongUsage(f"{earlier.path} was made from this log already", fix="give a log that it does not hold yet")
    both = {key: [*earlier.header[key], *header[key]] for key in ("log_sha256", "logs")}
    return with_earlier(stack, earlier), {**header, **both}


def needed_inputs(robot: Robot, folder: Path, logs: tuple[Path, ...], options: dict[str, Any]) -> dict[str, str]:
    """Return the hashes that the result depends on; without logs, those of the stack that is there."""
    from dynid.files.artifact import read_header

    gains = option_texts({"controller": robot.controller if options["method"] in SIMULATED else None})
    if logs:
        made_of = {key: value for key, value in options.items() if key not in BESIDE}
        return hashes(robot, logs, made_of) | gains | hashes_of_files(options)
    path = folder / "fullnumericregressor.npz"
    header = read_header(path) if path.is_file() else None
    if header is None:
        raise LogNotFound(f"no log given, and there is no {path}", fix=f"dynid identify {robot.slug} LOG")
    if header.get("key") != robot.model_key:
        raise LogNotFound(
            f"{path} belongs to another version of the robot file", fix=f"dynid parameters {robot.slug} LOG"
        )
    inputs = dict(header["inputs"])
    for name, text in option_texts(reading_part(options)).items():
        if text not in (inputs.get(name), *option_texts({name: READING_DEFAULTS[name]}).values()):
            raise WrongUsage(
                f"{name} is {inputs.get(name) or 'not set'} in {path}, not {text}",
                why="without logs, the stack that dynid parameters wrote is used as it is",
                fix=f"name the logs: dynid identify {robot.slug} LOG --{name.replace('_', '-')} {text}",
            )
    fit = {key: options[key] for key in DEFAULTS if key not in (*READING_DEFAULTS, *BESIDE)}
    return inputs | option_texts(fit) | gains | hashes_of_files(options)


def hashes_of_files(options: dict[str, Any]) -> dict[str, str]:
    """Return the hashes of the other files that a result depends on: held-out log, loaded log, prior."""
    named = {key: Path(options[key]) for key in ("loaded", "prior_file", "update") if options[key]}
    if _is_log(options["holdout"]):
        named["holdout"] = Path(options["holdout"])
    return input_hashes({key: path for key, path in named.items() if path.exists()})


def check_words(options: dict[str, Any]) -> None:
    """Raise for values that no log could make sense of, before anything is read or written."""
    reading_of(options)
    if options["holdout"] != "none" and not _is_log(options["holdout"]):
        percent(options["holdout"], "--holdout")


def _is_log(text: str) -> bool:
    return text != "none" and not re.fullmatch(r"[\d.]+%?", text)


def obtain_stack(
    common: Common,
    base: BaseModel,
    folder: Path,
    logs: tuple[Path, ...],
    options: dict[str, Any],
    inputs: dict[str, str],
) -> tuple[Stack, dict[str, Any]]:
    """Return the stack of the given logs, or of ``dynid parameters``."""
    from dynid.estimation import observation_files
    from dynid.estimation.effect_columns import settled

    if logs:
        stack, findings, timing = stack_logs(common, base, logs, options)
        header = {
            "robot": base.robot.name,
            "key": base.robot.model_key,
            "log_sha256": [inputs[f"log {k + 1}"] for k in range(len(logs))],
            "logs": [str(log) for log in logs],
            "cutoff_hz": stack.sources[0].chosen.cutoff,
            "log_findings": [asdict(f) for f in findings],
            **timing.facts(),
        }
        of_stack = hashes(base.robot, logs, reading_part(options))
        observation_files.save(folder / "fullnumericregressor.npz", stack, {**common.header(of_stack), **header})
        common.terminal.wrote(folder / "fullnumericregressor.npz")
        return stack, header
    path = folder / "fullnumericregressor.npz"
    sources, stored = observation_files.load(path)
    sources = settled(sources, base)
    common.terminal.stage("log", f"from {path}: {', '.join(stored['logs'])}")
    header = {key: stored[key] for key in ("robot", "key", "log_sha256", "logs", "cutoff_hz", "log_findings")}
    header |= {key: stored.get(key) for key in TIMING}
    return stack_sources(common, base, sources), header


def believes(options: dict[str, Any]) -> bool:
    """Return whether any option says what is believed of the bodies."""
    return any(options[key] != value for key, value in BELIEF_DEFAULTS.items())


def fitted(common: Common, base: BaseModel, stack: Stack, options: dict[str, Any]) -> Identification:
    """Fit the stack."""
    from dynid.estimation.estimate import estimate

    holdout = held_out(common, base, stack, options)
    found = estimate(
        stack,
        base,
        method=options["method"],
        holdout=holdout,
        # Why: who says what to believe has an answer for what the log leaves open.
        drop_weak=options["drop_weak"] or options["feasible"] is True or believes(options),
        feasible=options["feasible"],
    )
    common.terminal.stage("estimate", f"{METHOD_TEXT[found.method]}; {found.why}")
    common.terminal.stage("", f"{len(found.names)} base parameters; held out: {found.heldout}")
    scaled, raw = found.condition_number_scaled, found.condition_number
    condition = f"condition number {scaled:.3g} with normalised columns ({raw:.3g} without)"
    common.terminal.stage("excited", condition)
    common.terminal.findings(found.findings)
    return found


TIMING = ("delay_s", "delay_std_error_s", "delay_applied_s")
IN_FORCE = {"physical": "the physical set", "plain": "the plain estimate"}
METHOD_TEXT = {
    "wls": "weighted least squares, one noise level a joint",
    "ols": "ordinary least squares",
    "irls": "weighted least squares that gives spikes little weight (Huber)",
    "iv": "instrumental variables from the commanded motion",
    "idim-iv": "instrumental variables from the arm simulated under its controller",
    "didim": "torques of the arm simulated under its controller, fitted to the measured ones",
    "ridge": "weighted least squares with a pull towards the prior's base parameters",
}


def held_out(common: Common, base: BaseModel, stack: Stack, options: dict[str, Any]) -> HoldOut | None:
    """Return what is held out, as --holdout says."""
    import numpy as np

    from dynid.estimation.effect_columns import scaled
    from dynid.estimation.estimate import HoldOut, last_share
    from dynid.estimation.least_squares import weighted

    text = options["holdout"]
    if text == "none":
        return None
    if not _is_log(text):
        return last_share(stack, percent(text, "--holdout"))
    reading = reading_of({**options, "cutoff": str(stack.sources[0].chosen.cutoff), "exclude": ()})
    sources, _ = read_sources(common, base, (Path(text),), reading)
    test = stack_sources(common, base, scaled(sources, base, weighted(*stack.whole).theta))
    return HoldOut(np.ones(stack.blocks, dtype=bool), test, np.ones(test.blocks, dtype=bool), text)


def write_results(
    common: Common, folder: Path, base: BaseModel, stack: Stack, found: Identification, header: dict[str, Any]
) -> list[Path]:
    """Write parameters.npz, parameters.yaml and estimatedmotion.npz."""
    from dynid.estimation import result
    from dynid.validate import predict

    motions = [predict.predict(source, stack.rows_of_log(k), found.theta) for k, source in enumerate(stack.sources)]
    predict.save(
        folder / "estimatedmotion.npz", motions, {**header, "joints": list(stack.joints), "torque_from": "identified"}
    )
    facts = {
        "schema": "dynid/parameters-table/1",
        "robot": base.robot.name,
        "logs_sha256": list(header["log_sha256"]),
        "method": found.method,
        "cutoff_hz": float(f"{header['cutoff_hz']:.6g}"),
        "coulomb": {"shape": base.robot.coulomb_shape.shape, "velocity": list(base.robot.coulomb_shape.velocity)},
        "relative_error_percent": float(f"{found.relative_error_percent:.4g}"),
    }
    # Why last: parameters.npz is what later commands look for, so it appears only when everything else is there.
    result.write_yaml(folder / "parameters.yaml", found, base, facts)
    result.save(folder / "parameters.npz", found, base, header)
    wrote = [folder / name for name in ("estimatedmotion.npz", "parameters.yaml", "parameters.npz")]
    for path in wrote:
        common.terminal.wrote(path)
    return wrote


def answer_of(base: BaseModel, found: Identification, wrote: list[Path]) -> dict[str, Any]:
    """Return the JSON answer."""
    from dynid.estimation.result import parameter_table

    joints = [
        {
            "joint": j.joint,
            "rms_nm": j.rms,
            "relative_error_percent": j.relative_percent,
            "heldout_rms_nm": j.heldout_rms,
        }
        for j in found.joints
    ]
    return {
        "schema": "dynid/identify/1",
        "robot": base.robot.name,
        "method": found.method,
        "rank": found.rank,
        "samples": found.samples,
        "condition_number": found.condition_number,
        "condition_number_scaled": found.condition_number_scaled,
        "relative_error_percent": found.relative_error_percent,
        "heldout": found.heldout,
        "heldout_relative_error_percent": found.heldout_relative_error_percent,
        "joints": joints,
        "parameters": parameter_table(found, base),
        "physically_consistent": found.in_force == "physical",
        "in_force": found.in_force,
        "heldout_relative_error_percent_by_set": found.heldout_by_set,
        "links": found.physical.links(),
        "findings": [asdict(f) for f in found.findings],
        "wrote": wrote,
    }


def show_result(common: Common, base: BaseModel, found: Identification) -> None:
    """Print the table of joints, the list of parameters and how well they are known."""
    terminal = common.terminal
    torque = base.robot.torque
    units = ["A" if torque.relative else joint.torque_unit for joint in base.robot.joints]
    sizes = torque.gain if torque.relative and torque.gain else (1.0,) * base.robot.n
    rows = []
    for quality, unit, size in zip(found.joints, units, sizes, strict=True):
        held = "-" if quality.heldout_rms is None else f"{quality.heldout_rms / (size or 1.0):.3g} {unit}"
        rows.append(
            [
                quality.joint,
                f"{quality.rms / (size or 1.0):.3g} {unit}",
                f"{quality.torque_rms / (size or 1.0):.3g} {unit}",
                f"{quality.relative_percent:.1f} %",
                held,
            ]
        )
    terminal.table(["joint", "rms error", "torque rms", "unexplained", "held out"], rows)
    held_total = found.heldout_relative_error_percent
    total = f"total relative error {found.relative_error_percent:.2f} %"
    terminal.answer(total + (f", held out {held_total:.2f} % ({found.heldout})" if held_total is not None else ""))
    terminal.answer()
    terminal.table(["parameter", "value", "std error", "unit", "class", "known", "prior"], parameter_rows(base, found))
    counts = {word: found.knowledge.count(word) for word in ("well", "roughly", "not determined")}
    terminal.answer()
    full = found.physical
    mass = sum(value for name, value in zip(full.names, full.x, strict=True) if re.fullmatch(r"m\d+", name))
    terminal.fact("physical", f"full set of links in parameters.npz, {mass:.3g} kg in all")
    terminal.fact("in force", f"{IN_FORCE[found.in_force]}: {found.choice}")
    terminal.fact(
        "known",
        f"{counts['well']} well, {counts['roughly']} roughly, {counts['not determined']} not determined by this log",
    )


def parameter_rows(base: BaseModel, found: Identification) -> list[list[str]]:
    """Return one line a base parameter, with the digits that its error leaves."""
    from dynid.estimation.result import parameter_table

    rows = []
    for row in parameter_table(found, base):
        error = row["std_error"]
        value = "not determined" if error is None else f"{row['value']:.4g}"
        # Why: a centre of mass turned into its DH frame is off an axis by rounding, such as -2.1e-20.
        prior = "-" if row["prior"] is None else f"{row['prior']:.4g}" if abs(row["prior"]) > ROUNDING else "0"
        rows.append(
            [
                row["name"],
                value,
                "-" if error is None else f"{error:.2g}",
                row["unit"],
                row["class"],
                row["known"],
                prior,
            ]
        )
    return rows


#: Believed values below this are zero.
ROUNDING = 1e-12
LIMIT = re.compile(r"\s*([a-z_]+)\s*(<=|>=|<|>)\s*([-+0-9.eE]+)\s*")
#: Figures that --fail-if may name.
FIGURES = (
    "condition_number", "condition_number_scaled", "heldout_relative_error_percent", "max_heldout_rms_nm",
    "max_rms_nm", "rank", "relative_error_percent", "samples",
)  # fmt: skip


def parsed_limit(text: str) -> tuple[str, str, float]:
    """Read a limit such as ``max_rms_nm > 1.5``."""
    from dynid.files.yamlfile import closest

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
        raise WrongUsage(f"--fail-if: no figure '{name}'{closest(name, FIGURES)}", fix=f"one of {', '.join(FIGURES)}")
    return name, sign, limit


def broken(common: Common, facts: dict[str, Any], name: str, sign: str, limit: float) -> bool:
    """Return whether a limit is broken, and say so."""
    held = [joint["heldout_rms_nm"] for joint in facts["joints"] if joint["heldout_rms_nm"] is not None]
    values = {
        **facts,
        "max_rms_nm": max(joint["rms_nm"] for joint in facts["joints"]),
        "max_heldout_rms_nm": max(held, default=None),
    }
    value = values[name]
    if value is None:
        raise WrongUsage(f"--fail-if: nothing is held out, so there is no {name}", fix="--holdout 20%")
    holds = bool({"<": value < limit, ">": value > limit, "<=": value <= limit, ">=": value >= limit}[sign])
    if holds:
        common.terminal.say(f"limit      {name} = {value:.4g} {sign} {limit:g}")
    return holds
