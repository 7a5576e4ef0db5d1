"""ROS 1 bags as logs and back, without ROS.

Reads record by record (``bag_records``), writes with rosbags; what is damaged comes with finding W305.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid import limits
from dynid.drivers.interface import JOINT_STATE
from dynid.errors import BagTruncated, CannotWrite, Finding, LogLayout, LogNotFound
from dynid.files.bag_records import MAGIC, BrokenBag, Connection, Messages, read_index, scan
from dynid.files.cdr import MULTI_ARRAY, multi_array_ros1
from dynid.files.messages import CHECKSUMS, BrokenMessage, Collector
from dynid.log import Log
from dynid.npz import put_in_place
from dynid.scratch import scratch_folder

#: First bytes of a ROS bag of any version.
START = b"#ROSBAG"
#: Seconds since 1970 that the stamps of messages end with, in 2038.
LAST_STAMP = 2**31


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
        for some in scan(path):
            count(some.connection, len(some))
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
    return groups, (recovered(path, reason, groups),)


def message_stamps(log: Log, start: int) -> NDArray[np.int64]:
    """Return the stamps of a log's samples [ns since 1970], (N,).

    Raises:
        LogLayout: a message cannot hold them.
    """
    whole = bool(np.isfinite(log.t).all()) and abs(start) < LAST_STAMP * 10**9
    if not whole or log.t.min() + start * 1e-9 < 0 or log.t.max() + start * 1e-9 >= LAST_STAMP:
        raise LogLayout(
            f"{log.name} has times before 1970 or after 2038, or that are no numbers", where=log.name,
            why="messages of ROS have no such stamps", fix="write .npz, .csv or .parquet",
        )  # fmt: skip
    return np.asarray(start + np.round(log.t * 1e9).astype(np.int64))


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
    stamps = message_stamps(log, start)
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
            put_in_place(temporary, path)
    except OSError as error:
        raise CannotWrite(f"cannot write {path}: {error.strerror}", where=str(path)) from error


def _collect(found: Iterator[Messages], *, lenient: bool = False) -> dict[str, Collector]:
    collectors: dict[str, Collector] = {}
    for messages in found:
        connection = messages.connection
        if numbers := connection.type == MULTI_ARRAY:
            connection = replace(connection, type=JOINT_STATE, definition="", md5=CHECKSUMS[JOINT_STATE])
        collector = collectors.get(connection.topic)
        if collector is None:
            collector = collectors[connection.topic] = Collector(connection, lenient=lenient)
        if not numbers:
            collector.add_alike(messages.arrival, messages.raw)
            continue
        for time, raw in zip(messages.arrival.tolist(), messages.raw, strict=True):
            try:
                collector.add(time, multi_array_ros1(raw.tobytes()))
            except BrokenMessage:
                if not lenient:
                    raise
    return collectors


def recovered(path: Path, reason: str, groups: dict[str, list[Log]]) -> Finding:
    """Return finding W305: what of a damaged recording is used."""
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
