"""The residual against speed, position, load and time: where a missing effect shows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.reports.evidence import Evidence
from dynid.reports.figures import ESTIMATED
from dynid.reports.sections.interface import Picture, Section
from dynid.reports.svg import as_svg, page_style

Floats = NDArray[np.float64]

BINS = 24


class Residual(Section):
    """Averages of the residual over four quantities, each joint a row."""

    title, anchor = "Where the residual is", "residual"

    def context(self, evidence: Evidence) -> dict[str, Any]:
        """Return the figure."""
        return {"pictures": [] if evidence.motion is None else [averages(evidence)]}


def averages(evidence: Evidence) -> Picture:
    """Draw mean and spread of the residual in bins."""
    from matplotlib.figure import Figure

    motion, robot = evidence.motion, evidence.robot
    assert motion is not None
    residual = motion.tau_measured - motion.tau_estimated
    against = (
        ("velocity", motion.qd_estimated),
        ("position", motion.q_estimated),
        ("load", motion.tau_estimated),
        ("time [s]", np.broadcast_to(motion.t[:, None], residual.shape)),
    )
    with page_style("residual"):
        figure = Figure(figsize=(7.2, 0.5 + 1.0 * robot.n), layout="constrained")
        axes = figure.subplots(robot.n, 4, squeeze=False, sharey="row")
        for j, joint in enumerate(robot.joints):
            usable = motion.usable[:, j]
            size = float(np.std(residual[usable, j])) if usable.any() else 1.0
            for k, (what, values) in enumerate(against):
                axis = axes[j][k]
                centre, mean, spread = binned(values[usable, j], residual[usable, j])
                axis.axhline(0, lw=0.6, color="#8c8c8c")
                axis.fill_between(centre, mean - spread, mean + spread, color=ESTIMATED, alpha=0.25, lw=0)
                axis.plot(centre, mean, color=ESTIMATED, lw=1.2)
                axis.set_ylim(-3.2 * size, 3.2 * size)
                axis.tick_params(labelsize=6)
                axis.grid(lw=0.4)
                if j == robot.n - 1:
                    axis.set_xlabel(what, fontsize=8)
            axes[j][0].set_ylabel(f"{joint.name}\n[{joint.torque_unit}]".replace("$", r"\$"), fontsize=6)
        drawing = as_svg(figure, "mean and spread of the residual against velocity, position, load and time")
    return Picture(
        drawing,
        "The line is the mean residual in a bin, the band one standard deviation; noise gives a flat line at zero.",
        "A step at zero velocity is friction, a wave over position gravity or a spring, "
        "a slope over load a gear or gain, a drift over time heat.",
    )


def binned(x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Return centres, means and spreads of y in bins of equal count over x."""
    order = np.argsort(x)
    parts = [part for part in np.array_split(order, BINS) if len(part) > 1]
    rows = [(float(x[part].mean()), float(y[part].mean()), float(y[part].std())) for part in parts]
    centre, mean, spread = np.array(rows).reshape(-1, 3).T
    return centre, mean, spread
