"""Play a reviewed motion on the arm and record what its driver publishes; the only workflow that commands an arm.

Everything is checked before a joint moves, and nothing moves before the operator has confirmed it by the robot's name.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

from dynid.answer import Facts, picked
from dynid.disk import sha256
from dynid.drivers.command_port import CommandPort
from dynid.drivers.interface import driver_of
from dynid.drivers.ros import connect
from dynid.errors import Declined, DynidError, LimitsAssumed, NotReviewed, StartPoseOff, WrongUsage
from dynid.estimation.result import Identification
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

    def facts(self) -> Facts:
        """Return what the JSON answer of ``dynid record`` says."""
        ended = {"verdict": "dry run"} if self.outcome is None else session.facts(self.outcome)
        foreseen = asdict(self.forecast) if self.forecast is not None else {}
        return {"robot": self.robot.name, **ended, "foreseen": foreseen}


def require_usable(
    robot: Robot, trajectory: StoredTrajectory | None, options: RecordOptions
) -> None:
    """Refuse options that contradict each other before anything is looked for.

    Raises:
        WrongUsage: they do.
        LimitsAssumed: the motion was planned with rates that nobody gave (E512).
    """
    moves = options.move is not None or options.go_to_start or options.zero_torques
    if options.listen_only and moves:
        raise WrongUsage(
            "--listen-only sends nothing to the arm",
            fix="leave out --move, --go-to-start and --zero-torques",
        )
    if trajectory is None and not options.listen_only:
        raise WrongUsage(
            "no trajectory given", fix=f"dynid record {robot.word} TRAJECTORY, or --listen-only"
        )

    planned_with = {} if trajectory is None else trajectory.facts
    if assumed := unsafe_to_play(planned_with.get("assumed_limits", ())):
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
    with closing(connect("dynid_record", options.master, options.timeout)) as node:
        answered = f"master {node.uri} answered in {1e3 * (time.monotonic() - begin):.0f} ms"
        stage("preflight", answered)
        topic = preflight.find_topic(node, robot, options.topic)
        with closing(preflight.listener_of(node, robot, topic)) as listener:
            port = driver_of(robot).open_port(
                node, robot, topic, options.command_topic, moving=not options.listen_only
            )
            return _Run(
                robot, trajectory, options, operator, folder, parameters, command, listener, port
            ).recorded()


@dataclass(frozen=True)
class _Run:
    """One run: what is played, with which answers, into which folder; the driver that is heard and commanded."""

    robot: Robot
    trajectory: StoredTrajectory | None
    options: RecordOptions
    operator: Operator
    folder: Path
    parameters: Identification | None
    command: str
    listener: Listener
    port: CommandPort

    def recorded(self) -> Recording:
        """Check, ask, move or listen, write."""
        seen = self._observed()
        if self.options.listen_only:
            return self._listened()
        motion, forecast = self._prepared(seen)
        if self.options.dry_run:
            stage("dry run", "everything is in order; nothing was sent")
            return Recording(self.robot, self.options, forecast)
        self._ask_to_replace()
        require_confirmed(self.operator, self.robot)
        return self._moved(motion, seen, forecast)

    # ------------------------------------------------------------ before anything moves
    def _observed(self) -> ObservedState:
        """Listen to the driver and judge its numbers."""
        robot = self.robot
        seen = preflight.listen(self.listener, robot, self.options.timeout)
        heard = len(self.listener.names)
        used = f", {robot.n} used" * (heard != robot.n)
        stage("", f"{self.listener.topic}  {heard} names{used}, {seen.rate:.1f} Hz")
        preflight.check_units(seen, robot)
        if not self.options.zero_torques:
            notice(preflight.check_zero(seen, robot))
        words = {
            None: "the driver does not say whether gravity is in the torques",
            True: "torques without gravity, as the robot file says",
            False: "gravity is in the torques",
        }
        stage("torque", words[preflight.check_gravity(seen, robot, self.port)])
        return seen

    def _prepared(self, seen: ObservedState) -> tuple[Motion, Forecast]:
        """Return what will be played, checked sample by sample, and what it was judged to do."""
        planned, options = self.trajectory, self.options
        assert planned is not None
        preflight.check_endpoints(self.port)
        played = preflight.motion_to_play(
            self.robot,
            planned.motion,
            seen,
            speed=options.speed,
            repeat=options.repeat,
            go_to_start=options.go_to_start,
        )
        facts = planned.facts.get("scene") or {}
        shapes = Path(facts["urdf"]) if facts.get("urdf") else None
        if shapes is not None and not shapes.is_file():
            text = f"{shapes} was not found: distances are those of cylinders along the links"
            stage("note", text)
            shapes = None
        scene = scene_from(facts) if facts else Scene()
        forecast = motion_checks.forecast(self.robot, played, scene, self._forecaster(), shapes)
        stage("reviewed", self._review(planned))
        stage(
            "ready",
            f"about to move {self.robot.slug}: {forecast.seconds:.0f} s, fastest {forecast.fastest_joint} at "
            f"{forecast.speed_rad_s:.2f} rad/s, keep the stop button in reach",
        )
        return played.motion, forecast

    def _forecaster(self) -> TorqueForecaster:
        """Return what predicts the torques: an identified model, or the prior of the robot file."""
        robot, stored = self.robot, self.parameters
        source = "prior" if stored is None else str(stored.path)
        if robot.torque.relative:
            return TorqueForecaster(None, "those of this arm are counted in amperes", source)
        if robot.torque.source == "gravity_free":
            text = "those of this arm lack gravity, and so does its model"
            return TorqueForecaster(None, text, source)
        if stored is None:
            base = base_model(robot, self.folder)
            theta, words = base.prior(unknown=0.0), "the robot file's prior, without friction"
        elif stored.robot.joint_names != robot.joint_names:
            what = f"{stored.path} belongs to {stored.robot.name}"
            raise WrongUsage(what, fix="give a model of this arm")
        elif stored.robot.torque.relative:
            raise WrongUsage(f"{stored.path} predicts currents", fix="leave out --parameters")
        else:
            base, theta, words = stored.base, stored.theta, source
        observer = base.observer
        return TorqueForecaster(
            lambda motion: observer.torque(theta, motion.q, motion.qd, motion.qdd), words, source
        )

    def _review(self, planned: StoredTrajectory) -> str:
        """Return who has confirmed a motion.

        Raises:
            NotReviewed: nobody has, or it was changed afterwards.
        """
        review, file = planned.review, planned.source
        if planned.reviewed and review is not None:
            return f"by {review.by}, {review.when}" + ", unseen" * (not review.seen)
        if self.options.accept_unreviewed:
            return "no; accepted with --accept-unreviewed"
        again = f"dynid trajectory {self.robot.word} {shell('--review', file)}"
        if review is not None:
            raise NotReviewed(f"{file} was changed after {review.by} confirmed it", fix=again)
        raise NotReviewed(f"nobody confirmed {file}", fix=f"{again}, or --accept-unreviewed")

    def _ask_to_replace(self) -> None:
        """Ask before an earlier recording is replaced."""
        for name in ("log.bag", "log.npz"):
            if (self.folder / name).exists():
                return self.operator.may_replace(self.folder / name)

    # ------------------------------------------------------------ while it is recorded
    def _moved(self, motion: Motion, seen: ObservedState, forecast: Forecast) -> Recording:
        """Play the motion; the arm may have been moved since it was checked, so its place is checked once more."""
        port, listener = self.port, self.listener
        port.ready()
        stage("stop", f"{port.stop_words}; Enter or Ctrl-C stops the arm")
        if self.options.zero_torques:
            if not at_candle(seen):
                raise StartPoseOff(
                    "the arm is not at the candle pose (all joints 180 deg)",
                    why="its torque sensors are zeroed there",
                    fix="move it there by hand or joystick",
                )
            port.zero_torques()
            stage("zeroed", "torque sensors")
        assert listener.latest is not None
        check_place(listener.latest, self.robot, motion)
        reference = playing.ReferenceMotion(motion, listener.latest.q - motion.q[0])

        def poll(outcome: Outcome) -> bool:
            error = f"largest error {outcome.largest_deviation:.3f} rad"
            advance(outcome.seconds, reference.duration, error)
            return self.operator.stop_pressed()

        def play(recorder: LogRecorder) -> Outcome:
            stage("moving")
            return session.play(port, reference, self.options.max_deviation, recorder, poll)

        return self._written(play, forecast)

    def _listened(self) -> Recording:
        """Record while another program moves the arm."""
        self._ask_to_replace()
        seconds, stale = self.options.duration, PATIENT * tuning.STOP_STALE_S
        stage("listening", f"{seconds:g} s" if seconds else "until Enter or Ctrl-C")
        pressed = self.operator.stop_pressed
        return self._written(
            lambda recorder: session.listen_only(recorder, seconds, stale, lambda _: pressed())
        )

    def _written(
        self, work: Callable[[LogRecorder], Outcome], forecast: Forecast | None = None
    ) -> Recording:
        """Open the files, work, close them; the manifest is written before the first motion and completed after."""
        path = self.folder / "manifest.yaml"
        facts = self._beginning(forecast)
        manifest.write_manifest(path, facts)
        recorder = LogRecorder(self.listener, self.folder)
        recorder.start()
        outcome = work(recorder)
        outcome.tally = recorder.close()
        bag, texts = recorder.bag_path, recorder.text_folder
        log = {"bag": bag.name, "sha256": sha256(bag), "text": texts.name}
        facts |= {"ended": manifest.now(), **session.facts(outcome), "log": log}
        try:
            manifest.write_manifest(path, facts)
        except DynidError as error:
            # Why: a full disk must not hide what happened to the arm.
            outcome.notes.append(f"{error.what}; the manifest still says 'running'")
        failure = outcome.failure if outcome.failure is not None else recorder.failure
        files = bag, texts, path
        return Recording(self.robot, self.options, forecast, outcome, files, failure)

    def _beginning(self, forecast: Forecast | None) -> Facts:
        """Return what the manifest says before the first motion."""
        port, planned = self.port, self.trajectory
        facts = manifest.beginning(self.robot, port.node, self.command)
        facts["driver"] = {
            "kind": port.robot.columns.kind,
            "state_topic": port.state_topic,
            "command_topic": None if self.options.listen_only else port.command_topic,
            "parameters": port.parameters(),
        }
        if planned is not None and planned.source is not None:
            review = planned.review
            facts["trajectory"] = {
                "file": str(planned.source),
                "sha256": sha256(planned.source),
                "alpha": planned.alpha,
                **picked(self.options, "speed", "repeat"),
                "reviewed_by": review.by if review and planned.reviewed else None,
                "foreseen": asdict(forecast) if forecast is not None else {},
            }
        return facts


def require_confirmed(operator: Operator, robot: Robot) -> None:
    """Have the operator confirm the motion; anything but True refuses it.

    Raises:
        Declined: it was not confirmed.
    """
    if operator.confirm_motion(robot.slug) is not True:
        raise Declined(f"nobody confirmed that {robot.slug} may move", why="the arm was not moved")
