"""``dynid validate PARAMETERS LOG``: replay a log that was not used, and draw what comes out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.cli.arguments import NumberInRange, options_from, options_of
from dynid.cli.judged import show_judgement, show_next
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import may_write
from dynid.cli.report import renewed
from dynid.errors import ExitStatus
from dynid.options import share_or_none
from dynid.workflows.options import ValidateOptions

if TYPE_CHECKING:
    from dynid.workflows.validate import Validation


@dynid_command(
    "validate",
    examples=(
        "dynid validate out/kuka_lwr4plus unseen.bag",
        "dynid validate out/arm unseen.bag --max-unexplained 5%     exit 1 when worse",
        "dynid validate out/arm unseen.bag --mcap replay.mcap     for Foxglove, PlotJuggler, Rerun",
    ),
)
@click.argument("parameters", type=click.Path(path_type=Path))
@click.argument("log", type=click.Path(path_type=Path))
@options_from(ValidateOptions)
@click.option(
    "--max-rms",
    type=NumberInRange(min=0),
    metavar="NM",
    help="Exit 1 if the rms torque error of any joint is larger [N m or N].",
)
@click.option(
    "--max-unexplained",
    metavar="SHARE",
    help="Exit 1 if the total relative torque error is larger.",
)
@click.option(
    "--mcap",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Write measured, predicted and residual joint states with the arm's URDF for Foxglove, PlotJuggler and Rerun.",
)
@click.option("--plot/--no-plot", default=True, show_default=True, help="Draw the figures.")
def command(
    common: Common,
    parameters: Path,
    log: Path,
    plot: bool,
    mcap: Path | None,
    **values: Any,  # noqa: ANN401
) -> ExitStatus:
    """Compare predicted with measured torques on a recording that was not used to identify."""
    limits = {key: values.pop(key) for key in ("max_rms", "max_unexplained")}
    facts = run_validate(
        common, parameters, log, options_of(ValidateOptions, values), plot=plot, mcap=mcap, **limits
    )
    common.terminal.emit_json(facts)
    return ExitStatus.DONE if facts["passed"] else ExitStatus.LIMIT_NOT_MET


def run_validate(
    common: Common,
    parameters: Path,
    log: Path,
    options: ValidateOptions | None = None,
    *,
    max_rms: float | None = None,
    max_unexplained: str | None = None,
    plot: bool = True,
    mcap: Path | None = None,
    final: bool = True,
) -> dict[str, Any]:
    """Replay a log, write and print what comes out, and return the JSON answer.

    Args:
        common: the common options.
        parameters: the result.
        log: the recording.
        options: how it is replayed.
        max_rms: largest rms error of a joint that is no broken limit [N m or N].
        max_unexplained: largest total relative error, as a share.
        plot: whether figures are drawn.
        mcap: file for viewers.
        final: say the next command as well; not when another command goes on.
    """
    options = options or ValidateOptions()
    terminal = common.terminal
    largest = share_or_none(max_unexplained, "--max-unexplained")
    stored = dynid.loading.load_run(parameters)
    parent = stored.path.parent
    if mcap is not None:
        may_write(common, mcap, {})
    with terminal.progress() as progress:
        base = workflows.results.base_model_of(stored, parent, progress)
        progress.stage("read")
        found = workflows.validate.validate(
            stored,
            dynid.loading.read_log(log, stored.robot, options),
            options,
            base=base,
            progress=progress,
        )
        folder = found.folder(parent / "validation")
        wrote = [found.save(folder), *(found.write_figures(folder) if plot else [])]
        if mcap is not None:
            wrote.append(found.save_mcap(mcap, workflows.validate.urdf_of(stored, base)))
    broken = found.broken_limits(max_rms, largest)
    for sentence in broken:
        terminal.say(f"limit      {sentence}")
    show(common, found)
    terminal.wrote(*wrote)
    wrote += renewed(common, stored.path, base)
    if final:
        show_next(common, found.judgement)
    return {**found.facts(), "passed": not broken, "wrote": wrote}


def show(common: Common, found: Validation) -> None:
    """Print the answer, why, and the table of joints."""
    show_judgement(common, found.judgement)
    rows = []
    for quality, joint in zip(found.joints, found.robot.joints, strict=True):
        unit = joint.torque_unit
        if not quality.torque_rms:
            rows.append([quality.joint, *"----"])
            continue
        percent = f"{quality.relative_percent:.1f} %"
        errors = (f"{quality.rms:.3g} {unit}", f"{quality.torque_rms:.3g} {unit}", percent)
        rows.append([quality.joint, *errors, f"{quality.baseline_rms:.3g} {unit}"])
    common.terminal.table(["joint", "rms error", "torque rms", "unexplained", "baseline"], rows)
    common.terminal.sentence(
        f"total relative error {found.relative_error_percent:.2f} %; baseline: {found.baseline}"
    )
