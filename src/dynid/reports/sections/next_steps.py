"""What to do next with a result: commands that work when they are pasted, each with its reason, most urgent first."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynid.estimation.covariance import NOT_DETERMINED
from dynid.estimation.result import Identification
from dynid.reports.evidence import Evidence
from dynid.reports.sections.verdict import FAIR, GOOD, Light, lights
from dynid.text import shell


@dataclass(frozen=True)
class Step:
    """One thing to do.

    Attributes:
        why: the reason, one sentence.
        command: the command line; LOG stands for a recording that only the user can name.
    """

    why: str
    command: str


def next_steps(evidence: Evidence) -> dict[str, Any]:
    """Return what to do next, most urgent first."""
    return {"steps": steps(evidence)}


def steps(evidence: Evidence) -> list[Step]:
    """Return what to do next, most urgent first: prove it, find what is missing, move more, use it."""
    found, judged = evidence.result, {light.name: light for light in lights(evidence)}
    parts = (_missing(evidence, judged), _unseen(found, judged), _motion(found, judged), _use(found, judged))
    return [step for step in parts if step is not None]


def _unseen(found: Identification, judged: dict[str, Light]) -> Step | None:
    if judged["unseen motion"].state != "open":
        return None
    why = "The model was not tested on another motion: replay a recording of one."
    return Step(why, f"{shell('dynid', 'validate', found.path)} LOG")


def _missing(evidence: Evidence, judged: dict[str, Light]) -> Step | None:
    """Return the search for what is missing, where something is and nobody has searched."""
    found = evidence.result
    worse = next((finding.evidence.get("joint") for finding in found.findings if finding.code == "W404"), None)
    contradicted = found.in_force == "plain" or worse is not None
    if evidence.gap is not None or not (contradicted or found.relative_error_percent > GOOD):
        return None
    worst = max(found.joints, key=lambda joint: joint.relative_percent)
    why = (
        f"No physically possible arm explains {worse or 'the torques'} as well as the plain estimate: search for the "
        "effect that the model lacks."
        if contradicted
        else f"{found.relative_error_percent:.2g} % of the torque is unexplained, {worst.relative_percent:.2g} % on "
        f"{worst.joint}: search for the effect that the model lacks."
    )
    return Step(why, shell("dynid", "gap", found.path, *_logs(found)))


def _motion(found: Identification, judged: dict[str, Light]) -> Step | None:
    if judged["knowledge"].state == "good":
        return None
    count = found.knowledge.count(NOT_DETERMINED)
    why = f"{count} of {len(found.names)} parameters are not determined: plan a motion that shows them."
    return Step(why, f"dynid trajectory {found.robot.word}")


def _use(found: Identification, judged: dict[str, Light]) -> Step | None:
    if found.relative_error_percent > FAIR or judged["physics"].state == "bad":
        return None
    return Step(
        "Use the model in a simulator or a controller.", f"{shell('dynid', 'export', found.path)} --format urdf"
    )


def _logs(found: Identification) -> list[str]:
    """Return the paths of the fitted logs as they were given; LOG where they are gone."""
    paths = [str(path) for path in found.header.get("logs", [])]
    return paths if paths and all(Path(path).exists() for path in paths) else ["LOG"]
