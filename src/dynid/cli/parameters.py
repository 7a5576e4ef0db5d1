"""``dynid parameters ROBOT LOG...``: the regressor on a log, before anything is identified."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.log_options import (
    base_model,
    hashes,
    reading_of,
    reading_options,
    reading_part,
    stack_logs,
    stack_sources,
)
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import Answer, ask, may_write
from dynid.cli.runfile import write_run

if TYPE_CHECKING:
    from dynid.estimation.stack import Stack
    from dynid.model.store import BaseModel
    from dynid.robot import Robot


@dynid_command(
    "parameters",
    repeatable=True,
    examples=(
        "dynid parameters kuka_lwr4plus run.bag             stack, ask, identify",
        "dynid parameters kuka_lwr4plus a.bag b.bag --cutoff 8",
    ),
)
@click.argument("robot")
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="LOG...")
@reading_options
@click.option("--identify/--no-identify", "identify_now", default=None, help="Identify afterwards without asking.")
def command(common: Common, robot: str, logs: tuple[Path, ...], identify_now: bool | None, **options: Any) -> None:  # noqa: ANN401
    """Filter logs, stack the base regressor over them, and say what they excite."""
    from dynid.files.robotfile import load_robot

    reading_of(options)  # wrong words end here, before anything is read
    arm = load_robot(robot)
    common.terminal.findings(arm.findings)
    while True:
        facts = stack_and_write(common, arm, logs, options)
        common.terminal.emit_json(facts)
        answer = ask(common, "P5", given=identify_now)
        if answer is not Answer.RETRY:
            break
        options["cutoff"] = click.prompt("cut-off [Hz] or auto", default="auto", err=True)
        common = replace(common, force=True)
    if answer is Answer.YES:
        from dynid.cli.identify import run_identify

        run_identify(common, robot, (), show=not common.json)
    else:
        common.terminal.next(f"dynid identify {robot}")


def stack_and_write(common: Common, robot: Robot, logs: tuple[Path, ...], options: dict[str, Any]) -> dict[str, Any]:
    """Stack logs, write fullnumericregressor.npz and estimatedmotion.npz, and return the answer."""
    from dynid.estimation import observation_files

    folder = common.folder(robot.slug)
    path = folder / "fullnumericregressor.npz"
    inputs = hashes(robot, logs, reading_part(options))
    base = base_model(common, robot)
    if not may_write(common, path, inputs):
        sources, header = observation_files.load(path)
        return answer_of(common, base, stack_sources(common, base, sources), header, [])
    stack, findings, timing = stack_logs(common, base, logs, options)
    header = {
        **common.header(inputs),
        "robot": robot.name,
        "key": robot.model_key,
        "log_sha256": [inputs[f"log {k + 1}"] for k in range(len(logs))],
        "logs": [str(log) for log in logs],
        "cutoff_hz": stack.sources[0].chosen.cutoff,
        **timing.facts(),
        "log_findings": [asdict(f) for f in findings],
    }
    wrote = write_stack(common, folder, base, stack, header)
    write_run(folder, inputs)
    return answer_of(common, base, stack, header, wrote)


def write_stack(common: Common, folder: Path, base: BaseModel, stack: Stack, header: dict[str, Any]) -> list[Path]:
    """Write fullnumericregressor.npz and, with the torques of the prior, estimatedmotion.npz."""
    import numpy as np

    from dynid.estimation import observation_files
    from dynid.estimation.estimate import prior_base
    from dynid.validate import predict

    observation_files.save(folder / "fullnumericregressor.npz", stack, header)
    prior = np.nan_to_num(prior_base(base))
    motions = [predict.predict(source, stack.rows_of_log(k), prior) for k, source in enumerate(stack.sources)]
    estimated = {
        **header,
        "joints": list(stack.joints),
        "torque_from": "the prior; dynid identify puts the identified torque here",
    }
    predict.save(folder / "estimatedmotion.npz", motions, estimated)
    wrote = [folder / "fullnumericregressor.npz", folder / "estimatedmotion.npz"]
    for path in wrote:
        common.terminal.wrote(path)
    return wrote


def answer_of(
    common: Common, base: BaseModel, stack: Stack, header: dict[str, Any], wrote: list[Path]
) -> dict[str, Any]:
    """Say what the log excites and return the JSON answer."""
    from dynid.estimation.estimate import prior_base
    from dynid.estimation.excitation import weakly_excited
    from dynid.estimation.least_squares import merge, solve

    solution = solve(merge(stack.whole[0]))
    weak = weakly_excited(base, stack, prior_base(base))
    chosen = stack.sources[0].chosen
    rank = f"rank {solution.rank} of {base.reduction.rank}"
    common.terminal.stage(
        "excites", f"{rank}, condition number {solution.condition_number_scaled:.3g} with normalised columns"
    )
    common.terminal.findings(weak)
    return {
        "schema": "dynid/parameters/1",
        "robot": base.robot.name,
        "samples": stack.samples,
        "rate_hz": chosen.rate,
        "cutoff_hz": chosen.cutoff,
        "kept_rate_hz": chosen.kept_rate,
        **{key: header.get(key) for key in ("delay_s", "delay_std_error_s", "delay_applied_s")},
        "rank": solution.rank,
        "structural_rank": base.reduction.rank,
        "condition_number": solution.condition_number,
        "condition_number_scaled": solution.condition_number_scaled,
        "findings": [*header["log_findings"], *(asdict(finding) for finding in weak)],
        "wrote": wrote,
    }
