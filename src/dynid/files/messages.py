"""Raw messages of ROS -> logs; messages that differ only in their numbers are decoded together.

A container (``bag``, ``rosbag2``) hands over raw messages; ``Collector`` keeps their numbers, grouped by the joint
names they carry (an arm and its gripper often share a topic). Only the layouts below are decoded: the definition that
a recording carries is never interpreted. Source of CDR: OMG DDS-XTypes 1.3, section 7.4 (plain CDR, version 1).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.drivers.interface import JOINT_STATE
from dynid.errors import BagTruncated, Finding, WrongMessageType
from dynid.files import tuning
from dynid.log import Log
from dynid.text import shell

Times = NDArray[np.int64]
#: Arrays of some messages: ``arrival`` and ``stamp``, (N,) [ns], stamp 0 where a message has none; ``position``,
#: ``velocity`` and ``effort``, (N, n), NaN where a message has none, or (N, 0) where none has any.
Columns = dict[str, NDArray[Any]]
FIELDS = ("position", "velocity", "effort")

MULTI_ARRAY = "std_msgs/Float64MultiArray"
KINOVA_TYPES = ("kinova_msgs/JointAngles", "kinova_msgs/JointTorque", "kinova_msgs/JointVelocity")
_SEVEN = "\n".join(f"float32 joint{i}" for i in range(1, 8))
#: Checksums of the definitions in ROS 1 that the decoders below were written for.
CHECKSUMS = {
    JOINT_STATE: "3066dcd76a6cfaef579bd0f34173e9fd",
    MULTI_ARRAY: "4b7d974086d4060e7db4613a7e6c3ba4",
    **dict.fromkeys(KINOVA_TYPES, hashlib.md5(_SEVEN.encode(), usedforsecurity=False).hexdigest()),
}
#: What a little-endian message in CDR begins with, and a frame of zstd.
_CDR, _ZSTD = b"\0\1", b"\x28\xb5\x2f\xfd"


class Broken(Exception):
    """A recording is cut, was not closed, or has damaged records; says what was met."""


class BrokenMessage(Exception):
    """The bytes of a message do not have the layout of its type."""


@dataclass(frozen=True)
class Connection:
    """One publisher of one topic.

    Attributes:
        topic: topic name.
        type: message type as ROS 1 writes it, such as ``"sensor_msgs/JointState"``.
        cdr: whether messages are written as in ROS 2.
        md5: checksum of the definition in ROS 1.
    """

    topic: str
    type: str
    cdr: bool
    md5: str = ""


#: Publisher, time of arrival [ns] and bytes of a message.
Message = tuple[Connection, int, bytes]


@dataclass(frozen=True)
class Topic:
    """One topic of a recording.

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


def topics_of(counts: Iterable[tuple[Connection, int]]) -> dict[str, Topic]:
    """Return topics by name from numbers of messages, of which several may be of one topic."""
    found: dict[str, Topic] = {}
    for connection, count in counts:
        before = found[connection.topic].count if connection.topic in found else 0
        found[connection.topic] = Topic(connection.topic, connection.type, before + count)
    return found


def collected(
    path: Path, parts: Sequence[Path], scan: Callable[[Path], Iterator[Message]]
) -> tuple[dict[str, list[Log]], tuple[Finding, ...]]:
    """Return the numbers of a recording, also of one that is damaged.

    Args:
        path: the recording.
        parts: its files in the order of time.
        scan: yields the readable messages of a file, and raises ``Broken`` when there were others.

    Returns:
        for each topic its raw logs, one for each set of joint names, the largest first; and what was noticed.

    Raises:
        BagTruncated: nothing is readable.
        WrongMessageType: the layout of the messages is not the known one of their type.
    """
    collectors: dict[str, Collector] = {}
    reasons: list[str] = []
    for part in parts:
        try:
            for connection, arrival, raw in scan(part):
                if connection.topic not in collectors:
                    collectors[connection.topic] = Collector(connection)
                collectors[connection.topic].add(arrival, raw)
        except Broken as error:
            reasons.append(f"{part.name}: {error}" if part != path else str(error))
    groups = {topic: logs for topic, one in collectors.items() if (logs := one.logs())}
    reasons += [one.reason for one in collectors.values() if one.reason]
    if reasons and not groups:
        raise nothing_readable(path, reasons[0])
    return groups, (_recovered(path, "; ".join(reasons[:3]), groups),) if reasons else ()


