"""Look for mistakes in robot files, results and logs before anything is built on them."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.answer import picked
from dynid.arguments import one_thread
from dynid.errors import Finding, located
from dynid.files.artifact import kind_of, read_artifact
from dynid.files.inspect import has_torques, inspect, likely_units
from dynid.loading import checked_log, diagnose_logs, load_robot, read_log
from dynid.log import Log
from dynid.model.effects.catalogue import added_effects
from dynid.model.kinematics import tool_pose
from dynid.options import LogOptions
from dynid.robot import Robot
from dynid.signals.describe import LogSummary, describe
from dynid.text import visible
from dynid.units import joint_unit

ROBOT_SUFFIXES = (".yaml", ".yml", ".urdf")


@dataclass(frozen=True, repr=False)
class Checked:
    """What was found in one file.

    Attributes:
        path: the file.
        kind: ``"robot"``, ``"result"`` or ``"log"``.
        description: label and sentence, for people.
        facts: the same for programs.
        findings: what is worth a warning.
        robot: the robot that was read, or the arm of the log; None for a result.
        raw: the log as it was recorded, None for other files.
        log: the log in DH quantities, after the repairs that lose nothing.
    """

    path: str
    kind: str
    description: tuple[tuple[str, str], ...]
    facts: dict[str, Any] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    robot: Robot | None = None
    raw: Log | None = None
    log: Log | None = None

    @property
    def warnings(self) -> int:
        """Number of warnings."""
        return sum(finding.level == "warning" for finding in self.findings)

    def all_facts(self) -> dict[str, Any]:
        """Return the file's part of the JSON answer of ``dynid check``."""
        findings = [asdict(finding) for finding in self.findings]
        return {"path": self.path, "kind": self.kind, **self.facts, "findings": findings}

    def __repr__(self) -> str:
        """Return the description, one fact per line."""
        lines = [*self.description, *((f.code, f.text) for f in self.findings)]
        return "\n".join(visible(f"{label:<10} {text}") for label, text in lines)


@one_thread
def check(
    paths: Sequence[str | Path],
    robot: Robot | None = None,
    options: LogOptions = LogOptions(),
) -> tuple[Checked, ...]:
    """Look for mistakes in robot files, logs and results.

    Args:
        paths: the files; their kind is taken from their names.
        robot: the arm of the logs; that of the first robot file among the paths when None.
        options: how logs are read; filter, velocity and delay do not matter here.

    Raises:
        DynidError: the first serious fault of any file.
    """
    kinds = [_kind_of(str(path)) for path in paths]
    robots = {
        path: load_robot(path) for path, kind in zip(paths, kinds, strict=True) if kind == "robot"
    }
    arm, checks = robot or next(iter(robots.values()), None), []
    for path, kind in zip(paths, kinds, strict=True):
        if kind == "robot":
            checks.append(_check_robot(robots[path]))
        elif kind == "result":
            checks.append(_check_result(Path(path)))
        elif arm is None:
            checks.append(inspected(Path(path), options))
        else:
            checks.append(_check_log(Path(path), arm, options))
    return tuple(checks)


def _kind_of(path: str) -> str:
    """Return what a path is taken for: ``"robot"``, ``"result"`` or ``"log"``."""
    file = Path(path.partition(".urdf#")[0] + ".urdf" * (".urdf#" in path))
    if file.suffix == ".npz" and file.is_file():
        kind = kind_of(file)
        # Why: arrays without a header are a log that somebody has saved.
        return "log" if kind == "dynid/log" or (not kind and zipfile.is_zipfile(file)) else "result"
    return "log" if file.is_dir() or file.suffix not in (*ROBOT_SUFFIXES, "") else "robot"


