"""Raw ``sensor_msgs/JointState`` -> logs; messages that differ only in their numbers are decoded together.

``bags`` takes messages out of a recording; ``Collector`` keeps their numbers, grouped by the joint names they carry
(an arm and its gripper often share a topic). The definition that a recording carries is
never interpreted. Source of CDR: OMG DDS-XTypes 1.3, section 7.4 (plain CDR, version 1).
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import WrongMessageType
from dynid.files import tuning
from dynid.log import Log

Bytes = NDArray[np.uint8]
Times = NDArray[np.int64]
#: When each message arrived [ns], and its bytes.
Messages = list[tuple[int, bytes]]
#: Arrays of some messages: ``arrival`` and ``stamp``, (N,) [ns]; ``position``,
#: ``velocity`` and ``effort``, (N, n), NaN where messages have none.
Columns = dict[str, NDArray[Any]]
FIELDS = ("position", "velocity", "effort")
#: Parts of a stamp of seconds and nanoseconds [ns].
NANOSECONDS = np.array([10**9, 1])
#: What a little-endian message in CDR begins with.
_CDR = b"\0\1"


class Broken(Exception):
    """A recording or a message is cut, or has damaged bytes; says what was met."""


@dataclass(frozen=True)
class Topic:
    """One topic of a recording.

    Attributes:
        name: topic name.
        type: message type as ROS 1 writes it, such as ``"sensor_msgs/JointState"``.
        cdr: whether messages are written as in ROS 2.
        count: number of messages, where they were counted.
    """

    name: str
    type: str
    cdr: bool = False
    count: int = 0

    def __str__(self) -> str:
        """Return it as the messages show it."""
        return f"{self.name} ({self.type.split('/')[-1]}, {self.count})"


def whole(raw: bytes) -> int:
    """Return the whole number that bytes are."""
    return int.from_bytes(raw, "little")


# ---------------------------------------------------------------- messages to columns
class Collector:
    """Takes the messages of one topic, keeps their numbers.

    Attributes:
        reason: what was wrong with a message that was passed over, "" where none was.
    """

    def __init__(self, topic: Topic) -> None:
        self.reason = ""
        self._topic = topic
        # By the joints that messages carry: names in the order of the first message, and the numbers.
        self._groups: dict[Any, tuple[tuple[str, ...], list[Columns]]] = {}

    def add(self, messages: Messages) -> None:
        """Take messages, those of one length and layout in one go."""
        by_length = defaultdict[int, Messages](list)
        for arrived, raw in messages:
            by_length[len(raw)].append((arrived, raw))
        for length, some in by_length.items():
            times, raws = zip(*some, strict=True)
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

    def logs(self) -> list[Log]:
        """Return one raw log for each set of joint names, the largest first."""
        logs = (_log(*group, self._topic.name) for group in self._groups.values())
        return sorted(logs, key=len, reverse=True)

    def _keep(self, layout: _Layout, arrival: Times, table: Bytes) -> None:
        names, width = layout.names, len(layout.names) or max(n for _, n in layout.fields)
        first, blocks = self._groups.setdefault(frozenset(names) or width, (names, []))
        order = [names.index(name) for name in first] or slice(None)
        # Unit: bytes 4-11 are the stamp, in ROS 1 behind a sequence number, in CDR behind the encapsulation.
        block = {"arrival": arrival, "stamp": _taken(table, 4, 2, "<u4") @ NANOSECONDS}
        for key, (place, count) in zip(FIELDS, layout.fields, strict=True):
            # Why: a short field cannot be assigned to joints; NaN lets the checks name the samples.
            block[key] = np.full((len(table), width), np.nan)
            if count == width:
                block[key] = _taken(table, place, count, "<f8")[:, order]
        blocks.append(block)


def _taken(table: Bytes, place: int, count: int, kind: str) -> NDArray[Any]:
    """Return so many numbers of a type, as NumPy writes it, from a place in each message, (N, count)."""
    part = table[:, place : place + count * np.dtype(kind).itemsize]
    return np.ascontiguousarray(part).view(kind)


class _Layout:
    """Where a message has what: found by walking over it once.

    Attributes:
        names: of the joints; () where a driver fills in none.
        fields: start [byte] and count of the numbers of each of ``FIELDS``.
        equal: bytes in which messages of this layout agree, (length,).

    Raises:
        Broken: the bytes are not a message of this type.
        WrongMessageType: they are no plain CDR.
    """

    def __init__(self, raw: bytes, topic: Topic) -> None:
        if topic.cdr and raw[:2] != _CDR:
            raise WrongMessageType(
                f"messages of {topic.name} are compressed one by one, or not plain little-endian CDR",
                fix="ros2 bag convert without compression_mode, or record without it",
            )
        self._raw, self._at, self._cdr = raw, 0, topic.cdr
        self.equal = np.zeros(len(raw), dtype=bool)
        self._take(12)
        self._take(self._word())
        self.names = tuple(self._text() for _ in range(self._word()))
        self.fields = [self._numbers() for _ in FIELDS]
        if not self._cdr and self._at < len(raw):
            raise Broken("a message is too long for its type")

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
        return whole(self._raw[start : self._at])

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
def _log(names: tuple[str, ...], blocks: list[Columns], topic: str) -> Log:
    """Return messages, put in the order of arrival, as a raw log; absent positions and efforts are NaN.

    ``extra`` names the ``clock`` of its time and what it counts from, ``start_ns``, and the first and last
    ``arrival_ns``.
    """
    order = np.argsort(np.concatenate([block["arrival"] for block in blocks]), kind="stable")
    columns = {key: np.concatenate([block[key] for block in blocks])[order] for key in blocks[0]}
    arrival, stamp = columns["arrival"], columns["stamp"]
    # Why: a header stamp is taken where the sample is, so it is preferred; it may run on any epoch (some drivers stamp
    # with the monotonic clock), but must tick. One clock serves the topic: two are never mixed. Zero is where
    # the clock of a converted or simulated log begins; a driver without stamps writes zeros only.
    ticking = len(np.unique(stamp)) >= max(2, tuning.LEAST_DISTINCT * len(stamp))
    stamped = ticking and bool(np.all(stamp[1:] > 0))
    ns = stamp if stamped else arrival
    return Log(
        t=(ns - ns[0]) * 1e-9,
        q=columns["position"],
        tau=columns["effort"],
        names=names,
        qd=columns["velocity"] if np.isfinite(columns["velocity"]).any() else None,
        topic=topic,
        extra={
            "clock": "header" if stamped else "arrival",
            "start_ns": int(ns[0]),
            "arrival_ns": (int(arrival[0]), int(arrival[-1])),
        },
    )
