"""``dynid validate PARAMETERS LOG``: replay a log that was not used, and draw what comes out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.log_options import READING_DEFAULTS, percent, read_sources, reading_of, reading_options
from dynid.cli.options import Common, dynid_command
from dynid.errors import ExitStatus, SameRecording

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.estimation.observation_rows import Rows
    from dynid.estimation.result import StoredResult
    from dynid.model.store import BaseModel
    from dynid.validate.metrics import JointCheck
    from dynid.validate.predict import EstimatedMotion


DEFAULTS: dict[str, Any] = READING_DEFAULTS | {
    "allow_training_data": False,
    "max_rms": None,
    "max_unexplained": None,
    "plot": True,
}


@dynid_command(
    "validate",
    examples=(
        "dynid validate out/kuka_lwr4plus/parameters.npz unseen.bag",
        "dynid validate out/arm/parameters.npz unseen.bag --max-unexplained 5%     exit 1 when worse",
    ),
)
@click.argument("parameters", type=click.Path(path_type=Path))
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--allow-training-data", is_flag=True, help="Accept the recording that was used to identify.")
@click.option(
    "--max-rms", type=click.FloatRange(min=0), metavar="NM", help="Exit 1 when a joint's rms error is larger."
)
@click.option("--max-unexplained", metavar="SHARE", help="Exit 1 when the total relative error is larger.")
@click.option("--plot/--no-plot", default=True, show_default=True, help="Draw the figures.")
@reading_options
def command(common: Common, parameters: Path, log: Path, **options: Any) -> ExitStatus:  # noqa: ANN401
    """Compare estimated with measured torques on a recording that the model has not seen."""
    facts = run_validate(common, parameters, log, **options)
    common.terminal.emit_json(facts)
    picture = f"look at {facts['wrote'][-1]}" if options["plot"] else f"dynid validate {parameters} {log} --plot"
    common.terminal.next(picture)
    return ExitStatus.DONE if facts["passed"] else ExitStatus.LIMIT_NOT_MET


def run_validate(common: Common, parameters: Path, log: Path, **given: Any) -> dict[str, Any]:  # noqa: ANN401
    """Replay a log, write and print what comes out, and return the JSON answer."""
    from dynid.cli.drive_gains import in_amperes
    from dynid.estimation import result
    from dynid.estimation.effect_columns import scaled
    from dynid.estimation.stack import rows_of
    from dynid.validate import metrics, predict

    options = DEFAULTS | given
    terminal = common.terminal
    stored = result.load(parameters)
    base = base_model_of(common, stored)
    sha = refuse_training_log(stored, log, allow=options["allow_training_data"])
    cutoff = options["cutoff"] if options["cutoff"] != "auto" else repr(stored.cutoff)
    delay = options["delay"] if options["delay"] != "auto" else repr(stored.delay)
    reading = reading_of({**options, "cutoff": cutoff, "delay": delay}, identify=False)
    sources = read_sources(common, base, (log,), reading)[0]
    source = scaled(sources, base, stored.identification.theta)[0]
    with terminal.progress() as progress:
        progress.stage("replay", "")
        rows = list(rows_of(source, base.model.observer(base.reduction.base)))
        motion = predict.predict(source, rows, stored.identification.theta)
        baseline, what = baseline_torque(base, stored, rows, motion)
        joints, total = metrics.check(motion, baseline, base.robot.joint_names)
        wrote = write_outputs(parameters.parent / "validation" / log.stem, base, motion, sha, log, options["plot"])
    passed = judged(common, joints, total, options["max_rms"], options["max_unexplained"])
    show(common, base, joints, total, what)
    for path in wrote:
        terminal.wrote(path)
    answer = {
        "schema": "dynid/validate/1",
        "robot": base.robot.name,
        "relative_error_percent": total,
        "joints": [
            {
                "joint": j.joint,
                "rms_nm": j.rms,
                "relative_error_percent": j.relative_percent,
                "baseline_rms_nm": j.baseline_rms,
            }
            for j in joints
        ],
        "baseline": what,
        "cutoff_hz": source.chosen.cutoff,
        "passed": passed,
        "wrote": wrote,
    }
    found: dict[str, Any] = in_amperes(answer, base.robot)
    return found


def base_model_of(common: Common, stored: StoredResult) -> BaseModel:
    """Return the model that a result was made with; its base parameters are those of the result, never found anew."""
    from dynid.model.store import BaseModel, obtain_model

    with common.terminal.progress() as progress:
        progress.stage("model", "")
        model, _ = obtain_model(stored.robot, stored.path.parent)
    return BaseModel(model, stored.reduction)


def refuse_training_log(stored: StoredResult, log: Path, *, allow: bool) -> str:
    """Return the log's hash, after refusing one that the result was made from."""
    from dynid.files.artifact import sha256
    from dynid.files.logs import read_log

    if not log.exists():
        read_log(log, robot=stored.robot)
    sha = sha256(log)
    if sha in stored.log_sha256 and not allow:
        raise SameRecording(f"{log} was used to identify {stored.path}", where=str(log))
    return sha


