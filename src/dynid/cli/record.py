"""``dynid record ROBOT TRAJECTORY``: move the arm and log; the only command that commands an arm."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.cli.arguments import options_from, options_of, robot_argument
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import Answer, ask, confirm, input_hashes, key_pressed, may_write
from dynid.drivers.ros import raise_priority
from dynid.errors import ExitStatus, WrongUsage
from dynid.files.trajectoryfile import read_trajectory
from dynid.text import shell
from dynid.workflows.options import RecordOptions

if TYPE_CHECKING:
    from dynid.cli.terminal import Bar
    from dynid.record.session import Outcome
    from dynid.robot import Robot
    from dynid.workflows.record import Recording


@dataclass(frozen=True)
class TerminalOperator:
    """The person at the terminal; answers to ``dynid.workflows.record.Operator``.

    Attributes:
        common: the common options.
        bar: the progress report, which is taken away while a question is asked.
        move: name of the robot given with --move, in the place of typing it.
    """

    common: Common
    bar: Bar
    move: str | None

    def may_replace(self, path: Path) -> None:
        """Ask before an earlier recording is overwritten."""
        self.bar.pause()
        may_write(self.common, path, {})

    def confirm_motion(self, robot: str) -> bool:
        """Have the robot's name typed (P3); anything else raises an error."""
        self.bar.pause()
        confirm(self.common, robot, "type the robot's name to start", given=self.move)
        return True

    def stop_pressed(self) -> bool:
        """Return whether Enter was pressed."""
        return key_pressed(self.common)


@dynid_command(
    "record",
    examples=(
        "dynid record kinova_gen2 out/kinova_gen2/trajectory.npz --dry-run      checks only, sends nothing",
        "dynid record kinova_gen2 out/kinova_gen2/trajectory.npz --speed 50%    asks for the robot's name, then moves",
        "dynid record kuka_lwr4plus --listen-only --duration 60                 another program moves the arm",
        "dynid sim-driver kinova_gen2 --pose out/kinova_gen2/trajectory.npz     an arm to rehearse with",
    ),
)
@robot_argument
@click.argument(
    "trajectory", required=False, type=click.Path(exists=True, dir_okay=False, path_type=Path)
)
@click.option(
    "--move",
    metavar="ROBOT_NAME",
    help="Move without asking: the robot's name, as a person would type it.",
)
@options_from(RecordOptions)
@click.option(
    "--convert/--no-convert",
    default=None,
    help="Also write the recording as log.npz (asked at the end when not given).",
)
@click.option(
    "--parameters",
    type=click.Path(exists=True, path_type=Path),
    metavar="RESULT",
    help="Result whose model predicts the torques that the motion needs (default: the robot file's prior).",
)
def command(
    common: Common,
    robot: str,
    trajectory: Path | None,
    move: str | None,
    convert: bool | None,
    parameters: Path | None,
    **values: Any,  # noqa: ANN401
) -> ExitStatus:
    """Play a reviewed trajectory on the arm and record what its driver publishes."""
    options, arm = options_of(RecordOptions, values), dynid.load_robot(robot)
    _require_name(arm, move, options)
    planned = read_trajectory(trajectory, arm) if trajectory is not None else None
    workflows.record.require_usable(arm, planned, options)
    priority = raise_priority()
    with common.terminal.progress() as bar:
        common.terminal.detail("priority", priority)
        done = workflows.record.record(
            arm,
            planned,
            options,
            TerminalOperator(common, bar, move),
            common.folder(arm.slug),
            parameters=dynid.loading.load_run(parameters) if parameters is not None else None,
            command=common.header({})["command"],
            progress=bar,
        )
    return show(common, done, convert)


def _require_name(arm: Robot, move: str | None, options: RecordOptions) -> None:
    """Refuse a --move that names another arm, or does not belong here."""
    if move is not None and move != arm.slug:
        raise WrongUsage(
            f"--move names '{move}', but this is '{arm.slug}'",
            why="the arm was not moved",
            fix=shell("--move", arm.slug),
        )
    if options.listen_only and move is not None:
        raise WrongUsage(
            "--listen-only sends nothing to the arm",
            fix="leave out --move, --go-to-start and --zero-torques",
        )


def show(common: Common, done: Recording, convert: bool | None) -> ExitStatus:
    """Say how it went, ask whether to convert, and print the answer."""
    terminal, outcome = common.terminal, done.outcome
    if outcome is None:
        terminal.emit_json(done.facts())
        return ExitStatus.DONE
    assert done.bag is not None
    assert done.texts is not None
    assert done.manifest is not None
    tally = outcome.tally
    lost = f", {tally.lost} lost" if tally.lost else ", none lost"
    terminal.wrote(done.bag, note=f"{tally.messages} messages, {tally.rate:.1f} Hz{lost}")
    terminal.wrote(done.texts, note="position.txt, velocity.txt, torque.txt, time.txt")
    terminal.wrote(done.manifest)
    for note in outcome.notes:
        terminal.say(f"note       {note}")
    if outcome.failure is not None and not done.options.listen_only:
        say_stopped(common, outcome)
    if done.failure is not None:
        raise done.failure
    if not done.options.listen_only:
        terminal.stage(
            "moved",
            f"{outcome.commands} commands, latest {1e3 * outcome.largest_lateness:.1f} ms; "
            f"largest error {outcome.largest_deviation:.3f} rad, "
            f"torque {100 * outcome.largest_torque_share:.0f} % of the rating",
        )
    terminal.emit_json({**done.facts(), "wrote": [*done.files, *converted(common, done, convert)]})
    terminal.next(f"dynid identify {done.robot.word} {shell(done.bag)}")
    return ExitStatus.DONE


def say_stopped(common: Common, outcome: Outcome) -> None:
    """Say what is known about the arm after it was stopped."""
    if outcome.stop_failure:
        common.terminal.say(
            f"stop       FAILED: {outcome.stop_failure}; use the physical stop button now",
            "bold red",
        )
    else:
        common.terminal.say(f"stop       {outcome.stop}")
    words = {
        True: "the arm stands still",
        False: "THE ARM STILL MOVES",
        None: "no joint states come: look at the arm, use the physical stop button",
    }
    common.terminal.say(f"arm        {words[outcome.still]}")


def converted(common: Common, done: Recording, given: bool | None) -> tuple[Path, ...]:
    """Ask the paper's question (P4) and write log.npz."""
    assert done.bag is not None
    if ask(common, "P4", given=given) is not Answer.YES:
        common.terminal.next(f"dynid check {shell(done.bag)} --robot {done.robot.word} --convert")
        return ()
    target = workflows.record.convert(done, common.header(input_hashes({"log": done.bag})))
    common.terminal.wrote(target)
    return (target,)
