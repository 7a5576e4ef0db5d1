"""ROS 1 bags as logs and back, without ROS.

Reads record by record (``bag_records``), writes with rosbags; what is damaged comes with finding W305.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dynid import limits
from dynid.drivers.interface import JOINT_STATE
from dynid.drivers.registry import driver_of
from dynid.errors import BagTruncated, CannotWrite, Finding, JointNamesDiffer, LogNotFound, WrongMessageType
from dynid.files.bag_records import MAGIC, BrokenBag, Connection, read_index, scan
from dynid.files.messages import KINOVA_TYPES, BrokenMessage, Collector
from dynid.log import Log
from dynid.robot import Robot
from dynid.scratch import scratch_folder
from dynid.units import POSITION

#: First bytes of a ROS bag of any version.
START = b"#ROSBAG"


@dataclass(frozen=True)
class Topic:
    """One topic of a bag.

    Attributes:
        name: topic name.
        type: message type, such as ``"sensor_msgs/JointState"``.
        count: number of messages.
    """

    name: str
    type: str
    count: int

    def __str__(self) -> str:
        """Return it as the messages show it."""
        return f"{self.name} ({self.type.split('/')[-1]}, {self.count})"


def list_topics(path: Path) -> dict[str, Topic]:
    """Return the topics of a bag by name; those of a damaged one as far as it can be read.

    Raises:
        BagTruncated: nothing is readable.
        LogNotFound: not a bag.
    """
    _check_magic(path)
    found: dict[str, Topic] = {}

    def count(connection: Connection, messages: int) -> None:
        before = found.get(connection.topic)
        found[connection.topic] = Topic(
            connection.topic, connection.type, messages + (before.count if before is not None else 0)
        )

    try:
        index = read_index(path)
        for connection in index.connections.values():
            count(connection, 0)
        for counts in index.chunks.values():
            for number, messages in counts.items():
                if number in index.connections:
                    count(index.connections[number], messages)
    except BrokenBag:
        found.clear()
        for connection, _, _ in scan(path):
            count(connection, 1)
        if not found:
            raise _nothing_readable(path) from None
    return found


def read_topics(path: Path, names: Collection[str]) -> tuple[dict[str, list[Log]], tuple[Finding, ...]]:
    """Read topics of a bag.

    Returns:
        for each topic its raw logs, one for each set of joint names, the largest first; and what was noticed.

    Raises:
        BagTruncated: nothing of these topics is readable.
        WrongMessageType: the layout of the messages is not the known one of their type.
        TooLarge: a chunk, a message or a name is larger than the limit.
    """
    try:
        index = read_index(path)
        collectors = _collect(scan(path, recover=False, index=index, topics=names))
        return {name: collector.logs() for name, collector in collectors.items()}, ()
    except (BrokenBag, BrokenMessage) as error:
        reason = str(error)
    collectors = _collect(scan(path, topics=names), lenient=True)
    groups = {name: found for name, collector in collectors.items() if (found := collector.logs())}
    if not groups:
        raise _nothing_readable(path)
    return groups, (_recovered(path, reason, groups),)


def read_bag(path: Path, robot: Robot, topic: str | None = None) -> Log:
    """Read the joint states of a robot from a bag.

    Args:
        path: the bag.
        robot: the robot, whose driver chooses the topic, and whose joint names the messages.
        topic: topic of the joint states, None for the robot file's or the driver's.

    Raises:
        TopicMissing: the topic is not in the bag.
        WrongMessageType: the topic holds no positions or no torques.
        JointNamesDiffer: the messages name no joints.
        BagTruncated: nothing is readable.
    """
    topics = {name: found.type for name, found in list_topics(path).items()}
    driver = driver_of(robot)
    if JOINT_STATE not in topics.values() and (pair := _kinova_pair(topics, topic)):
        return _read_kinova_pair(path, robot, *pair)
    chosen = driver.choose_topic(topics, topic, robot, path.name)
    groups, findings = read_topics(path, [chosen])
    log = _of_robot(groups.get(chosen, []), robot, chosen)
    for key in ("position", "effort"):
        if key in log.extra["absent"]:
            raise WrongMessageType(f"{chosen} has no {key} in any of its {len(log)} messages", where=path.name)
    if log.extra["clock"] == "arrival":
        findings = (*findings, _arrival(chosen))
    return replace(log, source=path, findings=findings)


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


def _read_kinova_pair(path: Path, robot: Robot, angles: str, torques: str) -> Log:
    """Read angles and torques from two topics; each angle gets the torque at its time of arrival."""
    groups, findings = read_topics(path, [angles, torques])
    if angles not in groups or torques not in groups:
        raise WrongMessageType(f"{path.name} needs messages on both {angles} and {torques}", where=path.name)
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
        t - t[0], q, tau, robot.log_names[:n], source=path, topic=angles,
        findings=(*findings, _arrival(f"{angles} and {torques}")), extra={"clock": "arrival"},
    )  # fmt: skip


def _arrival(topic: str) -> Finding:
    text = f"{topic} has no usable time stamps: the time of arrival in the bag is used, which jitters more"
    return Finding("W304", "warning", text)


def write_bag(log: Log, path: Path, topic: str, start: int = 0) -> None:
    """Write a log as a bz2-compressed bag of sensor_msgs/JointState; equal logs give equal bytes.

    Args:
        log: the columns to publish, in their order.
        path: the file; an existing one is replaced.
        topic: topic of the messages, each stored at the time of its stamp.
        start: what ``log.t`` counts from [ns since 1970].
    """
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kinds = ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    State, Header, Time = (store.types[kind] for kind in kinds)
    stamps = start + np.round(log.t * 1e9).astype(np.int64)
    speeds = np.empty((len(log), 0)) if log.qd is None else log.qd
    q, qd, tau = (np.ascontiguousarray(part) for part in (log.q, speeds, log.tau))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with scratch_folder(path.parent) as folder:
            temporary = Path(folder) / path.name
            writer = Writer(temporary)
            writer.set_compression(Writer.CompressionFormat.BZ2)
            with writer:
                channel = writer.add_connection(topic, State.__msgtype__, typestore=store)
                for i, stamp in enumerate(stamps.tolist()):
                    header = Header(i, Time(*divmod(stamp, 10**9)), "")
                    message = State(header, list(log.names), q[i], qd[i], tau[i])
                    writer.write(channel, stamp, bytes(store.serialize_ros1(message, State.__msgtype__)))
            temporary.replace(path)
    except OSError as error:
        raise CannotWrite(f"cannot write {path}: {error.strerror}", where=str(path)) from error


def _collect(messages: Iterator[tuple[Connection, int, bytes]], *, lenient: bool = False) -> dict[str, Collector]:
    found: dict[str, Collector] = {}
    for connection, time, raw in messages:
        collector = found.get(connection.topic)
        if collector is None:
            collector = found[connection.topic] = Collector(connection, lenient=lenient)
        collector.add(time, raw)
    return found


def _recovered(path: Path, reason: str, groups: dict[str, list[Log]]) -> Finding:
    logs = [log for found in groups.values() for log in found]
    count = sum(len(log) for log in logs)
    seconds = float(max(log.extra["arrival_ns"][1] - log.extra["arrival_ns"][0] for log in logs)) * 1e-9
    text = (
        f"{path.name} was cut or not closed (recorder killed?): "
        f"{count} messages, {seconds:.1f} s, are readable and used; "
        f"reported by the reader: {reason.rstrip('.')}"
    )
    return Finding("W305", "warning", text, {"messages": count, "seconds": seconds, "reason": reason})


def _nothing_readable(path: Path) -> BagTruncated:
    return BagTruncated(f"{path.name} ends early (recorder killed?); 0 s are readable", where=str(path))


def _check_magic(path: Path) -> None:
    try:
        with limits.open_file(path) as stream:
            start = stream.read(len(MAGIC))
    except OSError as error:
        raise LogNotFound(f"cannot read {path}: {error.strerror}", where=str(path)) from error
    if not start:
        raise BagTruncated(f"{path.name} is empty: nothing was recorded", where=str(path), fix="record again")
    if not start.startswith(b"#ROSBAG V"):
        raise LogNotFound(f"{path.name} is not a ROS 1 bag", where=str(path))
    if start != MAGIC:
        version = start.decode("latin-1").strip()
        raise LogNotFound(
            f"{path.name} has the format {version}; dynid reads V2.0",
            where=str(path),
            fix="convert it with: rosbag fix",
        )
