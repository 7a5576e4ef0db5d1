"""Do the joints of a log stay within their limits? Where not, an offset of the robot file is wrong, or its limits."""

from __future__ import annotations

import math

import numpy as np

from dynid.errors import Finding
from dynid.log import Log
from dynid.robot import Joint, Robot
from dynid.signals.pieces import extremes

#: Positions this far beyond a limit are no rounding of a data sheet [rad or m].
OUTSIDE = 0.1


def beyond(joint: Joint, low: float, high: float) -> float:
    """Return how far a joint that moves from ``low`` to ``high`` leaves its limits [rad or m], but for full turns."""
    if joint.limits.position is None:
        return 0.0
    least, most = joint.limits.position
    if joint.revolute:
        turns = 2 * math.pi * round((least + most - low - high) / (4 * math.pi))
        low, high = low + turns, high + turns
    return float(max(0.0, least - low, high - most))


def check_ranges(log: Log, robot: Robot) -> tuple[Finding, ...]:
    """Return findings W332, one for each joint of a log in DH quantities that moves beyond its limits."""
    findings = []
    for joint, low, high in zip(robot.joints, *extremes(log.q), strict=True):
        too_far = beyond(joint, float(low), float(high))
        if too_far <= OUTSIDE:
            continue
        unit, factor = ("deg", math.degrees(1.0)) if joint.revolute else ("m", 1.0)
        least, most = joint.limits.position or (0.0, 0.0)
        quarters = (90, -90, 180) if joint.revolute else ()
        fits = [q for q in quarters if not beyond(joint, *(np.array([low, high]) + math.radians(q)))]
        text = (
            f"{joint.name} moves from {factor * low:.3g} to {factor * high:.3g} {unit}, {factor * too_far:.3g} {unit} "
            f"beyond its limits ({factor * least:.4g} to {factor * most:.4g}): its offset or these limits are wrong"
        )
        text += f"; an offset of {' or '.join(f'{q:+d}' for q in fits)} deg would fit" if fits else ""
        findings.append(Finding("W332", "warning", text, {"joint": joint.name, "beyond": too_far}))
    return tuple(findings)
