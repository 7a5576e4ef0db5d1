"""Parameters: the paper's 11 x n grid by class, and the table of base parameters with errors and prior."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dynid.reports.gathered import Gathered
from dynid.reports.section_figures import error_figure
from dynid.reports.svg import Picture, drawn
from dynid.reports.tables import parameter_rows
from dynid.robot import LINK_PARAMETERS

#: Letter of each class in the grid: colour never says it alone.
LETTERS = {"alone": "A", "combined": "C", "none": "–"}


def parameters(gathered: Gathered) -> dict[str, Any]:
    """Return the grid of classes, a picture of the errors, and the table of base parameters."""
    reduction, robot = gathered.result.reduction, gathered.robot
    grid = []
    for joint, name in enumerate(robot.joint_names, start=1):
        cells = [
            _cell(reduction.names, reduction.class_of, f"{kind}{joint}") for kind in LINK_PARAMETERS
        ]
        grid.append((name, cells))
    label = "standard error of each base parameter in percent of its value"
    errors = Picture(
        drawn(lambda: error_figure(gathered.result), label),
        "Each bar is a parameter's standard error in percent of its value; bars are cut at 300 %. Grey bars belong to "
        "parameters that are zero as far as the torques can tell.",
        "Blue bars above the dashed line (10 %): do not quote those values without their error.",
    )
    return {
        "heads": LINK_PARAMETERS,
        "grid": grid,
        "counts": {kind: len(getattr(reduction, kind)) for kind in LETTERS},
        "letters": LETTERS,
        "rows": parameter_rows(gathered.result),
        "pictures": [errors],
    }


def _cell(
    names: tuple[str, ...], class_of: Callable[[str], str], name: str
) -> tuple[str, str, str]:
    """Return class, letter and tip of a parameter."""
    if name not in names:
        return "absent", "", f"{name}: not a parameter of this model"
    kind = class_of(name)
    return kind, LETTERS[kind], f"{name}: {kind}"
