"""Results as text for other programs: CSV, LaTeX, and JUnit XML for continuous integration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dynid.answer import picked
from dynid.estimation.result import Identification
from dynid.reports.templating import rendered
from dynid.table import with_error
from dynid.text import csv_row, latex


@dataclass(frozen=True)
class JunitCase:
    """One line of a test report.

    Attributes:
        name: what was checked.
        group: what it belongs to, such as the robot.
        failure: why it failed; empty when it passed.
        seconds: how long it took.
        error: whether it could not be checked at all.
    """

    name: str
    group: str
    failure: str = ""
    seconds: float = 0.0
    error: bool = False


def junit(suite: str, cases: Sequence[JunitCase]) -> str:
    """Return a JUnit XML report."""
    return rendered("junit.xml", suite=suite, cases=cases) + "\n"


#: What of a result stands before its parameters.
FIGURES = (
    "method",
    "rank",
    "condition_number_scaled",
    "relative_error_percent",
    "heldout_relative_error_percent",
)


def run_rows(names: Sequence[str], runs: Sequence[Identification]) -> list[dict[str, Any]]:
    """Return one row per run: figures, then every parameter with its standard error; None where a run has none."""
    parameters = list(dict.fromkeys(name for run in runs for name in run.names))
    rows = []
    for label, run in zip(names, runs, strict=True):
        row = {"run": label, "robot": run.robot.name, **picked(run, *FIGURES)}
        known = {each["name"]: each for each in run.parameter_rows()}
        for name in parameters:
            own = known.get(name, {})
            row |= {name: own.get("value"), f"{name}_std_error": own.get("std_error")}
        rows.append(row)
    return rows


def runs_csv(names: Sequence[str], runs: Sequence[Identification]) -> str:
    """Return one row per run as CSV; empty where a run has no value."""
    rows = run_rows(names, runs)
    return "\n".join([csv_row(rows[0]), *(csv_row(row.values()) for row in rows), ""])


def runs_latex(names: Sequence[str], runs: Sequence[Identification]) -> str:
    """Return a table with one row per parameter and one column per run (the paper's Table 10), for booktabs."""
    return rendered(
        "runs.tex",
        names=names,
        rows=run_rows(names, runs),
        parameters=dict.fromkeys(name for run in runs for name in run.names),
        latex=latex,
        with_error=with_error,
    )