def nothing_readable(path: Path, reason: str) -> BagTruncated:
    """Return the mistake of a recording without one readable message."""
    if path.suffix in (".bag", ".active"):
        return BagTruncated(
            f"{path.name} ends early (recorder killed?); 0 s are readable", where=str(path)
        )
    better = path.with_name(f"{path.stem}_recovered{path.suffix}")
    fix = (
        shell("mcap", "recover", path, "-o", better)
        if path.suffix == ".mcap"
        else f"{shell('sqlite3', path, '.recover')} | {shell('sqlite3', better)}"
        if path.suffix == ".db3"
        else shell("ros2", "bag", "reindex", path)
    )
    text = f"{path.name} was cut or not closed: {reason.rstrip('.')}"
    return BagTruncated(text, where=str(path), fix=fix)


def _recovered(path: Path, reason: str, groups: dict[str, list[Log]]) -> Finding:
    """Return finding W305: what of a damaged recording is used."""
    logs = [log for found in groups.values() for log in found]
    count = sum(len(log) for log in logs)
    spans = [log.extra["arrival_ns"] for log in logs]
    seconds = max(float(last - first) for first, last in spans) * 1e-9
    text = (
        f"{path.name} was cut or not closed (recorder killed?): "
        f"{count} messages, {seconds:.1f} s, are readable and used; "
        f"reported by the reader: {reason.rstrip('.')}"
    )
    evidence = {"messages": count, "seconds": seconds, "reason": reason}
    return Finding("W305", "warning", text, evidence)


# ---------------------------------------------------------------- messages to columns
class Collector:
    """Takes the messages of one topic, keeps their numbers.

    Attributes:
        reason: what was wrong with a message that was passed over, "" where none was.

    Raises:
        WrongMessageType: the layout is not known.
    """

    def __init__(self, connection: Connection) -> None:
        _check_layout(connection)
        self.reason = ""
        self._connection = connection
        self._arrival: list[int] = []
        self._raws: list[bytes] = []
        # By the joints that messages carry: their names in the order of the first message, and blocks of numbers.
        self._groups: dict[Any, tuple[tuple[str, ...], list[Columns]]] = {}

    def add(self, arrival: int, raw: bytes) -> None:
        """Take a message; many are decoded together."""
        self._arrival.append(arrival)
        self._raws.append(raw)
        if len(self._raws) == tuning.MESSAGES:
            self._decode()

    def logs(self) -> list[Log]:
        """Return one raw log for each set of joint names, the largest first."""
        self._decode()
        found = (
            _log(names, _in_order(blocks), self._connection.topic)
            for names, blocks in self._groups.values()
        )
        return sorted(found, key=len, reverse=True)

    def _decode(self) -> None:
        """Decode the messages that wait, those of one length and layout in one go."""
        lengths, arrival = np.array([len(raw) for raw in self._raws]), np.array(self._arrival)
        for length in np.unique(lengths):
            rows = np.flatnonzero(lengths == length)
            raw = b"".join([self._raws[k] for k in rows])
            table = np.frombuffer(raw, np.uint8).reshape(len(rows), length)
            while len(rows):
                try:
                    layout = _layout(table[0].tobytes(), self._connection)
                    fixed = layout.fixed
                    alike = np.all(table[:, fixed] == table[0, fixed], axis=1)
                    self._keep(layout, arrival[rows[alike]], table[alike])
                except BrokenMessage as error:
                    self.reason = str(error)
                    alike = np.all(table == table[0], axis=1)
                rows, table = rows[~alike], table[~alike]
        self._arrival, self._raws = [], []

    def _keep(self, layout: _Layout, arrival: Times, table: NDArray[np.uint8]) -> None:
        stamp = np.zeros(len(table), np.int64)
        if layout.stamped:
            words = np.ascontiguousarray(table[:, 4:12]).view("<u4").astype(np.int64)
            stamp = words[:, 0] * 10**9 + words[:, 1]
        columns: Columns = {"arrival": arrival, "stamp": stamp}
        width = len(layout.names) or max(count for _, count in layout.fields)
        first, blocks = self._groups.setdefault(
            frozenset(layout.names) or width, (layout.names, [])
        )
        order = [layout.names.index(name) for name in first]
        for key, (start, count) in zip(FIELDS, layout.fields, strict=True):
            part = table[:, start : start + count * layout.number.itemsize]
            values = np.ascontiguousarray(part).view(layout.number).astype(float)
            # Why: a field shorter than the names cannot be assigned to joints; NaN lets the checks name the samples.
            values = values if count in (0, width) else np.full((len(table), width), np.nan)
            columns[key] = values[:, order] if count and layout.names != first else values
        blocks.append(columns)


