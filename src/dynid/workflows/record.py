"""Play a reviewed motion on the arm and record what its driver publishes; the only workflow that commands an arm.

Everything is checked before a joint moves, and nothing moves before the operator has confirmed it by the robot's name.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

from dynid.disk import sha256
from dynid.drivers.command_port import CommandPort
from dynid.drivers.interface import driver_of
from dynid.drivers.ros import Node, connect
from dynid.errors import Declined, DynidError, LimitsAssumed, NotReviewed, StartPoseOff, WrongUsage
from dynid.estimation.result import Identification
from dynid.files.logs import read_log
from dynid.files.trajectoryfile import StoredTrajectory
from dynid.motion import Motion
from dynid.progress import advance, notice, stage
from dynid.record import manifest, motion_checks, playing, preflight, session, tuning
from dynid.record.monitor import Outcome
from dynid.record.motion_checks import Forecast, TorqueForecaster
from dynid.record.preflight import ObservedState, at_candle, check_place
from dynid.record.recorder import Listener, LogRecorder
from dynid.robot import Robot
from dynid.text import shell
from dynid.trajectory.feasible import unsafe_to_play
from dynid.trajectory.scene import Scene, scene_from
from dynid.workflows.model import base_model
from dynid.workflows.options import RecordOptions

#: A recording that only listens ends after so many times the silence that stops a motion.
PATIENT = 8


class Operator(Protocol):
    """The person beside the arm: what is asked before anything moves or is overwritten."""

    def may_replace(self, path: Path) -> None:
        """Return when an earlier recording may be overwritten; raise an error of the catalogue otherwise."""

    def confirm_motion(self, robot: str) -> bool:
        """Return True only after a person has confirmed, by the robot's name, that the arm may move."""

    def stop_pressed(self) -> bool:
        """Return whether the person wants it to stop; asked about twenty times a second."""


