"""``dynid record ROBOT TRAJECTORY``: move the arm and log; the only command that commands an arm."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import Answer, ask, key_pressed, may_write, typed
from dynid.errors import DynidError, ExitStatus, NotReviewed, StartPoseOff, WrongUsage

if TYPE_CHECKING:
    from dynid.drivers.command_port import CommandPort
    from dynid.drivers.ros import Node
    from dynid.files.trajectoryfile import StoredTrajectory
    from dynid.motion import Motion
    from dynid.record.monitor import Monitor
    from dynid.record.preflight import ObservedState
    from dynid.record.recorder import Listener, LogRecorder
    from dynid.record.session import Outcome
    from dynid.robot import Robot


@dataclass(frozen=True)
class Options:
    """The options of ``record``, as given.

    Attributes:
        move: name of the robot, in the place of typing it.
        dry_run: check everything, send nothing.
        listen_only: record while another program moves the arm.
        repeat: how often the motion is played.
        speed: share of the planned speed.
        max_deviation: largest tracking error [rad].
        master: address of the ROS master.
        topic: of the joint states.
        command_topic: of the commands.
        timeout: patience for master and topic [s].
        convert: whether to write log.npz; None to ask.
        accept_unreviewed: play a motion that nobody has confirmed.
        go_to_start: approach the first pose slowly.
        zero_torques: zero the torque sensors first.
        parameters: identified model that predicts the torques; None for the robot file's prior.
        duration: length of a recording that only listens [s].
    """

    move: str | None
    dry_run: bool
    listen_only: bool
    repeat: int
    speed: float
    max_deviation: float
    master: str | None
    topic: str | None
    command_topic: str | None
    timeout: float
    convert: bool | None
    accept_unreviewed: bool
    go_to_start: bool
    zero_torques: bool
    parameters: Path | None
    duration: float | None


def _quantity(unit: str, scale: float = 1.0) -> Any:  # noqa: ANN401 - a click callback
    def read(ctx: click.Context, param: click.Parameter, value: str) -> float:
        text = value.strip().removesuffix(unit).strip()
        try:
            number = float(text) * (scale if value.strip().endswith("%") else 1.0)
        except ValueError:
            number = 0.0
        if not 0 < number < float("inf"):
            raise WrongUsage(f"--{str(param.name).replace('_', '-')} {value} is not a positive number of {unit}")
        return number

    return read


@dynid_command(
    "record",
    examples=(
        "dynid record kinova_gen2 out/kinova_gen2/trajectory.npz --dry-run      checks only, sends nothing",
        "dynid record kinova_gen2 out/kinova_gen2/trajectory.npz --speed 50%    asks for the robot's name, then moves",
        "dynid record kuka_lwr4plus --listen-only --duration 60                 another program moves the arm",
        "dynid sim-driver kinova_gen2 --pose out/kinova_gen2/trajectory.npz     an arm to rehearse with",
    ),
)
@click.argument("robot")
@click.argument("trajectory", required=False, type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--move", metavar="ROBOT_NAME", allow_from_autoenv=False, help="Move without asking for the name.")
@click.option("--dry-run", is_flag=True, help="Check everything, send nothing.")
@click.option("--listen-only", is_flag=True, help="Record while another program moves the arm.")
@click.option("--repeat", type=click.IntRange(1, 1000), default=1, show_default=True, help="Play it so often.")
@click.option(
    "--speed", default="100%", show_default=True, callback=_quantity("%", 0.01), help="Share of the planned speed."
)
@click.option(
    "--max-deviation", default="0.15rad", show_default=True, callback=_quantity("rad"), help="Stop beyond it."
)
@click.option("--master", metavar="URI", help="ROS master (default: ROS_MASTER_URI).")
@click.option("--topic", metavar="T", help="Topic of the joint states (default: the robot file's).")
@click.option("--command-topic", metavar="T", help="Topic or action of the commands (default: the driver's).")
@click.option(
    "--timeout", default="2s", show_default=True, callback=_quantity("s"), help="Patience for master and topic."
)
@click.option("--convert/--no-convert", default=None, help="Write log.npz afterwards.")
@click.option("--accept-unreviewed", is_flag=True, allow_from_autoenv=False, help="Play what nobody has confirmed.")
@click.option("--go-to-start", is_flag=True, allow_from_autoenv=False, help="Approach the first pose slowly.")
@click.option(
    "--zero-torques", is_flag=True, allow_from_autoenv=False, help="Zero the torque sensors (Kinova, candle pose)."
)
@click.option(
    "--parameters",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Identified model that predicts the torques (default: the robot file's prior).",
)
@click.option("--duration", type=click.FloatRange(0, min_open=True), metavar="S", help="Length with --listen-only.")
def command(common: Common, robot: str, trajectory: Path | None, **options: Any) -> ExitStatus:  # noqa: ANN401
    """Play a reviewed trajectory on the arm and record what its driver publishes."""
    from dynid.drivers.ros import connect, raise_priority
    from dynid.files.robotfile import load_robot
    from dynid.files.trajectoryfile import read_trajectory

    given = Options(**options)
    arm = load_robot(robot)
    _check_usage(arm, trajectory, given)
    stored = read_trajectory(trajectory, arm) if trajectory is not None else None
    priority = raise_priority()
    begin = time.monotonic()
    node = connect("dynid_record", given.master, given.timeout)
    common.terminal.stage("preflight", f"master {node.uri} answered in {1e3 * (time.monotonic() - begin):.0f} ms")
    try:
        common.terminal.detail("priority", priority)
        return Recording(common, arm, trajectory, stored, given, node).run()
    finally:
        node.close()


def _check_usage(arm: Robot, trajectory: Path | None, given: Options) -> None:
    """Refuse options that contradict each other before anything is looked for."""
    if given.move is not None and given.move != arm.slug:
        raise WrongUsage(
            f"--move names '{given.move}', but this is '{arm.slug}'",
            why="the arm was not moved",
            fix=f"--move {arm.slug}",
        )
    if given.listen_only and (given.move is not None or given.go_to_start or given.zero_torques):
        raise WrongUsage(
            "--listen-only sends nothing to the arm", fix="leave out --move, --go-to-start and --zero-torques"
        )
    if trajectory is None and not given.listen_only:
        raise WrongUsage("no trajectory given", fix=f"dynid record {arm.slug} TRAJECTORY, or --listen-only")


class Recording:
    """One run of the command: preflight, the question, the motion, what is written."""

    def __init__(
        self, common: Common, arm: Robot, path: Path | None, stored: StoredTrajectory | None, given: Options, node: Node
    ) -> None:
        self.common, self.terminal = common, common.terminal
        self.arm, self.path, self.stored, self.given, self.node = arm, path, stored, given, node
        self.folder = common.folder(arm.slug)
        self.foreseen: dict[str, Any] = {}

    def run(self) -> ExitStatus:
        """Check, ask, move, write."""
        from dynid.drivers.registry import driver_of
        from dynid.record import preflight

        topic = preflight.find_topic(self.node, self.arm, self.given.topic)
        listener = preflight.listener_of(self.node, self.arm, topic)
        try:
            port = driver_of(self.arm).open_port(
                self.node, self.arm, topic, self.given.command_topic, moving=not self.given.listen_only
            )
            seen = self._look(listener, port)
            if self.given.listen_only:
                return self._listen_only(listener, port)
            motion = self._plan(seen, port)
            if self.given.dry_run:
                self.terminal.stage("dry run", "everything is in order; nothing was sent")
                self._answer({"verdict": "dry run", "foreseen": self.foreseen})
                return ExitStatus.DONE
            self._may_write()
            typed(self.common, self.arm.slug, "type the robot's name to start", given=self.given.move)
            return self._move(listener, port, motion, seen)
        finally:
            listener.close()

    # ------------------------------------------------------------ preflight
    def _look(self, listener: Listener, port: CommandPort) -> ObservedState:
        """Listen to the driver and judge its numbers."""
        from dynid.record import preflight

        seen = preflight.listen(listener, self.arm, self.given.timeout)
        used = f"{len(seen.names)} names, {self.arm.n} used" if len(seen.names) != self.arm.n else f"{self.arm.n} names"
        self.terminal.stage("", f"{listener.topic}  {used}, {seen.rate:.1f} Hz")
        preflight.check_units(seen, self.arm)
        if not self.given.zero_torques:
            self.terminal.findings(preflight.check_zero(seen, self.arm))
        removed = preflight.check_gravity(seen, self.arm, port)
        words = {None: "the driver does not say whether gravity is in the torques", False: "gravity is in the torques"}
        self.terminal.stage("torque", words.get(removed, "torques without gravity, as the robot file says"))
        return seen

    def _plan(self, seen: ObservedState, port: CommandPort) -> Motion:
        """Return what will be played, checked sample by sample."""
        from dynid.cli.recordplan import foresee, motion_to_play
        from dynid.record import preflight

        assert self.stored is not None
        preflight.check_endpoints(port)
        played = motion_to_play(self.terminal, self.arm, self.stored, seen, self.given)
        self.foreseen = foresee(self.common, self.arm, played, self.stored, self.given.parameters)
        self._check_review()
        self.terminal.stage(
            "ready", f"about to move {self.arm.slug}: {played.motion.t[-1]:.0f} s, fastest "
            f"{self.foreseen['fastest_joint']} at {self.foreseen['speed_rad_s']:.2f} rad/s, "
            "keep the stop button in reach",
        )  # fmt: skip
        return played.motion

    def _check_review(self) -> None:
        assert self.stored is not None
        review = self.stored.review
        if self.stored.reviewed and review is not None:
            self.terminal.stage("reviewed", f"by {review.by}, {review.when}")
        elif self.given.accept_unreviewed:
            self.terminal.stage("reviewed", "no; accepted with --accept-unreviewed")
        elif review is not None:
            raise NotReviewed(
                f"{self.path} was changed after {review.by} confirmed it",
                fix=f"dynid trajectory {self.arm.slug} --review {self.path}",
            )
        else:
            raise NotReviewed(
                f"nobody confirmed {self.path}",
                fix=f"dynid trajectory {self.arm.slug} --review {self.path}, or --accept-unreviewed",
            )

    def _may_write(self) -> None:
        """Ask before an earlier recording is replaced."""
        for name in ("log.bag", "log.npz"):
            if (self.folder / name).exists():
                may_write(self.common, self.folder / name, {})
                return

    # ------------------------------------------------------------ recording
    def _move(self, listener: Listener, port: CommandPort, motion: Motion, seen: ObservedState) -> ExitStatus:
        from dynid.record import playing, session
        from dynid.record.monitor import StopRules
        from dynid.record.preflight import at_candle, check_place

        port.ready()
        self.terminal.stage("stop", f"{port.stop_words}; Enter or Ctrl-C stops the arm")
        if self.given.zero_torques:
            if not at_candle(seen):
                raise StartPoseOff(
                    "the arm is not at the candle pose (all joints 180 deg)",
                    why="its torque sensors are zeroed there",
                    fix="move it there by hand or joystick",
                )
            port.zero_torques()
            self.terminal.stage("zeroed", "torque sensors")
        assert listener.latest is not None
        check_place(listener.latest, self.arm, motion)
        reference = playing.ReferenceMotion(motion, listener.latest.q - motion.q[0])

        def run(recorder: LogRecorder) -> Outcome:
            with self.terminal.progress() as bar:
                bar.stage("moving")

                def poll(time: float, monitor: Monitor) -> bool:
                    bar.advance(time, reference.duration, f"largest error {monitor.largest_deviation:.3f} rad")
                    return key_pressed(self.common)

                return session.play(port, reference, StopRules(self.given.max_deviation), recorder, poll)

        return self._record(listener, port, run)

    def _listen_only(self, listener: Listener, port: CommandPort) -> ExitStatus:
        from dynid.record import session
        from dynid.record.monitor import StopRules

        self._may_write()
        self.terminal.stage(
            "listening", f"{self.given.duration:g} s" if self.given.duration else "until Enter or Ctrl-C"
        )
        stale = 8 * StopRules().stale
        seconds = self.given.duration

        def run(recorder: LogRecorder) -> Outcome:
            return session.listen_only(recorder, seconds, stale, lambda _: key_pressed(self.common))

        return self._record(listener, port, run)

    def _record(self, listener: Listener, port: CommandPort, run: Callable[[LogRecorder], Outcome]) -> ExitStatus:
        """Open the files, run, close them, say how it went."""
        from dynid.record.recorder import LogRecorder

        facts = self._beginning(port)
        recorder = LogRecorder(listener, self.folder)
        recorder.start()
        outcome: Outcome = run(recorder)
        outcome.tally = recorder.close()
        self._finish(facts, outcome, recorder.bag_path, recorder.text_folder)
        return self._end(outcome, recorder)

    def _beginning(self, port: CommandPort) -> dict[str, Any]:
        from dynid.files.artifact import sha256
        from dynid.record import manifest

        facts = manifest.beginning(self.arm, self.node, self.common.header({})["command"])
        facts["driver"] = {
            "kind": port.robot.driver.kind if port.robot.driver else "generic",
            "state_topic": port.state_topic,
            "command_topic": None if self.given.listen_only else port.command_topic,
            "parameters": port.parameters(),
        }
        if self.stored is not None and self.path is not None:
            review = self.stored.review
            facts["trajectory"] = {
                "file": str(self.path), "sha256": sha256(self.path), "alpha": self.stored.alpha,
                "speed": self.given.speed, "repeat": self.given.repeat,
                "reviewed_by": review.by if review and self.stored.reviewed else None, "foreseen": self.foreseen,
            }  # fmt: skip
        manifest.write_manifest(self.folder / "manifest.yaml", facts)
        return facts

    def _finish(self, facts: dict[str, Any], outcome: Outcome, bag: Path, texts: Path) -> None:
        """Complete the manifest; a full disk must not hide what happened to the arm."""
        from dynid.files.artifact import sha256
        from dynid.record import manifest, session

        facts |= {
            "ended": manifest.now(),
            **session.facts(outcome),
            "log": {"bag": bag.name, "sha256": sha256(bag), "text": texts.name},
        }
        try:
            manifest.write_manifest(self.folder / "manifest.yaml", facts)
        except DynidError as error:
            self.terminal.say(f"{error.what}; the manifest still says 'running'")

    def _end(self, outcome: Outcome, recorder: LogRecorder) -> ExitStatus:
        from dynid.record import session

        terminal, tally = self.terminal, outcome.tally
        lost = f", {tally.lost} lost" if tally.lost else ", none lost"
        terminal.wrote(recorder.bag_path, f"{tally.messages} messages, {tally.rate:.1f} Hz{lost}")
        terminal.wrote(recorder.text_folder, "position.txt, velocity.txt, torque.txt, time.txt")
        terminal.wrote(self.folder / "manifest.yaml")
        for note in outcome.notes:
            terminal.say(f"note       {note}")
        if outcome.failure is not None:
            self._say_stopped(outcome)
            raise outcome.failure
        if recorder.failure is not None:
            raise session.disk_error(recorder)
        if not self.given.listen_only:
            terminal.stage(
                "moved", f"{outcome.commands} commands, latest {1e3 * outcome.largest_lateness:.1f} ms; "
                f"largest error {outcome.largest_deviation:.3f} rad, "
                f"torque {100 * outcome.largest_torque_share:.0f} % of the rating",
            )  # fmt: skip
        wrote = [
            recorder.bag_path,
            recorder.text_folder,
            self.folder / "manifest.yaml",
            *self._converted(recorder.bag_path),
        ]
        self._answer({**session.facts(outcome), "foreseen": self.foreseen, "wrote": wrote})
        terminal.next(f"dynid identify {self.arm.slug} {recorder.bag_path}")
        return ExitStatus.DONE

    def _answer(self, facts: dict[str, Any]) -> None:
        self.terminal.emit_json({"schema": "dynid/record/1", "robot": self.arm.name, **facts})

    def _say_stopped(self, outcome: Outcome) -> None:
        """Say what is known about the arm after it was stopped."""
        if self.given.listen_only:
            return
        if outcome.stop_failure:
            self.terminal.say(
                f"stop       FAILED: {outcome.stop_failure}; use the physical stop button now", "bold red"
            )
        else:
            self.terminal.say(f"stop       {outcome.stop}")
        words = {
            True: "the arm stands still",
            False: "THE ARM STILL MOVES",
            None: "no joint states come: look at the arm, use the physical stop button",
        }
        self.terminal.say(f"arm        {words[outcome.still]}")

    def _converted(self, bag: Path) -> tuple[Path, ...]:
        """Ask the paper's question and write log.npz."""
        from dynid.cli.prompt import input_hashes
        from dynid.files.logs import read_log

        if ask(self.common, "P4", given=self.given.convert) is not Answer.YES:
            self.terminal.next(f"dynid check {bag} --robot {self.arm.slug} --convert")
            return ()
        target = self.folder / "log.npz"
        log = read_log(bag, robot=self.arm, topic=self.given.topic)
        log.save(target, self.common.header(input_hashes({"log": bag})))
        self.terminal.wrote(target)
        return (target,)
