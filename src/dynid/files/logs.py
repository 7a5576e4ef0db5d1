"""Any recording -> ``Log``: which reader reads a file, and which of its numbers are the robot's.

A further format is a file with a reader, its suffixes and its case in ``read_log`` and ``inspect``, and a row in
docs/reference/log-format.md. The module of a format is imported when a file of it is read.
"""

from __future__ import annotations

import difflib
import hashlib
import json
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dynid.disk import sha256
from dynid.drivers.interface import JOINT_STATE, driver_of
from dynid.errors import (
    Finding,
    JointNamesDiffer,
    LogLayout,
    LogNotFound,
    NewerSchema,
    WrongMessageType,
)
from dynid.files import bag, rosbag2, tables, tuning
from dynid.files.messages import KINOVA_TYPES, MULTI_ARRAY, Message, Topic, collected
from dynid.log import COLUMNS, SCHEMA, Log, has_rows
from dynid.npz import HEADER, read_npz
from dynid.robot import Robot
from dynid.text import whole_number
from dynid.units import POSITION
from dynid.version import __version__

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


class Container(Protocol):
    """What a kind of bag can do: the modules ``bag`` and ``rosbag2``."""

    def list_topics(self, path: Path) -> dict[str, Topic]:
        """Return the topics of a bag by name."""

    def parts_of(self, path: Path) -> list[Path]:
        """Return the files of a bag in the order of time."""

    def scan(self, part: Path, topics: Collection[str]) -> Iterator[Message]:
        """Yield the messages of some topics in a file."""


def container_of(kind: str) -> Container:
    """Return what lists and reads the topics of bags of a kind, ``"bag"`` or ``"rosbag2"``."""
    return bag if kind == "bag" else rosbag2


def read_topics(
    path: Path, names: Collection[str], container: Container
) -> tuple[dict[str, list[Log]], tuple[Finding, ...]]:
    """Return for each of some topics its raw logs, one for each set of joint names, the largest first; and findings.

    Raises:
        BagTruncated: nothing of these topics is readable.
        WrongMessageType: the layout of the messages is not the known one of their type.
    """
    return collected(path, container.parts_of(path), lambda part: container.scan(part, names))


