"""``dynid validate PARAMETERS LOG``: replay a log that was not used, and draw what comes out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import FILE, PATH, dynid_command, options_from
from dynid.cli.prompt import may_write
from dynid.cli.session import Session
from dynid.options import Options, option, share, unless
from dynid.runs import RunFolder
from dynid.workflows.options import ValidateOptions


@dataclass(frozen=True)
class Limits(Options):
    """Errors from which on the exit status is 1."""

    max_rms: float | None = option(
        None,
        "Exit 1 if the rms torque error of any joint is larger [N m or N].",
        metavar="NM",
        kind="float",
    )
    max_unexplained: float | None = option(
        None,
        "Exit 1 if the total relative torque error is larger.",
        metavar="SHARE",
        read=unless((), share),
    )


@dynid_command(
    "validate",
    examples=(
        "dynid validate out/kuka_lwr4plus other.bag",
        "dynid validate out/arm other.bag --max-unexplained 5%     exit 1 when worse",
        "dynid validate out/arm other.bag --mcap replay.mcap     for Foxglove, PlotJuggler, Rerun",
    ),
)
@click.argument("parameters", type=PATH)
@click.argument("log", type=PATH)
@options_from(ValidateOptions)
@options_from(Limits, "limits")
@click.option(
    "--mcap",
    type=FILE,
    metavar="FILE",
    help="Write measured, predicted and residual joint states with the arm's URDF for Foxglove, PlotJuggler and Rerun.",
)
@click.option("--plot/--no-plot", default=True, show_default=True, help="Draw the figures.")
def command(
    session: Session,
    parameters: Path,
    log: Path,
    options: ValidateOptions,
    limits: Limits,
    mcap: Path | None,
    plot: bool,
) -> Answer:
    """Compare predicted with measured torques on a recording that was not used to identify."""
    stored = dynid.loading.load_run(parameters)
    run = RunFolder.of(stored.path)
    if mcap is not None:
        may_write(session, mcap)
    base = workflows.model.base_model_of(stored, run.path)
    validation = workflows.validate.validate(stored, log, options, base=base)
    folder = validation.folder(run.path / "validation")
    wrote = [validation.save(folder), *(validation.write_figures(folder) if plot else [])]
    if mcap is not None:
        wrote.append(validation.save_mcap(mcap, workflows.validate.urdf_of(stored, base)))
    wrote += workflows.report.renewed(stored.path, base)
    return validation.answer(limits.max_rms, limits.max_unexplained, wrote)