def baseline_torque(
    base: BaseModel, stored: StoredResult, rows: list[Rows], motion: EstimatedMotion
) -> tuple[NDArray[np.float64], str]:
    """Return what a simpler model predicts: the prior where the robot file has one, otherwise a constant torque."""
    import numpy as np

    if base.robot.prior is None:
        return np.broadcast_to(motion.tau_measured.mean(axis=0), motion.tau_measured.shape), "a constant torque"
    prior = np.nan_to_num(stored.identification.prior)
    return np.concatenate([part.W @ prior for part in rows]), "the prior of the robot file"


def write_outputs(
    folder: Path, base: BaseModel, motion: EstimatedMotion, sha: str, log: Path, plot: bool
) -> list[Path]:
    """Write estimatedmotion.npz and the figures."""
    from dynid.validate import predict

    robot = base.robot
    header = {
        "robot": robot.name,
        "joints": list(robot.joint_names),
        "log": str(log),
        "log_sha256": [sha],
        "torque_from": "identified",
    }
    predict.save(folder / "estimatedmotion.npz", [motion], header)
    wrote = [folder / "estimatedmotion.npz"]
    if plot:
        from dynid.report.figures import write_figures

        sliding = tuple(not joint.revolute for joint in robot.joints)
        wrote += write_figures(folder, motion, robot.joint_names, sliding, f"{robot.name}, {log.name}")
    return wrote


def judged(
    common: Common, joints: list[JointCheck], total: float, max_rms: float | None, max_unexplained: str | None
) -> bool:
    """Return whether the limits are met, and name those that are not."""
    passed = True
    for joint in joints:
        if max_rms is not None and joint.rms > max_rms:
            common.terminal.say(f"limit      {joint.joint}: rms error {joint.rms:.3g} N m > {max_rms:g}")
            passed = False
    if max_unexplained is not None and total > 100 * percent(max_unexplained, "--max-unexplained"):
        common.terminal.say(f"limit      total relative error {total:.2f} % > {max_unexplained}")
        passed = False
    return passed


def show(common: Common, base: BaseModel, joints: list[JointCheck], total: float, what: str) -> None:
    """Print the table."""
    rows = []
    for quality, joint in zip(joints, base.robot.joints, strict=True):
        unit = joint.torque_unit
        errors = (f"{quality.rms:.3g} {unit}", f"{quality.torque_rms:.3g} {unit}", f"{quality.relative_percent:.1f} %")
        rows.append([quality.joint, *errors, f"{quality.baseline_rms:.3g} {unit}"])
    common.terminal.table(["joint", "rms error", "torque rms", "unexplained", "baseline"], rows)
    common.terminal.answer(f"total relative error {total:.2f} %      baseline: {what}")
