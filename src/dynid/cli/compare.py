"""``dynid compare RUN...``: many results in one table, and whether an arm or a result has drifted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

import dynid
from dynid import workflows
from dynid.cli.judged import show_answer
from dynid.cli.options import Common, dynid_command
from dynid.disk import write_text
from dynid.errors import ExitStatus

if TYPE_CHECKING:
    from dynid.workflows.compare import ComparedRun, RunComparison

_FILE = click.Path(dir_okay=False, path_type=Path)
#: Rows of changed numbers that are shown without -v.
SHOWN = 12


@dynid_command(
    "compare",
    examples=(
        "dynid compare out/a out/b out/c                              one table",
        "dynid compare out/now --baseline out/january                 exit 1 when parameters changed significantly",
        "dynid compare out/now --baseline expected --tolerance 1%     exit 1 when a number moved by more: for CI",
    ),
)
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN...")
@click.option(
    "--baseline",
    type=click.Path(path_type=Path),
    metavar="RUN",
    help="What the runs are judged against.",
)
@click.option(
    "--tolerance",
    metavar="SHARE",
    help="Largest change of any number against the baseline; without it the noise is the measure.",
)
@click.option("--csv", type=_FILE, metavar="FILE", help="Write one row per run as CSV.")
@click.option("--latex", type=_FILE, metavar="FILE", help="Write a LaTeX table.")
@click.option("--junit", type=_FILE, metavar="FILE", help="Write a JUnit XML report.")
def command(
    common: Common,
    runs: tuple[Path, ...],
    baseline: Path | None,
    tolerance: str | None,
    **files: Path | None,
) -> ExitStatus:
    """Compare identification results: one table, drift of an arm, regression against a baseline."""
    found = workflows.compare.compare(
        [dynid.loading.load_run(run) for run in runs],
        baseline=None if baseline is None else dynid.loading.load_run(baseline),
        tolerance=tolerance,
        names=workflows.compare.short_names(
            [dynid.loading.parameters_of(run) for run in runs], runs
        ),
        baseline_name=str(baseline or ""),
    )
    wrote = {kind: path for kind in ("csv", "latex", "junit") if (path := files[kind]) is not None}
    for kind, path in wrote.items():
        write_text(path, getattr(found, kind)())
        common.terminal.wrote(path)
    show(common, found)
    common.terminal.emit_json({**found.facts(), "wrote": list(wrote.values())})
    return ExitStatus.DONE if found.passed else ExitStatus.LIMIT_NOT_MET


def show(common: Common, found: RunComparison) -> None:
    """Print what changed in each run, one row per run, and what to do next."""
    compared = [(run, run.judgement) for run in found.runs if run.reference or len(found.runs) == 1]
    for run, judged in compared:
        if len(compared) > 1:
            common.terminal.answer(run.name)
        show_answer(common, judged)
        show_changes(common, run)
    common.terminal.show(found.table())
    if found.baseline is not None:
        for run in found.runs:
            if run.drift:
                common.terminal.say(f"limit      {run.name}: {run.drift}")
    changed = [judged for run, judged in compared if run.changed]
    if changed:
        step = changed[0].steps[0]
        common.terminal.next(step.command, step.why)


def show_changes(common: Common, run: ComparedRun) -> None:
    """Print what changed against the reference."""
    table = run.table()
    most = len(table) if common.verbose else SHOWN
    common.terminal.show(table[:most])
    if len(table):
        common.terminal.answer()
    if len(table) > most:
        common.terminal.answer(f"and {len(table) - most} more; all with -v or --json")
