"""The limits of this result: what it cannot tell."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid.reports.evidence import Evidence
from dynid.reports.sections.interface import Section


class Limits(Section):
    """What the result does not cover, from the data themselves."""

    title, anchor = "Limits of this result", "limits"

    def context(self, evidence: Evidence) -> dict[str, Any]:
        """Return the sentences."""
        return {"sentences": limits(evidence)}


def limits(evidence: Evidence) -> list[str]:
    """Return what must not be concluded, one sentence each."""
    found, robot, reduction = evidence.found, evidence.robot, evidence.stored.reduction
    open_ = [name for name, known in zip(found.names, found.knowledge, strict=True) if known == "not determined"]
    sentences = [
        f"{len(reduction.none)} of {len(reduction.names)} parameters show in no motion of this arm, and "
        f"{len(reduction.combined)} only in combinations: single link masses are mostly the prior's.",
    ]
    if open_:
        origin = "are the prior's" if found.in_force == "physical" else "may be anything"
        sentences.append(f"These logs do not determine {', '.join(open_)}: their values {origin}.")
    if evidence.motion is not None:
        top = np.abs(evidence.motion.qd_estimated).max(axis=0)
        shares = [
            f"{joint.name} {100 * speed / joint.limits.velocity:.0f} %"
            for joint, speed in zip(robot.joints, top, strict=True)
            if joint.limits.velocity
        ]
        if shares:
            sentences.append(f"Speeds reached, of the limits: {', '.join(shares)}. Friction beyond them is a guess.")
    sentences.append(
        f"What is faster than {evidence.stored.cutoff:.3g} Hz was filtered away: no vibration, no ripple in the model."
    )
    sentences.append("Temperature, load and wear were those of the recording; friction changes with all three.")
    if robot.torque.source == "joint_sensor":
        sentences.append(
            "Torque came from joint sensors: what lies before them (rotors, motor friction) is hardly seen."
        )
    if found.heldout_relative_error_percent is None and not evidence.unseen:
        sentences.append("No torque was kept back: the error on another motion is not known.")
    return sentences
