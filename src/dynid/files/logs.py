"""Any recording -> ``Log``: which reader reads a file, and which of its numbers are the robot's.

A further format is a file with a reader, its suffixes and its case in ``read_log`` and ``inspect``, and a row in
docs/reference/log-format.md. The module of a format is imported when a file of it is read.
"""

from __future__ import annotations

import difflib
import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np

from dynid.disk import sha256
from dynid.drivers.interface import JOINT_STATE, driver_of
from dynid.errors import (
    Finding,
    JointNamesDiffer,
    LogLayout,
    LogNotFound,
    NotAnArtifact,
    WrongMessageType,
)
from dynid.files import bag, rosbag2, tables, tuning
from dynid.files.artifact import require_schema
from dynid.files.messages import (
    KINOVA_TYPES,
    MULTI_ARRAY,
    Broken,
    Collector,
    nothing_readable,
)
from dynid.log import ARRAYS, COLUMNS, SCHEMA, Log, has_rows
from dynid.npz import HEADER, read_npz
from dynid.robot import Robot
from dynid.units import POSITION

#: Format of each suffix, and of the first bytes of a file that has none of these.
FORMATS = {
    ".bag": "bag",
    ".active": "bag",
    ".npz": "npz",
    ".csv": "table",
    ".tsv": "table",
    ".db3": "rosbag2",
    ".mcap": "rosbag2",
}
STARTS = {b"#ROSBAG": "bag", b"SQLite format 3\0": "rosbag2", b"\x89MCAP0\r\n": "rosbag2"}


#: What lists the topics of a bag and scans its messages, by its format.
CONTAINERS: dict[str, ModuleType] = {"bag": bag, "rosbag2": rosbag2}


def read_topics(
    path: Path, names: Collection[str], container: ModuleType
) -> tuple[dict[str, list[Log]], tuple[Finding, ...]]:
    """Return the numbers of some topics, also of a recording that is damaged.

    Returns:
        for each topic its raw logs, one for each set of joint names, the largest first; and what was noticed.

    Raises:
        BagTruncated: nothing of these topics is readable.
        WrongMessageType: the layout of the messages is not the known one of their type.
    """
    collectors: dict[str, Collector] = {}
    reasons: list[str] = []
    for part in rosbag2.parts_of(path):
        try:
            for some in container.scan(part, names):
                collectors.setdefault(some.topic.name, Collector(some.topic)).add(some)
        except Broken as error:
            reasons.append(f"{part.name}: {error}" if part != path else str(error))
    groups = {name: logs for name, one in collectors.items() if (logs := one.logs())}
    reasons += [one.reason for one in collectors.values() if one.reason]
    if not reasons:
        return groups, ()
    if not groups:
        raise nothing_readable(path, reasons[0])
    logs = [log for found in groups.values() for log in found]
    count, reason = sum(map(len, logs)), "; ".join(reasons[:3])
    seconds = max(float(np.ptp(log.extra["arrival_ns"])) for log in logs) * 1e-9
    text = (
        f"{path.name} was cut or not closed (recorder killed?): {count} messages, {seconds:.1f} s, are readable "
        f"and used; reported by the reader: {reason.rstrip('.')}"
    )
    evidence = {"messages": count, "seconds": seconds, "reason": reason}
    return groups, (Finding("W305", "warning", text, evidence),)


def format_of(path: Path) -> str:
    """Return the format of a recording: ``"bag"``, ``"rosbag2"``, ``"npz"``, ``"table"`` or ``"folder"`` of texts.

    Raises:
        LogNotFound: no such file, or not a log.
    """
    if not path.exists():
        raise LogNotFound(f"no such file {path}{_nearby(path)}", where=path)
    if path.is_dir():
        inside = (FORMATS.get(part.suffix) == "rosbag2" for part in path.iterdir())
        return "rosbag2" if (path / "metadata.yaml").is_file() or any(inside) else "folder"
    if not path.is_file():
        raise LogNotFound(f"cannot read {path}: it is no regular file", where=path)
    if path.suffix in FORMATS:
        return FORMATS[path.suffix]
    try:
        with path.open("rb") as stream:
            start = stream.read(max(map(len, STARTS)))
    except OSError as error:
        raise LogNotFound(f"cannot read {path}: {error.strerror}", where=path) from error
    for known, kind in STARTS.items():
        if start.startswith(known):
            return kind
    raise LogNotFound(
        f"{path} is not a log",
        where=path,
        fix=f"give a {', '.join(FORMATS)} file, or a folder of rosbag2 or with position.txt and torque.txt",
    )


