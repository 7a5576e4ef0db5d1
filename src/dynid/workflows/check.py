"""Look for mistakes in robot files, results and logs before anything is built on them."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from dynid.arguments import one_thread
from dynid.errors import Finding
from dynid.files.artifact import read_artifact, read_header
from dynid.files.inspect import inspect
from dynid.loading import checked_log, load_robot, located, read_log
from dynid.log import Log
from dynid.model.effects.catalogue import added_effects
from dynid.model.kinematics import tool_pose
from dynid.options import LogOptions
from dynid.robot import Robot
from dynid.signals.describe import LogSummary, describe
from dynid.text import visible
from dynid.units import joint_unit
from dynid.workflows.logs import diagnose_logs

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

    def answer(self) -> dict[str, Any]:
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
    kinds = [kind_of(str(path)) for path in paths]
    robots = {
        path: load_robot(path) for path, kind in zip(paths, kinds, strict=True) if kind == "robot"
    }
    arm = robot or next(iter(robots.values()), None)
    found = []
    for path, kind in zip(paths, kinds, strict=True):
        if kind == "robot":
            found.append(check_robot(robots[path]))
        elif kind == "result":
            found.append(check_result(Path(path)))
        else:
            found.append(check_log(Path(path), arm, options))
    return tuple(found)


def kind_of(path: str) -> str:
    """Return what a path is taken for: ``"robot"``, ``"result"`` or ``"log"``."""
    file = Path(path.partition(".urdf#")[0] + ".urdf" * (".urdf#" in path))
    if file.suffix == ".npz" and file.is_file():
        header = read_header(file)
        plain = header is None and zipfile.is_zipfile(file)
        return (
            "log"
            if plain or str((header or {}).get("schema", "")).startswith("dynid/log/")
            else "result"
        )
    return "log" if file.is_dir() or file.suffix not in (*ROBOT_SUFFIXES, "") else "robot"


# ---------------------------------------------------------------- robot files
def check_robot(robot: Robot) -> Checked:
    """Describe a robot file that could be read."""
    import numpy as np

    added_effects(robot)  # Why: it raises what is wrong with them.
    x, y, z = (float(value) for value in tool_pose(robot, np.zeros(robot.n))[:3, 3])
    revolute = sum(joint.revolute for joint in robot.joints)
    kinds = [
        f"{count} {kind}"
        for count, kind in ((revolute, "revolute"), (robot.n - revolute, "prismatic"))
        if count
    ]
    gravity = ", ".join(f"{value:g}" for value in robot.gravity)
    lines = [
        (
            "robot",
            f"{robot.name}, {' and '.join(kinds)} joint{'s' if robot.n > 1 else ''}, {robot.convention} DH",
        ),
        ("tool", f"at q = 0: x {x:.3f}  y {y:.3f}  z {z:.3f} m   (compare with a ruler)"),
        ("gravity", f"{gravity} m/s^2 in frame 0"),
        ("links", f"identified: {', '.join(str(number) for number in robot.identified_links)}"),
        ("limits", _limits(robot)),
        ("driver", _driver(robot)),
        ("prior", _prior(robot)),
    ]
    if robot.effects:
        lines.append(
            ("effects", ", ".join(f"{e.effect} on {', '.join(e.joints)}" for e in robot.effects))
        )
    facts = {
        "robot": robot.name,
        "n_joints": robot.n,
        "joints": list(robot.joint_names),
        "convention": robot.convention,
        "tool_at_zero_m": [x, y, z],
        "gravity_m_s2": list(robot.gravity),
        "key": robot.model_key,
    }
    return Checked(
        str(robot.path or robot.source), "robot", tuple(lines), facts, robot.findings, robot
    )


def _limits(robot: Robot) -> str:
    words = []
    for name in ("position", "velocity", "acceleration", "torque"):
        without = [joint.name for joint in robot.joints if getattr(joint.limits, name) is None]
        missing = f" (not for {', '.join(without)})" if 0 < len(without) < robot.n else ""
        words.append(f"{name} {'none' if len(without) == robot.n else 'given'}{missing}")
    return "   ".join(words)


def _driver(robot: Robot) -> str:
    if robot.driver is None:
        return "none: logs must have the robot file's joint names, rad and Nm (m and N at sliding joints)"
    topic = robot.driver.topic or "the driver's usual topic"
    return f"{robot.driver.kind}, {topic}, torque from {robot.torque.source}"


def _prior(robot: Robot) -> str:
    if robot.prior is None:
        return "none"
    return (
        "uniform cylinders"
        if robot.prior.cylinders
        else f"{len(robot.prior.links)} links with numbers"
    )


# ---------------------------------------------------------------- results
def check_result(path: Path) -> Checked:
    """Describe a result file by its header.

    Raises:
        NotAnArtifact: it is not a result, or is damaged.
    """
    artifact = read_artifact(path)
    lines = [("result", f"{artifact.schema}, written by dynid {artifact.header.get('dynid', '?')}")]
    for key in ("robot", "command", "seed", "convention", "method", "rank", "key"):
        if key in artifact.header:
            lines.append((key, str(artifact.header[key])))
    inputs = artifact.header.get("inputs")
    if isinstance(inputs, dict):
        lines += [
            ("input" if not i else "", f"{name}  sha256 {str(inputs[name])[:12]}")
            for i, name in enumerate(inputs)
        ]
    shapes = {name: list(array.shape) for name, array in artifact.arrays.items()}
    sizes = (f"{name} {' x '.join(map(str, shape)) or 'scalar'}" for name, shape in shapes.items())
    lines.append(("arrays", ", ".join(sizes)))
    facts = {"result": artifact.schema, "header": artifact.header, "arrays": shapes}
    return Checked(str(path), "result", tuple(lines), facts)


# ---------------------------------------------------------------- logs
def check_log(path: Path, robot: Robot | None, options: LogOptions) -> Checked:
    """Check and describe a log of a robot; without one, say what the log holds and how a robot file would read it.

    Raises:
        DynidError: the first serious fault of the log.
    """
    if robot is None:
        return inspected(path, options)
    raw = read_log(path, robot, options)
    log = checked_log(raw, robot, options)
    log = replace(
        log, findings=(*log.findings, *diagnose_logs([log], robot, anyway=options.anyway))
    )
    summary, columns = describe(log, robot), describe(raw, robot)
    matched = f"taken in the order of the robot file: {', '.join(robot.log_names)}"
    if columns.matched:
        ignored = f"; ignored: {', '.join(columns.ignored)}" if columns.ignored else ""
        matched = f"matched by name: {', '.join(columns.matched)}{ignored}"
    facts = {
        "robot": robot.name,
        "topic": raw.topic,
        "joints": list(robot.joint_names),
        "ignored": list(columns.ignored),
        **_facts(summary),
    }
    description = tuple(_lines(summary, raw, matched, robot))
    return Checked(str(path), "log", description, facts, log.findings, robot, raw, log)


def inspected(path: Path, options: LogOptions) -> Checked:
    """Describe a recording without knowing its arm.

    Raises:
        DynidError: nothing of it can be read.
    """
    with located(str(path)):
        found = inspect(path, options.rate)
    lines = [
        ("topic", f"{topic.name}  {topic.type}, {topic.count} messages")
        for topic in found.topics.values()
    ]
    if found.columns:
        lines.append(("columns", ", ".join(found.columns)))
    described = []
    for each in found.joints:
        log, units = each.log, each.units
        effort = units["effort"] if each.has_torques else "no torques"
        rate = (len(log) - 1) / log.duration if log.duration > 0 else 0.0
        span = [float(value) for value in log.q.max(axis=0) - log.q.min(axis=0)]
        lines += [
            ("joints", f"{each.topic} {', '.join(log.names) or f'{log.n} without names'}".strip()),
            ("samples", f"{len(log)}, {log.duration:.1f} s, {rate:.1f} Hz"),
            ("units", f"likely {units['position']} (span {max(span):.2f}) and {effort}"),
        ]
        described.append(
            {
                "topic": each.topic,
                "joints": list(log.names),
                "samples": len(log),
                "duration_s": log.duration,
                "rate_hz": rate,
                "span": span,
                "units": units,
            }
        )
    snippet = found.snippet()
    lines += [("robot file" if not k else "", line) for k, line in enumerate(snippet.splitlines())]
    facts = {
        "topics": [
            {"name": t.name, "type": t.type, "messages": t.count} for t in found.topics.values()
        ],
        "columns": list(found.columns),
        "joint_states": described,
        "snippet": snippet,
    }
    return Checked(str(path), "log", tuple(lines), facts, found.findings)


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


def _lines(summary: LogSummary, raw: Log, matched: str, robot: Robot) -> list[tuple[str, str]]:
    gaps = (
        "no gaps"
        if not summary.gaps
        else f"{summary.gaps} gaps (longest {1e3 * summary.longest_gap:.0f} ms)"
    )
    rate = f"{summary.rate:.1f} Hz +-{100 * summary.jitter:.1f} %"
    least = summary.least_moving
    turns = robot.joints[robot.joint_names.index(least)].revolute
    slowest = summary.rms_velocity[robot.joint_names.index(least)]
    return [
        ("log", f"{summary.samples} samples, {summary.duration:.1f} s, {rate}, {gaps}"),
        *([("topic", raw.topic)] if raw.topic else []),
        ("columns", matched),
        ("units", _units(summary, robot)),
        (
            "motion",
            f"{least} moves least ({slowest:.2f} {joint_unit('rad/s', revolute=turns)} rms)",
        ),
    ]


def _units(summary: LogSummary, robot: Robot) -> str:
    if not all(joint.revolute for joint in robot.joints):
        return _units_by_kind(summary, robot)
    slopes = [value for value in summary.velocity_slope if value is not None]
    velocity = (
        f"slope to dq/dt {min(slopes):.2f} to {max(slopes):.2f}"
        if slopes
        else "not measured or not used"
    )
    shares = [value for value in summary.torque_share if value is not None]
    share = f", {100 * max(shares):.0f} % of the rating" if shares else ""
    torque = f"torque {summary.torque_unit or 'Nm'} (max {max(summary.torque_max):.1f}{share})"
    return f"position rad (span {max(summary.span):.1f})   velocity rad/s ({velocity})   {torque}"


def _units_by_kind(summary: LogSummary, robot: Robot) -> str:
    """Say the units of an arm with sliding joints, apart for turning and for sliding ones."""
    words = []
    for revolute in (True, False):
        some = [j for j, joint in enumerate(robot.joints) if joint.revolute is revolute]
        if some:
            kind, length = ("turning", "rad") if revolute else ("sliding", "m")
            effort = "A" if summary.torque_unit == "A" else ("Nm" if revolute else "N")
            span, top = (
                max(values[j] for j in some) for values in (summary.span, summary.torque_max)
            )
            words.append(
                f"{kind} joints {length} (span {span:.2f}), {length}/s, {effort} (max {top:.1f})"
            )
    return "   ".join(words)
