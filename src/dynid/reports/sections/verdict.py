"""The verdict: three sentences and four lights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dynid.reports.evidence import Evidence
from dynid.reports.sections.interface import Section

#: Relative torque error of a joint that is good, and still fair [%]. A joint that moves little has larger ones.
GOOD, FAIR = 5.0, 15.0
#: Growth of the error on rows that were not fitted that is good, and still fair.
SAME, NEAR = 1.2, 2.0
#: An error on unseen torque that is good however small that of the fit is [%].
SMALL = 2.0


@dataclass(frozen=True)
class Light:
    """One light.

    Attributes:
        name: what it is about.
        state: ``"good"``, ``"fair"``, ``"bad"`` or ``"open"``.
        text: why.
    """

    name: str
    state: str
    text: str


class Verdict(Section):
    """Three sentences and four lights."""

    title, anchor = "Verdict", "verdict"

    def context(self, evidence: Evidence) -> dict[str, Any]:
        """Return sentences and lights."""
        return {"sentences": sentences(evidence), "lights": lights(evidence)}


def sentences(evidence: Evidence) -> list[str]:
    """Return the verdict in three sentences."""
    found = evidence.found
    worst = max(found.joints, key=lambda joint: joint.relative_percent)
    known = found.knowledge.count("well")
    unseen = unseen_percent(evidence)
    first = (
        f"The model explains all but {found.relative_error_percent:.2g} % of the measured torque; "
        f"{worst.joint} is the weakest joint with {worst.relative_percent:.2g} % unexplained."
    )
    second = (
        "No torque was kept back, so nothing is known about motions that were not fitted."
        if unseen is None
        else f"On torque that was not fitted ({unseen[0]}) {unseen[1]:.2g} % stay unexplained."
    )
    third = (
        f"{known} of {len(found.names)} base parameters are known as well as the torque needs, "
        f"{found.knowledge.count('not determined')} not determined by the logs; the {found.in_force} set is in force."
    )
    return [first, second, third]


def unseen_percent(evidence: Evidence) -> tuple[str, float] | None:
    """Return what was not fitted and its relative error: the worst unseen log, or the rows held out."""
    if evidence.unseen:
        worst = max(evidence.unseen, key=lambda unseen: unseen.percent)
        return worst.name, worst.percent
    held = evidence.found.heldout_relative_error_percent
    return None if held is None else (evidence.found.heldout, held)


def lights(evidence: Evidence) -> list[Light]:
    """Return fit, generality, knowledge and physics."""
    found = evidence.found
    unseen = unseen_percent(evidence)
    worst = max(joint.relative_percent for joint in found.joints)
    known = found.knowledge.count("well") / len(found.names)
    growth = None if unseen is None else unseen[1] / max(found.relative_error_percent, 1e-9)
    warnings = [finding for finding in found.findings if finding.level == "warning"]
    physical = found.in_force == "physical"
    return [
        Light("fit", _state(worst, GOOD, FAIR), f"weakest joint {worst:.2g} % unexplained"),
        Light(
            "unseen motion",
            "open" if growth is None else "good" if unseen and unseen[1] <= SMALL else _state(growth, SAME, NEAR),
            "nothing was kept back" if growth is None else f"error {growth:.2g} times that of the fit",
        ),
        Light("knowledge", _state(-known, -0.75, -0.5), f"{100 * known:.0f} % of the parameters known well"),
        Light(
            "physics",
            "good" if physical and not warnings else "fair" if physical or not warnings else "bad",
            "bodies that can exist" if physical else "the plain estimate is in force",
        ),
    ]


def _state(value: float, good: float, fair: float) -> str:
    return "good" if value <= good else "fair" if value <= fair else "bad"