@dataclass(frozen=True)
class Recording:
    """What was recorded, or only checked.

    Attributes:
        robot: the arm.
        options: how it was recorded.
        forecast: what the motion was judged to do; None when another program moved the arm.
        outcome: how it ended; None for a dry run.
        files: log.bag, the folder of the paper's text files, and manifest.yaml; () for a dry run.
        failure: what ended it early, or kept it from being written; None when all went well.
    """

    robot: Robot
    options: RecordOptions
    forecast: Forecast | None = None
    outcome: Outcome | None = None
    files: tuple[Path, ...] = ()
    failure: BaseException | None = None

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid record`` says."""
        ended = {"verdict": "dry run"} if self.outcome is None else session.facts(self.outcome)
        foreseen = asdict(self.forecast) if self.forecast is not None else {}
        return {"schema": "dynid/record/1", "robot": self.robot.name, **ended, "foreseen": foreseen}


@dataclass(frozen=True)
class _Session:
    """One run: what is played on what, with which answers, into which folder."""

    robot: Robot
    trajectory: StoredTrajectory | None
    options: RecordOptions
    operator: Operator
    folder: Path
    parameters: Identification | None
    command: str
    node: Node


def require_usable(
    robot: Robot, trajectory: StoredTrajectory | None, options: RecordOptions
) -> None:
    """Refuse options that contradict each other before anything is looked for.

    Raises:
        WrongUsage: they do.
        LimitsAssumed: the motion was planned with rates that nobody gave (E512).
    """
    if options.listen_only and (options.go_to_start or options.zero_torques):
        raise WrongUsage(
            "--listen-only sends nothing to the arm",
            fix="leave out --move, --go-to-start and --zero-torques",
        )
    if trajectory is None and not options.listen_only:
        raise WrongUsage(
            "no trajectory given", fix=f"dynid record {robot.word} TRAJECTORY, or --listen-only"
        )

    assumed = (
        unsafe_to_play(trajectory.facts.get("assumed_limits", ())) if trajectory is not None else ()
    )
    if assumed:
        raise LimitsAssumed(f"the motion was planned with assumed limits: {'; '.join(assumed)}")


def record(
    robot: Robot,
    trajectory: StoredTrajectory | None,
    options: RecordOptions,
    operator: Operator,
    folder: Path,
    *,
    parameters: Identification | None = None,
    command: str = "",
) -> Recording:
    """Check everything, ask the operator, play a motion, and record what the driver publishes.

    Args:
        robot: the arm.
        trajectory: the motion; None with ``listen_only``.
        options: how it is played and recorded.
        operator: who is asked before the arm moves, and may stop it.
        folder: where log.bag, the text files and manifest.yaml go.
        parameters: identified model that predicts the torques; the robot file's prior when None.
        command: what started it, for the manifest.

    Returns:
        What was recorded. A motion that was stopped is returned with its ``failure``; its log is kept.

    Raises:
        DynidError: something is not in order, and the arm was not moved.
    """
    require_usable(robot, trajectory, options)
    begin = time.monotonic()
    node = connect("dynid_record", options.master, options.timeout)
    stage("preflight", f"master {node.uri} answered in {1e3 * (time.monotonic() - begin):.0f} ms")
    try:
        return _recorded(
            _Session(robot, trajectory, options, operator, folder, parameters, command, node)
        )
    finally:
        node.close()


def _recorded(run: _Session) -> Recording:
    """Check, ask, move or listen, write."""
    options = run.options
    topic = preflight.find_topic(run.node, run.robot, options.topic)
    listener = preflight.listener_of(run.node, run.robot, topic)
    try:
        port = driver_of(run.robot).open_port(
            run.node, run.robot, topic, options.command_topic, moving=not options.listen_only
        )
        seen = _observed(run, listener, port)
        if options.listen_only:
            return _listened(run, listener, port)
        motion, forecast = _prepared(run, seen, port)
        if options.dry_run:
            stage("dry run", "everything is in order; nothing was sent")
            return Recording(run.robot, options, forecast)
        _ask_to_replace(run)
        require_confirmed(run.operator, run.robot)
        return _moved(run, listener, port, motion, seen, forecast)
    finally:
        listener.close()


# ---------------------------------------------------------------- before anything moves
def _observed(run: _Session, listener: Listener, port: CommandPort) -> ObservedState:
    """Listen to the driver and judge its numbers."""
    robot = run.robot
    seen = preflight.listen(listener, robot, run.options.timeout)
    heard = len(listener.names)
    used = f"{heard} names, {robot.n} used" if heard != robot.n else f"{robot.n} names"
    stage("", f"{listener.topic}  {used}, {seen.rate:.1f} Hz")
    preflight.check_units(seen, robot)
    if not run.options.zero_torques:
        notice(preflight.check_zero(seen, robot))
    removed = preflight.check_gravity(seen, robot, port)
    words = {
        None: "the driver does not say whether gravity is in the torques",
        False: "gravity is in the torques",
    }
    stage("torque", words.get(removed, "torques without gravity, as the robot file says"))
    return seen


def _prepared(run: _Session, seen: ObservedState, port: CommandPort) -> tuple[Motion, Forecast]:
    """Return what will be played, checked sample by sample, and what it was judged to do."""
    planned, options = run.trajectory, run.options
    assert planned is not None
    preflight.check_endpoints(port)
    played = preflight.motion_to_play(
        run.robot,
        planned.motion,
        seen,
        speed=options.speed,
        repeat=options.repeat,
        go_to_start=options.go_to_start,
    )
    facts = planned.facts.get("scene")
    shapes = Path(facts["urdf"]) if facts and facts["urdf"] else None
    if shapes is not None and not shapes.is_file():
        stage("note", f"{shapes} was not found: distances are those of cylinders along the links")
        shapes = None
    scene = scene_from(facts) if facts else Scene()
    forecast = motion_checks.forecast(run.robot, played, scene, _torque_forecaster(run), shapes)
    stage("reviewed", _review_text(run.robot, planned, options))
    stage(
        "ready",
        f"about to move {run.robot.slug}: {forecast.seconds:.0f} s, fastest {forecast.fastest_joint} at "
        f"{forecast.speed_rad_s:.2f} rad/s, keep the stop button in reach",
    )
    return played.motion, forecast


def _torque_forecaster(run: _Session) -> TorqueForecaster:
    """Return what predicts the torques: an identified model, or the prior of the robot file."""
    robot, stored = run.robot, run.parameters
    source = "prior" if stored is None else str(stored.path)
    if robot.torque.source == "gravity_free" or robot.torque.relative:
        reason = (
            "are counted in amperes"
            if robot.torque.relative
            else "lack gravity, and so does its model"
        )
        return TorqueForecaster(None, f"those of this arm {reason}", source)
    if stored is None:
        base = base_model(robot, run.folder)
        theta, words = (
            base.prior(unknown=0.0),
            "the robot file's prior, without friction",
        )
    else:
        if stored.robot.joint_names != robot.joint_names:
            raise WrongUsage(
                f"{stored.path} belongs to {stored.robot.name}", fix="give a model of this arm"
            )
        if stored.robot.torque.relative:
            raise WrongUsage(f"{stored.path} predicts currents", fix="leave out --parameters")
        base = stored.base
        theta, words = stored.theta, source
    observer = base.observer
    return TorqueForecaster(
        lambda motion: observer.torque(theta, motion.q, motion.qd, motion.qdd), words, source
    )


def _review_text(robot: Robot, planned: StoredTrajectory, options: RecordOptions) -> str:
    """Return who has confirmed a motion.

    Raises:
        NotReviewed: nobody has, or it was changed afterwards.
    """
    review, again = (
        planned.review,
        f"dynid trajectory {robot.word} {shell('--review', planned.source)}",
    )
    if planned.reviewed and review is not None:
        return f"by {review.by}, {review.when}" + ", unseen" * (not review.seen)
    if options.accept_unreviewed:
        return "no; accepted with --accept-unreviewed"
    if review is not None:
        raise NotReviewed(f"{planned.source} was changed after {review.by} confirmed it", fix=again)
    raise NotReviewed(f"nobody confirmed {planned.source}", fix=f"{again}, or --accept-unreviewed")


def require_confirmed(operator: Operator, robot: Robot) -> None:
    """Have the operator confirm the motion; anything but True refuses it.

    Raises:
        Declined: it was not confirmed.
    """
    if operator.confirm_motion(robot.slug) is not True:
        raise Declined(f"nobody confirmed that {robot.slug} may move", why="the arm was not moved")


def _ask_to_replace(run: _Session) -> None:
    """Ask before an earlier recording is replaced."""
    for name in ("log.bag", "log.npz"):
        if (run.folder / name).exists():
            run.operator.may_replace(run.folder / name)
            return


# ---------------------------------------------------------------- while it is recorded
def _moved(
    run: _Session,
    listener: Listener,
    port: CommandPort,
    motion: Motion,
    seen: ObservedState,
    forecast: Forecast,
) -> Recording:
    """Play the motion; the arm may have been moved since it was checked, so its place is checked once more."""
    port.ready()
    stage("stop", f"{port.stop_words}; Enter or Ctrl-C stops the arm")
    if run.options.zero_torques:
        if not at_candle(seen):
            raise StartPoseOff(
                "the arm is not at the candle pose (all joints 180 deg)",
                why="its torque sensors are zeroed there",
                fix="move it there by hand or joystick",
            )
        port.zero_torques()
        stage("zeroed", "torque sensors")
    assert listener.latest is not None
    check_place(listener.latest, run.robot, motion)
    reference = playing.ReferenceMotion(motion, listener.latest.q - motion.q[0])

    def play(recorder: LogRecorder) -> Outcome:
        stage("moving")

        def poll(outcome: Outcome) -> bool:
            error = f"largest error {outcome.largest_deviation:.3f} rad"
            advance(outcome.seconds, reference.duration, error)
            return run.operator.stop_pressed()

        return session.play(port, reference, run.options.max_deviation, recorder, poll)

    return _written(run, listener, port, play, forecast)


def _listened(run: _Session, listener: Listener, port: CommandPort) -> Recording:
    """Record while another program moves the arm."""
    _ask_to_replace(run)
    seconds = run.options.duration
    stage("listening", f"{seconds:g} s" if seconds else "until Enter or Ctrl-C")
    stale = PATIENT * tuning.STOP_STALE_S

    def listen(recorder: LogRecorder) -> Outcome:
        return session.listen_only(recorder, seconds, stale, lambda _: run.operator.stop_pressed())

    return _written(run, listener, port, listen, None)


def _written(
    run: _Session,
    listener: Listener,
    port: CommandPort,
    work: Callable[[LogRecorder], Outcome],
    forecast: Forecast | None,
) -> Recording:
    """Open the files, work, close them; the manifest is written before the first motion and completed after."""
    path = run.folder / "manifest.yaml"
    facts = _beginning(run, port, forecast)
    manifest.write_manifest(path, facts)
    recorder = LogRecorder(listener, run.folder)
    recorder.start()
    outcome = work(recorder)
    outcome.tally = recorder.close()
    bag, texts = recorder.bag_path, recorder.text_folder
    log = {"bag": bag.name, "sha256": sha256(bag), "text": texts.name}
    try:
        manifest.write_manifest(
            path, facts | {"ended": manifest.now(), **session.facts(outcome), "log": log}
        )
    except DynidError as error:
        # Why: a full disk must not hide what happened to the arm.
        outcome.notes.append(f"{error.what}; the manifest still says 'running'")
    failure = outcome.failure
    if failure is None:
        failure = recorder.failure
    return Recording(run.robot, run.options, forecast, outcome, (bag, texts, path), failure)


def _beginning(run: _Session, port: CommandPort, forecast: Forecast | None) -> dict[str, Any]:
    """Return what the manifest says before the first motion."""
    facts = manifest.beginning(run.robot, run.node, run.command)
    facts["driver"] = {
        "kind": port.robot.columns.kind,
        "state_topic": port.state_topic,
        "command_topic": None if run.options.listen_only else port.command_topic,
        "parameters": port.parameters(),
    }
    planned = run.trajectory
    if planned is not None and planned.source is not None:
        review = planned.review
        facts["trajectory"] = {
            "file": str(planned.source),
            "sha256": sha256(planned.source),
            "alpha": planned.alpha,
            "speed": run.options.speed,
            "repeat": run.options.repeat,
            "reviewed_by": review.by if review and planned.reviewed else None,
            "foreseen": asdict(forecast) if forecast is not None else {},
        }
    return facts


def convert(recording: Recording, header: dict[str, Any]) -> Path:
    """Write log.npz beside log.bag and return its path.

    Args:
        recording: what was recorded.
        header: facts for its header.
    """
    bag, topic = recording.files[0], recording.options.topic
    target = bag.with_name("log.npz")
    read_log(bag, robot=recording.robot, topic=topic).save(target, header)
    return target
