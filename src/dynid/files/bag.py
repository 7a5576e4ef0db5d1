"""ROS 1 bags by one linear walk over their chunks: also those without an index, or cut anywhere.

A recorder that was killed leaves a bag without index and with its last chunk open. Everything before the first broken
record is still there. Source: bag format 2.0, wiki.ros.org/Bags/Format/2.0.

Why not the reader of rosbags: it reads no bag without an index and takes ten times as long for an hour at 1 kHz.
"""

from __future__ import annotations

import bz2
import struct
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np

from dynid.errors import BagTruncated, LogNotFound
from dynid.files.messages import (
    NANOSECONDS,
    Broken,
    Messages,
    Topic,
    nothing_readable,
    taken,
    topics_of,
)
from dynid.npz import bounded
from dynid.text import shell

#: First line of a bag of version 2.0.
MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CHUNK_INFO, _CONNECTION = (bytes([code]) for code in (2, 5, 6, 7))
#: What stands before a time in a header, and the bytes of both.
_TIME, _TIMED = b"\r\0\0\0time=", 17
_SIZE = struct.Struct("<I").unpack_from
#: Fields of a header by name; b"" for those that are not there.
Fields = defaultdict[bytes, bytes]


def list_topics(path: Path) -> dict[str, Topic]:
    """Return the topics of a bag by name; those of a damaged one as far as it can be read.

    Raises:
        BagTruncated: nothing is readable.
        LogNotFound: not a bag.
    """
    known: dict[bytes, Topic] = {}
    counts = Counter[Topic]()
    try:
        with path.open("rb") as stream:
            stream.seek(_index(stream, path))
            for op, fields, data in _records(stream):
                if op == _CONNECTION:
                    counts[_remembered(fields, data, known)] += 0
                elif op == _CHUNK_INFO:
                    for number, count in struct.iter_unpack("<4sI", data[: len(data) // 8 * 8]):
                        counts[known[number]] += count
    except (Broken, KeyError):
        counts.clear()
        with suppress(Broken):
            for some in scan(path):
                counts[some.topic] += len(some.starts)
        if not counts:
            raise nothing_readable(path, "it has no index, or a damaged one") from None
    return topics_of(counts)


def scan(path: Path, topics: Collection[str] | None = None) -> Iterator[Messages]:
    """Yield the readable messages of some topics, all when None, chunk by chunk.

    Raises:
        Broken: after the last readable message, where there were others, or where there is no index.
        TooLarge: a chunk unpacks like a bomb.
    """
    known: dict[bytes, Topic] = {}
    damage: list[Broken] = []
    with path.open("rb") as stream:
        stream.seek(len(MAGIC))
        for op, fields, data in _records(stream):
            if op != _CHUNK:
                continue
            try:
                # Why the rest: a chunk is given its size when it is closed; an open one reaches to the end of the file.
                for some in _messages(_unpacked(fields, data or stream.read(), path), known):
                    if topics is None or some.topic.name in topics:
                        yield some
            except Broken as error:
                damage.append(error)
        stream.seek(0)
        _index(stream, path)
    if damage:
        raise damage[0]


def _messages(chunk: bytes, known: dict[bytes, Topic]) -> Iterator[Messages]:
    """Yield the messages of a chunk, whose topics become known.

    Raises:
        Broken: behind them, where another record is damaged.
    """
    at, found = 0, defaultdict[bytes, list[int]](list)
    with suppress(struct.error):
        while at < len(chunk):
            body = at + 8 + _SIZE(chunk, at)[0]
            end = body + _SIZE(chunk, body - 4)[0]
            if end > len(chunk):
                break
            head = chunk[at + 4 : body - 4]
            time = head.find(_TIME)
            # Why: headers of the messages of a topic differ in the time alone.
            found[head[:time] + head[time + _TIMED :]] += at, body, end
            at = end
    content = np.frombuffer(chunk, np.uint8)
    for places in found.values():
        starts, bodies, ends = np.reshape(places, (-1, 3)).T
        head = chunk[starts[0] + 4 : bodies[0] - 4]
        fields = _fields(head)
        number = fields[b"conn"]
        if fields[b"op"] == _CONNECTION:
            _remembered(fields, chunk[bodies[0] : ends[0]], known)
        elif fields[b"op"] == _MESSAGE and number in known:
            times = starts + 4 + head.find(_TIME) + len(_TIME)
            arrival = taken(content, times, 2, "<u4") @ NANOSECONDS
            yield Messages(known[number], arrival, content, bodies, ends)
    if at < len(chunk):
        raise Broken("it ends in the middle of a record")


def _index(stream: IO[bytes], path: Path) -> int:
    """Return where the index of a bag begins.

    Raises:
        BagTruncated: the bag is empty.
        LogNotFound: it is no bag that can be read.
        Broken: there is no index.
    """
    start = stream.read(len(MAGIC))
    if not start:
        raise BagTruncated(
            f"{path.name} is empty: nothing was recorded", where=path, fix="record again"
        )
    if not start.startswith(b"#ROSBAG V"):
        fix = f"see what it is: {shell('file', path)}; a bag begins with #ROSBAG V2.0"
        raise LogNotFound(f"{path.name} is not a ROS 1 bag", where=path, fix=fix)
    if start != MAGIC:
        version = start.decode("latin-1").strip()
        raise LogNotFound(
            f"{path.name} has the format {version}; dynid reads V2.0",
            where=path,
            fix="convert it with: rosbag fix",
        )
    _, opening, _ = next(_records(stream), (b"", Fields(bytes), b""))
    place = int.from_bytes(opening[b"index_pos"][:8], "little")
    if not place:
        raise Broken("it was never closed: there is no index")
    if place >= path.stat().st_size:
        raise Broken("it ends before its index")
    return place


def _records(stream: IO[bytes]) -> Iterator[tuple[bytes, Fields, bytes]]:
    """Yield kind, header and data of each record of a file, of one that is cut the data before the cut.

    Raises:
        Broken: behind the last readable one.
    """
    while head := stream.read(4):
        fields = _fields(stream.read(int.from_bytes(head, "little")))
        size = int.from_bytes(stream.read(4), "little")
        data = stream.read(size)
        yield fields[b"op"], fields, data
        if len(data) < size:
            raise Broken("it ends in the middle of a record")


def _fields(header: bytes) -> Fields:
    """Split a header into its fields: length, name=value."""
    found = Fields(bytes)
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


def _remembered(fields: Fields, data: bytes, known: dict[bytes, Topic]) -> Topic:
    """Return the topic of a connection; messages name it by its number."""
    facts = _fields(data) | fields
    name, kind, md5 = (
        facts.get(key, b"").decode("utf-8", "replace") for key in (b"topic", b"type", b"md5sum")
    )
    name = "/" * name.startswith("/") + "/".join(filter(None, name.split("/")))
    topic = known[fields[b"conn"]] = Topic(name, kind, md5=md5)
    return topic


def _unpacked(fields: Fields, data: bytes, path: Path) -> bytes:
    """Return the records in a chunk, of one that is cut those before the cut.

    Raises:
        Broken: it cannot be unpacked.
    """
    if fields[b"compression"] == b"none":
        return data
    size = int.from_bytes(fields[b"size"], "little")
    bounded(len(data), size, path)
    machine: Any
    if fields[b"compression"] == b"bz2":
        machine = bz2.BZ2Decompressor()
    elif fields[b"compression"] == b"lz4":
        from lz4.frame import LZ4FrameDecompressor

        machine = LZ4FrameDecompressor()
    else:
        raise Broken("a chunk has an unknown compression")
    try:
        # Why not the same for an open chunk: its size is not known.
        return bytes(machine.decompress(data, size or len(data) * 100))
    except (OSError, RuntimeError, EOFError, ValueError):
        raise Broken("a chunk cannot be decompressed") from None
