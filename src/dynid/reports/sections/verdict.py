"""The sections in words: verdict, what to do next, what was run, quality of the data, limits of the result."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynid.errors import Finding
from dynid.estimation.covariance import KNOWN_WELL, NEGLIGIBLE, NOT_DETERMINED, counted
from dynid.estimation.estimate import SAME_MOTION
from dynid.estimation.result import Identification
from dynid.reports.evidence import Evidence
from dynid.text import shell

#: Relative torque error of a joint that is good, and still fair [%]. A joint that moves little has larger ones.
GOOD, FAIR = 5.0, 15.0
#: Growth of the error on rows that were not fitted that is good, and still fair.
SAME, NEAR = 1.2, 2.0
#: Warnings about bodies: the plain numbers belong to no arm, or no possible arm explains a joint.
OF_PHYSICS = ("W404", "W405")
#: What predictions use.
USED = {"physical": "physical parameters", "plain": "plain estimate"}
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

    @property
    def title(self) -> str:
        """What it is about, as a reader sees it."""
        return "parameters" if self.name == "knowledge" else self.name

    @property
    def shown(self) -> str:
        """The state as a reader sees it."""
        return "not tested yet" if self.state == "open" else self.state


# ---------------------------------------------------------------- verdict
def verdict(evidence: Evidence) -> dict[str, Any]:
    """Return three sentences and four lights."""
    return {"sentences": sentences(evidence), "lights": lights(evidence)}


def sentences(evidence: Evidence) -> list[str]:
    """Return the verdict in three sentences."""
    found = evidence.result
    worst = max(found.joints, key=lambda joint: joint.relative_percent)
    known = _known(found)
    unseen = unseen_percent(evidence)
    held = found.heldout_relative_error_percent
    first = (
        f"The model leaves {found.relative_error_percent:.2g} % of the measured torque unexplained; "
        f"{worst.joint} is the weakest joint with {worst.relative_percent:.2g} %."
    )
    floor = "" if held is None else f" On held-out data ({found.heldout}) {held:.2g} % is unexplained."
    second = (
        f"It was not tested on another motion.{floor}"
        if unseen is None
        else f"On data that was not fitted ({unseen[0]}) {unseen[1]:.2g} % is unexplained."
    )
    third = (
        f"{known} of {len(found.names)} base parameters are known as well as the torques need, "
        f"{found.knowledge.count('not determined')} are not determined by the logs. Predictions use the "
        f"{USED[found.in_force]}."
    )
    return [first, second, third]


def unseen_percent(evidence: Evidence) -> tuple[str, float] | None:
    """Return another motion than the fitted ones and its relative error: the worst, or the one held out."""
    if others := [unseen for unseen in evidence.unseen if not unseen.same_motion]:
        worst = max(others, key=lambda unseen: unseen.percent)
        return worst.name, worst.percent
    held = evidence.result.heldout_relative_error_percent
    return None if held is None or evidence.result.heldout.endswith(SAME_MOTION) else (evidence.result.heldout, held)


def _known(found: Identification) -> int:
    """Return how many parameters are known as well as the torques need."""
    return sum(word in (KNOWN_WELL, NEGLIGIBLE) for word in found.knowledge)


def lights(evidence: Evidence) -> list[Light]:
    """Return the lights of fit, unseen motion, parameters and physics."""
    found = evidence.result
    unseen = unseen_percent(evidence)
    worst = max(joint.relative_percent for joint in found.joints)
    known = _known(found) / len(found.names)
    growth = None if unseen is None else unseen[1] / max(found.relative_error_percent, 1e-9)
    warnings = [finding for finding in found.findings if finding.level == "warning" and finding.code in OF_PHYSICS]
    physical = found.in_force == "physical"
    return [
        Light(
            "fit",
            _state(worst, GOOD, FAIR),
            f"{found.relative_error_percent:.2g} % unexplained, {worst:.2g} % at the weakest joint",
        ),
        Light(
            "unseen motion",
            "open" if growth is None else "good" if unseen and unseen[1] <= SMALL else _state(growth, SAME, NEAR),
            "no recording of another motion was replayed"
            if unseen is None or growth is None
            else f"{unseen[1]:.2g} % unexplained, {growth:.2g} times the fit's {found.relative_error_percent:.2g} %",
        ),
        Light("knowledge", _state(-known, -0.75, -0.5), f"known {counted(found.knowledge)}"),
        Light(
            "physics",
            "good" if physical and not warnings else "fair" if physical or not warnings else "bad",
            f"every link is a body that can exist{'; see the warnings' if warnings else ''}"
            if physical
            else "the plain estimate is used for predictions",
        ),
    ]


def _state(value: float, good: float, fair: float) -> str:
    return "good" if value <= good else "fair" if value <= fair else "bad"


# ---------------------------------------------------------------- what to do next
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


# ---------------------------------------------------------------- what was run
def run(evidence: Evidence) -> dict[str, Any]:
    """Return files, versions and command, and the logs with their hashes."""
    found, robot, header = evidence.result, evidence.robot, evidence.result.header
    logs = list(zip(header.get("logs", []), found.log_sha256, strict=False))
    facts = [
        ("robot", f"{robot.name}, {robot.n} joints, {robot.convention} DH"),
        ("robot file", header.get("robot_path", "")),
        ("model key", header.get("key", "")),
        ("estimator", f"{found.method}: {found.why}"),
        ("filter", f"zero-phase low-pass at {found.cutoff:.3g} Hz over torque and columns"),
        ("samples", f"{found.samples} instants x {robot.n} joints"),
        ("dynid", f"{header.get('dynid', '')}, seed {header.get('seed', '')}"),
    ]
    return {"facts": facts, "logs": logs, "command": header.get("command", "")}


def quality(evidence: Evidence) -> dict[str, Any]:
    """Return what was noticed in the logs and in the fit, warnings first."""
    logs = [Finding(**finding) for finding in evidence.result.header.get("log_findings", [])]
    found = [*logs, *evidence.result.findings]
    return {"findings": sorted(found, key=lambda finding: finding.level != "warning")}


# ---------------------------------------------------------------- limits
def limits(evidence: Evidence) -> dict[str, Any]:
    """Return what must not be concluded, one sentence each."""
    return {"sentences": limit_sentences(evidence)}


def limit_sentences(evidence: Evidence) -> list[str]:
    """Return what must not be concluded, one sentence each."""
    found, robot, reduction = evidence.result, evidence.robot, evidence.result.reduction
    open_ = [name for name, known in zip(found.names, found.knowledge, strict=True) if known == "not determined"]
    sentences = [
        f"No motion of this arm shows {len(reduction.none)} of {len(reduction.names)} parameters, and "
        f"{len(reduction.combined)} show only in combinations. Most single link masses come from the prior.",
    ]
    if open_:
        origin = "come from the prior" if found.in_force == "physical" else "are arbitrary"
        sentences.append(f"These logs do not determine {', '.join(open_)}: their values {origin}.")
    if evidence.motion is not None:
        top = np.abs(evidence.motion.qd_estimated).max(axis=0)
        shares = [
            f"{joint.name} {100 * speed / joint.limits.velocity:.0f} %"
            for joint, speed in zip(robot.joints, top, strict=True)
            if joint.limits.velocity
        ]
        if shares:
            sentences.append(
                f"Largest speeds over their limits: {', '.join(shares)}. Friction at higher speeds is extrapolated."
            )
    sentences.append(
        f"The filter removes what is faster than {evidence.result.cutoff:.3g} Hz, so the model has no vibration."
    )
    sentences.append("Friction changes with temperature, load and wear; the model has those of the recording.")
    if robot.torque.source == "joint_sensor":
        sentences.append(
            "Torques come from joint sensors, which hardly see the motor side (rotor inertia, motor friction)."
        )
    if found.heldout_relative_error_percent is None and not evidence.unseen:
        sentences.append("No data was held out: the error on another motion is unknown.")
    return sentences
