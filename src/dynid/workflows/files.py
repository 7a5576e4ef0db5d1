"""Files of others: what they hold and what is wrong with it, recordings as .npz or .csv, a robot file from a URDF."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dynid.answer import Answer, Facts, Part, picked
from dynid.arguments import one_thread
from dynid.errors import Finding, WrongMessageType, located
from dynid.files.artifact import kind_of, read_artifact
from dynid.files.convert import write_log
from dynid.files.inspect import has_torques, inspect, likely_units
from dynid.files.robotfile import robot_text
from dynid.files.urdffile import read_urdf
from dynid.judgement.rules import Step
from dynid.loading import checked_log, diagnose_logs, load_robot, read_log
from dynid.log import Log
from dynid.model.effects.catalogue import added_effects
from dynid.model.from_urdf import import_arm
from dynid.model.kinematics import tool_pose
from dynid.options import LogOptions
from dynid.robot import Robot, roll_pitch_yaw
from dynid.signals.checks import describe
from dynid.signals.columns import matching_columns
from dynid.text import shell
from dynid.units import joint_unit
from dynid.workflows.options import ImportOptions

ROBOT_SUFFIXES = (".yaml", ".yml", ".urdf")


#: What a file lacks, by the warning that tells it.
MISSING = {
    "W330": "usable once `driver: columns:` names the columns",
    "W333": "not usable: no joint states",
}
Lines = Sequence[tuple[str, str]]


@dataclass(frozen=True)
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

    path: Path
    kind: str
    description: Lines
    facts: Facts
    findings: tuple[Finding, ...] = ()
    robot: Robot | None = None
    raw: Log | None = None
    log: Log | None = None


@one_thread
def check(
    paths: Sequence[str | Path],
    robot: Robot | None = None,
    options: LogOptions = LogOptions(),
) -> list[Checked]:
    """Look for mistakes in robot files, logs and results.

    Args:
        paths: the files; their kind is taken from their names.
        robot: the arm of the logs; that of the first robot file among the paths when None.
        options: how logs are read; filter, velocity and delay do not matter here.

    Raises:
        DynidError: the first serious fault of any file.
    """
    kinds = [(Path(path), _kind_of(str(path))) for path in paths]
    robots = {path: load_robot(path) for path, kind in kinds if kind == "robot"}
    arm, checks = robot or next(iter(robots.values()), None), []
    for path, kind in kinds:
        if kind == "robot":
            checks.append(_check_robot(robots[path]))
        elif kind == "result":
            checks.append(_check_result(path))
        elif arm is None:
            checks.append(inspected(path, options))
        else:
            checks.append(_check_log(path, arm, options))
    return checks


def checks_answer(
    checks: Sequence[Checked], wrote: Sequence[Sequence[Path]], *, strict: bool
) -> Answer:
    """Return what ``dynid check`` answers.

    Args:
        checks: what was found in each file.
        wrote: what was written of each.
        strict: whether warnings are an exit status of 1.
    """
    findings, parts = [finding for each in checks for finding in each.findings], list[Part]()
    missing = [MISSING[each.code] for each in findings if each.code in MISSING]
    warnings = sum(each.level == "warning" for each in findings)
    for each in checks:
        parts += [*[""] * bool(parts), *each.description, *each.findings]
    names = " and ".join(each.path.name for each in checks)
    but = f", but see the warning{'s' * (warnings > 1)}" if warnings else ": no mistake was found"
    sentence = f"{names} can be used{but}."
    if missing:
        sentence = f"{names}: {missing[0]}."
    elif any(each.kind == "log" and each.robot is None for each in checks):
        sentence = f"{names} can be read; checking the numbers needs a robot file."
    facts = {
        "checked": [
            {
                **picked(each, "path", "kind"),
                **each.facts,
                "findings": each.findings,
                "wrote": files,
            }
            for each, files in zip(checks, wrote, strict=True)
        ],
        "findings": findings,
        "warnings": warnings,
        "usable": not missing,
    }
    return Answer(
        facts,
        sentence,
        parts,
        wrote=[path for files in wrote for path in files],
        next=[] if missing else _steps(checks),
        status=strict and warnings > 0,
    )


def _steps(checks: Sequence[Checked]) -> list[Step]:
    """Return the next command and why, where the files tell it."""
    robot = next((each.robot for each in checks if each.robot is not None), None)
    logs = [each.path for each in checks if each.kind == "log"]
    if logs and robot is None:
        why = "ROBOT is a robot file; the block above is the part of it that reads this recording."
        return [Step(why, f"{shell('dynid', 'check', *logs)} --robot ROBOT")]
    if robot is None:
        return []
    if logs:
        why = f"Identify the arm from {'it' if len(logs) == 1 else 'them'}."
        return [Step(why, f"dynid identify {robot.word} {shell(*logs)}")]
    command = f"dynid model {robot.word}"
    return [Step("Find out which parameters of the arm are identifiable.", command)]


def _kind_of(path: str) -> str:
    """Return what a path is taken for: ``"robot"``, ``"result"`` or ``"log"``."""
    file = Path(path.partition(".urdf#")[0] + ".urdf" * (".urdf#" in path))
    if file.suffix == ".npz" and file.is_file():
        # Why: arrays without a header are a log that somebody has saved.
        return "log" if kind_of(file) in ("dynid/log", "") else "result"
    return "log" if file.is_dir() or file.suffix not in (*ROBOT_SUFFIXES, "") else "robot"


# ---------------------------------------------------------------- robot files
def _check_robot(robot: Robot) -> Checked:
    """Describe a robot file that could be read."""
    added_effects(robot)  # Why: it raises what is wrong with them.
    tool = tool_pose(robot, np.zeros(robot.n))[:3, 3]
    counts = sorted(Counter(joint.type for joint in robot.joints).items(), reverse=True)
    kinds = " and ".join(f"{count} {kind}" for kind, count in counts)
    kinds += f" joint{'s' * (robot.n > 1)}, {robot.convention} DH"
    place = "  ".join(f"{axis} {value:.3f}" for axis, value in zip("xyz", tool, strict=True))
    gravity = ", ".join(f"{value:g}" for value in robot.gravity)
    driver = "none: logs must have the robot file's joint names, rad and Nm, m and N"
    if robot.driver is not None:
        topic = robot.driver.topic or "the driver's usual topic"
        driver = f"{robot.driver.kind}, {topic}, torque from {robot.torque.source}"
    lines = (
        ("robot", f"{robot.name}, {kinds}"),
        ("tool", f"at q = 0: {place} m   (compare with a ruler)"),
        ("gravity", f"{gravity} m/s^2 in frame 0"),
        ("driver", driver),
    )
    facts = {
        **picked(robot, "convention", robot="name", n_joints="n", key="model_key"),
        **picked(robot, joints="joint_names", gravity_m_s2="gravity"),
        "tool_at_zero_m": tool,
    }
    path = Path(str(robot.path or robot.source))
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
    shapes = {name: array.shape for name, array in artifact.arrays.items()}
    sizes = (f"{name} {' x '.join(map(str, shape)) or 'scalar'}" for name, shape in shapes.items())
    lines.append(("arrays", ", ".join(sizes)))
    facts = {"result": artifact.schema, "header": header, "arrays": shapes}
    return Checked(path, "result", lines, facts)


# ---------------------------------------------------------------- logs
def _check_log(path: Path, robot: Robot, options: LogOptions) -> Checked:
    """Check and describe a log of a robot."""
    raw = read_log(path, robot, options)
    log = checked_log(raw, robot, options)
    log = replace(log, findings=(*log.findings, *diagnose_logs([log], robot, options)))
    numbers, columns = describe(log, robot), matching_columns(raw, robot)
    ignored = [name for k, name in enumerate(raw.names) if k not in columns]
    matched = f"taken in the order of the robot file: {', '.join(robot.log_names)}"
    if raw.names:
        left = f"; ignored: {', '.join(ignored)}" if ignored else ""
        matched = f"matched by name: {', '.join(raw.names[k] for k in columns)}{left}"
    facts = {
        **picked(robot, robot="name", joints="joint_names"),
        "topic": raw.topic,
        "ignored": ignored,
        **numbers,
    }
    gaps = "no gaps"
    if numbers["gaps"]:
        gaps = f"{numbers['gaps']} gaps (longest {1e3 * numbers['longest_gap_s']:.0f} ms)"
    rate = f"{numbers['rate_hz']:.1f} Hz +-{100 * numbers['jitter_share']:.1f} %"
    least = robot.joint_names.index(numbers["least_moving"])
    unit = joint_unit("rad/s", revolute=robot.joints[least].revolute)
    slowest = f"{numbers['rms_velocity_rad_s'][least]:.2f} {unit} rms"
    lines = (
        ("log", f"{len(log)} samples, {log.duration:.1f} s, {rate}, {gaps}"),
        *([("topic", raw.topic)] if raw.topic else []),
        ("columns", matched),
        ("units", _units(numbers, robot)),
        ("motion", f"{numbers['least_moving']} moves least ({slowest})"),
    )
    return Checked(path, "log", lines, facts, log.findings, robot, raw, log)


def _units(numbers: Facts, robot: Robot) -> str:
    """Say the units of a log that was described."""
    kinds = sorted({joint.revolute for joint in robot.joints}, reverse=True)
    units = [("rad", "rad/s", "Nm") if kind else ("m", "m/s", "N") for kind in kinds]
    length, speed, effort = (" or ".join(names) for names in zip(*units, strict=True))
    currents = numbers.get("torque_max_a")
    effort = "A" if currents else effort
    slopes = [slope for slope in numbers["velocity_slope"] if slope is not None]
    shares = [share for share in numbers["torque_share"] if share is not None]
    velocity = "not measured or not used"
    if slopes:
        velocity = f"slope to dq/dt {min(slopes):.2f} to {max(slopes):.2f}"
    rated = f", {100 * max(shares):.0f} % of the rating" if shares else ""
    largest = max(currents or numbers["torque_max_nm"])
    return (
        f"position {length} (span {max(numbers['position_span_rad']):.1f})   velocity {speed} ({velocity})   "
        f"torque {effort} (max {largest:.1f}{rated})"
    )


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
        span = np.ptp(log.q, axis=0)
        names = ", ".join(log.names) or f"{log.n} without names"
        lines += [
            ("joints", f"{log.topic} {names}".strip()),
            ("samples", f"{len(log)}, {log.duration:.1f} s, {rate:.1f} Hz"),
            ("units", f"likely {units['position']} (span {max(span):.2f}) and {effort}"),
        ]
        described.append(
            {
                **picked(log, "topic", joints="names", duration_s="duration"),
                "units": units,
                "samples": len(log),
                "rate_hz": rate,
                "span": span,
            }
        )
    snippet = contents.snippet()
    lines += [("" if k else "robot file", line) for k, line in enumerate(snippet.splitlines())]
    facts = {
        "topics": [picked(t, "name", "type", messages="count") for t in contents.topics.values()],
        "columns": contents.columns,
        "joint_states": described,
        "snippet": snippet,
    }
    return Checked(path, "log", lines, facts, contents.findings)


def convert(
    path: Path, target: Path, robot: Robot | None = None, options: LogOptions = LogOptions()
) -> Answer:
    """Write a recording in the format of another file's suffix; every number stays as it was recorded.

    Args:
        path: the recording.
        target: the file to write: .npz or .csv.
        robot: the arm, whose file says which topic and columns; None to take what is there.
        options: which joint states.

    Raises:
        DynidError: the recording cannot be read, or the file cannot be written.
    """
    if robot is not None:
        log = read_log(path, robot, options)
        findings = log.findings
    else:
        with located(str(path)):
            contents = inspect(path, options.rate)
            logs = [log for log in contents.logs if options.topic in (None, log.topic)]
            if not logs:
                there = [*map(str, contents.topics.values())] or contents.columns or ["nothing"]
                what = f"{path} has no topic that dynid can read as joint states; it has {', '.join(there)}"
                raise WrongMessageType(what, fix="give --robot")
        log, findings = max(logs, key=len), contents.findings
    size = f"{len(log)} samples, {log.duration:.1f} s, {log.n} joints"
    return Answer(
        {"samples": len(log), **picked(log, duration_s="duration", joints="names")},
        parts=(*findings, ("log", size)),
        wrote=[write_log(log, target)],
    )


UNKNOWN_EFFORT = "a URDF does not say what the effort column of a log is; write `torque: {source: ...}` into the file"
HEAD = """\
Made by dynid import from {urdf}, link {base} to {tip}; joint values are the URDF's.
The frame of {tip} in the last DH frame: xyz {xyz}, rpy {rpy} [m, rad].
Forward kinematics agree with the URDF to {largest:.1e} m and rad.
What the effort column of your logs is, a URDF does not say. Write one of these:
torque: {{source: joint_sensor}}     sensors behind the gears, as on KUKA LWR and iiwa, Franka
torque: {{source: motor_torque}}     from the motors' currents, in N m, as on UR and most industrial arms
torque: {{source: motor_current}}    in A, or in a unit that nobody knows (then with relative: true)"""


def import_urdf(path: Path, options: ImportOptions) -> tuple[str, Answer]:
    """Return the text of the robot file that a chain of a URDF describes, and what is worth knowing about it.

    Args:
        path: the URDF.
        options: which chain.

    Raises:
        WrongUrdf: there is no such chain, or it has joints that a DH table cannot describe.
    """
    made = import_arm(
        read_urdf(path),
        read_urdf(path, exact=True),
        **picked(options, "base", "tip", "convention", "name"),
    )
    robot, pose = made.robot, made.tip_pose
    # Position [m] and roll, pitch, yaw [rad] of the tip in the last DH frame, rounding noise taken off.
    rows = (pose[:3, 3], roll_pitch_yaw(pose[:3, :3]))
    xyz, rpy = ([round(float(value), 12) + 0.0 for value in row] for row in rows)
    head = HEAD.format(urdf=path.name, xyz=xyz, rpy=rpy, **picked(made, "base", "tip", "largest"))
    bodies = robot.prior.links if robot.prior else ()
    facts = {
        **picked(robot, "convention", robot="name", n_joints="n"),
        **picked(made, "base", "tip", kinematics_largest_difference="largest"),
        "joints": [
            picked(
                joint,
                "type",
                joint="name",
                a_m="a",
                twist_rad="twist",
                d_m="d",
                theta_offset_rad="theta_offset",
            )
            for joint in robot.joints
        ],
        "tip_in_last_frame": {"xyz_m": xyz, "rpy_rad": rpy},
        "mass_kg": sum(body.mass for body in bodies) if robot.prior else None,
        "findings": made.findings,
    }
    chain = f"{robot.name}, {robot.n} joints from {made.base} to {made.tip}"
    answer = Answer(
        facts,
        parts=(
            *made.findings,
            ("robot", f"{chain}, {robot.convention} DH"),
            ("check", f"forward kinematics agree with the URDF to {made.largest:.1e} m and rad"),
            ("torque", UNKNOWN_EFFORT),
        ),
    )
    return robot_text(robot, head), answer
