"""Results as text for other programs: CSV, LaTeX, and JUnit XML for continuous integration."""

from __future__ import annotations

import csv
import io
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.estimation.result import StoredResult


@dataclass(frozen=True)
class Case:
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


def junit(suite: str, cases: Sequence[Case]) -> str:
    """Return a JUnit XML report."""
    failed = [case for case in cases if case.failure and not case.error]
    broken = [case for case in cases if case.error]
    facts = {"name": suite, "tests": str(len(cases)), "failures": str(len(failed)), "errors": str(len(broken))}
    root = ET.Element("testsuites", facts)
    element = ET.SubElement(root, "testsuite", facts)
    for case in cases:
        one = ET.SubElement(element, "testcase", name=case.name, classname=case.group, time=f"{case.seconds:.3f}")
        if case.failure:
            first = case.failure.splitlines()[0]
            ET.SubElement(one, "error" if case.error else "failure", message=first).text = case.failure
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def runs_csv(names: Sequence[str], runs: Sequence[StoredResult]) -> str:
    """Return one row a run: figures, then every parameter with its standard error; empty where a run has none."""
    parameters = list(dict.fromkeys(name for run in runs for name in run.identification.names))
    columns = [column for name in parameters for column in (name, f"{name}_std_error")]
    head = ["run", "robot", "method", "rank", "condition_number_scaled", "relative_error_percent"]
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow([*head, "heldout_relative_error_percent", *columns])
    for label, run in zip(names, runs, strict=True):
        found = run.identification
        values = {name: repr(float(value)) for name, value in zip(found.names, found.theta, strict=True)}
        errors = zip(found.names, found.std_error, strict=True)
        values |= {f"{name}_std_error": repr(float(error)) for name, error in errors if np.isfinite(error)}
        held = found.heldout_relative_error_percent
        row = [
            label,
            run.robot.name,
            found.method,
            found.rank,
            found.condition_number_scaled,
            found.relative_error_percent,
        ]
        writer.writerow([*row, "" if held is None else held, *(values.get(column, "") for column in columns)])
    return stream.getvalue()


def runs_latex(names: Sequence[str], runs: Sequence[StoredResult]) -> str:
    """Return a table with one row a parameter and one column a run (the paper's Table 10), for booktabs."""
    parameters = list(dict.fromkeys(name for run in runs for name in run.identification.names))
    lines = [rf"\begin{{tabular}}{{l{'r' * len(runs)}}}", r"\toprule"]
    lines.append(" & ".join(["", *map(latex_text, names)]) + r" \\")
    lines.append(r"\midrule")
    for name in parameters:
        lines.append(" & ".join([latex_text(name), *(_cell(run, name) for run in runs)]) + r" \\")
    lines.append(r"\midrule")
    figures = (f"{run.identification.relative_error_percent:.3g}" for run in runs)
    lines.append(" & ".join([r"relative error [\%]", *figures]) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def _cell(run: StoredResult, name: str) -> str:
    found = run.identification
    if name not in found.names:
        return "--"
    k = found.names.index(name)
    value, error = float(found.theta[k]), float(found.std_error[k])
    if not np.isfinite(error):
        return "not determined"
    if error <= 0:
        return f"${value:.6g}$"
    places = max(0, 1 - int(np.floor(np.log10(error))))
    return rf"${value:.{places}f} \pm {error:.{places}f}$"


def latex_text(text: str) -> str:
    """Return text with the characters that mean something in LaTeX written out."""
    special = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    return "".join(special.get(c, f"\\{c}" if c in "_&%$#{}" else c) for c in text)