# ---------------------------------------------------------------- robot files
def _check_robot(robot: Robot) -> Checked:
    """Describe a robot file that could be read."""
    added_effects(robot)  # Why: it raises what is wrong with them.
    tool = tool_pose(robot, np.zeros(robot.n))[:3, 3].tolist()
    revolute = sum(joint.revolute for joint in robot.joints)
    counts = {"revolute": revolute, "prismatic": robot.n - revolute}
    kinds = " and ".join(f"{count} {kind}" for kind, count in counts.items() if count)
    kinds += f" joint{'s' * (robot.n > 1)}, {robot.convention} DH"
    place = "  ".join(f"{axis} {value:.3f}" for axis, value in zip("xyz", tool, strict=True))
    gravity = ", ".join(f"{value:g}" for value in robot.gravity)
    effects = ", ".join(f"{e.effect} on {', '.join(e.joints)}" for e in robot.effects)
    limits = []
    for name in ("position", "velocity", "acceleration", "torque"):
        without = [joint.name for joint in robot.joints if getattr(joint.limits, name) is None]
        none = len(without) == robot.n
        missing = f" (not for {', '.join(without)})" if without and not none else ""
        limits.append(f"{name} {'none' if none else 'given'}{missing}")
    driver = (
        "none: logs must have the robot file's joint names, rad and Nm (m and N at sliding joints)"
    )
    if robot.driver is not None:
        topic = robot.driver.topic or "the driver's usual topic"
        driver = f"{robot.driver.kind}, {topic}, torque from {robot.torque.source}"
    prior = "none"
    if robot.prior is not None:
        numbers = f"{len(robot.prior.links)} links with numbers"
        prior = "uniform cylinders" if robot.prior.cylinders else numbers
    lines = (
        ("robot", f"{robot.name}, {kinds}"),
        ("tool", f"at q = 0: {place} m   (compare with a ruler)"),
        ("gravity", f"{gravity} m/s^2 in frame 0"),
        ("links", f"identified: {', '.join(map(str, robot.identified_links))}"),
        ("limits", "   ".join(limits)),
        ("driver", driver),
        ("prior", prior),
        *([("effects", effects)] if effects else []),
    )
    facts = {
        **picked(robot, "convention", robot="name", n_joints="n", key="model_key"),
        "joints": list(robot.joint_names),
        "tool_at_zero_m": tool,
        "gravity_m_s2": list(robot.gravity),
    }
    path = str(robot.path or robot.source)
    return Checked(path, "robot", lines, facts, robot.findings, robot)


# ---------------------------------------------------------------- results
def _check_result(path: Path) -> Checked:
    """Describe a result file by its header."""
    artifact = read_artifact(path)
    header = artifact.header
    lines = [("result", f"{artifact.schema}, written by dynid {header.get('dynid', '?')}")]
    for key in ("robot", "command", "seed", "convention", "method", "rank", "key"):
        if key in header:
            lines.append((key, str(header[key])))
    inputs = header.get("inputs")
    for i, (name, hashed) in enumerate(inputs.items() if isinstance(inputs, dict) else ()):
        lines.append(("" if i else "input", f"{name}  sha256 {str(hashed)[:12]}"))
    shapes = {name: list(array.shape) for name, array in artifact.arrays.items()}
    sizes = (f"{name} {' x '.join(map(str, shape)) or 'scalar'}" for name, shape in shapes.items())
    lines.append(("arrays", ", ".join(sizes)))
    facts = {"result": artifact.schema, "header": header, "arrays": shapes}
    return Checked(str(path), "result", tuple(lines), facts)


# ---------------------------------------------------------------- logs
def _check_log(path: Path, robot: Robot, options: LogOptions) -> Checked:
    """Check and describe a log of a robot."""
    raw = read_log(path, robot, options)
    log = checked_log(raw, robot, options)
    log = replace(log, findings=(*log.findings, *diagnose_logs([log], robot, options)))
    summary, columns = describe(log, robot), describe(raw, robot)
    matched = f"taken in the order of the robot file: {', '.join(robot.log_names)}"
    if columns.matched:
        ignored = f"; ignored: {', '.join(columns.ignored)}" if columns.ignored else ""
        matched = f"matched by name: {', '.join(columns.matched)}{ignored}"
    numbers = picked(
        summary,
        *("samples", "gaps", "least_moving", "velocity_slope", "torque_share"),
        duration_s="duration",
        rate_hz="rate",
        jitter_share="jitter",
        longest_gap_s="longest_gap",
        position_span_rad="span",
        rms_velocity_rad_s="rms_velocity",
        **{f"torque_max_{'a' if summary.torque_unit == 'A' else 'nm'}": "torque_max"},
    )
    facts = {
        "robot": robot.name,
        "topic": raw.topic,
        "joints": list(robot.joint_names),
        "ignored": list(columns.ignored),
        **numbers,
    }
    lines = _lines(summary, raw, matched, robot)
    return Checked(str(path), "log", lines, facts, log.findings, robot, raw, log)