def read_log(
    path: Path, *, robot: Robot, topic: str | None = None, rate: float | None = None
) -> Log:
    """Read a recording as it is: the driver's columns, order and units.

    Args:
        path: a file of a format of ``FORMATS``, a folder of rosbag2, or one with the paper's text files.
        robot: the robot, whose driver chooses the topic and columns.
        topic: ROS topic, None for the robot file's or the driver's.
        rate: sample rate of text files without time [Hz].

    Raises:
        LogNotFound: no such file, or not a log.
        TopicMissing: the topic is not in the bag.
        WrongMessageType: the topic holds no joint states.
        BagTruncated: a damaged bag in which nothing is readable.
        LogLayout: columns are missing.
    """
    path = Path(path)
    kind = format_of(path)
    if kind == "npz":
        log = read_npz_log(path)
    elif kind == "folder":
        log = tables.read_folder(path, rate)
    elif kind == "table":
        sensors = robot.torque.source == "joint_sensor"
        log = tables.read_table(path, robot.log_names, robot.columns.columns, rate, sensors=sensors)
    else:
        log = _read_joint_states(path, robot, topic, CONTAINERS[kind])
    log = replace(log, sha256=hash_of(path))
    if len(log) and np.isfinite(log.t[0]) and abs(log.t[0]) > tuning.CALENDAR_FROM_S:
        log = replace(log, t=log.t - log.t[0], extra={**log.extra, "t0": float(log.t[0])})
    if not log.names:
        text = f"{path.name} does not name its columns: the order {', '.join(robot.log_names)} is assumed"
        log = replace(log, findings=(*log.findings, Finding("W320", "warning", text)))
    return log


def hash_of(path: Path) -> str:
    """Return the SHA-256 of a file; of a folder of rosbag2 that of its recordings, one after the other."""
    if not path.is_dir() or format_of(path) != "rosbag2":
        return sha256(path)
    first, *more = map(sha256, rosbag2.parts_of(path))
    return hashlib.sha256("".join([first, *more]).encode()).hexdigest() if more else first


def _nearby(path: Path) -> str:
    """Return the logs beside a missing one, the most alike first."""
    folder = path.parent
    if not folder.is_dir():
        return f"; there is no folder {folder}"
    logs = [each.name for each in folder.iterdir() if each.suffix in FORMATS or each.is_dir()]
    alike = difflib.get_close_matches(path.name, sorted(logs), n=3, cutoff=0.5)
    return f"; nearby: {', '.join(alike)}" if alike else ""


# ---------------------------------------------------------------- .npz
def read_npz_log(path: Path) -> Log:
    """Read an .npz log, which ``Log.save`` writes: arrays ``t, q, [qd], tau, [q_ref]`` and one JSON header.

    Other arrays with a row per sample go into ``extra``.
    Plain .npz files of other people have no header: their columns have no names. ``q_motor`` and ``tau_motor`` in the
    place of ``q`` and ``tau`` say that the numbers are on the motor side.

    Raises:
        LogNotFound: not an .npz file, or a dynid result of another kind.
        NewerSchema: written by a newer dynid.
        TooLarge: an array unpacks like a bomb.
        LogLayout: arrays are missing or their sizes differ.
    """
    try:
        arrays = read_npz(path)
        header = dict(json.loads(str(arrays.pop(HEADER)))) if HEADER in arrays else {}
        units = {str(key): str(unit) for key, unit in dict(header.get("units") or {}).items()}
        names = tuple(header.get("joint_names") or ())
        if header:
            require_schema(path, header, SCHEMA)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise LogNotFound(
            f"{path.name} is not an .npz log, or is damaged: {error}", where=path
        ) from error
    except NotAnArtifact as error:
        holds = header.get("schema") or "something else"
        raise LogNotFound(f"{path.name} holds {holds}, not a log", where=path) from error
    motor = "q_motor" in arrays
    position, torque = ("q_motor", "tau_motor") if motor else ("q", "tau")
    for key in ("t", position, torque):
        if key not in arrays:
            have = ", ".join(sorted(arrays)) or "no arrays"
            raise LogLayout(f"{path.name} has no array '{key}'; it has {have}", where=path)
    extra = {
        key: values
        for key, values in arrays.items()
        if key not in (*ARRAYS, "q", "qd", "tau")
        and (COLUMNS[key] if key in COLUMNS else has_rows(values, arrays["t"].size))
    }
    effort = units.get("effort")
    log = Log(
        t=arrays["t"],
        q=arrays[position],
        tau=arrays[torque],
        names=names,
        qd=arrays.get("qd"),
        source=path,
        topic=str(header.get("topic", "")),
        tau_unit="A" if effort in ("A", "mA") else "Nm" if effort else "",
        units=units,
        motor_side=motor or bool(header.get("motor_side")),
        dh=bool(header.get("dh")),
        extra=extra,
    )
    if not log.q.size:
        raise LogLayout(f"{path.name}: array 'q' holds no numbers", where=path)
    return log


