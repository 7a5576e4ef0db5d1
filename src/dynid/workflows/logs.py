"""Recordings as objects: read once, checked, in DH quantities; conditioned for one model whenever it is needed.

Is the robot file wrong? ``check`` asks it of every log, ``identify`` where the fit is poor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.errors import DynidError, Finding
from dynid.log import Log
from dynid.options import Options, delay_or_auto, frequency_or_auto, intervals, option
from dynid.progress import SILENT, Progress
from dynid.robot import Robot
from dynid.workflows import arguments
from dynid.workflows.arguments import one_thread, public

if TYPE_CHECKING:
    from dynid.estimation.result import Identification
    from dynid.model.base_model import BaseModel
    from dynid.model.regressor import Model
    from dynid.signals.conditioned_log import ConditionedLog
    from dynid.workflows.arguments import LogLike, RobotLike
    from dynid.workflows.parameters import Observations


@dataclass(frozen=True)
class LogOptions(Options):
    """How logs are read, checked and filtered."""

    cutoff: float | None = option(
        None,
        "Cut-off frequency [Hz] of the zero-phase low-pass filter over torques and regressor columns; "
        "auto takes it from the band of the motion.",
        metavar="auto|HZ",
        shown="auto",
        read=frequency_or_auto,
    )
    velocity: str | None = option(
        None,
        "Use velocities derived from the positions, or those that the driver measured "
        "(default: derived, after they were compared with the measured ones).",
        choices=("derived", "measured"),
    )
    exclude: tuple[tuple[float, float], ...] = option(
        (),
        "Leave out an interval of the log [s], such as 3.2-3.4; may be repeated.",
        metavar="T0-T1",
        repeatable=True,
        read=intervals,
    )
    delay: float | None = option(
        None,
        "How much later than the positions the torques are stamped [s]; auto estimates the delay, reports it, and "
        "corrects it when it is clear.",
        metavar="auto|off|SECONDS",
        shown="auto",
        read=delay_or_auto,
    )
    topic: str | None = option(
        None, "ROS topic of the joint states (default: the driver's).", metavar="TOPIC"
    )
    rate: float | None = option(
        None, "Sample rate [Hz] of text logs without a time column.", metavar="HZ", kind="positive"
    )
    anyway: bool = option(
        False,
        "Continue although another mapping of the columns explains the log far better (E324); the result says so.",
    )
    sort_time: bool = option(False, "Put samples whose time stamps are only shuffled in order.")


def read_log(path: Path | str, robot: Robot, options: LogOptions = LogOptions()) -> Log:
    """Return a recording as it is on disk: the driver's columns, order and units.

    Args:
        path: bag, text folder, CSV or npz file.
        robot: the arm.
        options: how to read it.

    Raises:
        DynidError: the file is missing, damaged, or has no joint states of this arm (E301 to E305).
    """
    from dynid.files import logs

    with located(str(path)):
        return logs.read_log(Path(path), robot=robot, topic=options.topic, rate=options.rate)


@public
def load_log(
    path: LogLike,
    robot: RobotLike,
    options: LogOptions | None = None,
    *,
    identify: bool = True,
    **changes: Any,  # noqa: ANN401
) -> Log:
    """Return a recording in DH quantities of an arm, checked; its ``findings`` say what was noticed.

    Args:
        path: bag, text folder, CSV or npz file; or a log made from arrays.
        robot: the arm, its name, or the path of its file.
        options: how to read it.
        identify: refuse logs that are too short or too still to identify from (E313, E401).
        changes: single options by name, such as ``sort_time=True``; see ``dynid.LogOptions``.

    Raises:
        WrongUsage: an argument or option is something else than what is wanted (E101).
        DynidError: the first serious fault of the log (E301 to E401).

    Example:
        dynid.load_log("run1.bag", "kuka_lwr4plus", exclude="3.2-3.4")
    """
    options, robot = arguments.options(LogOptions, options, changes), arguments.robot(robot)
    identify = arguments.instance(identify, bool, "identify", "True or False")
    return checked_log(
        arguments.log(path, robot, options, "path"), robot, options, identify=identify
    )


@one_thread
def checked_log(
    log: Log,
    robot: Robot,
    options: LogOptions = LogOptions(),
    *,
    identify: bool = True,
    alone: bool = True,
) -> Log:
    """Return a log in DH quantities of an arm, checked; one that is so already is not checked again.

    Raises:
        DynidError: the first serious fault of the log.
    """
    from dynid.signals.checks import prepare

    if options.velocity == "derived":
        log = replace(log, qd=None)
    with located(str(log.source or "log")):
        log = prepare(
            log,
            robot,
            exclude=options.exclude,
            sort_time=options.sort_time,
            identify=identify,
            alone=alone,
        )
    if options.velocity == "measured" and log.qd is None:
        log = replace(log, qd=log.extra.get("qd_reported"))
    if options.velocity == "measured" and log.qd is None:
        finding = Finding("W308", "warning", f"{log.name} has no velocity; the derived one is used")
        if finding not in log.findings:
            log = replace(log, findings=(*log.findings, finding))
    return log


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
    from dynid.signals import conditioned_log

    return conditioned_log.condition_logs(
        logs,
        model,
        cutoff=options.cutoff,
        delay=options.delay or 0.0,
        measured_velocity=options.velocity == "measured",
        progress=progress,
    )


@contextmanager
def located(where: str) -> Iterator[None]:
    """Give a mistake that does not say where it was found the name of its log."""
    try:
        yield
    except DynidError as error:
        error.where = error.where or where
        raise


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
    suspicious = {"W404", "W405", "W413"} & {finding.code for finding in found.findings}
    if np.any(left >= tuning.UNEXPLAINED * size) or suspicious:
        return True
    if found.stack is None or base.robot.torque.source == "gravity_free":
        return False
    q = np.concatenate([segment.q for log in found.stack.logs for segment in log.segments])
    q = q[:: max(1, len(q) // tuning.POSES_OF_WEIGHT)]
    weight = base.model.observer(base.reduction.base).torque(found.plain, q, 0.0 * q, 0.0 * q)
    expected = np.std(expected_torque(q, base.robot), axis=0)
    heaviest = int(np.argmax(expected))
    return bool(np.std(weight[:, heaviest]) < tuning.WEIGHT * expected[heaviest])
