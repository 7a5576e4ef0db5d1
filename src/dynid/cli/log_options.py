"""What the commands of loop 3 share: reading logs, stacking, and the options for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.options import Common
from dynid.cli.prompt import input_hashes
from dynid.errors import DynidError, Finding, WrongUsage

if TYPE_CHECKING:
    from dynid.estimation.delay import Delay
    from dynid.estimation.sources import Reading
    from dynid.estimation.stack import Source, Stack
    from dynid.model.store import BaseModel
    from dynid.robot import Robot

#: No driver is this late; a larger number is meant in milliseconds [s].
LONGEST_DELAY = 0.5
#: The delay is estimated anew after it was corrected until it changes by less than this [s], at most so many times.
DELAY_FOUND, DELAY_ROUNDS = 2e-4, 3

READING_OPTIONS: tuple[Callable[[Any], Any], ...] = (
    click.option("--cutoff", metavar="auto|HZ", default="auto", show_default=True, help="Over torque and columns."),
    click.option(
        "--velocity", type=click.Choice(["derived", "measured"]),
        help="Ignore the driver's velocity, or use it (default: derived, and compared with it).",
    ),
    click.option("--exclude", metavar="T0-T1", multiple=True, help="Leave out a stretch [s]; repeatable."),
    click.option(
        "--delay", metavar="auto|off|SECONDS", default="auto", show_default=True,
        help="Of the torques; auto estimates it, says it, and corrects it when it is clear.",
    ),
    click.option("--topic", metavar="TOPIC", help="ROS topic of the joint states."),
    click.option("--rate", type=click.FloatRange(min=0, min_open=True), metavar="HZ", help="Of text logs."),
    click.option("--sort-time", is_flag=True, help="Sort samples whose time stamps are only shuffled."),
)  # fmt: skip


READING_DEFAULTS: dict[str, Any] = {
    "cutoff": "auto", "velocity": None, "exclude": (), "topic": None, "rate": None, "sort_time": False,
    "delay": "auto",
}  # fmt: skip


def reading_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of reading a log to a command."""
    for option in reversed(READING_OPTIONS):
        function = option(function)
    return function


def reading_of(options: dict[str, Any], *, identify: bool = True) -> Reading:
    """Return how to read logs, from the command's options."""
    from dynid.estimation.sources import Reading

    return Reading(
        topic=options["topic"],
        rate=options["rate"],
        cutoff=_cutoff(options["cutoff"]),
        velocity=options["velocity"] or "",
        exclude=tuple(_stretch(text) for text in options["exclude"]),
        sort_time=options["sort_time"],
        delay=_delay(options["delay"]) or 0.0,
        identify=identify,
    )


def _cutoff(text: str) -> float | None:
    if text == "auto":
        return None
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise WrongUsage(f"--cutoff '{text}' is neither auto nor a frequency in Hz", fix="such as --cutoff 8")
    return value


def _delay(text: str) -> float | None:
    """Return a delay in seconds; None for auto, 0 for off."""
    if text in ("auto", "off"):
        return None if text == "auto" else 0.0
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) <= LONGEST_DELAY:
        raise WrongUsage(
            f"--delay '{text}' is neither auto, off nor a time up to {LONGEST_DELAY:g} s", fix="such as --delay 0.008"
        )
    return value


def _stretch(text: str) -> tuple[float, float]:
    start, dash, end = text.strip().partition("-")
    try:
        found = (float(start), float(end))
    except ValueError:
        found = (1.0, 0.0)
    if not dash or found[0] > found[1]:
        raise WrongUsage(f"--exclude '{text}' is not a stretch of time", fix="such as --exclude 3.2-3.4")
    return found


