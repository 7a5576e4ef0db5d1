"""``dynid compare RUN...``: many results in one table, and whether an arm or a result has drifted."""

from __future__ import annotations

from pathlib import Path

import click

import dynid
from dynid import workflows
from dynid.cli.options import FILE, PATH, Answered, dynid_command, options_from
from dynid.cli.session import Session
from dynid.disk import write_text
from dynid.workflows.options import CompareOptions

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
@click.argument("runs", nargs=-1, required=True, type=PATH, metavar="RUN...")
@click.option(
    "--baseline", type=PATH, metavar="RUN", help="Result that the runs are compared with."
)
@options_from(CompareOptions)
@click.option("--csv", type=FILE, metavar="FILE", help="Write one row per run as CSV.")
@click.option("--latex", type=FILE, metavar="FILE", help="Write a LaTeX table.")
@click.option("--junit", type=FILE, metavar="FILE", help="Write a JUnit XML report.")
def command(
    session: Session,
    runs: tuple[Path, ...],
    baseline: Path | None,
    options: CompareOptions,
    **files: Path | None,
) -> Answered:
    """Compare identification results: one table, drift of an arm, regression against a baseline."""
    paths = [dynid.loading.parameters_of(run) for run in runs]
    comparison = workflows.compare.compare(
        paths,
        baseline=baseline,
        tolerance=options.tolerance,
        names=workflows.compare.short_names(paths, runs),
        baseline_name=str(baseline or ""),
    )
    wrote = {kind: path for kind, path in files.items() if path is not None}
    for kind, path in wrote.items():
        write_text(path, getattr(comparison, kind)())
        session.wrote(path)
    judgements = [
        (run, run.judgement)
        for run in comparison.runs
        if run.reference or len(comparison.runs) == 1
    ]
    for run, judgement in judgements:
        if len(judgements) > 1:
            session.answer(run.name)
        session.judgement(judgement)
        changes = run.table()
        shown = changes if session.verbose else changes[:SHOWN]
        session.table(shown)
        if changes:
            session.answer()
        if len(changes) > len(shown):
            session.answer(f"and {len(changes) - SHOWN} more; all with -v or --json")
    session.table(comparison.table())
    for run in comparison.runs if comparison.baseline is not None else ():
        if run.drift:
            session.say(f"limit      {run.name}: {run.drift}")
    steps = [judgement.steps[0] for run, judgement in judgements if run.changed]
    for step in steps[:1]:
        session.next(step.command, step.why)
    return {**comparison.facts(), "wrote": list(wrote.values())}, not comparison.passed
