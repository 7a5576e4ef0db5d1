"""Raw ROS 1 messages -> float arrays, block by block, so that a bag of hours is never held as messages.

``Collector`` takes the raw messages of one topic and keeps only their numbers, grouped by the joint names they carry
(an arm and its gripper often share a topic).
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.files.bag_recovery import Connection

Floats = NDArray[np.float64]
Times = NDArray[np.int64]

JOINT_STATE = "sensor_msgs/JointState"
#: Checksum of the one definition that the fixed layout below was written for.
JOINT_STATE_MD5 = "3066dcd76a6cfaef579bd0f34173e9fd"
KINOVA_TYPES = ("kinova_msgs/JointAngles", "kinova_msgs/JointTorque", "kinova_msgs/JointVelocity")
#: Messages that are decoded together: large enough for numpy, small enough to be forgotten soon.
BLOCK = 4096


@dataclass(frozen=True)
class Series:
    """The messages of one topic as arrays.

    Attributes:
        names: joint names of the columns, () for a message without names.
        arrival: time of arrival in the bag, (N,) [ns].
        stamp: header stamps, (N,) [ns], 0 where the message has none.
        position: (N, n), NaN where the message has none; n is 0 when no message has any. Likewise the others.
        velocity: (N, n) or (N, 0).
        effort: (N, n) or (N, 0).
    """

    names: tuple[str, ...]
    arrival: Times
    stamp: Times
    position: Floats
    velocity: Floats
    effort: Floats

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(self.arrival)


class Collector:
    """Takes the messages of one topic, keeps their numbers.

    Args:
        connection: type and definition of the messages.
        lenient: whether messages that cannot be decoded are passed over, as in a damaged bag.
    """

    def __init__(self, connection: Connection, *, lenient: bool = False) -> None:
        self.connection = connection
        self.lenient = lenient
        self.count = 0
        self._pending: list[tuple[int, bytes]] = []
        self._blocks: dict[frozenset[str], list[Series]] = {}
        self._decode: Callable[[bytes], object] | None = None

    def add(self, arrival: int, raw: bytes) -> None:
        """Take one message."""
        self._pending.append((arrival, raw))
        self.count += 1
        if len(self._pending) == BLOCK:
            self._flush()

    def groups(self) -> list[Series]:
        """Return one series for each set of joint names, the largest first."""
        self._flush()
        return sorted((_joined(blocks) for blocks in self._blocks.values()), key=len, reverse=True)

    def _flush(self) -> None:
        if not self._pending:
            return
        arrival = np.array([time for time, _ in self._pending], dtype=np.int64)
        raws = [raw for _, raw in self._pending]
        self._pending = []
        fast = joint_state_block(arrival, raws) if self.connection.md5 == JOINT_STATE_MD5 else None
        for block in [fast] if fast is not None else self._one_by_one(arrival, raws):
            self._blocks.setdefault(frozenset(block.names), []).append(block)

    def _one_by_one(self, arrival: Times, raws: Sequence[bytes]) -> list[Series]:
        """Decode by the bag's own definition; messages with equal names and lengths go into one block."""
        rows: dict[tuple[Any, ...], list[tuple[int, int, Any, Any, Any]]] = {}
        for time, raw in zip(arrival, raws, strict=True):
            try:
                if self._decode is None:
                    self._decode = _decoder(self.connection)
                names, stamp, position, velocity, effort = _fields(self._decode(raw), self.connection.type)
            except broken_bytes():
                if not self.lenient:
                    raise
                continue
            key = (names, len(position), len(velocity), len(effort))
            rows.setdefault(key, []).append((int(time), stamp, position, velocity, effort))
        return [_block(key[0], entries) for key, entries in rows.items()]


def joint_state_block(arrival: Times, raws: Sequence[bytes]) -> Series | None:
    """Decode JointStates of one layout in one go; None when they differ in anything but stamps and numbers."""
    length = len(raws[0])
    if any(len(raw) != length for raw in raws):
        return None
    layout = _layout(raws[0])
    if layout is None:
        return None
    names, starts, counts = layout
    table = np.frombuffer(b"".join(raws), dtype=np.uint8).reshape(len(raws), length)
    # Unit: bytes 0-3 are the sequence number, 4-11 the stamp; from 12 on only the three number fields may differ.
    edges = [12, *(edge for s, c in zip(starts, counts, strict=True) for edge in (s, s + 8 * c))]
    for begin, end in zip(edges[::2], [*edges[1::2], length], strict=True):
        if not np.array_equal(table[:, begin:end], np.broadcast_to(table[0, begin:end], (len(raws), end - begin))):
            return None
    position, velocity, effort = (
        np.ascontiguousarray(table[:, s : s + 8 * c]).view("<f8").reshape(len(raws), c).astype(float)
        for s, c in zip(starts, counts, strict=True)
    )
    stamp = np.ascontiguousarray(table[:, 4:12]).view("<u4").astype(np.int64)
    return Series(names, arrival, stamp[:, 0] * 10**9 + stamp[:, 1], position, velocity, effort)


