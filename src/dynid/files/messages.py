"""Raw messages of ROS -> logs, block by block, so that a recording of hours is never held as messages.

A container (``bag``, ``rosbag2``) hands over raw messages; ``Collector`` keeps only their numbers, grouped by the joint
names they carry (an arm and its gripper often share a topic). Only the layouts below are decoded, by the code below:
the definition that a recording carries is compared with the known one and never interpreted.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid import limits
from dynid.drivers.interface import JOINT_STATE
from dynid.errors import BagTruncated, Finding, TooLarge, WrongMessageType
from dynid.files import tuning
from dynid.log import Log
from dynid.scratch import Growing, taken

Times = NDArray[np.int64]
#: Arrays of some messages: ``arrival`` and ``stamp``, (N,) [ns], stamp 0 where a message has none; ``position``,
#: ``velocity`` and ``effort``, (N, n), NaN where a message has none, or (N, 0) where none has any.
Columns = dict[str, NDArray[Any]]
FIELDS = ("position", "velocity", "effort")
#: Fewer messages than this are not worth a call of NumPy; half or double makes no difference.
FEW = 32

MULTI_ARRAY = "std_msgs/Float64MultiArray"
KINOVA_TYPES = ("kinova_msgs/JointAngles", "kinova_msgs/JointTorque", "kinova_msgs/JointVelocity")
_SEVEN = tuple(f"float32 joint{i}" for i in range(1, 8))
#: Definitions that the decoders below were written for: the fields of each type, and those of the types in it.
LAYOUTS: dict[str, dict[str, tuple[str, ...]]] = {
    JOINT_STATE: {
        JOINT_STATE: (
            "std_msgs/Header header",
            "string[] name",
            "float64[] position",
            "float64[] velocity",
            "float64[] effort",
        ),
        "std_msgs/Header": ("uint32 seq", "time stamp", "string frame_id"),
    },
    MULTI_ARRAY: {MULTI_ARRAY: ("std_msgs/MultiArrayLayout layout", "float64[] data")},
    **{kind: {kind: _SEVEN} for kind in KINOVA_TYPES},
}
#: Their checksums: ROS takes the md5 of the fields, with the md5 of a type in its place.
CHECKSUMS = {
    JOINT_STATE: "3066dcd76a6cfaef579bd0f34173e9fd",
    MULTI_ARRAY: "4b7d974086d4060e7db4613a7e6c3ba4",
    **{
        kind: hashlib.md5("\n".join(_SEVEN).encode(), usedforsecurity=False).hexdigest()
        for kind in KINOVA_TYPES
    },
}
_SEVEN_FLOATS = struct.Struct("<7f")
#: A sequence of no numbers or names, as ROS 1 writes it.
_NONE = b"\0\0\0\0"


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
        definition: text of the message definition, "" where there is none; it is only compared, never interpreted.
        md5: checksum of the definition, as the recorder wrote it.
        encoding: how messages are written: ``"ros1"``, ``"cdr"`` or something else.
    """

    topic: str
    type: str
    definition: str
    md5: str = ""
    encoding: str = "ros1"


#: Messages of one connection and one length: their publisher, when they were recorded, (N,) [ns], and their bytes,
#: (N, length).
Messages = tuple[Connection, Times, NDArray[np.uint8]]


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


def counted(messages: Iterable[Messages]) -> dict[str, Topic]:
    """Return the topics of a damaged recording by name: of the messages that can be read."""
    counts: list[tuple[Connection, int]] = []
    try:
        for connection, arrival, _ in messages:
            counts.append((connection, len(arrival)))
    except Broken:
        pass
    return topics_of(counts)


