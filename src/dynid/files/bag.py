"""ROS 1 bags by one linear walk over their records: also those without an index, or cut anywhere.

A recorder that was killed leaves a bag without index and with its last chunk open. Everything before the first broken
record is still there. Source: bag format 2.0, wiki.ros.org/Bags/Format/2.0.

Why not the reader of rosbags: it reads no bag without an index and takes five times as long for an hour at 1 kHz.
"""

from __future__ import annotations

import bz2
import io
import struct
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from dynid.errors import BagTruncated, LogNotFound
from dynid.files.messages import (
    Broken,
    Connection,
    Message,
    Topic,
    nothing_readable,
    topics_of,
)
from dynid.npz import bounded
from dynid.text import shell

#: First line of a bag of version 2.0.
MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG, _CHUNK, _CHUNK_INFO, _CONNECTION = (bytes([code]) for code in (2, 3, 5, 6, 7))
#: A record header holds a few short fields; a larger number is debris [byte].
_LARGEST_HEADER = 1 << 20
_TIME, _STAMP = b"\r\0\0\0time=", struct.Struct("<II")
Fields = dict[bytes, bytes]


def list_topics(path: Path) -> dict[str, Topic]:
    """Return the topics of a bag by name; those of a damaged one as far as it can be read.

    Raises:
        BagTruncated: nothing is readable.
        LogNotFound: not a bag.
    """
    known: dict[int, Connection] = {}
    counts: list[tuple[int, int]] = []
    try:
        with path.open("rb") as stream:
            stream.seek(_index(stream, path))
            for fields, data in _records(stream):
                if fields.get(b"op") == _CONNECTION:
                    _remember(fields, data, known)
                elif fields.get(b"op") == _CHUNK_INFO:
                    counts += struct.iter_unpack("<II", data[: len(data) // 8 * 8])
        return topics_of(
            [(known[number], count) for number, count in [*((each, 0) for each in known), *counts]]
        )
    except (Broken, KeyError) as error:
        reason = str(error)
    found: list[tuple[Connection, int]] = []
    with suppress(Broken):
        found += ((connection, 1) for connection, _, _ in scan(path))
    if not found:
        raise nothing_readable(path, reason)
    return topics_of(found)


def parts_of(path: Path) -> list[Path]:
    """Return the files of a recording: one."""
    return [path]


def scan(path: Path, topics: Collection[str] | None = None) -> Iterator[Message]:
    """Yield the readable messages of some topics, all when None, in the order of the file.

    Raises:
        Broken: after the last readable message, where there were others: a record or a chunk is damaged.
        TooLarge: a chunk unpacks like a bomb.
    """
    known: dict[int, Connection] = {}
    damage: list[str] = []
    with path.open("rb") as stream:
        try:
            _index(stream, path)
        except Broken as error:
            damage.append(str(error))
        stream.seek(len(MAGIC))
        try:
            for fields, data in _records(stream):
                if fields.get(b"op") == _CHUNK:
                    inner = _records(io.BytesIO(_unpacked(fields, data, stream, path, damage)))
                else:
                    inner = iter([(fields, data)])
                try:
                    for each, content in inner:
                        if (message := _message(each, content, known)) and (
                            topics is None or message[0].topic in topics
                        ):
                            yield message
                except Broken as error:
                    damage.append(str(error))
        except Broken as error:
            damage.append(str(error))
    if damage:
        raise Broken(damage[0])


def _index(stream: IO[bytes], path: Path) -> int:
    """Return where the index of a bag begins."""
    start = stream.read(len(MAGIC))
    if not start:
        raise BagTruncated(
            f"{path.name} is empty: nothing was recorded", where=str(path), fix="record again"
        )
    if not start.startswith(b"#ROSBAG V"):
        fix = f"see what it is: {shell('file', path)}; a bag begins with #ROSBAG V2.0"
        raise LogNotFound(f"{path.name} is not a ROS 1 bag", where=str(path), fix=fix)
    if start != MAGIC:
        version = start.decode("latin-1").strip()
        text = f"{path.name} has the format {version}; dynid reads V2.0"
        raise LogNotFound(text, where=str(path), fix="convert it with: rosbag fix")
    opening = next(_records(stream), ({}, b""))[0]
    place = int.from_bytes(opening.get(b"index_pos", b"")[:8], "little")
    if not place:
        raise Broken("it was never closed: there is no index")
    if place >= path.stat().st_size:
        raise Broken("it ends before its index")
    return place


def _records(stream: IO[bytes]) -> Iterator[tuple[Fields, bytes]]:
    """Yield header and data of each record; of a chunk that is cut the data that is there.

    Raises:
        Broken: a record is damaged or cut.
    """
    # Why: headers of messages differ in the time alone.
    known: dict[bytes, Fields] = {}
    while head := stream.read(4):
        length = int.from_bytes(head, "little")
        if length > _LARGEST_HEADER:
            raise Broken("a record header is damaged")
        header = stream.read(length)
        time = header.find(_TIME) + len(_TIME)
        key = header[:time] + header[time + 8 :]
        if key not in known:
            known[key] = _fields(header)
        fields = known[key]
        if time >= len(_TIME):
            fields = {**fields, b"time": header[time : time + 8]}
        size = int.from_bytes(stream.read(4), "little")
        data = stream.read(size)
        if len(data) < size and fields.get(b"op") != _CHUNK:
            raise Broken("it ends in the middle of a record")
        yield fields, data
        if len(data) < size:
            raise Broken("its last chunk is cut")


def _fields(header: bytes) -> Fields:
    """Split a header into its fields: length, name=value."""
    found: Fields = {}
    at = 0
    while at < len(header):
        size = int.from_bytes(header[at : at + 4], "little")
        content = header[at + 4 : at + 4 + size]
        name, equals, value = content.partition(b"=")
        if len(content) != size or not equals:
            raise Broken("a record header is damaged")
        found[name] = value
        at += 4 + size
    return found


def _message(fields: Fields, data: bytes, known: dict[int, Connection]) -> Message | None:
    """Return the message of a record, or remember the connection that it describes."""
    op = fields.get(b"op")
    if op == _CONNECTION:
        _remember(fields, data, known)
    if op != _MESSAGE or len(fields.get(b"time", b"")) != 8:
        return None
    connection = known.get(int.from_bytes(fields.get(b"conn", b""), "little"))
    seconds, nanoseconds = _STAMP.unpack(fields[b"time"])
    return (connection, seconds * 10**9 + nanoseconds, data) if connection else None


def _remember(fields: Fields, data: bytes, known: dict[int, Connection]) -> None:
    facts = _fields(data)
    topic, kind, md5 = (
        words.get(key, b"").decode("utf-8", "replace")
        for words, key in ((fields, b"topic"), (facts, b"type"), (facts, b"md5sum"))
    )
    topic = "/" * topic.startswith("/") + "/".join(filter(None, topic.split("/")))
    known[int.from_bytes(fields.get(b"conn", b""), "little")] = Connection(topic, kind, False, md5)


def _unpacked(
    fields: Fields, data: bytes, stream: IO[bytes], path: Path, damage: list[str]
) -> bytes:
    """Return the records in a chunk, of one that is cut those before the cut; note what is wrong with it.

    Why: a chunk is given its size when it is closed; an open one reaches to the end of the file, and the messages of
    an uncompressed one simply follow.
    """
    compression = fields.get(b"compression", b"")
    if compression == b"none":
        return data
    size = int.from_bytes(fields.get(b"size", b""), "little")
    if not data:
        data = stream.read()
    bounded(len(data), size, path)
    machine: Any
    if compression == b"bz2":
        machine = bz2.BZ2Decompressor()
    elif compression == b"lz4":
        from lz4.frame import LZ4FrameDecompressor

        machine = LZ4FrameDecompressor()
    else:
        damage.append("a chunk has an unknown compression")
        return b""
    try:
        # Why not the same for an open chunk: its size is not known.
        return bytes(machine.decompress(data, size or len(data) * 100))
    except (OSError, RuntimeError, EOFError, ValueError):
        damage.append("a chunk cannot be decompressed")
        return b""
