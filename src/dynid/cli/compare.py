"""``dynid compare RUN...``: many results in one table, and whether an arm or a result has drifted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import FILE, PATH, dynid_command, options_from
from dynid.cli.session import Session
from dynid.disk import write_text
from dynid.workflows.options import CompareOptions


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
) -> Answer:
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
    return replace(comparison.answer(), wrote=[*wrote.values()])
