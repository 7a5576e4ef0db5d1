"""Is the robot file wrong? ``check`` asks it of every log, ``identify`` where the fit is poor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dynid.errors import DynidError, Finding
from dynid.log import Log
from dynid.robot import Robot
from dynid.workflows.logs import LogOptions, load_log, located

if TYPE_CHECKING:
    from dynid.estimation.result import Identification
    from dynid.model.base_model import BaseModel
    from dynid.workflows.parameters import Observations


def diagnose_logs(logs: Sequence[Log], robot: Robot, *, anyway: bool = False) -> tuple[Finding, ...]:
    """Ask of each checked log whether another robot file explains it far better.

    Args:
        logs: checked logs.
        robot: the arm that they were checked for.
        anyway: whether a wrong mapping is only a finding (W329).

    Raises:
        GravityRemoved: the torques do not change with the weight of the arm (E317).
        WrongMapping: names the likeliest mistake, with the edit (E324).
    """
    from dynid.diagnose.diagnosis import diagnose

    found: list[Finding] = []
    for log in logs:
        with located(str(log.source or "log")):
            found += diagnose(log, robot, anyway=anyway)
    return tuple(found)


def check_weight(log: Log, robot: Robot) -> None:
    """Raise when the torques of a checked log, which a model is compared with, have no weight of the arm in them.

    Raises:
        GravityRemoved: its fix says how the driver publishes the whole torque (E317).
    """
    from dynid.diagnose.gravity import check_gravity

    with located(str(log.source or "log")):
        check_gravity(log, robot)


def identified(
    fit: Callable[[], Identification], base: BaseModel, seen: Observations, options: LogOptions
) -> Identification:
    """Return what a fit gives; where it is poor or not possible, ask first whether the robot file is wrong.

    Args:
        fit: makes the result.
        base: the arm's base model.
        seen: what is fitted.
        options: how its logs are read; whether a wrong mapping is only a finding of the result (W329).

    Raises:
        GravityRemoved: the torques do not change with the weight of the arm (E317).
        WrongMapping: the robot file is wrong (E324).
        DynidError: the fit is not possible for another reason.
    """
    try:
        found = fit()
    except DynidError:
        diagnose_logs(_logs_of(seen, base.robot, options), base.robot, anyway=options.anyway)
        raise
    if not poor(found, base):
        return found
    mistakes = diagnose_logs(_logs_of(seen, base.robot, options), base.robot, anyway=options.anyway)
    return replace(found, findings=(*mistakes, *found.findings))


def _logs_of(seen: Observations, robot: Robot, options: LogOptions) -> Sequence[Log]:
    """Return the checked logs of observations; of stored ones, and of those made elsewhere, what is still there."""
    if seen.checked:
        return seen.checked
    there = [path for path in map(Path, seen.logs) if path.exists() and path.name]
    return [load_log(path, robot, options, identify=False) for path in there]


def poor(found: Identification, base: BaseModel) -> bool:
    """Return whether a fit leaves much of a joint's torque, or fits what no arm with weight would make.

    The plain estimate is judged, without a residual model: it leaves least, and random columns take in mistakes.
    """
    from dynid.diagnose import tuning
    from dynid.model.parameters import expected_torque

    factors = found.factors
    left = np.linalg.norm(factors @ np.append(found.plain, -1.0), axis=1)
    size = np.linalg.norm(factors[:, :, -1], axis=1)
    if np.any(left >= tuning.UNEXPLAINED * size) or {"W404", "W405"} & {finding.code for finding in found.findings}:
        return True
    if found.stack is None or base.robot.torque.source == "gravity_free":
        return False
    q = np.concatenate([segment.q for log in found.stack.logs for segment in log.segments])
    q = q[:: max(1, len(q) // tuning.POSES_OF_WEIGHT)]
    weight = base.model.observer(base.reduction.base).torque(found.plain, q, 0.0 * q, 0.0 * q)
    expected = np.std(expected_torque(q, base.robot), axis=0)
    heaviest = int(np.argmax(expected))
    return bool(np.std(weight[:, heaviest]) < tuning.WEIGHT * expected[heaviest])