def format_of(path: Path) -> str:
    """Return the format of a recording: ``"bag"``, ``"rosbag2"``, ``"npz"``, ``"table"`` or ``"folder"`` of texts.

    Raises:
        LogNotFound: no such file, or not a log.
    """
    if not path.exists():
        raise LogNotFound(f"no such file {path}{_nearby(path)}", where=str(path))
    if path.is_dir():
        inside = (FORMATS.get(part.suffix) == "rosbag2" for part in path.iterdir())
        return "rosbag2" if (path / "metadata.yaml").is_file() or any(inside) else "folder"
    if not path.is_file():
        raise LogNotFound(f"cannot read {path}: it is no regular file", where=str(path))
    if path.suffix in FORMATS:
        return FORMATS[path.suffix]
    try:
        with path.open("rb") as stream:
            start = stream.read(max(map(len, STARTS)))
    except OSError as error:
        raise LogNotFound(f"cannot read {path}: {error.strerror}", where=str(path)) from error
    for known, kind in STARTS.items():
        if start.startswith(known):
            return kind
    raise LogNotFound(
        f"{path} is not a log",
        where=str(path),
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
    elif kind in ("table", "folder"):
        columns = robot.driver.columns if robot.driver else None
        log = (
            tables.read_folder(path, rate)
            if kind == "folder"
            else (tables.read_table(path, robot.log_names, columns, rate))
        )
    else:
        log = _read_joint_states(path, robot, topic, container_of(kind))
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

    parts = rosbag2.parts_of(path)
    return (
        sha256(parts[0])
        if len(parts) == 1
        else hashlib.sha256("".join(map(sha256, parts)).encode()).hexdigest()
    )


def _nearby(path: Path) -> str:
    """Return the logs beside a missing one, the most alike first."""
    folder = path.parent
    if not folder.is_dir():
        return f"; there is no folder {folder}"
    logs = [
        entry.name
        for entry in sorted(folder.iterdir())
        if entry.suffix in FORMATS or entry.is_dir()
    ]
    alike = difflib.get_close_matches(path.name, logs, n=3, cutoff=0.5)
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
        header: dict[str, Any] = (
            dict(json.loads(str(arrays.pop(HEADER)))) if HEADER in arrays else {}
        )
        units = {str(key): str(unit) for key, unit in dict(header.get("units") or {}).items()}
        names = tuple(str(name) for name in header.get("joint_names") or ())
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LogNotFound(
            f"{path.name} is not an .npz log, or is damaged: {error}", where=str(path)
        ) from error
    if header:
        _check_schema(path, header)
    motor, own = "q_motor" in arrays, ("t", "q", "qd", "tau", "q_motor", "tau_motor")
    position, torque = ("q_motor", "tau_motor") if motor else ("q", "tau")
    for key in ("t", position, torque):
        if key not in arrays:
            have = ", ".join(sorted(arrays)) or "no arrays"
            raise LogLayout(f"{path.name} has no array '{key}'; it has {have}", where=str(path))
    log = Log(
        t=arrays["t"],
        q=arrays[position],
        tau=arrays[torque],
        names=names,
        qd=arrays.get("qd"),
        source=path,
        topic=str(header.get("topic", "")),
        tau_unit="" if "effort" not in units else "A" if units["effort"] in ("A", "mA") else "Nm",
        units=units,
        motor_side=motor or bool(header.get("motor_side", False)),
        dh=bool(header.get("dh", False)),
        extra={
            key: x
            for key, x in arrays.items()
            if key not in own and _kept(key, x, arrays["t"].size)
        },
    )
    if not log.q.size:
        raise LogLayout(f"{path.name}: array 'q' holds no numbers", where=str(path))
    return log


def _kept(key: str, array: NDArray[Any], samples: int) -> bool:
    """Return whether an array of a file is a column of joints, or anything else with a row per sample."""
    return bool(COLUMNS[key]) if key in COLUMNS else has_rows(array, samples)


def _check_schema(path: Path, header: dict[str, Any]) -> None:
    schema = str(header.get("schema", ""))
    kind, _, number = schema.rpartition("/")
    if kind == "dynid/log" and whole_number(number) > 1:
        writer = header.get("dynid", "?")
        raise NewerSchema(
            f"{path.name} was written by dynid {writer} (schema {number}); this is {__version__}; upgrade",
            where=str(path),
        )
    if schema != SCHEMA:
        raise LogNotFound(
            f"{path.name} holds {schema or 'something else'}, not a log", where=str(path)
        )


# ---------------------------------------------------------------- joint states of bags
def _read_joint_states(path: Path, robot: Robot, topic: str | None, container: Container) -> Log:
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
    driver = driver_of(robot)
    if JOINT_STATE not in topics.values() and (pair := _kinova_pair(topics, topic)):
        return _read_kinova_pair(path, robot, *pair, container)
    chosen = driver.choose_topic(topics, topic, robot, path.name)
    apart = robot.driver.effort_topic if robot.driver else None
    if apart is not None and topics.get(apart) not in (JOINT_STATE, MULTI_ARRAY):
        found = f"is {topics[apart]}" if apart in topics else "is not there"
        text = (
            f"the topic of the torques, {apart}, {found}; {JOINT_STATE} or {MULTI_ARRAY} is needed"
        )
        raise WrongMessageType(
            text, where=path.name, fix="correct `effort_topic:` under `driver:` in the robot file"
        )
    wanted = [chosen] if apart is None else [chosen, apart]
    groups, findings = read_topics(path, wanted, container)
    log = _of_robot(groups.get(chosen, []), robot, chosen)
    if apart is not None:
        log = _with_effort(log, groups.get(apart, []), robot, apart)
    for key in ("position", "effort"):
        if key in log.extra["absent"]:
            raise WrongMessageType(
                f"{chosen} has no {key} in any of its {len(log)} messages", where=path.name
            )
    if log.extra["clock"] == "arrival":
        findings = (*findings, _arrival(chosen))
    return replace(log, source=path, findings=findings)


def _with_effort(log: Log, groups: Sequence[Log], robot: Robot, topic: str) -> Log:
    """Return a log with the torques of another topic, each position with the torque at its time.

    Raises:
        WrongMessageType: the topic has other joints, or no time in common with the positions.
    """
    if not groups:
        raise WrongMessageType(f"{topic} has no messages", where=topic)
    one = next((group for group in groups if set(robot.log_names) <= set(group.names)), groups[0])
    torque = one.q if "effort" in one.extra["absent"] else one.tau
    joints = list(one.names) or [*robot.log_names[: one.n]]
    if torque.shape[1] < robot.n or not set(joints) <= {*log.names, *one.names}:
        raise WrongMessageType(
            f"{topic} has {torque.shape[1]} torques, {robot.name} has {robot.n} joints", where=topic
        )
    # Unit: both clocks count from their own first message; stamps of headers only compare with each other.
    both = log.extra["clock"] == one.extra["clock"]
    first = (
        (one.extra["start_ns"] - log.extra["start_ns"])
        if both
        else (one.extra["arrival_ns"][0] - log.extra["arrival_ns"][0])
    )
    clock = one.t + first * 1e-9
    shared = (log.t >= clock[0]) & (log.t <= clock[-1])
    if not shared.any():
        raise WrongMessageType(f"{log.topic} and {topic} share no time", where=topic)
    tau = np.full((int(shared.sum()), log.n), np.nan)
    for k, name in enumerate(log.names):
        if name in joints:
            tau[:, k] = np.interp(log.t[shared], clock, torque[:, joints.index(name)])
    extra = {**log.extra, "absent": tuple(key for key in log.extra["absent"] if key != "effort")}
    t, qd = log.t[shared], log.qd[shared] if log.qd is not None else None
    extra["start_ns"] += round(1e9 * float(t[0]))
    return replace(log, t=t - t[0], q=log.q[shared], tau=tau, qd=qd, extra=extra)


def _of_robot(groups: Sequence[Log], robot: Robot, topic: str) -> Log:
    """Return the log whose names cover the robot's; other nodes may publish on the same topic."""
    for names in (robot.log_names, robot.joint_names):
        for log in groups:
            if set(names) <= set(log.names):
                return log
    if not groups:
        raise WrongMessageType(f"{topic} has no messages", where=topic)
    if not groups[0].names:
        raise JointNamesDiffer(
            f"the messages of {topic} name no joints",
            where=topic,
            fix="make the driver fill the names of its JointState",
        )
    return groups[0]


def _kinova_pair(topics: dict[str, str], asked: str | None) -> tuple[str, str] | None:
    """Return the topics of angles and torques of a bag that has only Kinova's own messages."""
    own = [name for name, kind in topics.items() if kind in KINOVA_TYPES]
    angles = [name for name in own if name.endswith("joint_angles")]
    torques = [name for name in own if name.endswith("joint_torques")]
    if not angles or not torques or (asked is not None and asked not in (angles[0], torques[0])):
        return None
    return angles[0], torques[0]


def _read_kinova_pair(
    path: Path, robot: Robot, angles: str, torques: str, container: Container
) -> Log:
    """Read angles and torques from two topics; each angle gets the torque at its time of arrival."""
    groups, findings = read_topics(path, [angles, torques], container)
    if angles not in groups or torques not in groups:
        raise WrongMessageType(
            f"{path.name} needs messages on both {angles} and {torques}", where=path.name
        )
    position, torque = groups[angles][0], groups[torques][0]
    # Unit: these messages have no stamps, so that both logs count from the arrival of their own first message.
    grid = torque.t + (torque.extra["arrival_ns"][0] - position.extra["arrival_ns"][0]) * 1e-9
    both = (position.t >= grid[0]) & (position.t <= grid[-1])
    if not both.any():
        raise WrongMessageType(f"{angles} and {torques} share no time", where=path.name)
    t, n = position.t[both], min(robot.n, 7)
    unit = robot.driver.units["position"] if robot.driver else "rad"
    # Unit: these messages are in degrees by definition; the log is handed over in the unit that the robot file expects.
    q = position.q[both, :n] * POSITION["deg"] / POSITION[unit]
    tau = np.column_stack([np.interp(t, grid, torque.q[:, j]) for j in range(n)])
    return Log(
        t - t[0],
        q,
        tau,
        robot.log_names[:n],
        source=path,
        topic=angles,
        findings=(*findings, _arrival(f"{angles} and {torques}")),
        extra={"clock": "arrival"},
    )


def _arrival(topic: str) -> Finding:
    text = f"{topic} has no usable time stamps: the time of arrival in the bag is used, which jitters more"
    return Finding("W304", "warning", text)
