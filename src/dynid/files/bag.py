"""ROS 1 bag -> joint states as arrays, without ROS.

Reads with rosbags; what rosbags cannot open is scanned record by record (``salvage``) and comes with finding W305.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.errors import BagTruncated, Finding, LogNotFound
from dynid.files.bag_recovery import MAGIC, Connection, scan
from dynid.files.messages import Collector, Series, broken_bytes

Floats = NDArray[np.float64]

#: A clock ticks: header stamps with fewer distinct values than this share of the messages are not one.
LEAST_DISTINCT = 0.5


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
    try:
        return _indexed_topics(path)
    except broken_bytes():
        found: dict[str, Topic] = {}
        for connection, _, _ in scan(path):
            before = found.get(connection.topic)
            found[connection.topic] = Topic(connection.topic, connection.type, before.count + 1 if before else 1)
        if not found:
            raise _nothing_readable(path) from None
        return found


def read_topics(path: Path, names: Collection[str]) -> tuple[dict[str, list[Series]], tuple[Finding, ...]]:
    """Read topics of a bag.

    Returns:
        for each topic its series, one for each set of joint names, the largest first; and what was noticed.

    Raises:
        BagTruncated: nothing of these topics is readable.
    """
    try:
        collectors = _collect(_indexed(path, names))
        return {name: collector.groups() for name, collector in collectors.items()}, ()
    except broken_bytes() as error:
        reason = str(error).strip() or type(error).__name__
    collectors = _collect((item for item in scan(path) if item[0].topic in names), lenient=True)
    groups = {name: found for name, collector in collectors.items() if (found := collector.groups())}
    if not groups:
        raise _nothing_readable(path)
    return groups, (_salvaged(path, reason, groups),)


def clock(series: Series) -> tuple[Floats, str]:
    """Return the time since the first message, (N,) [s], and which clock it is: ``"header"`` or ``"arrival"``.

    Why: a header stamp is taken where the sample is, so it is preferred; it may run on any epoch (some drivers stamp
    with the monotonic clock), but must tick. One clock serves the whole topic: two are never mixed.
    """
    ticking = len(np.unique(series.stamp)) >= max(2, LEAST_DISTINCT * len(series))
    sane = len(series) > 0 and bool(np.all(series.stamp > 0)) and ticking
    ns = series.stamp if sane else series.arrival
    return (ns - ns[0]) * 1e-9 if len(ns) else np.zeros(0), "header" if sane else "arrival"


def _collect(messages: Iterator[tuple[Connection, int, bytes]], *, lenient: bool = False) -> dict[str, Collector]:
    found: dict[str, Collector] = {}
    for connection, time, raw in messages:
        collector = found.get(connection.topic)
        if collector is None:
            collector = found[connection.topic] = Collector(connection, lenient=lenient)
        collector.add(time, raw)
    return found


def _indexed(path: Path, names: Collection[str]) -> Iterator[tuple[Connection, int, bytes]]:
    from rosbags.rosbag1 import Reader

    with Reader(path) as reader:
        chosen = [connection for connection in reader.connections if connection.topic in names]
        known = {connection.id: _plain(connection) for connection in chosen}
        for connection, time, raw in reader.messages(connections=chosen):
            yield known[connection.id], time, raw


def _indexed_topics(path: Path) -> dict[str, Topic]:
    from rosbags.rosbag1 import Reader

    with Reader(path) as reader:
        found: dict[str, Topic] = {}
        for connection in reader.connections:
            before = found.get(connection.topic)
            count = connection.msgcount + (before.count if before else 0)
            found[connection.topic] = Topic(connection.topic, _plain(connection).type, count)
        return found


def _plain(connection: object) -> Connection:
    """Return a connection of rosbags as our own; newer versions wrap the text of the definition."""
    definition = connection.msgdef  # type: ignore[attr-defined]
    return Connection(
        connection.topic,  # type: ignore[attr-defined]
        connection.msgtype.replace("/msg/", "/"),  # type: ignore[attr-defined]
        getattr(definition, "data", definition),
        connection.digest,  # type: ignore[attr-defined]
    )


def _salvaged(path: Path, reason: str, groups: dict[str, list[Series]]) -> Finding:
    count = sum(len(series) for found in groups.values() for series in found)
    spans = [series.arrival[-1] - series.arrival[0] for found in groups.values() for series in found]
    seconds = float(max(spans)) * 1e-9
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
        with path.open("rb") as stream:
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
