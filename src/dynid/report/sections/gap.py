"""The gap between arm and model: what ``dynid gap`` named, before and after."""

from __future__ import annotations

from typing import Any

from dynid.report.evidence import Evidence
from dynid.report.sections.interface import Section


class Gap(Section):
    """Verdict, named effects, held-out error before and after."""

    title, anchor = "Missing effects", "gap"

    def context(self, evidence: Evidence) -> dict[str, Any]:
        """Return what gap.npz says, nothing when the search was not run."""
        return {"gap": evidence.gap, "path": evidence.stored.path}
