"""ROS 1 bags: their topics and messages, by one linear walk over the records; a damaged bag gives what is readable.

A recorder that was killed leaves a bag without index and with its last chunk open; a full disk leaves one cut
anywhere. Everything before the first broken record is still there. Records are read chunk by chunk, so memory holds one
chunk at a time, whatever the file says; the index only tells which chunks may be passed over. Source: bag format 2.0,
wiki.ros.org/Bags/Format/2.0.

Why not the reader of rosbags: it takes seven times as long, holds an entry for each message, and reads no bag without
an index (benchmarks/read_bag.md).
"""

from __future__ import annotations

import bz2
import os
import struct
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from dynid import limits
from dynid.errors import BagTruncated, Finding, LogNotFound
from dynid.files.messages import (
    FEW,
    Broken,
    Connection,
    Messages,
    Topic,
    collected,
    counted,
    nothing_readable,
    topics_of,
)
from dynid.log import Log
from dynid.text import shell

#: First bytes of a ROS bag of any version, and the line that opens one of version 2.0.
START, MAGIC = b"#ROSBAG", b"#ROSBAG V2.0\n"
_MESSAGE, _BAG, _CHUNK, _CHUNK_INFO, _CONNECTION = (bytes([code]) for code in (2, 3, 5, 6, 7))
#: A record header holds a few short fields; a larger number is debris.
_LARGEST_HEADER = 1 << 20
_PIECE = 1 << 16
#: The field of a message's header that differs from message to message: length, name, eight bytes.
_TIME = b"\r\0\0\0time="


def list_topics(path: Path) -> dict[str, Topic]:
    """Return the topics of a bag by name; those of a damaged one as far as it can be read.

    Raises:
        BagTruncated: nothing is readable.
        LogNotFound: not a bag.
    """
    _check_magic(path)
    try:
        connections, chunks = read_index(path)
    except Broken as error:
        if found := counted(scan(path)):
            return found
        raise nothing_readable(path, str(error)) from None
    none = [(connection, 0) for connection in connections.values()]
    some = [
        (n, count) for counts in chunks.values() for n, count in counts.items() if n in connections
    ]
    return topics_of([*none, *((connections[number], count) for number, count in some)])


def read_topics(
    path: Path, names: Collection[str]
) -> tuple[dict[str, list[Log]], tuple[Finding, ...]]:
    """Return for each of some topics its raw logs, one for each set of joint names, the largest first; and findings.

    Raises:
        BagTruncated: nothing of these topics is readable.
        WrongMessageType: the layout of the messages is not the known one of their type.
        TooLarge: a chunk, a message or a name is larger than the limit.
    """
    return collected(path, [path], lambda part: scan(part, names))


def _check_magic(path: Path) -> None:
    try:
        with limits.open_file(path) as stream:
            start = stream.read(len(MAGIC))
    except OSError as error:
        raise LogNotFound(f"cannot read {path}: {error.strerror}", where=str(path)) from error
    if not start:
        raise BagTruncated(
            f"{path.name} is empty: nothing was recorded", where=str(path), fix="record again"
        )
    if not start.startswith(b"#ROSBAG V"):
        fix = f"see what it is: {shell('file', path)}; a bag begins with #ROSBAG V2.0"
        raise LogNotFound(f"{path.name} is not a ROS 1 bag", where=str(path), fix=fix)
    if start != MAGIC:
        version = start.decode("latin-1").strip()
        raise LogNotFound(
            f"{path.name} has the format {version}; dynid reads V2.0",
            where=str(path),
            fix="convert it with: rosbag fix",
        )