def collected(
    path: Path, parts: Sequence[Path], scan: Callable[[Path], Iterable[Messages]]
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
        TooLarge: a chunk, a message or a name is larger than the limit.
    """

    def read(*, lenient: bool) -> dict[str, list[Log]]:
        collectors: dict[str, Collector] = {}
        for part in parts:
            try:
                for connection, arrival, raw in scan(part):
                    if connection.topic not in collectors:
                        collectors[connection.topic] = Collector(connection, lenient=lenient)
                    collectors[connection.topic].add(arrival, raw)
            except Broken as error:
                reasons.append(f"{part.name}: {error}" if part != path else str(error))
        return {
            topic: logs for topic, collector in collectors.items() if (logs := collector.logs())
        }

    reasons: list[str] = []
    try:
        groups = read(lenient=False)
    except BrokenMessage as error:
        reasons[:] = [str(error)]
        groups = read(lenient=True)
    if reasons and not groups:
        raise nothing_readable(path, reasons[0])
    return groups, (_recovered(path, "; ".join(reasons[:3]), groups),) if reasons else ()


def nothing_readable(path: Path, reason: str) -> BagTruncated:
    """Return the mistake of a recording without one readable message."""
    if path.suffix in (".bag", ".active"):
        return BagTruncated(
            f"{path.name} ends early (recorder killed?); 0 s are readable", where=str(path)
        )
    return BagTruncated(
        f"{path.name}: nothing is readable: {reason}",
        where=str(path),
        fix="record again, or try: ros2 bag reindex FOLDER; mcap recover FILE",
    )


def _recovered(path: Path, reason: str, groups: dict[str, list[Log]]) -> Finding:
    """Return finding W305: what of a damaged recording is used."""
    logs = [log for found in groups.values() for log in found]
    count = sum(len(log) for log in logs)
    seconds = (
        float(max(log.extra["arrival_ns"][1] - log.extra["arrival_ns"][0] for log in logs)) * 1e-9
    )
    text = (
        f"{path.name} was cut or not closed (recorder killed?): "
        f"{count} messages, {seconds:.1f} s, are readable and used; "
        f"reported by the reader: {reason.rstrip('.')}"
    )
    return Finding(
        "W305", "warning", text, {"messages": count, "seconds": seconds, "reason": reason}
    )


# ---------------------------------------------------------------- known layouts
def check_layout(connection: Connection) -> None:
    """Raise when messages do not have the one layout that is known for their type.

    Raises:
        WrongMessageType: the type is not known, or the definition is another one.
    """
    kind, ros1 = connection.type, connection.encoding == "ros1"
    if kind not in LAYOUTS or not (
        ros1 or (connection.encoding == "cdr" and kind in (JOINT_STATE, MULTI_ARRAY))
    ):
        written = "" if ros1 else f" ({connection.encoding})"
        text = f"{connection.topic} has messages of the type {kind}{written}"
        raise WrongMessageType(text, where=connection.topic)
    if ros1 and kind != MULTI_ARRAY:
        known = connection.md5 == CHECKSUMS[kind] or _fields_of(connection) == LAYOUTS[kind]
    else:
        # Why only its own fields: those of the types in it are called differently in ROS 2; recorders may write none.
        known = _fields_of(connection)[kind] in ((), LAYOUTS[kind][kind])
    if not known:
        md5 = f" (md5 {connection.md5[:40]})" if connection.md5 else ""
        raise WrongMessageType(
            f"the {kind} of {connection.topic} differs from the standard definition{md5}",
            where=connection.topic,
            why="dynid decodes the standard layout only",
            fix="record with the standard definition of this message",
        )


def _fields_of(connection: Connection) -> dict[str, tuple[str, ...]]:
    """Return the lines of a definition by type, without comments and blank lines."""
    found: dict[str, list[str]] = {connection.type: []}
    current = connection.type
    for raw in connection.definition.splitlines():
        words = raw.partition("#")[0].split()
        if words[:1] == ["MSG:"] and len(words) == 2:
            current = words[1].replace("/msg/", "/")
            found[current] = []
        elif words and set(raw.strip()) != {"="}:
            kind = words[0].replace("/msg/", "/")
            kind = f"std_msgs/{kind}" if kind in ("Header", "MultiArrayLayout") else kind
            found[current].append(" ".join([kind, *words[1:]]))
    return {kind: tuple(lines) for kind, lines in found.items()}


# ---------------------------------------------------------------- messages to columns
class Collector:
    """Takes the messages of one topic, keeps their numbers.

    Args:
        connection: type, encoding and definition of the messages.
        lenient: whether messages that cannot be decoded are passed over, as in a damaged recording.

    Raises:
        WrongMessageType: the layout is not known.
    """

    def __init__(self, connection: Connection, *, lenient: bool = False) -> None:
        check_layout(connection)
        self.connection = connection
        self.lenient = lenient
        self._pending: list[tuple[int, bytes]] = []
        self._bytes = 0
        self._count = 0
        # By the joints that messages carry: their names in the order of the first message, and the numbers so far.
        self._groups: dict[frozenset[str], tuple[tuple[str, ...], dict[str, Growing]]] = {}

    def add(self, arrival: Times, raw: NDArray[np.uint8]) -> None:
        """Take messages of one length; few of them are put together with others before they are decoded.

        Args:
            arrival: when they were recorded, (N,) [ns].
            raw: their bytes, (N, length).
        """
        limits.check("message_bytes", raw.shape[1], self.connection.topic)
        self._count += len(arrival)
        limits.check("samples", self._count, self.connection.topic)
        if len(arrival) < FEW:
            for time, one in zip(arrival.tolist(), raw, strict=True):
                self._pending.append((time, one.tobytes()))
            self._bytes += raw.size
            if len(self._pending) >= tuning.MESSAGES or self._bytes > tuning.MESSAGE_BYTES:
                self._flush()
            return
        self._flush()
        self._decode(arrival, raw)

    def logs(self) -> list[Log]:
        """Return one raw log for each set of joint names, the largest first."""
        self._flush()
        found = (
            _log(names, _in_order(kept), self.connection.topic)
            for names, kept in self._groups.values()
        )
        return sorted(found, key=len, reverse=True)

    def _flush(self) -> None:
        if not self._pending:
            return
        arrival = np.array([time for time, _ in self._pending], dtype=np.int64)
        raws = [raw for _, raw in self._pending]
        self._pending, self._bytes = [], 0
        if len({len(raw) for raw in raws}) == 1:
            self._decode(arrival, np.frombuffer(b"".join(raws), np.uint8).reshape(len(raws), -1))
        else:
            self._keep(self._one_by_one(arrival, raws))

    def _decode(self, arrival: Times, table: NDArray[np.uint8]) -> None:
        """Decode messages of one length, in one go where they have one layout."""
        fast = None
        if self.connection.type == JOINT_STATE and table.shape[1]:
            plain: NDArray[np.uint8] | None = table
            if self.connection.encoding == "cdr":
                from dynid.files import cdr

                plain = cdr.joint_states(table)
            fast = joint_state_block(arrival, plain) if plain is not None else None
        self._keep(
            [fast]
            if fast is not None
            else self._one_by_one(arrival, [one.tobytes() for one in table])
        )

    def _keep(self, blocks: Sequence[tuple[tuple[str, ...], Columns]]) -> None:
        for names, columns in blocks:
            key = frozenset(names)
            if key not in self._groups:
                self._groups[key] = (
                    names,
                    {each: Growing(0, np.int64) for each in ("arrival", "stamp")},
                )
            first, kept = self._groups[key]
            _append(kept, first, names, columns)
        limits.check("joint_sets", len(self._groups), self.connection.topic)

    def _one_by_one(
        self, arrival: Times, raws: Sequence[bytes]
    ) -> list[tuple[tuple[str, ...], Columns]]:
        """Decode message by message; those with equal names and lengths go into one block."""
        rows: dict[tuple[Any, ...], list[tuple[int, int, Any, Any, Any]]] = {}
        for time, raw in zip(arrival, raws, strict=True):
            try:
                names, stamp, position, velocity, effort = _decoded(raw, self.connection)
            except (BrokenMessage, TooLarge) as error:
                if self.lenient:
                    continue
                # Why: sizes that no message before it had are damage, sizes of the first one are what was recorded.
                if isinstance(error, TooLarge) and (rows or self._groups):
                    raise BrokenMessage("a message has impossible sizes") from None
                raise
            key = (names, len(position), len(velocity), len(effort))
            rows.setdefault(key, []).append((int(time), stamp, position, velocity, effort))
        return [(key[0], _columns(key[0], entries)) for key, entries in rows.items()]


def _append(
    kept: dict[str, Growing], names: tuple[str, ...], own: tuple[str, ...], columns: Columns
) -> None:
    """Add messages to the numbers of those that carry the same joints; NaN where some lack what others have.

    Args:
        kept: the numbers so far.
        names: of the first message, whose order all get.
        own: the same in the order of these messages.
        columns: what they hold.
    """
    before, count, width = len(kept["arrival"]), len(columns["arrival"]), len(names) or 7

    def lack(key: str, count: int) -> None:
        for start in range(0, count if key in kept else 0, tuning.MESSAGES):
            kept[key].append(np.full((min(tuning.MESSAGES, count - start), width), np.nan))

    for key in FIELDS:
        values = columns[key]
        if values.shape[1] and key not in kept:
            kept[key] = Growing(values.shape[1])
            lack(key, before)
        if not values.shape[1]:
            lack(key, count)
        else:
            kept[key].append(
                values if own == names else values[:, [own.index(name) for name in names]]
            )
    for key in ("arrival", "stamp"):
        kept[key].append(columns[key])


def _in_order(kept: dict[str, Growing]) -> Columns:
    """Return all messages in the order of arrival."""
    found: Columns = {key: growing.whole() for key, growing in kept.items()}
    if np.any(np.diff(found["arrival"]) < 0):
        order = np.argsort(found["arrival"], kind="stable")
        found = {key: taken(values, order) for key, values in found.items()}
    return {key: np.zeros((len(found["arrival"]), 0)) for key in FIELDS} | found


def joint_state_block(
    arrival: Times, table: NDArray[np.uint8]
) -> tuple[tuple[str, ...], Columns] | None:
    """Decode JointStates of one layout in one go; None when they differ in anything but stamps and numbers.

    Args:
        arrival: when they were recorded, (N,) [ns].
        table: their bytes, (N, length).
    """
    length = table.shape[1]
    layout = _layout(table[0].tobytes())
    if layout is None:
        return None
    names, starts, counts = layout
    # Unit: bytes 0-3 are the sequence number, 4-11 the stamp; from 12 on only the three number fields may differ.
    edges = [12, *(edge for s, c in zip(starts, counts, strict=True) for edge in (s, s + 8 * c))]
    for begin, end in zip(edges[::2], [*edges[1::2], length], strict=True):
        if not np.all(table[:, begin:end] == table[0, begin:end]):
            return None
    stamp = np.ascontiguousarray(table[:, 4:12]).view("<u4").astype(np.int64)
    columns: Columns = {"arrival": arrival, "stamp": stamp[:, 0] * 10**9 + stamp[:, 1]}
    for key, s, c in zip(FIELDS, starts, counts, strict=True):
        columns[key] = (
            np.ascontiguousarray(table[:, s : s + 8 * c])
            .view("<f8")
            .reshape(len(table), c)
            .astype(float)
        )
    return names, columns


def _layout(raw: bytes) -> tuple[tuple[str, ...], list[int], list[int]] | None:
    """Return the names, and where position, velocity and effort start and how many numbers they have."""
    try:
        names, starts, counts = _parts(raw)
    except (struct.error, UnicodeDecodeError, TooLarge):
        return None
    fits = starts[2] + 8 * counts[2] == len(raw) and all(c in (0, len(names)) for c in counts)
    return (names, starts, counts) if fits else None


def _parts(raw: bytes) -> tuple[tuple[str, ...], list[int], list[int]]:
    """Return the names of a JointState, and where its three fields of numbers start and how many each has."""
    (size,) = struct.unpack_from("<I", raw, 12)
    at = 16 + size
    (count,) = struct.unpack_from("<I", raw, at)
    at += 4
    limits.check("columns", min(count, len(raw) // 4), "a JointState")
    names = []
    for _ in range(count):
        (size,) = struct.unpack_from("<I", raw, at)
        limits.check("name_length", min(size, len(raw)), "a JointState")
        names.append(raw[at + 4 : at + 4 + size].decode())
        at += 4 + size
    starts, counts = [], []
    for _ in range(3):
        (numbers,) = struct.unpack_from("<I", raw, at)
        starts.append(at + 4)
        counts.append(numbers)
        at += 4 + 8 * numbers
    return tuple(names), starts, counts


def _decoded(raw: bytes, connection: Connection) -> tuple[tuple[str, ...], int, Any, Any, Any]:
    """Return names, stamp [ns], position, velocity and effort of one message of a known type.

    Raises:
        BrokenMessage: the bytes are not such a message.
    """
    if connection.encoding == "cdr":
        from dynid.files import cdr

        raw = (
            cdr.joint_state(raw)
            if connection.type == JOINT_STATE
            else _nameless(cdr.multi_array(raw))
        )
    elif connection.type == MULTI_ARRAY:
        raw = _nameless(_multi_array(raw))
    elif connection.type != JOINT_STATE:
        if len(raw) < _SEVEN_FLOATS.size:
            raise BrokenMessage("a message is too short for its type")
        return (), 0, _SEVEN_FLOATS.unpack_from(raw), (), ()
    try:
        seconds, nanoseconds = struct.unpack_from("<II", raw, 4)
        names, starts, counts = _parts(raw)
    except (struct.error, UnicodeDecodeError):
        raise BrokenMessage(
            "a message is too short for its type, or its names are not text"
        ) from None
    if starts[2] + 8 * counts[2] > len(raw):
        raise BrokenMessage("a message is too short for its type")
    values = [
        np.frombuffer(raw, "<f8", count, start) for start, count in zip(starts, counts, strict=True)
    ]
    return names, seconds * 10**9 + nanoseconds, *values


def _multi_array(raw: bytes) -> bytes:
    """Return the numbers of a std_msgs/Float64MultiArray of ROS 1: count, then little-endian numbers."""
    try:
        (count,) = struct.unpack_from("<I", raw, 0)
        limits.check("columns", min(count, len(raw) // 4), "a Float64MultiArray")
        at = 4
        for _ in range(count):
            (size,) = struct.unpack_from("<I", raw, at)
            at += 12 + size
        (numbers,) = struct.unpack_from("<I", raw, at + 4)
    except struct.error:
        raise BrokenMessage("a message is too short for its type") from None
    if len(raw) < at + 8 + 8 * numbers:
        raise BrokenMessage("a message is too short for its type")
    return raw[at + 4 : at + 8 + 8 * numbers]


def _nameless(numbers: bytes) -> bytes:
    """Return a JointState of ROS 1 that has only positions, without names and stamp."""
    # Unit: sequence number, stamp (two words), length of the frame's name, number of names.
    return b"\0" * 20 + numbers + _NONE + _NONE


def _columns(names: tuple[str, ...], entries: list[tuple[int, int, Any, Any, Any]]) -> Columns:
    width = len(names) or 7
    arrays = [
        np.array([entry[i] for entry in entries], dtype=float).reshape(len(entries), -1)
        for i in (2, 3, 4)
    ]
    # Why: a field shorter than the names cannot be assigned to joints; NaN lets the checks name the samples.
    arrays = [a if a.shape[1] in (0, width) else np.full((len(a), width), np.nan) for a in arrays]
    times = np.array([entry[:2] for entry in entries], dtype=np.int64)
    return {"arrival": times[:, 0], "stamp": times[:, 1], **dict(zip(FIELDS, arrays, strict=True))}


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
