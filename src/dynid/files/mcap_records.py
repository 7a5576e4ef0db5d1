"""An MCAP file -> its messages, by one linear walk over its records; a damaged one gives what is still readable.

Memory holds one chunk at a time, whatever the file says. The summary at the end, where there is one, tells topics and
counts, and which chunks may be passed over. Source: mcap.dev/spec, version 0.

Why not the readers of mcap and rosbags: both unpack chunks to whatever size they have (5 and 6 GB of a file of 19 MB)
and read nothing of a file that was cut (benchmarks/read_bag.md).
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from dynid import limits
from dynid.files.messages import Broken, Connection

MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _CHUNK_INDEX, _STATISTICS, _DATA_END = (
    2,
    3,
    4,
    5,
    6,
    8,
    11,
    15,
)
#: Bytes of the footer record and the magic behind it.
_TAIL = 9 + 20 + len(MAGIC)
#: Part of a chunk before its compressed records, without the name of the compression.
_CHUNK_HEAD = struct.Struct("<QQQI")

_PAIR = struct.Struct("<HQ")

#: Latest time [ns] that is counted, in the year 2262: the format has room for twice as much.
LATEST = 2**63 - 1


@dataclass
class Summary:
    """What the end of a closed file says.

    Attributes:
        channels: by their number.
        counts: messages of each channel.
        chunks: for each chunk, by its place in the file, the channels that it holds.
    """

    schemas: dict[int, tuple[str, str, str]] = field(default_factory=dict)
    channels: dict[int, Connection] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)
    chunks: dict[int, frozenset[int]] = field(default_factory=dict)

    def take(self, op: int, data: bytes, path: Path) -> None:
        """Remember a schema or a channel.

        Raises:
            Broken: the record is not whole.
            TooLarge: there are more of them than the limit.
        """
        reader = _Fields(data)
        if op == _SCHEMA:
            number, name, encoding = reader.short(), reader.text(), reader.text()
            self.schemas[number] = (name, encoding, reader.text())
        else:
            number, schema, topic, encoding = (
                reader.short(),
                reader.short(),
                reader.text(),
                reader.text(),
            )
            name, kind, definition = self.schemas.get(schema, ("", "", ""))
            text = definition if kind in ("ros2msg", "ros1msg") else ""
            self.channels[number] = Connection(
                topic, name.replace("/msg/", "/"), text, encoding=encoding
            )
        limits.check("connections", max(len(self.schemas), len(self.channels)), path)


class _Fields:
    """The fields of one record, one after the other."""

    def __init__(self, data: bytes, at: int = 0) -> None:
        self.data, self.at = data, at

    def _take(self, form: str) -> int:
        try:
            (value,) = struct.unpack_from(form, self.data, self.at)
        except struct.error:
            raise Broken("a record is shorter than its fields") from None
        self.at += struct.calcsize(form)
        return int(value)

    def short(self) -> int:
        return self._take("<H")

    def word(self) -> int:
        return self._take("<I")

    def long(self) -> int:
        return self._take("<Q")

    def text(self) -> str:
        return self._counted().decode("utf-8", "replace")

    def pairs(self) -> list[tuple[int, int]]:
        """Return a map of channels to numbers."""
        content = self._counted()
        if len(content) % _PAIR.size:
            raise Broken("a map holds half a pair")
        return list(_PAIR.iter_unpack(content))

    def _counted(self) -> bytes:
        size = self.word()
        if self.at + size > len(self.data):
            raise Broken("a record is shorter than its fields")
        self.at += size
        return self.data[self.at - size : self.at]


def read_summary(path: Path) -> Summary:
    """Return what the end of a file says about it.

    Raises:
        Broken: there is no summary, or it is damaged.
    """
    with limits.open_file(path) as stream:
        end = stream.seek(0, os.SEEK_END)
        if end < len(MAGIC) + _TAIL:
            raise Broken("it was never closed: there is no summary")
        stream.seek(end - _TAIL)
        tail = stream.read(_TAIL)
        if tail[0] != _FOOTER or not tail.endswith(MAGIC):
            raise Broken("it was never closed: there is no summary")
        (start,) = struct.unpack_from("<Q", tail, 9)
        if not len(MAGIC) <= start < end:
            raise Broken("it has no summary")
        found = Summary()
        for op, data, _ in _records(stream, start, end - _TAIL, path, whole=True):
            if op in (_SCHEMA, _CHANNEL):
                found.take(op, data, path)
            elif op == _STATISTICS:
                _take_counts(found, data)
            elif op == _CHUNK_INDEX:
                _take_chunk(found, data)
        if not found.channels or not found.counts:
            raise Broken("its summary names no channels")
        return found


def _take_counts(found: Summary, data: bytes) -> None:
    # Unit: three counts and the times take 42 bytes before the map of counts.
    found.counts.update(_Fields(data, 42).pairs())


def _take_chunk(found: Summary, data: bytes) -> None:
    place, pairs = _Fields(data, 16).long(), _Fields(data, 32).pairs()
    if pairs:
        found.chunks[place] = frozenset(channel for channel, _ in pairs)


def scan(
    path: Path, topics: Collection[str] | None = None
) -> Iterator[tuple[Connection, int, bytes]]:
    """Yield channel, time of arrival [ns] and bytes of the messages, in the order of the file.

    Args:
        path: the file.
        topics: only these, None for all.

    Raises:
        Broken: what comes behind the last message that was yielded cannot be read.
        TooLarge: a chunk or a message is beyond the limit.
    """
    known, skip = Summary(), frozenset[int]()
    if topics is not None:
        with suppress(Broken):
            summary = read_summary(path)
            wanted = {
                number for number, channel in summary.channels.items() if channel.topic in topics
            }
            skip = frozenset(place for place, has in summary.chunks.items() if not has & wanted)
            # Why: channels may be told only in the chunks that are passed over.
            known.schemas, known.channels = summary.schemas, summary.channels
    with limits.open_file(path) as stream:
        end = stream.seek(0, os.SEEK_END)
        stream.seek(0)
        if stream.read(len(MAGIC)) != MAGIC:
            raise Broken("it does not begin like an MCAP file")
        unpacked = 0
        for op, data, at in _records(stream, len(MAGIC), end, path, skip=skip):
            if op == _DATA_END:
                return
            if op == _CHUNK and len(data) >= _CHUNK_HEAD.size:
                # Why: many small chunks that each expand as they like would take as long as one large one.
                unpacked += _CHUNK_HEAD.unpack_from(data)[2]
                limits.check_expansion(at + len(data), unpacked, path, whole=True)
            for inner, content in _unpacked(data, path) if op == _CHUNK else [(op, data)]:
                if inner in (_SCHEMA, _CHANNEL):
                    known.take(inner, content, path)
                elif inner == _MESSAGE:
                    channel, arrival = _head(content, known)
                    if topics is None or channel.topic in topics:
                        yield channel, arrival, content[22:]
        raise Broken("it was never closed")


def _head(content: bytes, known: Summary) -> tuple[Connection, int]:
    """Return the channel of a message and its time of arrival [ns]."""
    if len(content) < 22:
        raise Broken("a message is shorter than its head")
    number, _, arrival = struct.unpack_from("<HIQ", content)
    if number not in known.channels:
        raise Broken("a message belongs to no channel")
    if arrival > LATEST:
        raise Broken("the time stamp of a message is out of range")
    return known.channels[number], arrival


def _records(
    stream: IO[bytes],
    start: int,
    end: int,
    path: Path,
    *,
    skip: Collection[int] = (),
    whole: bool = False,
) -> Iterator[tuple[int, bytes, int]]:
    """Yield kind, content and place of the records that matter; the others are passed over unread."""
    at = start
    wanted = {_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END} | (
        {_STATISTICS, _CHUNK_INDEX} if whole else set()
    )
    while at < end:
        stream.seek(at)
        head = stream.read(9)
        if len(head) < 9:
            raise Broken("it ends inside a record")
        op, size = head[0], struct.unpack("<Q", head[1:])[0]
        if size > end - at - 9:
            raise Broken("it ends inside a record")
        if op == 0:
            raise Broken("a record has no kind")
        if op in wanted and at not in skip:
            limits.check("message_bytes" if op == _MESSAGE else "chunk_bytes", size, path)
            yield op, stream.read(size), at
        at += 9 + size


def _unpacked(data: bytes, path: Path) -> Iterator[tuple[int, bytes]]:
    """Yield the records in a chunk."""
    if len(data) < _CHUNK_HEAD.size + 4:
        raise Broken("a chunk is shorter than its head")
    _, _, size, checksum = _CHUNK_HEAD.unpack_from(data)
    fields = _Fields(data)
    fields.at = _CHUNK_HEAD.size
    compression, packed = fields.text(), fields.long()
    body = data[fields.at : fields.at + packed]
    limits.check("chunk_bytes", size, path)
    limits.check_expansion(len(body), size, path)
    records = unpack(body, compression, size)
    if len(records) != size or (checksum and zlib.crc32(records) != checksum):
        raise Broken("a chunk does not have its checksum")
    at = 0
    while at + 9 <= size:
        op, length = records[at], struct.unpack_from("<Q", records, at + 1)[0]
        if length > size - at - 9:
            raise Broken("a record is longer than its chunk")
        if op == _MESSAGE:
            limits.check("message_bytes", length, path)
        yield op, records[at + 9 : at + 9 + length]
        at += 9 + length


def unpack(body: bytes, compression: str, size: int) -> bytes:
    """Return unpacked data of at most a known size.

    Raises:
        Broken: the data is damaged, or packed in a way that is not known.
    """
    if compression == "":
        return body
    try:
        if compression == "zstd":
            return _unpack_zstd(body, size)
        if compression == "lz4":
            import lz4.frame

            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(body, max_length=size))
    except (RuntimeError, ValueError, EOFError) as error:
        raise Broken(f"a chunk cannot be unpacked: {error}") from None
    raise Broken(f"its chunks are packed with {compression[:20]!r}, which is not known")


def _unpack_zstd(body: bytes, size: int) -> bytes:
    import zstandard

    try:
        with zstandard.ZstdDecompressor().stream_reader(body) as reader:
            return bytes(reader.read(size))
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from None
