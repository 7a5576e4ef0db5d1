"""Checks of the measured velocity against the change of position: unit, sign, and which column is whose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding, JointNamesDiffer, VelocityInconsistent
from dynid.log import Log
from dynid.robot import Robot
from dynid.signals.columns import units
from dynid.signals.motion import MOVING_SPEED, per_joint, speeds
from dynid.signals.pieces import extremes
from dynid.signals.values import unit_fix

Floats = NDArray[np.float64]

#: Slope of measured velocity on the change of position: tried on simulated motions it stays in 0.92-1.01, and drops to
#: 0.58 with heavy noise; so these bands mean another unit or sign, nothing else.
DEGREES = (30.0, 90.0)
RADIANS = (0.010, 0.030)
REVERSED = (-1.5, -0.5)
#: Slopes outside this band are not noise any more, but no known unit either.
AGREES = (0.8, 1.25)
#: A wrong column correlates up to 0.73 with a joint of the same motion; a right one above 0.9 unless very noisy.
WRONG_COLUMN = 0.75
RIGHT_COLUMN = 0.9
#: Fewer samples in motion show nothing.
LEAST_MOVING = 20


def slopes(log: Log, robot: Robot) -> Floats:
    """Return the slope of measured velocity on the change of position, (n,); NaN for a joint that does not move."""
    if log.qd is None:
        return np.full(robot.n, np.nan)
    rows, both, own = np.zeros(robot.n, dtype=int), np.zeros(robot.n), np.zeros(robot.n)
    for part, v in speeds(log):
        alive = np.abs(v) > per_joint(MOVING_SPEED, robot)
        v = np.where(alive, v, 0.0)
        rows += alive.sum(axis=0)
        both += np.sum(v * log.qd[part], axis=0)
        own += np.sum(v * v, axis=0)
    return np.where(rows >= LEAST_MOVING, both / np.where(own > 0.0, own, 1.0), np.nan)


def check_order(log: Log, robot: Robot) -> None:
    """Raise when velocity columns follow the positions of other joints.

    Why: one wrong pair may correlate by chance, so the best assignment of all columns decides.

    Raises:
        JointNamesDiffer: names the joints that look swapped.
    """
    if log.qd is None:
        return
    low, high = extremes(log.qd)
    rows = np.sum([np.sum(np.abs(v) > per_joint(MOVING_SPEED, robot), axis=0) for _, v in speeds(log)], axis=0)
    joints = np.flatnonzero((rows >= LEAST_MOVING) & (high > low))
    if len(joints) < 2:
        return
    k = len(joints)
    # Why: a reversed sign is another mistake (E308), so it must not look like a wrong column.
    likeness = np.abs(_correlation(log, joints))
    if np.all(np.diag(likeness) >= WRONG_COLUMN):
        return
    from scipy.optimize import linear_sum_assignment

    best = linear_sum_assignment(-likeness)[1]
    for i in np.flatnonzero(best != np.arange(k)):
        labelled, swapped = float(likeness[i, i]), float(likeness[i, best[i]])
        if swapped > RIGHT_COLUMN and labelled < WRONG_COLUMN:
            one, other = robot.joint_names[joints[i]], robot.joint_names[joints[best[i]]]
            raise JointNamesDiffer(
                f"{one} and {other} look swapped (correlation {swapped:.2f} swapped, {labelled:.2f} as labelled)",
                where=log.topic,
                why="the velocity column of one joint follows the position of the other",
                fix="correct the columns of the log; if only the velocities are swapped: --velocity derived",
            )


def _correlation(log: Log, joints: NDArray[np.intp]) -> Floats:
    """Return how the change of position of each joint correlates with the measured velocity of each, (k, k)."""
    assert log.qd is not None
    k = len(joints)
    total, square = np.zeros(2 * k), np.zeros((2 * k, 2 * k))
    for part, v in speeds(log):
        x = np.hstack([v[:, joints], log.qd[part][:, joints]])
        total += x.sum(axis=0)
        square += x.T @ x
    covariance = square - np.outer(total, total) / len(log)
    size = np.sqrt(np.diagonal(covariance))
    return np.asarray((covariance / np.outer(size, size))[:k, k:])


def check_slopes(log: Log, robot: Robot) -> tuple[Finding, ...]:
    """Return finding W308 for velocities that agree only roughly with the change of position.

    Raises:
        VelocityInconsistent: unit or sign is wrong.
    """
    findings = []
    for joint, slope in zip(robot.joints, slopes(log, robot), strict=True):
        if np.isnan(slope) or AGREES[0] <= slope <= AGREES[1]:
            continue
        if joint.revolute:
            _check_unit(joint.name, float(slope), log, robot)
        if REVERSED[0] <= slope <= REVERSED[1]:
            raise VelocityInconsistent(
                f"{joint.name} velocity has the opposite sign (slope {slope:.2f} to the change of position)",
                where=log.topic,
                fix="correct the sign of the velocity or of the position in the log, or use --velocity derived",
            )
        text = f"{joint.name} velocity is {slope:.2f} x the change of position; --velocity derived is better"
        findings.append(Finding("W308", "warning", text, {"joint": joint.name, "slope": float(slope)}))
    return tuple(findings)


def _check_unit(name: str, slope: float, log: Log, robot: Robot) -> None:
    declared = units(log, robot)["velocity"]
    text = f"{name} velocity is {slope:.3g} x the change of position"
    if DEGREES[0] <= abs(slope) <= DEGREES[1]:
        raise VelocityInconsistent(f"{text}: deg/s", where=log.topic, fix=_fix(robot, "deg/s"))
    if RADIANS[0] <= abs(slope) <= RADIANS[1]:
        right = "rad/s" if declared == "deg/s" else ""
        fix = (
            _fix(robot, right)
            if right
            else "are positions in degrees? declare `units:` under `driver:` in the robot file"
        )
        raise VelocityInconsistent(f"{text}: rad/s, while positions are in degrees?", where=log.topic, fix=fix)


def _fix(robot: Robot, unit: str) -> str:
    return f"{unit_fix(robot, {'velocity': unit})}, or use --velocity derived"
