"""Raw messages of ROS -> logs; messages that differ only in their numbers are decoded together.

A container (``bag``, ``rosbag2``) hands over raw messages; ``Collector`` keeps their numbers, grouped by the joint
names they carry (an arm and its gripper often share a topic). Only the layouts below are decoded: the definition that
a recording carries is never interpreted. Source of CDR: OMG DDS-XTypes 1.3, section 7.4 (plain CDR, version 1).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.drivers.interface import JOINT_STATE
from dynid.errors import BagTruncated, Finding, WrongMessageType
from dynid.files import tuning
from dynid.log import Log
from dynid.text import shell

Times = NDArray[np.int64]
#: Arrays of some messages: ``arrival`` and ``stamp``, (N,) [ns], stamp 0 where a message has none; ``position``,
#: ``velocity`` and ``effort``, (N, n), where messages have them.
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
    """A recording or a message is cut, or has damaged bytes; says what was met."""


@dataclass(frozen=True)
class Topic:
    """One topic of a recording.

    Attributes:
        name: topic name.
        type: message type as ROS 1 writes it, such as ``"sensor_msgs/JointState"``.
        cdr: whether messages are written as in ROS 2.
        md5: checksum of the definition in ROS 1.
        count: number of messages, where they were counted.
    """

    name: str
    type: str
    cdr: bool = False
    md5: str = ""
    count: int = 0

    def __str__(self) -> str:
        """Return it as the messages show it."""
        return f"{self.name} ({self.type.split('/')[-1]}, {self.count})"


#: Topic, time of arrival [ns] and bytes of a message.
Message = tuple[Topic, int, bytes]


def topics_of(counts: Iterable[tuple[Topic, int]]) -> dict[str, Topic]:
    """Return topics by name from numbers of messages, of which several may be of one topic."""
    found: dict[str, Topic] = {}
    for topic, count in counts:
        before = found.get(topic.name, topic).count
        found[topic.name] = replace(topic, count=before + count)
    return found


def collected(
    path: Path, parts: Sequence[Path], scan: Callable[[Path], Iterable[Message]]
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
            for topic, arrival, raw in scan(part):
                if topic.name not in collectors:
                    collectors[topic.name] = Collector(topic)
                collectors[topic.name].add(arrival, raw)
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


def nothing_readable(path: Path, reason: str) -> BagTruncated:
    """Return the mistake of a recording without one readable message."""
    if path.suffix in (".bag", ".active"):
        text = f"{path.name} ends early (recorder killed?); 0 s are readable"
        return BagTruncated(text, where=path)
    better = path.with_name(f"{path.stem}_recovered{path.suffix}")
    fixes = {
        ".mcap": shell("mcap", "recover", path, "-o", better),
        ".db3": f"{shell('sqlite3', path, '.recover')} | {shell('sqlite3', better)}",
    }
    text = f"{path.name} was cut or not closed: {reason.rstrip('.')}"
    fix = fixes.get(path.suffix, shell("ros2", "bag", "reindex", path))
    return BagTruncated(text, where=path, fix=fix)


# ---------------------------------------------------------------- messages to columns
class Collector:
    """Takes the messages of one topic, keeps their numbers.

    Attributes:
        reason: what was wrong with a message that was passed over, "" where none was.

    Raises:
        WrongMessageType: the layout is not known.
    """

    def __init__(self, topic: Topic) -> None:
        if topic.type not in CHECKSUMS or (topic.cdr and topic.type in KINOVA_TYPES):
            text = f"{topic.name} has messages of the type {topic.type}"
            raise WrongMessageType(text, where=topic.name)
        if not topic.cdr and topic.md5 != CHECKSUMS[topic.type]:
            raise WrongMessageType(
                f"the {topic.type} of {topic.name} differs from the standard definition (md5 {topic.md5[:40]})",
                where=topic.name,
                why="dynid decodes the standard layout only",
                fix="record with the standard definition of this message",
            )
        self.reason = ""
        self._topic = topic
        self._waiting: list[tuple[int, bytes]] = []
        # By the joints that messages carry: names in the order of the first message, their number, blocks of numbers.
        self._groups: dict[Any, tuple[tuple[str, ...], int, list[Columns]]] = {}

    def add(self, arrival: int, raw: bytes) -> None:
        """Take a message; many are decoded together."""
        self._waiting.append((arrival, raw))
        if len(self._waiting) == tuning.MESSAGES:
            self._decode()

    def logs(self) -> list[Log]:
        """Return one raw log for each set of joint names, the largest first."""
        self._decode()
        found = (_log(*group, self._topic.name) for group in self._groups.values())
        return sorted(found, key=len, reverse=True)

    def _decode(self) -> None:
        """Decode the messages that wait, those of one length and layout in one go."""
        self._waiting.sort(key=_length)
        for length, same in groupby(self._waiting, _length):
            times, raws = zip(*same, strict=True)
            arrival = np.array(times)
            table = np.frombuffer(b"".join(raws), np.uint8).reshape(len(raws), length)
            while len(table):
                try:
                    layout = _Layout(table[0].tobytes(), self._topic)
                    alike = np.all(table[:, layout.equal] == table[0, layout.equal], axis=1)
                    self._keep(layout, arrival[alike], table[alike])
                except Broken as error:
                    self.reason = str(error)
                    alike = np.all(table == table[0], axis=1)
                arrival, table = arrival[~alike], table[~alike]
        self._waiting = []

    def _keep(self, layout: _Layout, arrival: Times, table: NDArray[np.uint8]) -> None:
        stamp = np.zeros(len(table), np.int64)
        if layout.stamped:
            words = np.ascontiguousarray(table[:, 4:12]).view("<u4").astype(np.int64)
            stamp = words[:, 0] * 10**9 + words[:, 1]
        columns: Columns = {"arrival": arrival, "stamp": stamp}
        names, width = layout.names, len(layout.names) or max(n for _, n in layout.fields)
        first, _, blocks = self._groups.setdefault(frozenset(names) or width, (names, width, []))
        order = [names.index(name) for name in first]
        for key, (start, count) in zip(FIELDS, layout.fields, strict=True):
            if not count:
                continue
            part = table[:, start : start + count * int(layout.number[-1])]
            values = np.ascontiguousarray(part).view(layout.number).astype(float)
            # Why: a field shorter than the names cannot be assigned to joints; NaN lets the checks name the samples.
            values = values if count == width else np.full((len(table), width), np.nan)
            columns[key] = values if names == first else values[:, order]
        blocks.append(columns)


def _length(message: tuple[int, bytes]) -> int:
    return len(message[1])


class _Layout:
    """Where a message has what: found by walking over it once.

    Attributes:
        names: of the joints; () where messages of this type have none.
        fields: start [byte] and count of the numbers of each of ``FIELDS``.
        equal: bytes in which messages of this layout agree, (length,).
        number: type of the numbers, as NumPy writes it.
        stamped: whether bytes 4 to 11 are a stamp.

    Raises:
        Broken: the bytes are not a message of this type.
        WrongMessageType: it is compressed.
    """

    def __init__(self, raw: bytes, topic: Topic) -> None:
        if topic.cdr and raw[:4] == _ZSTD:
            raise WrongMessageType(
                "every message of the recording is compressed (zstd)",
                why="dynid reads messages as they were sent, and MCAP whose chunks are compressed",
                fix="ros2 bag convert without compression_mode, or record without --compression-mode message",
            )
        if topic.cdr and raw[:2] != _CDR:
            raise Broken("a message is not plain little-endian CDR")
        self._raw, self._at, self._cdr = raw, 0, topic.cdr
        self.equal = np.zeros(len(raw), dtype=bool)
        self.names: tuple[str, ...] = ()
        self.number, self.stamped = "<f8", topic.type == JOINT_STATE
        if topic.type in KINOVA_TYPES:
            self.number = "<f4"
            self.fields = [(self._take(28), 7), (0, 0), (0, 0)]
        elif topic.type == MULTI_ARRAY:
            self._take(4 * topic.cdr)
            for _ in range(self._word()):
                self._text(), self._word(), self._word()
            self._word()
            self.fields = [self._numbers(), (0, 0), (0, 0)]
        else:
            # Unit: bytes 4-11 are the stamp, in ROS 1 behind a sequence number, in CDR behind the encapsulation.
            self._take(12)
            self._take(self._word())
            self.names = tuple(self._text() for _ in range(self._word()))
            self.fields = [self._numbers() for _ in FIELDS]

    def _take(self, size: int, align: int = 1, *, equal: bool = False) -> int:
        """Pass over some bytes, return where they begin; CDR aligns from behind the encapsulation of four bytes."""
        start = self._at + (4 - self._at) % align * self._cdr
        self._at = start + size
        if self._at > len(self._raw):
            raise Broken("a message is too short for its type")
        self.equal[start : self._at] = equal
        return start

    def _word(self) -> int:
        start = self._take(4, 4, equal=True)
        return int.from_bytes(self._raw[start : self._at], "little")

    def _text(self) -> str:
        start = self._take(self._word(), equal=True)
        try:
            return self._raw[start : self._at].rstrip(b"\0").decode()
        except UnicodeDecodeError:
            raise Broken("the names of a message are not text") from None

    def _numbers(self) -> tuple[int, int]:
        count = self._word()
        return self._take(8 * count, 8 if count else 1), count


# ---------------------------------------------------------------- columns to logs
def _log(names: tuple[str, ...], n: int, blocks: list[Columns], topic: str) -> Log:
    """Return messages, put in the order of arrival, as a raw log.

    ``extra`` names the ``clock`` of its time and what it counts from, ``start_ns``, the first and last ``arrival_ns``,
    and as ``absent`` the fields that no message has; absent positions and efforts are NaN.
    """
    sizes = [len(block["arrival"]) for block in blocks]
    found: Columns = {}
    for key in dict.fromkeys(key for block in blocks for key in block):
        # Why popped: the blocks of a column are not needed when it is whole.
        parts = [
            block.pop(key) if key in block else np.full((size, n), np.nan)
            for block, size in zip(blocks, sizes, strict=True)
        ]
        found[key] = np.concatenate(parts)
    if np.any(np.diff(found["arrival"]) < 0):
        order = np.argsort(found["arrival"], kind="stable")
        found = {key: values[order] for key, values in found.items()}
    arrival, stamp = found["arrival"], found["stamp"]
    # Why: a header stamp is taken where the sample is, so it is preferred; it may run on any epoch (some drivers stamp
    # with the monotonic clock), but must tick. One clock serves the whole topic: two are never mixed. Zero is where
    # the clock of a converted or simulated log begins; a driver without stamps writes zeros only.
    rising = len(stamp) > 1 and bool(np.all(np.diff(stamp) > 0))
    ticking = rising or len(np.unique(stamp)) >= max(2, tuning.LEAST_DISTINCT * len(stamp))
    stamped = (rising and stamp[0] >= 0) or (ticking and bool(np.all(stamp > 0)))
    ns = stamp if stamped else arrival
    nothing = np.broadcast_to(np.array(np.nan), (len(ns), n))
    return Log(
        t=(ns - ns[0]) * 1e-9,
        q=found.get("position", nothing),
        tau=found.get("effort", nothing),
        names=names,
        qd=found.get("velocity"),
        topic=topic,
        extra={
            "clock": "header" if stamped else "arrival",
            "start_ns": int(ns[0]),
            "arrival_ns": (int(arrival[0]), int(arrival[-1])),
            "absent": tuple(key for key in FIELDS if key not in found),
        },
    )
