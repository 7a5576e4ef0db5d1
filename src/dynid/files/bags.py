"""Recordings of ROS -> raw logs: ROS 1 bags by one walk over their records, those of ROS 2 by rosbags.

A recorder that was killed leaves a bag without index and with its last chunk open. The walk needs no index and gives
everything before the first broken record. Source: bag format 2.0, wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import bz2
import io
import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from dynid.errors import BagTruncated, DynidError, Finding, LogNotFound
from dynid.files.messages import Broken, Collector, Topic
from dynid.log import Log
from dynid.npz import bounded
from dynid.text import shell

#: Suffixes of the files that recorders of ROS 2 write.
ROS2 = (".db3", ".mcap")
#: First line of a bag of version 2.0.
MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = (bytes([code]) for code in (2, 5, 7))
#: Fields of a header by name; b"" for those that are not there.
Fields = defaultdict[bytes, bytes]


def read_topics(
    path: Path, names: Collection[str]
) -> tuple[dict[str, list[Log]], tuple[Finding, ...]]:
    """Return the numbers of some topics, also of a recording that is damaged.

    Returns:
        for each topic its raw logs, one for each set of joint names, the largest first; and what was noticed.

    Raises:
        BagTruncated: nothing of these topics is readable.
        WrongMessageType: the layout of the messages is not the known one of their type.
        TooLarge: a chunk unpacks like a bomb.
    """
    collectors: dict[str, Collector] = {}
    reasons = []
    for part in parts_of(path):
        try:
            for topic, arrival, raw in _messages(part, names):
                if topic.name not in collectors:
                    collectors[topic.name] = Collector(topic)
                collectors[topic.name].add(arrival, raw)
        except Broken as error:
            reasons.append(f"{part.name}: {error}" if part != path else str(error))
    groups = {name: logs for name, one in collectors.items() if (logs := one.logs())}
    reasons += [one.reason for one in collectors.values() if one.reason]
    if not reasons:
        return groups, ()
    if not groups:
        raise _nothing_readable(path, reasons[0])
    logs = [log for group in groups.values() for log in group]
    count, reason = sum(map(len, logs)), "; ".join(reasons[:3])
    seconds = max(float(np.ptp(log.extra["arrival_ns"])) for log in logs) * 1e-9
    text = (
        f"{path.name} was cut or not closed (recorder killed?): {count} messages, {seconds:.1f} s, are readable "
        f"and used; reported by the reader: {reason.rstrip('.')}"
    )
    evidence = {"messages": count, "seconds": seconds, "reason": reason}
    return groups, (Finding("W305", "warning", text, evidence),)


def list_topics(path: Path) -> dict[str, Topic]:
    """Return the topics of a recording by name; those of a damaged ROS 1 bag as far as it can be read.

    Raises:
        BagTruncated: nothing is readable.
        LogNotFound: not a recording.
    """
    counts = Counter[Topic]()
    for part in parts_of(path):
        try:
            with _opened(part) as reader:
                for each in reader.connections:
                    counts[_topic(each, part)] += each.msgcount
        except Broken as error:
            with suppress(Broken):
                walked = () if part.suffix in ROS2 else _walked(part)
                counts.update(topic for topic, _, _ in walked)
            if not counts:
                raise _nothing_readable(part, str(error)) from None
    return {topic.name: replace(topic, count=count) for topic, count in counts.items()}


def parts_of(path: Path) -> list[Path]:
    """Return the files of a recording in the order of time.

    Raises:
        LogNotFound: a folder without any.
        BagTruncated: a file is empty, or a database was not closed.
    """
    parts = [path]
    if path.is_dir():
        parts = [part for part in path.iterdir() if part.suffix in ROS2 and part.is_file()]
    if not parts:
        fix = "check the path"
        for packed in path.glob("*.zstd"):
            fix = f"unpack it with: {shell('zstd', '-d', packed)}"
        raise LogNotFound(f"{path} has no .db3 or .mcap file", where=path, fix=fix)
    for part in parts:
        if not part.stat().st_size:
            text = f"{part.name} is empty: nothing was recorded"
            raise BagTruncated(text, where=part, fix="record again")
        journal = part.with_name(f"{part.name}-wal")
        if journal.is_file() and journal.stat().st_size:
            raise BagTruncated(
                f"{part.name} was not closed: messages wait in {journal.name}",
                where=part,
                fix=shell("sqlite3", part, "PRAGMA wal_checkpoint(TRUNCATE)"),
            )
    # Why: rosbag2 numbers the parts of a recording at the end of their names, 9 before 10.
    return sorted(parts, key=lambda p: ([int(k) for k in re.findall(r"\d+", p.stem)[-1:]], p.name))


def _nothing_readable(path: Path, reason: str) -> BagTruncated:
    """Return the mistake of a recording without one readable message."""
    if path.suffix in (".bag", ".active"):
        return BagTruncated(
            f"{path.name} ends early (recorder killed?); 0 s are readable", where=path
        )
    better = path.with_name(f"{path.stem}_recovered{path.suffix}")
    fixes = {
        ".mcap": shell("mcap", "recover", path, "-o", better),
        ".db3": f"{shell('sqlite3', path, '.recover')} | {shell('sqlite3', better)}",
    }
    text = f"{path.name} was cut or not closed: {reason.rstrip('.')}"
    fix = fixes.get(path.suffix, shell("ros2", "bag", "reindex", path))
    return BagTruncated(text, where=path, fix=fix)


def _messages(part: Path, names: Collection[str]) -> Iterator[tuple[Topic, int, bytes]]:
    """Yield topic, time of arrival [ns] and bytes of the readable messages of some topics; ``Broken`` behind them."""
    if part.suffix not in ROS2:
        yield from (each for each in _walked(part) if each[0].name in names)
        return
    with _opened(part) as reader:
        topics = {each.id: _topic(each, part) for each in reader.connections if each.topic in names}
        wanted = [each for each in reader.connections if each.id in topics]
        for each, arrival, raw in reader.messages(wanted) if wanted else ():
            yield topics[each.id], arrival, raw


# ---------------------------------------------------------------- with an index
@contextmanager
def _opened(part: Path) -> Iterator[Any]:
    """Open a file of a recording with rosbags; ``Broken`` where it is damaged or has no index."""
    from rosbags import rosbag1, rosbag2

    try:
        with (rosbag2 if part.suffix in ROS2 else rosbag1).Reader(part) as reader:
            if part.suffix == ".mcap":
                for chunk in reader.storage.chunks:
                    bounded(chunk.compressed_size, chunk.uncompressed_size, part)
            yield reader
    except (DynidError, PermissionError):
        raise
    # Why all: of damaged bytes rosbags, SQLite and the decompressors raise whatever they meet.
    except Exception as error:  # noqa: BLE001
        raise Broken(str(error) or type(error).__name__) from None


def _topic(each: Any, part: Path) -> Topic:  # noqa: ANN401
    return Topic(each.topic, each.msgtype.replace("/msg/", "/"), part.suffix in ROS2)


# ---------------------------------------------------------------- ROS 1, without its index
def _walked(path: Path) -> Iterator[tuple[Topic, int, bytes]]:
    """Yield topic, time of arrival [ns] and bytes of the messages of a bag, chunk by chunk.

    Raises:
        Broken: behind the last readable message, where one was not or there is no index.
        LogNotFound: it is no bag that can be read.
    """
    known: dict[bytes, Topic] = {}
    index, damage = 0, None
    with path.open("rb") as stream:
        _require_bag(path, stream.read(len(MAGIC)))
        for kind, chunk in _records(stream):
            index = index or int.from_bytes(kind[b"index_pos"], "little")
            if kind[b"op"] != _CHUNK:
                continue
            try:
                for fields, data in _records(io.BytesIO(_unpacked(kind, chunk, path))):
                    number, time = fields[b"conn"], fields[b"time"]
                    if fields[b"op"] == _CONNECTION:
                        known[number] = _connected(_fields(data) | fields)
                    elif fields[b"op"] == _MESSAGE and number in known:
                        seconds, rest = (int.from_bytes(x, "little") for x in (time[:4], time[4:]))
                        yield known[number], seconds * 10**9 + rest, data
            except Broken as error:
                damage = damage or error
        if not index or index >= path.stat().st_size:
            raise Broken("it was never closed, or ends before its index: there is no index")
    if damage:
        raise damage


def _require_bag(path: Path, start: bytes) -> None:
    """Raise where a file does not begin as a bag of version 2.0."""
    if not start.startswith(b"#ROSBAG V"):
        fix = f"see what it is: {shell('file', path)}; a bag begins with #ROSBAG V2.0"
        raise LogNotFound(f"{path.name} is not a ROS 1 bag", where=path, fix=fix)
    if start != MAGIC:
        text = f"{path.name} has the format {start.decode('latin-1').strip()}; dynid reads V2.0"
        raise LogNotFound(text, where=path, fix="convert it with: rosbag fix")


def _records(stream: IO[bytes]) -> Iterator[tuple[Fields, bytes]]:
    """Yield header and data of each record, which a bag and its chunks consist of; ``Broken`` behind a cut one."""
    while head := stream.read(4):
        fields = _fields(stream.read(int.from_bytes(head, "little")))
        size = int.from_bytes(stream.read(4), "little")
        # Why the rest: a chunk is given its size when it is closed; an open one reaches to the end of the file.
        is_chunk = fields[b"op"] == _CHUNK
        data = stream.read(size or -1 if is_chunk else size)
        if is_chunk or len(data) == size:
            yield fields, data
        if len(data) < size:
            raise Broken("it ends in the middle of a record")


def _fields(header: bytes) -> Fields:
    """Split a header into its fields: length, name=value."""
    fields, stream = Fields(bytes), io.BytesIO(header)
    while head := stream.read(4):
        size = int.from_bytes(head, "little")
        content = stream.read(size)
        name, equals, value = content.partition(b"=")
        if len(content) != size or not equals:
            raise Broken("a record header is damaged")
        fields[name] = value
    return fields


def _connected(facts: Fields) -> Topic:
    """Return the topic of a connection, which messages name by its number."""
    name, kind, md5 = (
        facts[key].decode("utf-8", "replace") for key in (b"topic", b"type", b"md5sum")
    )
    return Topic(re.sub("/+", "/", name).removesuffix("/"), kind, md5=md5)


def _unpacked(fields: Fields, data: bytes, path: Path) -> bytes:
    """Return the records in a chunk, of one that is cut those before the cut; ``Broken`` where it is damaged."""
    if fields[b"compression"] == b"none":
        return data
    size = int.from_bytes(fields[b"size"], "little")
    bounded(len(data), size, path)
    machine = bz2.BZ2Decompressor()
    if fields[b"compression"] == b"lz4":
        from lz4.frame import LZ4FrameDecompressor

        machine = LZ4FrameDecompressor()
    try:
        # Why not the same for an open chunk: its size is not known.
        return bytes(machine.decompress(data, size or len(data) * 100))
    except (OSError, RuntimeError, EOFError, ValueError):
        raise Broken("a chunk cannot be decompressed") from None