def _layout(raw: bytes) -> tuple[tuple[str, ...], list[int], list[int]] | None:
    """Return the names, and where position, velocity and effort start and how many numbers they have."""
    try:
        (size,) = struct.unpack_from("<I", raw, 12)
        at = 16 + size
        (count,) = struct.unpack_from("<I", raw, at)
        at += 4
        names = []
        for _ in range(count):
            (size,) = struct.unpack_from("<I", raw, at)
            names.append(raw[at + 4 : at + 4 + size].decode())
            at += 4 + size
        starts, counts = [], []
        for _ in range(3):
            (numbers,) = struct.unpack_from("<I", raw, at)
            starts.append(at + 4)
            counts.append(numbers)
            at += 4 + 8 * numbers
    except (struct.error, UnicodeDecodeError):
        return None
    return (tuple(names), starts, counts) if at == len(raw) and all(c in (0, count) for c in counts) else None


def broken_bytes() -> tuple[type[Exception], ...]:
    """Return what rosbags and its decompressors raise on broken bytes, at opening or in the middle of reading."""
    from rosbags.rosbag1 import ReaderError
    from rosbags.serde import SerdeError
    from rosbags.typesys import TypesysError

    broken_numbers = (struct.error, ValueError, LookupError, OverflowError, AssertionError, MemoryError)
    return (ReaderError, SerdeError, TypesysError, OSError, RuntimeError, EOFError, *broken_numbers)


def _decoder(connection: Connection) -> Callable[[bytes], object]:
    """Return a function from raw bytes to a message object, made from the definition in the bag."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    package, _, name = connection.type.partition("/")
    full = f"{package}/msg/{name}"
    store.register(get_types_from_msg(connection.definition, full))

    def decode(raw: bytes) -> object:
        return store.deserialize_ros1(raw, full)

    return decode


def _fields(message: object, kind: str) -> tuple[tuple[str, ...], int, Any, Any, Any]:
    """Return names, stamp [ns], position, velocity and effort of a message."""
    if kind == JOINT_STATE:
        state: Any = message
        stamp = int(state.header.stamp.sec) * 10**9 + int(state.header.stamp.nanosec)
        return tuple(state.name), stamp, state.position, state.velocity, state.effort
    values = [float(getattr(message, f"joint{i}")) for i in range(1, 8)]
    return (), 0, values, (), ()


def _block(names: tuple[str, ...], entries: list[tuple[int, int, Any, Any, Any]]) -> Series:
    width = len(names) or 7
    arrays = [np.array([entry[i] for entry in entries], dtype=float).reshape(len(entries), -1) for i in (2, 3, 4)]
    # Why: a field shorter than the names cannot be told apart by joint; NaN lets the checks name the samples.
    arrays = [a if a.shape[1] in (0, width) else np.full((len(a), width), np.nan) for a in arrays]
    times = np.array([entry[:2] for entry in entries], dtype=np.int64)
    return Series(names, times[:, 0], times[:, 1], *arrays)


def _joined(blocks: list[Series]) -> Series:
    """Join blocks that carry the same joints, perhaps in another order, in the order of arrival."""
    names = blocks[0].names
    widths = [max(getattr(b, key).shape[1] for b in blocks) for key in ("position", "velocity", "effort")]
    parts: list[list[Floats]] = [[], [], []]
    for block in blocks:
        order = [block.names.index(name) for name in names]
        for part, key, width in zip(parts, ("position", "velocity", "effort"), widths, strict=True):
            values: Floats = getattr(block, key)
            if values.shape[1] != width:
                values = np.full((len(values), width), np.nan)
            elif order and order != list(range(len(order))) and width:
                values = values[:, order]
            part.append(values)
    arrival = np.concatenate([block.arrival for block in blocks])
    stamp = np.concatenate([block.stamp for block in blocks])
    arrays = [np.concatenate(part) for part in parts]
    if np.any(np.diff(arrival) < 0):
        order_ = np.argsort(arrival, kind="stable")
        arrival, stamp, arrays = arrival[order_], stamp[order_], [a[order_] for a in arrays]
    return Series(names, arrival, stamp, *arrays)
