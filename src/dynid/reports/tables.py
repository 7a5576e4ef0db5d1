"""Results as text for other programs: CSV, LaTeX, and JUnit XML for continuous integration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.answer import picked
from dynid.estimation.result import Identification
from dynid.reports.templating import template
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
    return template("junit.xml").render(suite=suite, cases=cases) + "\n"


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
        place = {name: k for k, name in enumerate(run.names)}
        for name in parameters:
            k = place.get(name)
            error = None if k is None else float(run.std_error[k])
            row[name] = None if k is None else float(run.theta[k])
            row[f"{name}_std_error"] = error if error is not None and np.isfinite(error) else None
        rows.append(row)
    return rows


def runs_csv(names: Sequence[str], runs: Sequence[Identification]) -> str:
    """Return one row per run as CSV; empty where a run has no value."""
    rows = run_rows(names, runs)
    return "\n".join([csv_row(rows[0]), *(csv_row(row.values()) for row in rows), ""])


def runs_latex(names: Sequence[str], runs: Sequence[Identification]) -> str:
    """Return a table with one row per parameter and one column per run (the paper's Table 10), for booktabs."""
    rows = run_rows(names, runs)
    lines = [rf"\begin{{tabular}}{{l{'r' * len(runs)}}}", r"\toprule"]
    lines.append(" & ".join(["", *map(latex, names)]) + r" \\")
    lines.append(r"\midrule")
    for name in dict.fromkeys(name for run in runs for name in run.names):
        cells = (_cell(row[name], row[f"{name}_std_error"]) for row in rows)
        lines.append(" & ".join([latex(name), *cells]) + r" \\")
    lines.append(r"\midrule")
    figures = (f"{run.relative_error_percent:.3g}" for run in runs)
    lines.append(" & ".join([r"relative error [\%]", *figures]) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def _cell(value: float | None, error: float | None) -> str:
    if value is None:
        return "--"
    if error is None:
        return "not determined"
    return rf"${with_error(value, error)} \pm {with_error(error, error)}$"
