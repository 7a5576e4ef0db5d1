"""``dynid record ROBOT TRAJECTORY``: move the arm and log; the only command that commands an arm."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import Existing, Input, dynid_command
from dynid.cli.prompt import ask, confirm, key_pressed, may_write
from dynid.cli.session import Session
from dynid.disk import sha256
from dynid.drivers.ros import raise_priority
from dynid.files.trajectoryfile import read_trajectory
from dynid.judgement.rules import Step
from dynid.options import LogOptions, option
from dynid.text import shell
from dynid.workflows.options import RecordOptions

if TYPE_CHECKING:
    from dynid.record.monitor import Outcome
    from dynid.robot import Robot
    from dynid.workflows.record import Recording

#: What is known of an arm after it was stopped.
STILL = {
    True: "the arm stands still",
    False: "THE ARM STILL MOVES",
    None: "no joint states arrive: use the physical stop button",
}


@dataclass(frozen=True)
class TerminalOperator:
    """The person at the terminal; answers to ``dynid.workflows.record.Operator``.

    Attributes:
        session: of the command.
        move: name of the robot given with --move, in the place of typing it.
    """

    session: Session
    move: str | None

    def may_replace(self, path: Path) -> None:
        """Ask before an earlier recording is overwritten."""
        may_write(self.session, path)

    def confirm_motion(self, robot: str) -> bool:
        """Have the robot's name typed (P3); anything else raises an error."""
        confirm(self.session, robot, self.move)
        return True

    def stop_pressed(self) -> bool:
        """Return whether Enter was pressed."""
        return key_pressed(self.session)


@dynid_command("record")
def command(
    session: Session,
    *,
    robot: Robot,
    trajectory: Input | None = None,
    options: RecordOptions,
    convert: bool | None = option(
        None, "Also write the recording as log.npz (asked at the end when not given)."
    ),
    parameters: Existing | None = option(
        None,
        "Result whose model predicts the torques that the motion needs (default: the robot file's prior).",
        metavar="RESULT",
    ),
) -> Answer:
    """Play a reviewed trajectory on the arm and record what its driver publishes.

    Examples:
      dynid record kinova_gen2 out/kinova_gen2/trajectory.npz --dry-run      checks only, sends nothing
      dynid record kinova_gen2 out/kinova_gen2/trajectory.npz --speed 50%    asks for the robot's name, then moves
      dynid record kuka_lwr4plus --listen-only --duration 60                 another program moves the arm
      dynid sim-driver kinova_gen2 --pose out/kinova_gen2/trajectory.npz     an arm to rehearse with
    """
    if options.move is not None:
        # Why before anything is looked for: it may name another arm.
        confirm(session, robot.slug, options.move)
    planned = read_trajectory(trajectory, robot) if trajectory is not None else None
    session.stage("priority", raise_priority(), shown=bool(session.verbose))
    done = workflows.record.record(
        robot,
        planned,
        options,
        TerminalOperator(session, options.move),
        session.folder(robot.slug),
        parameters=dynid.loading.load_run(parameters) if parameters is not None else None,
        command=session.header({})["command"],
    )
    outcome = done.outcome
    if outcome is None:
        return Answer(done.facts())
    show(session, done, outcome)
    if done.failure is not None:
        raise done.failure
    return ended(session, done, outcome, convert)


def ended(session: Session, done: Recording, outcome: Outcome, convert: bool | None) -> Answer:
    """Say how a motion went, and convert the recording if that is wanted."""
    if not done.options.listen_only:
        late = f"latest {1e3 * outcome.largest_lateness:.1f} ms"
        error = f"largest error {outcome.largest_deviation:.3f} rad"
        torque = f"torque {100 * outcome.largest_torque_share:.0f} % of the rating"
        session.stage("moved", f"{outcome.commands} commands, {late}; {error}, {torque}")
    bag, robot = done.files[0], done.robot
    steps = [Step("", f"dynid identify {robot.word} {shell(bag)}")]
    made = []
    if ask(session, "P4", given=convert) == "yes":
        log = dynid.loading.read_log(bag, robot, LogOptions(topic=done.options.topic))
        made = [log.save(bag.with_name("log.npz"), session.header({"log": sha256(bag)}))]
    else:
        steps.insert(0, Step("", f"dynid check {shell(bag)} --robot {robot.word} --convert"))
    return Answer(done.facts(), wrote=made, next=steps)


def show(session: Session, done: Recording, outcome: Outcome) -> None:
    """Say what was written, and what is known about an arm that was stopped."""
    bag, texts, manifest = done.files
    lost = f"{outcome.tally.lost or 'none'} lost"
    count = f"{outcome.tally.messages} messages, {outcome.tally.rate:.1f} Hz, {lost}"
    session.wrote(bag, note=count)
    session.wrote(texts, note="position.txt, velocity.txt, torque.txt, time.txt")
    session.wrote(manifest)
    for note in outcome.notes:
        session.say(f"note       {note}")
    if outcome.failure is None or done.options.listen_only:
        return
    if outcome.stop_failure:
        urgent = "use the physical stop button now"
        session.say(f"stop       FAILED: {outcome.stop_failure}; {urgent}", "bold red")
    else:
        session.say(f"stop       {outcome.stop}")
    session.say(f"arm        {STILL[outcome.still]}")
