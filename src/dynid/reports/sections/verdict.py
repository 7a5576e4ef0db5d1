"""The sections in words: verdict, what to do next, what was run, quality of the data, limits of the result."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid.errors import Finding
from dynid.estimation.covariance import KNOWN_WELL, NEGLIGIBLE, NOT_DETERMINED
from dynid.reports.gathered import Gathered

#: What predictions use.
USED = {"physical": "physical parameters", "plain": "plain estimate"}


# ---------------------------------------------------------------- verdict
def verdict(gathered: Gathered) -> dict[str, Any]:
    """Return the sentences and the lights."""
    return {"sentences": sentences(gathered), "lights": gathered.judgement.lights}


def sentences(gathered: Gathered) -> list[str]:
    """Return the verdict: the answer, why, what to beware of, and how well the parameters are known."""
    found, judged = gathered.result, gathered.judgement
    worst = max(found.joints, key=lambda joint: joint.relative_percent)
    fitted = (
        f"On the fitted logs {found.relative_error_percent:.2g} % of the torque is unexplained; {worst.joint} is the "
        f"weakest joint with {worst.relative_percent:.2g} %."
    )
    known, open_ = (
        sum(word in (KNOWN_WELL, NEGLIGIBLE) for word in found.knowledge),
        found.knowledge.count(NOT_DETERMINED),
    )
    rest = f", {open_} are not determined by the logs" if open_ else ""
    parameters = (
        f"{known} of {len(found.names)} base parameters are known as well as the torques need{rest}. "
        f"Predictions use the {USED[found.in_force]}."
    )
    return [judged.sentence, *judged.reasons, *judged.warnings, fitted, parameters]


def next_steps(gathered: Gathered) -> dict[str, Any]:
    """Return what to do next, most urgent first."""
    return {"steps": gathered.judgement.steps}


# ---------------------------------------------------------------- what was run
def run(gathered: Gathered) -> dict[str, Any]:
    """Return files, versions and command, and the logs with their hashes."""
    found, robot, header = gathered.result, gathered.robot, gathered.result.header
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


def quality(gathered: Gathered) -> dict[str, Any]:
    """Return what was noticed in the logs and in the fit, warnings first."""
    logs = [Finding(**finding) for finding in gathered.result.header.get("log_findings", [])]
    found = [*logs, *gathered.result.findings]
    return {"findings": sorted(found, key=lambda finding: finding.level != "warning")}


# ---------------------------------------------------------------- limits
def limits(gathered: Gathered) -> dict[str, Any]:
    """Return what must not be concluded, one sentence each."""
    return {"sentences": limit_sentences(gathered)}


def limit_sentences(gathered: Gathered) -> list[str]:
    """Return what must not be concluded, one sentence each."""
    found, robot, reduction = gathered.result, gathered.robot, gathered.result.reduction
    open_ = [
        name
        for name, known in zip(found.names, found.knowledge, strict=True)
        if known == "not determined"
    ]
    sentences = [
        f"No motion of this arm shows {len(reduction.none)} of {len(reduction.names)} parameters, and "
        f"{len(reduction.combined)} show only in combinations. Most single link masses come from the prior.",
    ]
    if open_:
        origin = "come from the prior" if found.in_force == "physical" else "are arbitrary"
        sentences.append(f"These logs do not determine {', '.join(open_)}: their values {origin}.")
    if gathered.motion is not None:
        top = np.abs(gathered.motion.qd_estimated).max(axis=0)
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
        f"The filter removes what is faster than {gathered.result.cutoff:.3g} Hz, so the model has no vibration."
    )
    sentences.append(
        "Friction changes with temperature, load and wear; the model has those of the recording."
    )
    if robot.torque.source == "joint_sensor":
        sentences.append(
            "Torques come from joint sensors, which hardly see the motor side (rotor inertia, motor friction)."
        )
    if robot.torque.source == "unknown":
        sentences.append(
            "The robot file does not say whether torques come from joint sensors or from the motors."
        )
    if found.heldout_relative_error_percent is None and not gathered.unseen:
        sentences.append("No data was held out: the error on another motion is unknown.")
    return sentences
