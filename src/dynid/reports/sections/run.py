"""What was run: files, hashes, versions, and the command that repeats it."""

from __future__ import annotations

from typing import Any

from dynid.reports.evidence import Evidence
from dynid.reports.sections.interface import Section


class Run(Section):
    """Files, hashes, versions, command."""

    title, anchor = "What was run", "run"

    def context(self, evidence: Evidence) -> dict[str, Any]:
        """Return facts and the logs with their hashes."""
        stored, found, header = evidence.stored, evidence.found, evidence.stored.header
        logs = list(zip(header.get("logs", []), stored.log_sha256, strict=False))
        facts = [
            ("robot", f"{stored.robot.name}, {stored.robot.n} joints, {stored.robot.convention} DH"),
            ("robot file", header.get("robot_path", "")),
            ("model key", header.get("key", "")),
            ("estimator", f"{found.method}: {found.why}"),
            ("filter", f"zero-phase low-pass at {stored.cutoff:.3g} Hz over torque and columns"),
            ("samples", f"{found.samples} instants x {stored.robot.n} joints"),
            ("dynid", f"{header.get('dynid', '')}, seed {header.get('seed', '')}"),
        ]
        return {"facts": facts, "logs": logs, "command": header.get("command", "")}
