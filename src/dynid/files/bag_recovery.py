"""A damaged ROS 1 bag -> the messages that are still readable, by one linear scan without the index.

A recorder that was killed leaves a bag without index and with its last chunk open; a full disk leaves one cut
anywhere. Everything before the first broken record is still there. Records are read one by one, chunk by chunk, so
memory holds one chunk at a time. Source: bag format 2.0, wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import bz2
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

#: Length of the line ``#ROSBAG V2.0`` that opens every bag.
MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7
#: A record header holds a few short fields; a larger number is debris.
_LARGEST_HEADER = 1 << 24
_PIECE = 1 << 16


@dataclass(frozen=True)
class Connection:
    """One publisher of one topic.

    Attributes:
        topic: topic name.
        type: message type, such as ``"sensor_msgs/JointState"``.
        definition: text of the message definition.
        md5: checksum of the definition.
    """

    topic: str
    type: str
    definition: str
    md5: str


class _BrokenRecord(Exception):
    """The bytes at hand are not a whole record."""


def scan(path: Path) -> Iterator[tuple[Connection, int, bytes]]:
    """Yield connection, arrival time [ns] and raw bytes of every readable message, in the order of the file."""
    connections: dict[int, Connection] = {}
    with path.open("rb") as stream:
        end = stream.seek(0, os.SEEK_END)
        stream.seek(len(MAGIC))
        while True:
            try:
                header, size = _read_head(stream, end)
                if header.get(b"op") == bytes([_CHUNK]):
                    whole = 0 < size <= end - stream.tell()
                    if size == 0:
                        # Why: a chunk is given its size when it is closed; the messages of an open one simply follow.
                        yield from _open_chunk(stream, header, end, connections)
                        continue
                    chunk = stream.read(size)
                    yield from _messages(_decompress(chunk, header, whole), connections)
                    continue
                yield from _one(header, _read_exactly(stream, size, end), connections)
            except _BrokenRecord:
                return


def _open_chunk(
    stream: IO[bytes], header: dict[bytes, bytes], end: int, connections: dict[int, Connection]
) -> Iterator[tuple[Connection, int, bytes]]:
    """Yield the messages of a chunk that was never closed; it reaches to the end of the file unless uncompressed."""
    if header.get(b"compression") != b"none":
        yield from _messages(_decompress(stream.read(end - stream.tell()), header, whole=False), connections)


def _read_exactly(stream: IO[bytes], size: int, end: int) -> bytes:
    if size > end - stream.tell():
        raise _BrokenRecord
    return stream.read(size)


def _read_head(stream: IO[bytes], end: int) -> tuple[dict[bytes, bytes], int]:
    """Read a record's header and the size of its data."""
    length = struct.unpack("<I", _read_exactly(stream, 4, end))[0]
    if length > _LARGEST_HEADER:
        raise _BrokenRecord
    header = _fields(_read_exactly(stream, length, end))
    return header, struct.unpack("<I", _read_exactly(stream, 4, end))[0]


def _fields(block: bytes) -> dict[bytes, bytes]:
    """Split a header into its fields: length, name=value."""
    found: dict[bytes, bytes] = {}
    position = 0
    while position < len(block):
        if position + 4 > len(block):
            raise _BrokenRecord
        size = int.from_bytes(block[position : position + 4], "little")
        field = block[position + 4 : position + 4 + size]
        name, equals, value = field.partition(b"=")
        if len(field) != size or not equals:
            raise _BrokenRecord
        found[name] = value
        position += 4 + size
    return found


def _messages(chunk: bytes, connections: dict[int, Connection]) -> Iterator[tuple[Connection, int, bytes]]:
    """Yield the messages of a chunk up to the first broken one."""
    position, end = 0, len(chunk)
    try:
        while position + 8 <= end:
            head = int.from_bytes(chunk[position : position + 4], "little")
            body = position + 8 + head
            if body > end:
                return
            size = int.from_bytes(chunk[body - 4 : body], "little")
            if body + size > end:
                return
            yield from _one(_fields(chunk[position + 4 : body - 4]), chunk[body : body + size], connections)
            position = body + size
    except _BrokenRecord:
        return


def _one(
    header: dict[bytes, bytes], data: bytes, connections: dict[int, Connection]
) -> Iterator[tuple[Connection, int, bytes]]:
    """Yield the message of a record, or remember the connection it describes."""
    op = header.get(b"op")
    if op == bytes([_MESSAGE]):
        connection = connections.get(_number(header, b"conn"))
        stamp = header.get(b"time", b"")
        if connection is not None and len(stamp) == 8:
            seconds, nanoseconds = struct.unpack("<II", stamp)
            yield connection, seconds * 10**9 + nanoseconds, data
    elif op == bytes([_CONNECTION]):
        facts = _fields(data)
        words = [facts.get(key, b"").decode("utf-8", "replace") for key in (b"type", b"message_definition", b"md5sum")]
        connections[_number(header, b"conn")] = Connection(header.get(b"topic", b"").decode("utf-8", "replace"), *words)


def _number(header: dict[bytes, bytes], key: bytes) -> int:
    value = header.get(key, b"")
    if len(value) != 4:
        raise _BrokenRecord
    return int.from_bytes(value, "little")


def _decompress(chunk: bytes, header: dict[bytes, bytes], whole: bool) -> bytes:
    """Return the content of a chunk.

    Why: a chunk that is cut gives what its complete blocks hold; one that is whole but does not decompress is given up,
    because what comes out before the error may already be wrong.
    """
    kind = header.get(b"compression")
    if kind == b"none":
        return chunk
    machine: Any
    if kind == b"bz2":
        machine = bz2.BZ2Decompressor()
    elif kind == b"lz4":
        from lz4.frame import LZ4FrameDecompressor

        machine = LZ4FrameDecompressor()
    else:
        return b""
    out = bytearray()
    try:
        for start in range(0, len(chunk), _PIECE):
            out += machine.decompress(chunk[start : start + _PIECE])
    except (OSError, RuntimeError, EOFError, ValueError):
        return b"" if whole else bytes(out)
    return bytes(out)
