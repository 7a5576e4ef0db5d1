"""Objects from what stands for them: arms, recordings, results and motions by name, path, or as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from dynid.arguments import instance, one_thread, public
from dynid.diagnose.diagnosis import diagnose
from dynid.diagnose.gravity import check_gravity
from dynid.errors import DynidError, Finding, RobotNotFound, WrongUsage, located
from dynid.estimation.result import Identification
from dynid.files import robotfile
from dynid.files.logs import FORMATS
from dynid.files.logs import read_log as read_recording
from dynid.files.trajectoryfile import read_trajectory
from dynid.files.urdffile import read_urdf
from dynid.log import Log
from dynid.model.from_urdf import import_arm
from dynid.motion import Motion
from dynid.options import LogOptions
from dynid.progress import notice
from dynid.robot import Robot
from dynid.signals.checks import prepare


class HasMotion(Protocol):
    """What holds a motion: a plan, or what is in its file."""

    @property
    def motion(self) -> Motion:
        """The motion."""


# What stands for an arm, a recording, several of them, a result, and a motion.
RobotLike: TypeAlias = Robot | str | Path
LogLike: TypeAlias = Log | str | Path
LogsLike: TypeAlias = LogLike | Sequence[LogLike]
ResultLike: TypeAlias = Identification | str | Path
MotionLike: TypeAlias = Motion | HasMotion | str | Path


@public
def load_robot(source: RobotLike, *, base: str | None = None, tip: str | None = None) -> Robot:
    """Return an arm.

    Args:
        source: name of a robot file that comes with dynid, path of a robot file, or path of a URDF; ``arm.urdf#link``
            names the last link of the arm as well; or an arm, which is returned.
        base: first link of the arm in a URDF; None for its root.
        tip: last link of the arm in a URDF; None for where the chain ends.

    Raises:
        WrongUsage: an argument is something else than what is wanted (E101).
        RobotNotFound: there is no such file (E205).
        DynidError: the file has a mistake (E201 to E207), or the URDF does not say which chain is the arm.

    Example:
        dynid.load_robot("kuka_lwr4plus")
    """
    if not isinstance(source, (str, Path)):
        return as_robot(source, "source")
    file, mark, link = str(source).rpartition("#")
    path = Path(file if mark and file.lower().endswith(".urdf") else source)
    if path.suffix.lower() != ".urdf":
        if tip is not None or base is not None:
            raise WrongUsage(
                f"{source} is not a URDF: its chain has one tip", fix="leave out --tip"
            )
        if path.suffix in FORMATS:
            fix = "the robot comes first, then its logs: dynid identify ROBOT LOG"
            raise RobotNotFound(f"{source} is a log or a result, no robot", fix=fix)
        robot = robotfile.load_robot(source)
    else:
        if not path.is_file():
            robotfile.find_robot(str(path))  # ends with the message that a missing robot file gets
        tip = tip or (link if path != Path(source) else None)
        made = import_arm(read_urdf(path), read_urdf(path, exact=True), base=base, tip=tip)
        robot = replace(made.robot, source=str(source), findings=made.findings)
    notice(robot.findings)
    return robot


def read_log(path: Path | str, robot: Robot, options: LogOptions = LogOptions()) -> Log:
    """Return a recording as it is on disk: the driver's columns, order and units.

    Args:
        path: bag, text folder, CSV or npz file.
        robot: the arm.
        options: how to read it.

    Raises:
        DynidError: the file is missing, damaged, or has no joint states of this arm (E301 to E305).
    """
    with located(path):
        return read_recording(Path(path), robot=robot, topic=options.topic, rate=options.rate)


@public
def load_log(
    path: LogLike,
    robot: RobotLike,
    options: LogOptions = LogOptions(),
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
    robot = as_robot(robot)
    return checked_log(as_log(path, robot, options, "path"), robot, options, identify=identify)


@one_thread
def checked_log(
    log: Log,
    robot: Robot,
    options: LogOptions = LogOptions(),
    *,
    identify: bool = True,
) -> Log:
    """Return a log in DH quantities of an arm, checked; one that is so already is not checked again.

    Raises:
        DynidError: the first serious fault of the log.
    """
    if options.velocity == "derived":
        log = replace(log, qd=None)
    try:
        with located(log.source or "log"):
            log = prepare(
                log,
                robot,
                exclude=options.exclude,
                sort_time=options.sort_time,
                identify=identify,
            )
    except DynidError:
        # Why: a log that was cut is too short for a reason.
        notice(log.findings)
        raise
    if options.velocity == "measured" and log.qd is None:
        log = replace(log, qd=log.extra.get("qd_reported"))
        finding = Finding("W308", "warning", f"{log.name} has no velocity; the derived one is used")
        if log.qd is None and finding not in log.findings:
            log = replace(log, findings=(*log.findings, finding))
    return log


def diagnose_logs(logs: Sequence[Log], robot: Robot, options: LogOptions) -> tuple[Finding, ...]:
    """Ask of each checked log whether another robot file explains it far better.

    Raises:
        GravityRemoved: the torques do not change with the weight of the arm (E317).
        WrongMapping: names the likeliest mistake, with the edit (E324); a finding (W329) with ``options.anyway``.
    """
    findings: list[Finding] = []
    for log in logs:
        with located(log.source or "log"):
            findings += diagnose(log, robot, anyway=options.anyway)
    return tuple(findings)


def check_weight(log: Log, robot: Robot) -> None:
    """Raise when the torques of a checked log are currents and those of the model not, or have no weight (E317)."""
    with located(log.source or "log"):
        if log.tau_unit == "A" and not robot.torque.relative:
            raise WrongUsage(
                f"{log.name} holds currents in A, the model has N m: the gains of the drives are not known",
                fix="identify with the gains in the robot file: torque: {source: motor_current, gain: [...]}",
            )
        check_gravity(log, robot)


def load_run(run: Path) -> Identification:
    """Return the result of a run, given by its folder or by its parameters.npz.

    Raises:
        NotAnArtifact: the file is none, or is damaged.
    """
    return Identification.load(parameters_of(run))


def parameters_of(run: Path) -> Path:
    """Return the parameters.npz of a run given by its folder or by the file."""
    return run / "parameters.npz" if run.is_dir() else run


def as_robot(value: RobotLike, name: str = "robot") -> Robot:
    """Return an arm given by itself, by name, or by the path of its file."""
    if isinstance(value, (str, Path)):
        return load_robot(value)
    wanted = "a name such as 'kuka_lwr4plus', the path of a robot file or URDF, or what dynid.load_robot returns"
    return instance(value, Robot, name, f"an arm: {wanted}")


def as_log(value: LogLike, arm: Robot, options: LogOptions, name: str = "log") -> Log:
    """Return a log given by itself, or by its path."""
    if isinstance(value, (str, Path)):
        return read_log(value, arm, options)
    return instance(value, Log, name, "a log: its path, or what dynid.load_log returns")


def as_logs(value: LogsLike, arm: Robot, options: LogOptions, name: str = "logs") -> list[Log]:
    """Return one or several logs, each given by itself or by its path."""
    return [as_log(each, arm, options, name) for each in several(value, name)]


def several(value: Any, name: str) -> list[Any]:  # noqa: ANN401
    """Return the items of a list, for which a single one may stand."""
    items = [*value] if isinstance(value, (list, tuple)) else [value]
    if not items:
        raise WrongUsage(f"{name} is empty")
    return items


def as_result(value: ResultLike, name: str = "result") -> Identification:
    """Return a result given by itself, by its folder, or by its file."""
    if isinstance(value, (str, Path)):
        return load_run(Path(value))
    wanted = "a result: its folder, its parameters.npz, or what dynid.identify returns"
    return instance(value, Identification, name, wanted)


def as_motion(value: MotionLike, arm: Robot) -> Motion:
    """Return a motion given by itself, in a plan, or by the path of its file."""
    held = read_trajectory(Path(value), arm) if isinstance(value, (str, Path)) else value
    wanted = "a motion: dynid.Motion, a plan, or the path of a trajectory.npz"
    motion = instance(getattr(held, "motion", held), Motion, "motion", wanted)
    if motion.q.shape[1] != arm.n:
        raise WrongUsage(f"motion has {motion.q.shape[1]} joints, and {arm.name} has {arm.n}")
    return motion