# ---------------------------------------------------------------- joint states of bags
def _read_joint_states(path: Path, robot: Robot, topic: str | None, container: ModuleType) -> Log:
    """Read the joint states of a robot from a bag.

    Args:
        path: the bag.
        robot: the robot, whose driver chooses the topic, and whose joint names the messages.
        topic: topic of the joint states, None for the robot file's or the driver's.
        container: what lists and reads topics of bags of this kind.

    Raises:
        TopicMissing: the topic is not in the bag.
        WrongMessageType: the topic holds no positions or no torques.
        JointNamesDiffer: the messages name no joints.
        BagTruncated: nothing is readable.
    """
    topics = {name: found.type for name, found in container.list_topics(path).items()}
    apart = robot.columns.effort_topic
    pair = _kinova_pair(topics, topic) if JOINT_STATE not in topics.values() else None
    if pair:
        chosen, apart = pair
    else:
        chosen = driver_of(robot).choose_topic(topics, topic, robot, path.name)
        if apart is not None and topics.get(apart) not in (JOINT_STATE, MULTI_ARRAY):
            found = f"is {topics[apart]}" if apart in topics else "is not there"
            raise WrongMessageType(
                f"the topic of the torques, {apart}, {found}; {JOINT_STATE} or {MULTI_ARRAY} is needed",
                where=path.name,
                fix="correct `effort_topic:` under `driver:` in the robot file",
            )
    groups, findings = read_topics(path, {chosen, apart or chosen}, container)
    log = _of_robot(groups, robot, chosen)
    if pair:
        log = _in_degrees(log, robot)
    elif not log.names:
        raise JointNamesDiffer(
            f"the messages of {chosen} name no joints",
            where=chosen,
            fix="make the driver fill the names of its JointState",
        )
    if apart is not None:
        log = _with_effort(log, _of_robot(groups, robot, apart), robot)
    for key in ("position", "effort"):
        if key in log.extra["absent"]:
            raise WrongMessageType(
                f"{chosen} has no {key} in any of its {len(log)} messages", where=path.name
            )
    if log.extra["clock"] == "arrival":
        text = (
            f"{' and '.join(pair or [chosen])} has no usable time stamps: "
            "the time of arrival in the bag is used, which jitters more"
        )
        findings = (*findings, Finding("W304", "warning", text))
    return replace(log, source=path, findings=findings)


def _kinova_pair(topics: dict[str, str], asked: str | None) -> tuple[str, str] | None:
    """Return the topics of angles and torques of a bag that has only Kinova's own messages."""
    own = [name for name, kind in topics.items() if kind in KINOVA_TYPES]
    angles = [name for name in own if name.endswith("joint_angles")]
    torques = [name for name in own if name.endswith("joint_torques")]
    pair = next(zip(angles, torques, strict=False), None)
    return pair if pair and asked in (None, *pair) else None


def _of_robot(groups: Mapping[str, Sequence[Log]], robot: Robot, topic: str) -> Log:
    """Return the log of a topic whose names cover the robot's; other nodes may publish on the same topic."""
    logs = groups.get(topic, ())
    if not logs:
        raise WrongMessageType(f"{topic} has no messages", where=topic)
    covering = (
        log
        for names in (robot.log_names, robot.joint_names)
        for log in logs
        if set(names) <= set(log.names)
    )
    return next(covering, logs[0])


def _in_degrees(log: Log, robot: Robot) -> Log:
    """Return angles of Kinova's own messages, which are degrees by definition, in the unit of the robot file."""
    n = min(robot.n, log.n)
    q = log.q[:, :n] * POSITION["deg"] / POSITION[robot.columns.units["position"]]
    return replace(log, q=q, tau=log.tau[:, :n], names=robot.log_names[:n])


def _with_effort(log: Log, one: Log, robot: Robot) -> Log:
    """Return a log with the torques of another topic, each position with the torque at its time.

    Raises:
        WrongMessageType: the topic has other joints, or no time in common with the positions.
    """
    torque = one.q if "effort" in one.extra["absent"] else one.tau
    joints = one.names or robot.log_names[: one.n]
    if torque.shape[1] < robot.n or not set(joints) <= {*log.names, *one.names}:
        raise WrongMessageType(
            f"{one.topic} has {torque.shape[1]} torques, {robot.name} has {robot.n} joints",
            where=one.topic,
        )
    # Unit: both clocks count from their own first message; stamps of headers only compare with each other.
    both = log.extra["clock"] == one.extra["clock"]
    start, other = (
        each.extra["start_ns"] if both else each.extra["arrival_ns"][0] for each in (log, one)
    )
    clock = one.t + (other - start) * 1e-9
    shared = (log.t >= clock[0]) & (log.t <= clock[-1])
    if not shared.any():
        raise WrongMessageType(f"{log.topic} and {one.topic} share no time", where=one.topic)
    t, tau = log.t[shared], np.full((int(shared.sum()), log.n), np.nan)
    for k, name in enumerate(log.names):
        if name in joints:
            tau[:, k] = np.interp(t, clock, torque[:, joints.index(name)])
    extra = {**log.extra, "absent": tuple(key for key in log.extra["absent"] if key != "effort")}
    extra["start_ns"] += round(1e9 * float(t[0]))
    qd = log.qd[shared] if log.qd is not None else None
    return replace(log, t=t - t[0], q=log.q[shared], tau=tau, qd=qd, extra=extra)
