"""Recordings as objects: read once, checked, in DH quantities; conditioned for one model whenever it is needed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.errors import DynidError, Finding
from dynid.log import Log
from dynid.options import Options, delay_or_auto, frequency_or_auto, intervals, option
from dynid.progress import SILENT, Progress
from dynid.robot import Robot
from dynid.threads import one_thread
from dynid.workflows import arguments
from dynid.workflows.arguments import public

if TYPE_CHECKING:
    from dynid.model.regressor import Model
    from dynid.signals.conditioned_log import ConditionedLog
    from dynid.workflows.arguments import LogLike, RobotLike


@dataclass(frozen=True)
class LogOptions(Options):
    """How logs are read, checked and filtered."""

    cutoff: float | None = option(
        None,
        "Cut-off frequency [Hz] of the zero-phase low-pass filter over torques and regressor columns; "
        "auto takes it from the band of the motion.",
        metavar="auto|HZ", shown="auto", read=frequency_or_auto,
    )  # fmt: skip
    velocity: str | None = option(
        None,
        "Use velocities derived from the positions, or those that the driver measured "
        "(default: derived, after they were compared with the measured ones).",
        choices=("derived", "measured"),
    )
    exclude: tuple[tuple[float, float], ...] = option(
        (), "Leave out an interval of the log [s], such as 3.2-3.4; may be repeated.",
        metavar="T0-T1", repeatable=True, read=intervals,
    )  # fmt: skip
    delay: float | None = option(
        None,
        "How much later than the positions the torques are stamped [s]; auto estimates the delay, reports it, and "
        "corrects it when it is clear.",
        metavar="auto|off|SECONDS", shown="auto", read=delay_or_auto,
    )  # fmt: skip
    topic: str | None = option(None, "ROS topic of the joint states (default: the driver's).", metavar="TOPIC")
    rate: float | None = option(
        None, "Sample rate [Hz] of text logs without a time column.", metavar="HZ", kind="positive"
    )
    anyway: bool = option(
        False, "Go on although another mapping of the columns explains the log far better (E324); the result says so."
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
    return checked_log(arguments.log(path, robot, options, "path"), robot, options, identify=identify)


@one_thread
def checked_log(
    log: Log, robot: Robot, options: LogOptions = LogOptions(), *, identify: bool = True, alone: bool = True
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
        progress: told what was read and how it is filtered.
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
