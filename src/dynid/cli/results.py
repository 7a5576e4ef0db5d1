"""Commands on results: validate, compare, report, export."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import click

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import FILE, PATH, dynid_command, options_from
from dynid.cli.prompt import may_write, write_once
from dynid.cli.session import Session
from dynid.disk import write_text
from dynid.runs import RunFolder
from dynid.workflows.options import FORMATS, CompareOptions, ExportOptions, ValidateOptions


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
@click.option(
    "--mcap",
    type=FILE,
    metavar="FILE",
    help="Write measured, predicted and residual joint states with the arm's URDF for Foxglove, PlotJuggler and Rerun.",
)
@click.option("--plot/--no-plot", default=True, show_default=True, help="Draw the figures.")
def validate_command(
    session: Session,
    parameters: Path,
    log: Path,
    options: ValidateOptions,
    mcap: Path | None,
    plot: bool,
) -> Answer:
    """Compare predicted with measured torques on a recording that was not used to identify."""
    stored = dynid.loading.load_run(parameters)
    run = RunFolder.of(stored.path)
    if mcap is not None:
        may_write(session, mcap)
    validation = dynid.validate(stored, log, options)
    folder = validation.folder(run.path / "validation")
    wrote = [validation.save(folder), *(validation.write_figures(folder) if plot else [])]
    if mcap is not None:
        wrote.append(validation.save_mcap(mcap, workflows.validate.urdf_of(stored)))
    wrote += workflows.report.renewed(stored.path)
    return replace(validation.answer(), wrote=wrote)


@dynid_command(
    "compare",
    examples=(
        "dynid compare out/a out/b out/c                              one table",
        "dynid compare out/now --baseline out/january                 exit 1 when parameters changed significantly",
        "dynid compare out/now --baseline expected --tolerance 1%     exit 1 when a number moved by more: for CI",
    ),
)
@click.argument("runs", nargs=-1, required=True, type=PATH, metavar="RUN...")
@click.option(
    "--baseline", type=PATH, metavar="RUN", help="Result that the runs are compared with."
)
@options_from(CompareOptions)
@click.option("--csv", type=FILE, metavar="FILE", help="Write one row per run as CSV.")
@click.option("--latex", type=FILE, metavar="FILE", help="Write a LaTeX table.")
@click.option("--junit", type=FILE, metavar="FILE", help="Write a JUnit XML report.")
def compare_command(
    session: Session,
    runs: tuple[Path, ...],
    baseline: Path | None,
    options: CompareOptions,
    **files: Path | None,
) -> Answer:
    """Compare identification results: one table, drift of an arm, regression against a baseline."""
    comparison = dynid.compare(runs, baseline=baseline, tolerance=options.tolerance)
    wrote = {kind: path for kind, path in files.items() if path is not None}
    for kind, path in wrote.items():
        write_text(path, getattr(comparison, kind)())
    return replace(comparison.answer(), wrote=[*wrote.values()])


@dynid_command(
    "report",
    examples=(
        "dynid report out/kuka_lwr4plus               writes report.html and summary.md there",
        "dynid report out/kuka_lwr4plus --open        and shows it in the browser",
    ),
)
@click.argument("run", type=PATH)
@click.option("--open/--no-open", default=False, help="Open it in the browser.")
def report_command(session: Session, run: Path, open: bool) -> Answer:
    """Make the report of a result again."""
    stored = dynid.loading.load_run(run)
    made = workflows.report.report(stored)
    wrote = made.save(session.out or stored.path.parent)
    if open:
        click.launch(str(wrote[0].resolve()))
    return replace(made.answer(), wrote=wrote)


@dynid_command(
    "export",
    examples=(
        "dynid export out/kuka_lwr4plus --format urdf",
        "dynid export out/kuka_lwr4plus --format urdf --urdf lwr.urdf       your own file, new inertial blocks",
        "dynid export out/kuka_lwr4plus --format c --format python",
        "dynid export out/kuka_lwr4plus --format mjcf --draws 100       arms for randomisation",
    ),
)
@click.argument("run", type=PATH)
@click.option(
    "--format",
    type=click.Choice([*FORMATS, "all"]),
    multiple=True,
    required=True,
    help="Format to write; may be given several times.",
)
@options_from(ExportOptions)
def export_command(
    session: Session, run: Path, format: tuple[str, ...], options: ExportOptions
) -> Answer:
    """Write the identified model as URDF, MJCF, YAML, C, Python or MATLAB."""
    stored = dynid.loading.load_run(run)
    made = workflows.export.export(
        stored,
        session.out or stored.path.parent,
        options,
        formats=[name for name in FORMATS if name in format or "all" in format],
        seed=session.seed,
        write=partial(write_once, session),
    )
    return made.answer()
