"""ROS 2 messages (CDR) as the same messages of ROS 1, so that everything behind the container is the same.

Only sensor_msgs/JointState and std_msgs/Float64MultiArray are known, both endiannesses. Source: OMG DDS-XTypes 1.3,
section 7.4 (plain CDR, versions 1 and 2).
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from dynid import limits
from dynid.errors import TooLarge, WrongMessageType
from dynid.files.messages import BrokenMessage

#: Kind of the encapsulation (second byte) -> byte order and largest alignment.
_KINDS = {0: (">", 8), 1: ("<", 8), 6: (">", 4), 7: ("<", 4)}
_SEQUENCE = b"\0\0\0\0"
#: What a frame of zstd begins with.
_ZSTD = b"\x28\xb5\x2f\xfd"


class _Reader:
    """Walks over one message; alignment counts from behind the four bytes of the encapsulation.

    Attributes:
        starts: where the numbers of the sequences begin that were read.
    """

    def __init__(self, raw: bytes) -> None:
        if raw[:4] == _ZSTD:
            raise WrongMessageType(
                "every message of the recording is compressed (zstd)",
                why="dynid reads messages as they were sent, and MCAP whose chunks are compressed",
                fix="ros2 bag convert without compression_mode, or record without --compression-mode message",
            )
        if len(raw) < 4 or raw[0] != 0 or raw[1] not in _KINDS:
            raise BrokenMessage("a message is not plain CDR")
        self.raw, self.at, self.starts = raw, 4, list[int]()
        self.order, self.widest = _KINDS[raw[1]]

    def _align(self, size: int) -> None:
        size = min(size, self.widest)
        self.at += -(self.at - 4) % size

    def number(self) -> int:
        self._align(4)
        try:
            (value,) = struct.unpack_from(f"{self.order}I", self.raw, self.at)
        except struct.error:
            raise BrokenMessage("a message is too short for its type") from None
        self.at += 4
        return int(value)

    def text(self) -> bytes:
        """Return a string without its closing zero."""
        size = self.number()
        if self.at + size > len(self.raw):
            raise BrokenMessage("a message is too short for its type")
        self.at += size
        return self.raw[self.at - size : self.at].rstrip(b"\0")

    def floats(self) -> bytes:
        """Return a sequence of doubles as ROS 1 writes it: count, then little-endian numbers."""
        count = self.number()
        if count:
            self._align(8)
        self.starts.append(self.at)
        if not count:
            return _SEQUENCE
        end = self.at + 8 * count
        if end > len(self.raw):
            raise BrokenMessage("a message is too short for its type")
        part, self.at = self.raw[self.at : end], end
        body = part if self.order == "<" else np.frombuffer(part, ">f8").astype("<f8").tobytes()
        return struct.pack("<I", count) + body


def _string(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


def joint_state(raw: bytes) -> bytes:
    """Return a sensor_msgs/msg/JointState in CDR as the sensor_msgs/JointState of ROS 1.

    Raises:
        BrokenMessage: the bytes are not such a message.
        TooLarge: more names, or longer ones, than the limits.
    """
    reader = _Reader(raw)
    head = struct.pack("<III", 0, reader.number(), reader.number()) + _string(reader.text())
    count = reader.number()
    limits.check("columns", min(count, len(raw) // 4), "a JointState")
    names = [_string(reader.text()) for _ in range(count)]
    fields = [reader.floats() for _ in range(3)]
    return b"".join([head, struct.pack("<I", count), *names, *fields])


def joint_states(table: NDArray[np.uint8]) -> NDArray[np.uint8] | None:
    """Return messages of one length as ``joint_state`` does, (N, length); None where more than their numbers differ.

    Args:
        table: their bytes, (N, length).
    """
    one = table[0].tobytes()
    try:
        first = joint_state(one)
    except (BrokenMessage, TooLarge):
        return None
    if one[1] not in (1, 7):
        return None
    reader = _Reader(one)
    reader.number(), reader.number(), reader.text()
    for _ in range(reader.number()):
        reader.text()
    # The stamp, and the numbers of each sequence: where they lie here, and in a message of ROS 1.
    places = [(4, 4, 8)]
    ends = []
    for _ in range(3):
        reader.floats()
        ends.append(reader.at)
    tail = len(first)
    for start, end in zip(reversed(reader.starts), reversed(ends), strict=True):
        places.append((start, tail - (end - start), end - start))
        tail -= end - start + 4
    alike = np.ones(table.shape[1], dtype=bool)
    found = np.tile(np.frombuffer(first, np.uint8), (len(table), 1))
    for here, there, size in places:
        alike[here : here + size] = False
        found[:, there : there + size] = table[:, here : here + size]
    return found if (table[:, alike] == table[0, alike]).all() else None


def multi_array(raw: bytes) -> bytes:
    """Return the numbers of a std_msgs/msg/Float64MultiArray in CDR as ROS 1 writes them.

    Raises:
        BrokenMessage: the bytes are not such a message.
        TooLarge: more dimensions than columns may be.
    """
    reader = _Reader(raw)
    count = reader.number()
    limits.check("columns", min(count, len(raw) // 4), "a Float64MultiArray")
    for _ in range(count):
        reader.text()
        reader.number(), reader.number()
    reader.number()
    return reader.floats()
