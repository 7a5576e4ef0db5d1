"""Recordings as objects: read once, checked, in DH quantities; conditioned for one model whenever it is needed.

Is the robot file wrong? ``check`` asks it of every log, ``identify`` where the fit is poor.
"""

from __future__ import annotations

from collections.abc import Sequence

from dynid.diagnose.diagnosis import diagnose
from dynid.diagnose.gravity import check_gravity
from dynid.errors import Finding
from dynid.loading import located
from dynid.log import Log
from dynid.model.regressor import Model
from dynid.options import LogOptions
from dynid.progress import SILENT, Progress
from dynid.robot import Robot
from dynid.signals import conditioned_log
from dynid.signals.conditioned_log import ConditionedLog


def condition_logs(
    logs: Sequence[Log], model: Model, options: LogOptions, progress: Progress = SILENT
) -> list[ConditionedLog]:
    """Filter checked logs, all with the same cut-off, and say what was noticed in them.

    Args:
        logs: checked logs.
        model: the model whose columns are wanted.
        options: filter, delay and velocity; a delay of None counts as zero.
        progress: reports what was read and how it is filtered.
    """
    return conditioned_log.condition_logs(
        logs,
        model,
        cutoff=options.cutoff,
        delay=options.delay or 0.0,
        measured_velocity=options.velocity == "measured",
        progress=progress,
    )


# ---------------------------------------------------------------- is the robot file wrong?
def diagnose_logs(
    logs: Sequence[Log], robot: Robot, *, anyway: bool = False
) -> tuple[Finding, ...]:
    """Ask of each checked log whether another robot file explains it far better.

    Args:
        logs: checked logs.
        robot: the arm that they were checked for.
        anyway: whether a wrong mapping is only a finding (W329).

    Raises:
        GravityRemoved: the torques do not change with the weight of the arm (E317).
        WrongMapping: names the likeliest mistake, with the edit (E324).
    """
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
    with located(str(log.source or "log")):
        check_gravity(log, robot)
