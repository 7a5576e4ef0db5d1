"""Measured and predicted torque of the logs that were fitted."""

from __future__ import annotations

from typing import Any

from dynid.estimation.prediction import EstimatedMotion
from dynid.reports.evidence import Evidence
from dynid.reports.figures import QUANTITIES, draw
from dynid.reports.sections.interface import Picture, Section
from dynid.reports.svg import as_svg, page_style


class Torque(Section):
    """One panel a joint, the residual on the same scale."""

    title, anchor = "Measured and predicted torque", "torque"

    def context(self, evidence: Evidence) -> dict[str, Any]:
        """Return the figure and the table of joints."""
        pictures = [] if evidence.motion is None else [torques(evidence, evidence.motion, "fitted logs")]
        units = [joint.torque_unit for joint in evidence.robot.joints]
        return {"pictures": pictures, "joints": list(zip(evidence.found.joints, units, strict=True))}


def torques(evidence: Evidence, motion: EstimatedMotion, title: str) -> Picture:
    """Draw measured and estimated torque of all joints."""
    with page_style(title):
        figure = draw(motion, QUANTITIES[-1], evidence.robot.joint_names, evidence.sliding, title)
        drawing = as_svg(figure, f"measured and estimated torque of each joint, {title}")
    return Picture(
        drawing,
        "Grey is measured, blue estimated, orange what is left, all on one scale a joint.",
        "Orange that follows a pattern (steps at reversals, waves) is an effect that the model misses, not noise.",
    )