def _check_layout(connection: Connection) -> None:
    """Raise when messages do not have the one layout that is known for their type."""
    kind, topic = connection.type, connection.topic
    if kind not in CHECKSUMS or (connection.cdr and kind in KINOVA_TYPES):
        raise WrongMessageType(f"{topic} has messages of the type {kind}", where=topic)
    if not connection.cdr and connection.md5 != CHECKSUMS[kind]:
        raise WrongMessageType(
            f"the {kind} of {topic} differs from the standard definition (md5 {connection.md5[:40]})",
            where=topic,
            why="dynid decodes the standard layout only",
            fix="record with the standard definition of this message",
        )


class _Layout(NamedTuple):
    """Where a message has what; messages that agree in their ``fixed`` bytes are decoded together."""

    names: tuple[str, ...]
    #: Start [byte] and count of the numbers of each of ``FIELDS``.
    fields: Sequence[tuple[int, int]]
    fixed: NDArray[np.bool_]
    number: np.dtype[Any] = np.dtype("<f8")
    stamped: bool = False


class _Reader:
    """Walks over one message, in which alignment counts from behind the four bytes of the encapsulation."""

    def __init__(self, raw: bytes, at: int, *, cdr: bool) -> None:
        self.raw, self.at, self.cdr = raw, at, cdr
        self.fixed = np.ones(len(raw), dtype=bool)

    def skip(self, size: int) -> int:
        """Pass over bytes that may differ from message to message; return where they begin."""
        start, self.at = self.at, self.at + size
        if self.at > len(self.raw):
            raise BrokenMessage("a message is too short for its type")
        self.fixed[start : self.at] = False
        return start

    def word(self) -> int:
        self.skip(-self.at % 4 if self.cdr else 0)
        self.at += 4
        return int.from_bytes(self._until(self.at - 4), "little")

    def text(self) -> str:
        size = self.word()
        self.at += size
        try:
            return self._until(self.at - size).rstrip(b"\0").decode()
        except UnicodeDecodeError:
            raise BrokenMessage("the names of a message are not text") from None

    def numbers(self) -> tuple[int, int]:
        """Return where the numbers of a sequence begin and how many they are."""
        count = self.word()
        self.skip((4 - self.at) % 8 if self.cdr and count else 0)
        return self.skip(8 * count), count

    def _until(self, start: int) -> bytes:
        if self.at > len(self.raw):
            raise BrokenMessage("a message is too short for its type")
        return self.raw[start : self.at]