def inspected(path: Path, options: LogOptions) -> Checked:
    """Describe a recording without knowing its arm.

    Raises:
        DynidError: nothing of it can be read.
    """
    with located(str(path)):
        contents = inspect(path, options.rate)
    lines = [
        ("topic", f"{topic.name}  {topic.type}, {topic.count} messages")
        for topic in contents.topics.values()
    ]
    if contents.columns:
        lines.append(("columns", ", ".join(contents.columns)))
    described = []
    for log in contents.logs:
        units = likely_units(log)
        effort = units["effort"] if has_torques(log) else "no torques"
        rate = (len(log) - 1) / log.duration if log.duration > 0 else 0.0
        span = np.ptp(log.q, axis=0).tolist()
        names = ", ".join(log.names) or f"{log.n} without names"
        lines += [
            ("joints", f"{log.topic} {names}".strip()),
            ("samples", f"{len(log)}, {log.duration:.1f} s, {rate:.1f} Hz"),
            ("units", f"likely {units['position']} (span {max(span):.2f}) and {effort}"),
        ]
        described.append(
            {
                "topic": log.topic,
                "units": units,
                "joints": list(log.names),
                "samples": len(log),
                "duration_s": log.duration,
                "rate_hz": rate,
                "span": span,
            }
        )
    snippet = contents.snippet()
    lines += [("" if k else "robot file", line) for k, line in enumerate(snippet.splitlines())]
    facts = {
        "topics": [picked(t, "name", "type", messages="count") for t in contents.topics.values()],
        "columns": list(contents.columns),
        "joint_states": described,
        "snippet": snippet,
    }
    return Checked(str(path), "log", tuple(lines), facts, contents.findings)


def _lines(
    summary: LogSummary, raw: Log, matched: str, robot: Robot
) -> tuple[tuple[str, str], ...]:
    gaps = "no gaps"
    if summary.gaps:
        gaps = f"{summary.gaps} gaps (longest {1e3 * summary.longest_gap:.0f} ms)"
    rate = f"{summary.rate:.1f} Hz +-{100 * summary.jitter:.1f} %"
    least = robot.joint_names.index(summary.least_moving)
    unit = joint_unit("rad/s", revolute=robot.joints[least].revolute)
    slowest = f"({summary.rms_velocity[least]:.2f} {unit} rms)"
    return (
        ("log", f"{summary.samples} samples, {summary.duration:.1f} s, {rate}, {gaps}"),
        *([("topic", raw.topic)] if raw.topic else []),
        ("columns", matched),
        ("units", _units(summary, robot)),
        ("motion", f"{summary.least_moving} moves least {slowest}"),
    )


def _units(summary: LogSummary, robot: Robot) -> str:
    """Say the units of a log; of an arm with sliding joints apart for turning and for sliding ones."""
    if all(joint.revolute for joint in robot.joints):
        slopes = [value for value in summary.velocity_slope if value is not None]
        velocity = "not measured or not used"
        if slopes:
            velocity = f"slope to dq/dt {min(slopes):.2f} to {max(slopes):.2f}"
        shares = [value for value in summary.torque_share if value is not None]
        share = f", {100 * max(shares):.0f} % of the rating" if shares else ""
        torque = f"{summary.torque_unit or 'Nm'} (max {max(summary.torque_max):.1f}{share})"
        position = f"position rad (span {max(summary.span):.1f})"
        return f"{position}   velocity rad/s ({velocity})   torque {torque}"
    words = []
    for revolute, kind, length, effort in (
        (True, "turning", "rad", "Nm"),
        (False, "sliding", "m", "N"),
    ):
        some = [j for j, joint in enumerate(robot.joints) if joint.revolute is revolute]
        if some:
            span, top = (max(x[j] for j in some) for x in (summary.span, summary.torque_max))
            unit = "A" if summary.torque_unit == "A" else effort
            sizes = f"{length} (span {span:.2f}), {length}/s, {unit} (max {top:.1f})"
            words.append(f"{kind} joints {sizes}")
    return "   ".join(words)