def percent(text: str, option: str) -> float:
    """Return a share written as ``20%`` or ``0.2``."""
    try:
        value = float(text.removesuffix("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        value = -1.0
    if not 0 < value < 1:
        raise WrongUsage(f"{option} '{text}' is not a share between 0 and 100 %", fix=f"such as {option} 20%")
    return value


@dataclass(frozen=True)
class Stacked:
    """Logs ready to be identified from.

    Attributes:
        base: model and base parameters.
        stack: the stacked rows.
        findings: what was noticed in the logs.
        inputs: hashes that the results depend on.
        header: facts for the results' headers.
    """

    base: BaseModel
    stack: Stack
    findings: tuple[Finding, ...]
    inputs: dict[str, str]
    header: dict[str, Any]


def base_model(common: Common, robot: Robot) -> BaseModel:
    """Return the robot's model with base parameters, derived when it is not there yet or stale."""
    from dynid.model.store import key_of, obtain_base_model, paths, stored_key

    path = paths(common.folder(robot.slug))[1]
    fresh = stored_key(path) == key_of(robot)
    with common.terminal.progress() as progress:
        progress.stage("model", "")
        base = obtain_base_model(robot, path.parent)
    if not fresh:
        made = f"{len(base.reduction.names)} -> {base.reduction.rank} base parameters"
        common.terminal.stage("model", f"derived for {robot.name}: {made}, stored in {path.parent}")
    return base


def reading_part(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options that change how a log is read: the stack depends on these and on nothing else."""
    return {key: options[key] for key in READING_DEFAULTS}


def hashes(robot: Robot, logs: Sequence[Path], options: dict[str, Any]) -> dict[str, str]:
    """Return what a result depends on: hashes of robot and logs, and each option as it was given."""
    for log in logs:
        if not log.exists():
            from dynid.files.logs import read_log

            read_log(log, robot=robot)
    named = {f"log {k + 1}": log for k, log in enumerate(logs)}
    return {"robot": robot.model_key, **input_hashes(named), **option_texts(options)}


def option_texts(options: dict[str, Any]) -> dict[str, str]:
    """Return options as text by name, for the inputs of a result."""
    return {
        name: " ".join(value) if isinstance(value, tuple) else str(value)
        for name, value in options.items()
        if value is not None
    }


def read_sources(
    common: Common, base: BaseModel, logs: Sequence[Path], reading: Reading
) -> tuple[list[Source], list[Finding]]:
    """Read and condition logs, all with the same cut-off, and say what was noticed."""
    from dynid.estimation.sources import common_cutoff, read_source

    terminal = common.terminal
    sources: list[Source] = []
    findings: list[Finding] = []
    with terminal.progress() as progress:
        for path in logs:
            progress.stage("read", "")
            source, log = _located(path, partial(read_source, path, base.model, reading))
            sources.append(source)
            findings += log.findings
            terminal.stage("log", f"{path}: {len(log)} samples, {log.duration:.1f} s, {log.rate:.1f} Hz")
            terminal.findings(log.findings)
        cutoff = common_cutoff(sources)
        if any(source.chosen.cutoff != cutoff for source in sources):
            again = replace(reading, cutoff=cutoff)
            sources = [_located(path, partial(read_source, path, base.model, again))[0] for path in logs]
    chosen = sources[0].chosen
    how = "from the motion's band" if reading.cutoff is None else "as given"
    terminal.stage(
        "filter",
        f"zero-phase low-pass at {chosen.cutoff:.3g} Hz over torque and columns ({how}; positions at "
        f"{chosen.position_cutoff:.3g} Hz), {chosen.kept_rate:.3g} Hz kept",
    )
    return sources, findings


def _located(path: Path, read: Callable[[], Any]) -> Any:  # noqa: ANN401
    """Read a log; a mistake that does not say which log it was found in gets its path."""
    try:
        return read()
    except DynidError as error:
        error.where = error.where or str(path)
        raise


@dataclass(frozen=True)
class Timing:
    """What is known about the delay of the torques.

    Attributes:
        estimated: the estimate and its standard error [s], None when nobody asked.
        applied: what was corrected [s].
    """

    estimated: Delay | None = None
    applied: float = 0.0

    def facts(self) -> dict[str, float | None]:
        """Return what the JSON answer and the headers say."""
        found = self.estimated
        return {
            "delay_s": found.seconds if found else self.applied or None,
            "delay_std_error_s": found.std_error if found else None,
            "delay_applied_s": self.applied,
        }


def stack_logs(
    common: Common, base: BaseModel, logs: Sequence[Path], options: dict[str, Any]
) -> tuple[Stack, list[Finding], Timing]:
    """Read, condition and stack logs; estimate how late the torques are, and correct that when it is clear."""
    from dynid.estimation.delay import Delay, delay_findings, estimate_delay
    from dynid.estimation.effect_columns import settled

    reading = reading_of(options)
    sources, findings = read_sources(common, base, logs, reading)
    sources = settled(sources, base)
    stack = stack_sources(common, base, sources)
    if options["delay"] != "auto":
        return stack, findings, Timing(applied=reading.delay)
    found, applied = estimate_delay(stack), 0.0
    for _ in range(DELAY_ROUNDS if found.clear else 0):
        applied = found.seconds
        stack = stacked_again(base, logs, replace(reading, delay=applied, cutoff=sources[0].chosen.cutoff))
        left = estimate_delay(stack)
        found = Delay(applied + left.seconds, left.std_error)
        if abs(found.seconds - applied) < DELAY_FOUND:
            break
    size = f"torques {1e3 * found.seconds:+.1f} +- {1e3 * found.std_error:.1f} ms after the positions"
    common.terminal.stage("delay", f"{size}; {f'corrected by {1e3 * applied:.1f} ms' if applied else 'left as it is'}")
    said = delay_findings(found, applied)
    common.terminal.findings(said)
    return stack, [*findings, *said], Timing(found, applied)


def stacked_again(base: BaseModel, logs: Sequence[Path], reading: Reading) -> Stack:
    """Read and stack logs in another way, without saying again what was noticed in them."""
    from dynid.estimation.effect_columns import settled
    from dynid.estimation.sources import read_source
    from dynid.estimation.stack import stack_base

    return stack_base(settled([read_source(path, base.model, reading)[0] for path in logs], base), base)


def stack_sources(common: Common, base: BaseModel, sources: Sequence[Source]) -> Stack:
    """Stack conditioned logs."""
    from dynid.estimation.stack import stack_base

    with common.terminal.progress() as progress:
        progress.stage("stack", "")
        result = stack_base(sources, base, progress)
    rows = f"{result.samples} samples x {len(result.joints)} joints"
    common.terminal.stage("stacked", f"{rows} -> W {int(result.rows.sum())} x {len(result.names)}")
    return result
