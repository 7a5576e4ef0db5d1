"""Parameters: the paper's 11 x n grid by class, and the table of base parameters with errors and prior."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid.reports.evidence import Evidence
from dynid.reports.figures import ESTIMATED, RESIDUAL
from dynid.reports.sections.interface import Picture, Section
from dynid.reports.svg import as_svg, page_style
from dynid.robot import LINK_PARAMETERS

#: Letter of each class in the grid: colour never says it alone.
LETTERS = {"alone": "A", "combined": "C", "none": "–"}


class Parameters(Section):
    """The grid, a picture of values with error bars, and the table."""

    title, anchor = "Parameters", "parameters"

    def context(self, evidence: Evidence) -> dict[str, Any]:
        """Return grid, counts, picture and rows."""
        reduction, robot = evidence.stored.reduction, evidence.robot
        grid = []
        for joint, name in enumerate(robot.joint_names, start=1):
            cells = [self._cell(reduction.names, reduction.class_of, f"{p}{joint}") for p in LINK_PARAMETERS]
            grid.append((name, cells))
        counts = {kind: len(getattr(reduction, kind)) for kind in LETTERS}
        return {
            "heads": LINK_PARAMETERS,
            "grid": grid,
            "counts": counts,
            "letters": LETTERS,
            "rows": rows(evidence),
            "pictures": [values(evidence)],
        }

    @staticmethod
    def _cell(names: tuple[str, ...], class_of: Any, name: str) -> tuple[str, str, str]:  # noqa: ANN401
        if name not in names:
            return "absent", "", f"{name}: not a parameter of this model"
        kind = class_of(name)
        return kind, LETTERS[kind], f"{name}: {kind}"


def rows(evidence: Evidence) -> list[dict[str, Any]]:
    """Return one row a base parameter."""
    found, reduction = evidence.found, evidence.stored.reduction
    table = []
    for i, name in enumerate(found.names):
        error, value, prior = (float(x[i]) for x in (found.std_error, found.theta, found.prior))
        terms = [f"{factor:+.3g} {term}" for term, factor in reduction.terms(i).items()]
        formula = reduction.formulas[i].split(" = ", 1)[-1] if reduction.formulas else " ".join(terms)
        table.append(
            {
                "name": name,
                "value": f"{value:.4g}",
                "error": f"{error:.2g}" if np.isfinite(error) else "not determined",
                "known": found.knowledge[i],
                "prior": "" if np.isnan(prior) else f"{prior:.4g}",
                "formula": formula if len(terms) > 1 else "",
            }
        )
    return table


def values(evidence: Evidence) -> Picture:
    """Draw each parameter against its prior, both in standard errors of what is known."""
    from matplotlib.figure import Figure

    found = evidence.found
    finite = np.isfinite(found.std_error) & (np.abs(found.theta) > 0)
    share = np.full(len(found.theta), np.nan)
    share[finite] = 100 * found.std_error[finite] / np.abs(found.theta[finite])
    with page_style("values"):
        figure = Figure(figsize=(6.4, 2.6), layout="constrained")
        axis = figure.subplots()
        place = np.arange(len(share))
        axis.bar(place, np.clip(share, 0.05, 300), width=0.8, color=ESTIMATED)
        axis.axhline(10, color=RESIDUAL, lw=1, ls="--")
        axis.set_yscale("log")
        axis.set_ylabel("error / value [%]")
        axis.set_xticks(place, found.names, rotation=90, fontsize=5.5)
        axis.margins(x=0.01)
        axis.grid(axis="y", lw=0.5)
        drawing = as_svg(figure, "standard error of each base parameter in percent of its value")
    return Picture(
        drawing,
        "Each bar is a parameter's standard error in percent of its value; bars are cut at 300 %.",
        "Bars above the dashed line (10 %): do not quote those values without their error.",
    )
