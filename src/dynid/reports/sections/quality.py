"""Data quality: what was noticed in the recordings."""

from __future__ import annotations

from typing import Any

from dynid.errors import Finding
from dynid.reports.evidence import Evidence
from dynid.reports.sections.interface import Section


class Quality(Section):
    """Findings of the logs and of the fit."""

    title, anchor = "Data quality", "quality"

    def context(self, evidence: Evidence) -> dict[str, Any]:
        """Return the findings, warnings first."""
        logs = [Finding(**finding) for finding in evidence.stored.header.get("log_findings", [])]
        found = [*logs, *evidence.found.findings]
        return {"findings": sorted(found, key=lambda finding: finding.level != "warning")}
