"""The unseen log: torque that no parameter was fitted to."""

from __future__ import annotations

from typing import Any

from dynid.reports.evidence import Evidence
from dynid.reports.sections.interface import Section
from dynid.reports.sections.torque import torques


class UnseenLog(Section):
    """Validations beside the result, else the rows that were held out."""

    title, anchor = "Unseen log", "unseen"

    def context(self, evidence: Evidence) -> dict[str, Any]:
        """Return the validations with their figures."""
        found = evidence.found
        shown = [(each, torques(evidence, each.motion, f"unseen: {each.name}")) for each in evidence.unseen]
        return {"unseen": shown, "found": found, "joints": evidence.robot.joint_names, "path": evidence.stored.path}