def _layout(raw: bytes, connection: Connection) -> _Layout:
    """Return the layout of a message of a known type.

    Raises:
        BrokenMessage: the bytes are not such a message.
        WrongMessageType: it is compressed.
    """
    if connection.cdr and raw[:4] == _ZSTD:
        raise WrongMessageType(
            "every message of the recording is compressed (zstd)",
            why="dynid reads messages as they were sent, and MCAP whose chunks are compressed",
            fix="ros2 bag convert without compression_mode, or record without --compression-mode message",
        )
    if connection.cdr and raw[:2] != _CDR:
        raise BrokenMessage("a message is not plain little-endian CDR")
    reader = _Reader(raw, 0, cdr=connection.cdr)
    if connection.type in KINOVA_TYPES:
        start = reader.skip(28)
        return _Layout((), [(start, 7), (start, 0), (start, 0)], reader.fixed, np.dtype("<f4"))
    if connection.type == MULTI_ARRAY:
        reader.at = 4 if connection.cdr else 0
        for _ in range(reader.word()):
            reader.text(), reader.word(), reader.word()
        reader.word()
        return _Layout((), [reader.numbers(), (0, 0), (0, 0)], reader.fixed)
    # Unit: bytes 4-11 are the stamp, in ROS 1 behind a sequence number, in CDR behind the encapsulation.
    reader.skip(12)
    reader.skip(reader.word())
    names = tuple(reader.text() for _ in range(reader.word()))
    fields = [reader.numbers() for _ in FIELDS]
    return _Layout(names, fields, reader.fixed, stamped=True)


def _in_order(blocks: list[Columns]) -> Columns:
    """Return all messages in the order of arrival."""
    width = {key: max(block[key].shape[-1] for block in blocks) for key in FIELDS}
    found: Columns = {}
    for key in ("arrival", "stamp", *FIELDS):
        # Why popped: the blocks of a column are not needed when it is whole.
        parts = [block.pop(key) for block in blocks]
        lack = [len(part) if key in width and part.shape[1] < width[key] else 0 for part in parts]
        parts = [
            np.full((count, width[key]), np.nan) if count else part
            for part, count in zip(parts, lack, strict=True)
        ]
        found[key] = np.concatenate(parts)
    if np.any(np.diff(found["arrival"]) < 0):
        order = np.argsort(found["arrival"], kind="stable")
        found = {key: values[order] for key, values in found.items()}
    return found


def _log(names: tuple[str, ...], columns: Columns, topic: str) -> Log:
    """Return messages as a raw log.

    ``extra`` names the ``clock`` of its time and what it counts from, ``start_ns``, the first and last ``arrival_ns``,
    and as ``absent`` the fields that no message has; absent positions and efforts are NaN.
    """
    ns, clock = _time(columns["stamp"], columns["arrival"])
    t = (ns - ns[0]) * 1e-9
    n = max(len(names), *(columns[key].shape[1] for key in FIELDS))
    nothing = np.broadcast_to(np.array(np.nan), (len(t), n))
    q, qd, tau = (columns[key] if columns[key].shape[1] else nothing for key in FIELDS)
    absent = tuple(key for key in FIELDS if not columns[key].shape[1])
    span = (int(columns["arrival"][0]), int(columns["arrival"][-1]))
    return Log(
        t=t,
        q=q,
        tau=tau,
        names=names,
        qd=None if "velocity" in absent else qd,
        topic=topic,
        extra={"clock": clock, "start_ns": int(ns[0]), "arrival_ns": span, "absent": absent},
    )


def _time(stamp: Times, arrival: Times) -> tuple[Times, str]:
    """Return the time of each message, (N,) [ns], and which clock it is: ``"header"`` or ``"arrival"``.

    Why: a header stamp is taken where the sample is, so it is preferred; it may run on any epoch (some drivers stamp
    with the monotonic clock), but must tick. One clock serves the whole topic: two are never mixed.
    """
    rising = len(stamp) > 1 and bool(np.all(np.diff(stamp) > 0))
    ticking = rising or len(np.unique(stamp)) >= max(2, tuning.LEAST_DISTINCT * len(stamp))
    # Why zero: the clock of a converted or simulated log begins there; a driver without stamps writes zeros only.
    sane = (rising and stamp[0] >= 0) or (ticking and bool(np.all(stamp > 0)))
    return (stamp, "header") if sane else (arrival, "arrival")
