"""The half of ``dynid check`` that looks at logs: reads, checks, describes, and on demand writes log.npz."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dynid.cli.check import Checked
from dynid.cli.intervals import stretches
from dynid.cli.options import Common
from dynid.cli.prompt import input_hashes, may_write
from dynid.errors import WrongUsage

if TYPE_CHECKING:
    from dynid.log import Log
    from dynid.robot import Robot
    from dynid.signals.describe import LogSummary


@dataclass(frozen=True)
class LogOptions:
    """The options of ``check`` that only concern logs, as given on the command line."""

    topic: str | None = None
    rate: float | None = None
    exclude: Sequence[str] = ()
    sort_time: bool = False
    convert: bool = False
    fix: bool = False


def check_log(common: Common, path: Path, robot: Robot | None, options: LogOptions) -> Checked:
    """Check and describe a log of a robot.

    Raises:
        WrongUsage: the robot is not given.
        DynidError: the first serious fault of the log.
    """
    from dynid.files.logs import read_log
    from dynid.signals.checks import prepare
    from dynid.signals.describe import describe

    exclude = stretches(options.exclude)
    if robot is None and path.exists():
        raise WrongUsage(
            f"{path} is a log, and no robot is given",
            why="columns, units and limits are those of a robot file",
            fix=f"dynid check {path} --robot ROBOT",
        )
    log = read_log(path, robot=robot, topic=options.topic, rate=options.rate)  # type: ignore[arg-type]
    assert robot is not None  # a path that does not exist has ended in read_log
    raw = log
    log = prepare(log, robot, exclude=exclude, sort_time=options.sort_time)
    summary = describe(log, robot)
    wrote = _written(common, path, robot, options, log if options.fix else raw)
    facts = {
        "robot": robot.name,
        "topic": raw.topic,
        "joints": list(robot.joint_names),
        "ignored": list(describe(raw, robot).ignored),
        **_facts(summary),
    }
    return Checked(str(path), "log", tuple(_lines(summary, raw, robot)), facts, log.findings, wrote)


def _written(common: Common, path: Path, robot: Robot, options: LogOptions, log: Log) -> tuple[Path, ...]:
    """Write log.npz where that was asked for and is not done yet."""
    if not (options.convert or options.fix):
        return ()
    target = common.folder(robot.slug) / "log.npz"
    inputs = input_hashes({"log": path}, asdict(options))
    if not may_write(common, target, inputs):
        return ()
    log.save(target, common.header(inputs))
    return (target,)


def _facts(summary: LogSummary) -> dict[str, object]:
    unit = "nm" if summary.torque_unit != "A" else "a"
    return {
        "samples": summary.samples,
        "duration_s": summary.duration,
        "rate_hz": summary.rate,
        "jitter_share": summary.jitter,
        "gaps": summary.gaps,
        "longest_gap_s": summary.longest_gap,
        "position_span_rad": list(summary.span),
        "rms_velocity_rad_s": list(summary.rms_velocity),
        "velocity_slope": list(summary.velocity_slope),
        f"torque_max_{unit}": list(summary.torque_max),
        "torque_share": list(summary.torque_share),
        "least_moving": summary.least_moving,
    }


def _lines(summary: LogSummary, raw: Log, robot: Robot) -> list[tuple[str, str]]:
    gaps = "no gaps" if not summary.gaps else f"{summary.gaps} gaps (longest {1e3 * summary.longest_gap:.0f} ms)"
    rate = f"{summary.rate:.1f} Hz +-{100 * summary.jitter:.1f} %"
    lines = [("log", f"{summary.samples} samples, {summary.duration:.1f} s, {rate}, {gaps}")]
    if raw.topic:
        lines.append(("topic", raw.topic))
    lines.append(("columns", _columns(raw, robot)))
    lines.append(("units", _units(summary)))
    least = summary.least_moving
    slowest = summary.rms_velocity[robot.joint_names.index(least)]
    lines.append(("motion", f"{least} moves least ({slowest:.2f} rad/s rms)"))
    return lines


def _columns(raw: Log, robot: Robot) -> str:
    from dynid.signals.describe import describe

    found = describe(raw, robot)
    if not found.matched:
        return f"taken in the order of the robot file: {', '.join(robot.log_names)}"
    ignored = f"; ignored: {', '.join(found.ignored)}" if found.ignored else ""
    return f"matched by name: {', '.join(found.matched)}{ignored}"


def _units(summary: LogSummary) -> str:
    slopes = [value for value in summary.velocity_slope if value is not None]
    velocity = f"slope to dq/dt {min(slopes):.2f} to {max(slopes):.2f}" if slopes else "not measured or not used"
    shares = [value for value in summary.torque_share if value is not None]
    share = f", {100 * max(shares):.0f} % of the rating" if shares else ""
    torque = f"torque {summary.torque_unit or 'Nm'} (max {max(summary.torque_max):.1f}{share})"
    return f"position rad (span {max(summary.span):.1f})   velocity rad/s ({velocity})   {torque}"
