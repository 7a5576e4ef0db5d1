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
from dynid.files.messages import Broken, Message, Topic, nothing_readable, topics_of
from dynid.npz import bounded
from dynid.text import shell

#: First line of a bag of version 2.0.
MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG, _CHUNK, _CHUNK_INFO, _CONNECTION = (bytes([code]) for code in (2, 3, 5, 6, 7))
#: A record header holds a few short fields; a larger number is debris [byte].
_LARGEST_HEADER = 1 << 20
_TIME = b"\r\0\0\0time="
Fields = dict[bytes, bytes]


def list_topics(path: Path) -> dict[str, Topic]:
    """Return the topics of a bag by name; those of a damaged one as far as it can be read.

    Raises:
        BagTruncated: nothing is readable.
        LogNotFound: not a bag.
    """
    known: dict[bytes, Topic] = {}
    counts: list[tuple[Topic, int]] = []
    damage: list[str] = []
    with path.open("rb") as stream:
        stream.seek(_index(stream, path, damage))
        try:
            for fields, data in _records(stream, damage):
                if fields.get(b"op") == _CONNECTION:
                    counts.append((_remembered(fields, known), 0))
                elif fields.get(b"op") == _CHUNK_INFO:
                    pairs = struct.iter_unpack("<4sI", data[: len(data) // 8 * 8])
                    counts += [(known[number], count) for number, count in pairs]
        except KeyError:
            damage.append("its index is damaged")
    if damage:
        counts = []
        with suppress(Broken):
            counts += ((topic, 1) for topic, _, _ in scan(path))
        if not counts:
            raise nothing_readable(path, damage[0])
    return topics_of(counts)


def scan(path: Path, topics: Collection[str] | None = None) -> Iterator[Message]:
    """Yield the readable messages of some topics, all when None, in the order of the file.

    Raises:
        Broken: after the last readable message, where there were others: a record or a chunk is damaged.
        TooLarge: a chunk unpacks like a bomb.
    """
    known: dict[bytes, Topic] = {}
    damage: list[str] = []
    with path.open("rb") as stream:
        _index(stream, path, damage)
        stream.seek(len(MAGIC))
        for fields, data in _records(stream, damage, chunks_of=path):
            if fields.get(b"op") == _CONNECTION:
                _remembered(fields, known)
            elif fields.get(b"op") == _MESSAGE and len(time := fields.get(b"time", b"")) == 8:
                topic = known.get(fields.get(b"conn", b""))
                if topic is None or (topics is not None and topic.name not in topics):
                    continue
                seconds, nanoseconds = struct.unpack("<II", time)
                yield topic, seconds * 10**9 + nanoseconds, data
    if damage:
        raise Broken(damage[0])


def _index(stream: IO[bytes], path: Path, damage: list[str]) -> int:
    """Return where the index of a bag begins; note that there is none."""
    start = stream.read(len(MAGIC))
    if not start:
        text = f"{path.name} is empty: nothing was recorded"
        raise BagTruncated(text, where=path, fix="record again")
    if not start.startswith(b"#ROSBAG V"):
        fix = f"see what it is: {shell('file', path)}; a bag begins with #ROSBAG V2.0"
        raise LogNotFound(f"{path.name} is not a ROS 1 bag", where=path, fix=fix)
    if start != MAGIC:
        version = start.decode("latin-1").strip()
        text = f"{path.name} has the format {version}; dynid reads V2.0"
        raise LogNotFound(text, where=path, fix="convert it with: rosbag fix")
    opening, _ = next(_records(stream, damage), ({}, b""))
    place = int.from_bytes(opening.get(b"index_pos", b"")[:8], "little")
    if not place:
        damage.append("it was never closed: there is no index")
    elif place >= path.stat().st_size:
        damage.append("it ends before its index")
    return place


def _records(
    stream: IO[bytes], damage: list[str], chunks_of: Path | None = None
) -> Iterator[tuple[Fields, bytes]]:
    """Yield header and data of each record, in the place of a chunk of a file those in it; note what is damaged.

    Of a connection the facts in its data are with those in its header.
    """
    # Why: headers of messages differ in the time alone.
    known: dict[bytes, Fields] = {}
    try:
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
            if fields.get(b"op") == _CHUNK and chunks_of:
                plain = fields.get(b"compression") == b"none"
                inside = (
                    data if plain else _unpacked(fields, data or stream.read(), chunks_of, damage)
                )
                yield from _records(io.BytesIO(inside), damage)
                if len(data) < size:
                    raise Broken("its last chunk is cut")
            elif len(data) < size:
                raise Broken("it ends in the middle of a record")
            elif fields.get(b"op") == _CONNECTION:
                yield {**_fields(data), **fields}, data
            else:
                yield fields, data
    except Broken as error:
        damage.append(str(error))


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


def _remembered(fields: Fields, known: dict[bytes, Topic]) -> Topic:
    """Return the topic of a connection; messages name it by its number."""
    name, kind, md5 = (
        fields.get(key, b"").decode("utf-8", "replace") for key in (b"topic", b"type", b"md5sum")
    )
    name = "/" * name.startswith("/") + "/".join(filter(None, name.split("/")))
    topic = known[fields.get(b"conn", b"")] = Topic(name, kind, md5=md5)
    return topic


def _unpacked(fields: Fields, data: bytes, path: Path, damage: list[str]) -> bytes:
    """Return the records in a compressed chunk, of one that is cut those before the cut; note what is wrong with it.

    Why: a chunk is given its size when it is closed; an open one reaches to the end of the file, and the messages of
    an uncompressed one simply follow.
    """
    size = int.from_bytes(fields.get(b"size", b""), "little")
    bounded(len(data), size, path)
    machine: Any
    if fields.get(b"compression") == b"bz2":
        machine = bz2.BZ2Decompressor()
    elif fields.get(b"compression") == b"lz4":
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