# ---------------------------------------------------------------- the index
def read_index(path: Path) -> tuple[dict[int, Connection], dict[int, dict[int, int]]]:
    """Return what the index at the end of a closed bag says.

    Returns:
        the connections by their number; for each chunk, by its place in the file, how many messages of which
        connection it has.

    Raises:
        Broken: there is none, or it is damaged.
        TooLarge: it names more connections than the limit.
    """
    with limits.open_file(path) as stream:
        end = stream.seek(0, os.SEEK_END)
        stream.seek(len(MAGIC))
        opening, _ = _read_head(stream, end)
        if opening.get(b"op") != _BAG:
            raise Broken("it does not begin with a bag header")
        place = opening.get(b"index_pos", b"")
        start = int.from_bytes(place, "little") if len(place) == 8 else 0
        if start == 0:
            raise Broken("it was never closed: there is no index")
        if start > end:
            raise Broken("it ends before its index")
        stream.seek(start)
        connections: dict[int, Connection] = {}
        chunks: dict[int, dict[int, int]] = {}
        while stream.tell() < end:
            header, size = _read_head(stream, end)
            data = _read_exactly(stream, size, end)
            if header.get(b"op") == _CONNECTION:
                _remember(header, data, connections, path)
            elif header.get(b"op") == _CHUNK_INFO:
                chunk = int.from_bytes(header.get(b"chunk_pos", b""), "little")
                chunks[chunk] = dict(struct.iter_unpack("<II", data[: len(data) // 8 * 8]))
        counts = [_number(opening, key) for key in (b"conn_count", b"chunk_count")]
        if len(connections) < counts[0] or len(chunks) < counts[1]:
            raise Broken("its index is not whole")
        return connections, chunks


# ---------------------------------------------------------------- the walk
def scan(path: Path, topics: Collection[str] | None = None) -> Iterator[Messages]:
    """Yield every readable message, chunk by chunk in the order of the file; those that are alike come together.

    Args:
        path: the bag.
        topics: names of the topics that are wanted; all when None.

    Raises:
        Broken: after the last readable message, where there were others: a record or a chunk is damaged.
        TooLarge: a chunk unpacks to more than the limit.
    """
    connections: dict[int, Connection] = {}
    chunks: dict[int, dict[int, int]] = {}
    damage: list[str] = []
    try:
        connections, chunks = read_index(path)
    except Broken as error:
        damage.append(str(error))
    # Why: a chunk without any wanted message is not unpacked.
    wanted = {
        number for number, one in connections.items() if topics is None or one.topic in topics
    }
    unwanted = {
        place
        for place, numbers in chunks.items()
        if topics is not None and not wanted & set(numbers)
    }
    unpacked = 0
    with limits.open_file(path) as stream:
        end = stream.seek(0, os.SEEK_END)
        stream.seek(len(MAGIC))
        try:
            while stream.tell() < end:
                place = stream.tell()
                header, size = _read_head(stream, end)
                if header.get(b"op") != _CHUNK:
                    messages = _one(header, _read_exactly(stream, size, end), connections, path)
                elif place in unwanted:
                    stream.seek(size, os.SEEK_CUR)
                    continue
                else:
                    content = _content(stream, header, size, end, path, damage)
                    unpacked += len(content) if header.get(b"compression") != b"none" else 0
                    limits.check_expansion(stream.tell(), unpacked, path, whole=True)
                    messages = _messages(content, connections, path, damage)
                for item in messages:
                    if topics is None or item[0].topic in topics:
                        yield item
        except Broken as error:
            damage.append(str(error))
    if damage:
        raise Broken(damage[0])


def _content(
    stream: IO[bytes],
    header: dict[bytes, bytes],
    size: int,
    end: int,
    path: Path,
    damage: list[str],
) -> bytes:
    """Return what a chunk holds, and note what is wrong with it.

    Why: a chunk is given its size when it is closed; an open one reaches to the end of the file, and the messages of an
    uncompressed one simply follow.
    """
    compression = header.get(b"compression", b"")
    if size == 0:
        damage.append("its last chunk was not closed")
        if compression == b"none":
            return b""
    left = size or end - stream.tell()
    whole = size > 0 and left <= end - stream.tell()
    if compression == b"none":
        limits.check("chunk_bytes", min(left, end - stream.tell()), path)
    content = _unpacked(stream, min(left, end - stream.tell()), compression, whole, path, damage)
    if not whole:
        damage.append("its last chunk is cut")
    return content


def _read_exactly(stream: IO[bytes], size: int, end: int) -> bytes:
    if size > end - stream.tell():
        raise Broken("it ends in the middle of a record")
    return stream.read(size)


def _read_head(stream: IO[bytes], end: int) -> tuple[dict[bytes, bytes], int]:
    """Read a record's header and the size of its data."""
    length = struct.unpack("<I", _read_exactly(stream, 4, end))[0]
    if length > _LARGEST_HEADER:
        raise Broken("a record header is damaged")
    header = _fields(_read_exactly(stream, length, end))
    return header, struct.unpack("<I", _read_exactly(stream, 4, end))[0]


def _fields(block: bytes) -> dict[bytes, bytes]:
    """Split a header into its fields: length, name=value."""
    found: dict[bytes, bytes] = {}
    position = 0
    while position < len(block):
        size = int.from_bytes(block[position : position + 4], "little")
        content = block[position + 4 : position + 4 + size]
        name, equals, value = content.partition(b"=")
        if len(content) != size or not equals:
            raise Broken("a record header is damaged")
        found[name] = value
        position += 4 + size
    return found


def _messages(
    chunk: bytes, connections: dict[int, Connection], path: Path, damage: list[str]
) -> Iterator[Messages]:
    """Yield the messages of a chunk up to the first broken one, those together that are alike."""
    places: dict[tuple[int, int], list[int]] = {}
    position, end, last, row = 0, len(chunk), (0, 0), 0
    while position < end:
        head = 8 + int.from_bytes(chunk[position : position + 4], "little")
        body = position + head
        size = int.from_bytes(chunk[body - 4 : body], "little")
        if body > end or body + size > end:
            damage.append("a chunk ends in the middle of a message")
            break
        row = row + 1 if (head, size) == last else 0
        last, count = (head, size), 1
        if row == FEW:
            count, row = _alike(chunk, position, head, size), 0
        after = position + count * (head + size)
        places.setdefault(last, []).extend(range(position, after, head + size))
        position = after
    # Records of one header but for the time: bytes of header and data, and where they begin.
    groups = [
        (head, size, where)
        for (head, size), found in places.items()
        for where in _by_header(chunk, head, head + size, np.array(found))
    ]
    # The header of each, by where its first record begins.
    headers: dict[int, dict[bytes, bytes]] = {}
    try:
        for head, size, where in sorted(groups, key=lambda group: int(group[2][0])):
            end = int(where[0])
            headers[end] = _fields(chunk[end + 4 : end + head - 4])
            if headers[end].get(b"op") == _CONNECTION:
                for place in where.tolist():
                    _remember(headers[end], chunk[place + head :][:size], connections, path)
        end = len(chunk)
    except Broken as error:
        damage.append(str(error))
    for head, size, where in groups:
        yield from _of_group(
            chunk, headers.get(int(where[0]), {}), head, size, where[where < end], connections
        )


def _alike(chunk: bytes, position: int, head: int, size: int) -> int:
    """Return how many records that begin like the one at a position follow it, itself included."""
    record = head + size
    rows = np.frombuffer(
        chunk, np.uint8, (len(chunk) - position) // record * record, position
    ).reshape(-1, record)
    lengths = np.r_[0:4, head - 4 : head]
    equal = np.all(rows[:, lengths] == rows[0, lengths], axis=1)
    return len(equal) if equal.all() else int(np.argmin(equal))


def _by_header(
    chunk: bytes, head: int, step: int, where: NDArray[np.int64]
) -> Iterator[NDArray[np.int64]]:
    """Yield records with headers and data of one length each by what their headers say besides the time."""
    time = chunk.find(_TIME, where[0], where[0] + head) - where[0] + len(_TIME)
    headers = _rows(chunk, where, head, step).copy()
    if len(_TIME) <= time <= head - 8:
        headers[
            np.all(headers[:, time - len(_TIME) : time] == np.frombuffer(_TIME, np.uint8), axis=1),
            time : time + 8,
        ] = 0
    if np.all(headers == headers[0]):
        yield where
        return
    _, kind = np.unique(headers.view(f"V{head}").ravel(), return_inverse=True)
    order = np.argsort(kind, kind="stable")
    for part in np.split(order, np.flatnonzero(np.diff(kind[order])) + 1):
        yield where[part]


def _of_group(
    chunk: bytes,
    header: dict[bytes, bytes],
    head: int,
    size: int,
    where: NDArray[np.int64],
    connections: dict[int, Connection],
) -> Iterator[Messages]:
    """Yield the messages of records with one header but for the time."""
    if header.get(b"op") != _MESSAGE or not len(where) or len(header.get(b"time", b"")) != 8:
        return
    connection = connections.get(_number(header, b"conn"))
    if connection is None:
        return
    records = _rows(chunk, where, head + size, head + size)
    time = chunk.find(_TIME, where[0]) - where[0] + len(_TIME)
    words = np.ascontiguousarray(records[:, time : time + 8]).view("<u4").astype(np.int64)
    yield connection, words[:, 0] * 10**9 + words[:, 1], records[:, head:]


def _rows(chunk: bytes, where: NDArray[np.int64], length: int, step: int) -> NDArray[np.uint8]:
    """Return pieces of one length of a chunk, (N, length); those a step apart without a copy."""
    content = np.frombuffer(chunk, np.uint8)
    if where[-1] - where[0] == (len(where) - 1) * step:
        return content[where[0] : where[0] + len(where) * step].reshape(-1, step)[:, :length]
    return np.asarray(content[where[:, None] + np.arange(length)])


def _one(
    header: dict[bytes, bytes], data: bytes, connections: dict[int, Connection], path: Path
) -> Iterator[Messages]:
    """Yield the message of a record, or remember the connection it describes."""
    op = header.get(b"op")
    if op == _MESSAGE:
        connection = connections.get(_number(header, b"conn"))
        stamp = header.get(b"time", b"")
        if connection is not None and len(stamp) == 8:
            seconds, nanoseconds = struct.unpack("<II", stamp)
            arrival = np.array([seconds * 10**9 + nanoseconds], dtype=np.int64)
            yield connection, arrival, np.frombuffer(data, np.uint8)[None]
    elif op == _CONNECTION:
        _remember(header, data, connections, path)


def _remember(
    header: dict[bytes, bytes], data: bytes, found: dict[int, Connection], path: Path
) -> None:
    facts = _fields(data)
    words = [
        facts.get(key, b"").decode("utf-8", "replace")
        for key in (b"type", b"message_definition", b"md5sum")
    ]
    topic = header.get(b"topic", b"").decode("utf-8", "replace")
    parts = [part for part in topic.split("/") if part]
    found[_number(header, b"conn")] = Connection(
        f"{'/' if topic.startswith('/') else ''}{'/'.join(parts)}", *words
    )
    limits.check("connections", len(found), path)


def _number(header: dict[bytes, bytes], key: bytes) -> int:
    value = header.get(key, b"")
    if len(value) != 4:
        raise Broken("a record header is damaged")
    return int.from_bytes(value, "little")


def _unpacked(
    stream: IO[bytes], size: int, compression: bytes, whole: bool, path: Path, damage: list[str]
) -> bytes:
    """Return the content of a chunk, of which ``size`` bytes are in the file; unpacked piece by piece within the limit.

    Why: a chunk that is cut gives what its complete blocks hold; one that is whole but does not decompress is given up,
    because what comes out before the error may already be wrong.
    """
    if compression == b"none":
        return stream.read(size)
    after = stream.tell() + size
    unpack = _decompressor(compression)
    out = bytearray()
    try:
        if unpack is None:
            damage.append("a chunk has an unknown compression")
            return b""
        while stream.tell() < after:
            for part in unpack(stream.read(min(_PIECE, after - stream.tell()))):
                out += part
                limits.check("chunk_bytes", len(out), path)
    except (OSError, RuntimeError, EOFError, ValueError, MemoryError):
        damage.append("a chunk cannot be decompressed")
        out = bytearray() if whole else out
    finally:
        stream.seek(after)
    return bytes(out)


def _decompressor(compression: bytes) -> Callable[[bytes], Iterator[bytes]] | None:
    """Return a function from packed pieces to unpacked ones of limited size."""
    machine: Any
    if compression == b"bz2":
        machine = bz2.BZ2Decompressor()
    elif compression == b"lz4":
        from lz4.frame import LZ4FrameDecompressor

        machine = LZ4FrameDecompressor()
    else:
        return None

    def unpack(piece: bytes) -> Iterator[bytes]:
        if machine.eof:
            return
        yield machine.decompress(piece, _PIECE)
        while not machine.needs_input and not machine.eof:
            yield machine.decompress(b"", _PIECE)

    return unpack
