"""Excitation: what the motion could teach."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid.reports.evidence import Evidence
from dynid.reports.figures import ESTIMATED, MEASURED, RESIDUAL
from dynid.reports.sections.interface import Picture, Section
from dynid.reports.svg import as_svg, page_style


class Excitation(Section):
    """Singular values of the stack and how far each joint moved."""

    title, anchor = "Excitation", "excitation"

    def context(self, evidence: Evidence) -> dict[str, Any]:
        """Return both figures and the condition numbers."""
        found = evidence.found
        pictures = [spectrum(evidence)] if evidence.singular_values is not None else []
        pictures += [coverage(evidence)] if evidence.motion is not None else []
        return {"pictures": pictures, "found": found, "size": len(found.names)}


def spectrum(evidence: Evidence) -> Picture:
    """Draw the singular values of the normalised stack."""
    from matplotlib.figure import Figure

    values = evidence.singular_values
    assert values is not None
    with page_style("spectrum"):
        figure = Figure(figsize=(6.4, 2.4), layout="constrained")
        axis = figure.subplots()
        axis.semilogy(np.arange(1, len(values) + 1), values / values[0], "o-", ms=3, lw=0.8, color=ESTIMATED)
        axis.axhline(1e-3, color=RESIDUAL, lw=1, ls="--")
        axis.set_xlabel("direction in the space of base parameters")
        axis.set_ylabel("singular value / largest")
        axis.grid(lw=0.5)
        drawing = as_svg(figure, "singular values of the stack with normalised columns")
    return Picture(
        drawing,
        "Each dot is a combination of parameters; the further right, the less the motion shows it.",
        "Dots below the dashed line (1/1000): noise in those directions is amplified a thousandfold.",
    )


def coverage(evidence: Evidence) -> Picture:
    """Draw the range of positions and speeds of each joint beside its limits."""
    from matplotlib.figure import Figure

    motion, robot = evidence.motion, evidence.robot
    assert motion is not None
    with page_style("coverage"):
        figure = Figure(figsize=(6.4, 0.8 + 0.34 * robot.n), layout="constrained")
        axes = figure.subplots(1, 2, sharey=True)
        rows = np.arange(robot.n)
        for axis, values, what in (
            (axes[0], motion.q_estimated, "position"),
            (axes[1], motion.qd_estimated, "velocity"),
        ):
            low, high = values.min(axis=0), values.max(axis=0)
            for j, joint in enumerate(robot.joints):
                speed = joint.limits.velocity
                limit = joint.limits.position if what == "position" else (-speed, speed) if speed else None
                if limit:
                    axis.barh(j, limit[1] - limit[0], left=limit[0], height=0.7, color=MEASURED, alpha=0.35)
            axis.barh(rows, high - low, left=low, height=0.35, color=ESTIMATED)
            axis.set_xlabel(f"{what} [rad{'/s' if what == 'velocity' else ''}; m for sliding joints]", fontsize=8)
            axis.grid(axis="x", lw=0.5)
            axis.tick_params(labelsize=8)
        names = [joint.name.replace("$", r"\$") for joint in robot.joints]
        axes[0].set_yticks(rows, names)
        axes[0].invert_yaxis()
        drawing = as_svg(figure, "range of positions and velocities of each joint, and its limits")
    return Picture(
        drawing,
        "Blue is what the joint did, grey what its limits allow.",
        "A joint whose blue bar is short taught little: its inertia and friction come from few, small signals.",
    )
