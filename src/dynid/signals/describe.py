"""The numbers that ``dynid check LOG`` shows: samples, rate, motion, torques."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.log import Log
from dynid.robot import Robot
from dynid.signals import tuning
from dynid.signals.checks import slopes
from dynid.signals.motion import speed


def describe(log: Log, robot: Robot) -> dict[str, Any]:
    """Return the numbers of a checked log for JSON; those of each joint in the robot's order and DH quantities.

    ``jitter_share`` is half the spread of the middle 95 % of the sample times; ``velocity_slope``, the measured
    velocity over the change of position, is None where it is not measured or nothing moves, and ``torque_share``, of
    the rating, where that is unknown; ``least_moving`` is the joint that is slowest for its speed limit.
    """
    step = np.diff(log.t)
    usual, top = float(np.median(step)), np.abs(log.tau).max(axis=0)
    low, high = np.percentile(step, [2.5, 97.5])
    rms = np.sqrt(np.mean(speed(log) ** 2, axis=0))
    currents = log.tau_unit == "A"
    ratings = np.full(robot.n, np.nan) if currents else robot.limits("torque", np.nan)
    return {
        "samples": len(log),
        "duration_s": log.duration,
        "rate_hz": 1.0 / usual,
        "jitter_share": float(high - low) / 2 / usual,
        "gaps": int(np.sum(step > tuning.GAP_SAMPLES * usual)),
        "longest_gap_s": float(step.max()),
        "position_span_rad": np.ptp(log.q, axis=0).tolist(),
        "rms_velocity_rad_s": rms.tolist(),
        "velocity_slope": _known(slopes(log, robot)),
        f"torque_max_{'a' if currents else 'nm'}": top.tolist(),
        "torque_share": _known(top / ratings),
        "least_moving": robot.joint_names[int(np.argmin(rms / robot.limits("velocity", 1.0)))],
    }


def _known(numbers: Floats) -> list[float | None]:
    return [None if np.isnan(x) else x for x in numbers.tolist()]
