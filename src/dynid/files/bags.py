"""Recordings of ROS -> raw logs: ROS 1 bags by one walk over their records, those of ROS 2 by rosbags.

A recorder that was killed leaves a bag without index and with its last chunk open. The walk needs no index and gives
everything before the first broken record. Source: bag format 2.0, wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import bz2
import io
import re
import struct
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dynid.drivers.interface import JOINT_STATE
from dynid.errors import BagTruncated, DynidError, Finding, LogNotFound
from dynid.files import tuning
from dynid.files.messages import Broken, Collector, Messages, Topic, whole
from dynid.log import Log
from dynid.npz import bounded
from dynid.text import shell

if TYPE_CHECKING:
    from rosbags.rosbag2 import Reader

#: Suffixes of the files that recorders of ROS 2 write.
ROS2 = (".db3", ".mcap")
#: First line of a bag of version 2.0.
MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _CHUNK, _CONNECTION = b"\2", b"\5", b"\7"
#: What stands before a time in a header.
_TIME = b"\r\0\0\0time="
_SIZE = struct.Struct("<I").unpack_from
#: Fields of a header by name; b"" for those that are not there.
Fields = defaultdict[bytes, bytes]


class Recording(NamedTuple):
    """What a recording holds.

    Attributes:
        topics: its topics by name, with the number of their messages.
        logs: raw logs of joint states, one for each topic and set of joint names, the largest of a topic first.
        findings: what was noticed.
    """

    topics: dict[str, Topic]
    logs: list[Log]
    findings: tuple[Finding, ...]


def read_bag(path: Path) -> Recording:
    """Return what a recording holds, also of one that is damaged.

    Raises:
        BagTruncated: it is damaged, and no joint states are readable.
        LogNotFound: not a recording.
        WrongMessageType: messages are compressed one by one.
        TooLarge: a chunk unpacks like a bomb.
    """
    counts = Counter[Topic]()
    collectors: dict[str, Collector] = {}
    reasons = []
    for part in parts_of(path):
        try:
            for topic, messages in (_ros2 if part.suffix in ROS2 else _ros1)(part, counts):
                collectors.setdefault(topic.name, Collector(topic)).add(messages)
        except Broken as error:
            reasons.append(f"{part.name}: {error}" if part != path else str(error))
    topics = {topic.name: replace(topic, count=count) for topic, count in counts.items()}
    logs = [log for each in collectors.values() for log in each.logs()]
    reasons += [each.reason for each in collectors.values() if each.reason]
    if not reasons:
        return Recording(topics, logs, ())
    if not logs:
        text = "ends early (recorder killed?), and no joint states of it are readable"
        raise BagTruncated(f"{path.name} {text}: {reasons[0]}", where=path)
    count, reason = sum(map(len, logs)), "; ".join(reasons[:3])
    seconds = max(float(np.ptp(log.extra["arrival_ns"])) for log in logs) * 1e-9
    text = (
        f"{path.name} was cut or not closed (recorder killed?): {count} messages, {seconds:.1f} s, are readable "
        f"and used; reported by the reader: {reason.rstrip('.')}"
    )
    evidence = {"messages": count, "seconds": seconds, "reason": reason}
    return Recording(topics, logs, (Finding("W305", "warning", text, evidence),))


def parts_of(path: Path) -> list[Path]:
    """Return the files of a recording in the order of time.

    Raises:
        LogNotFound: a folder without any.
        BagTruncated: a file of it is empty.
    """
    parts = [path]
    if path.is_dir():
        parts = [part for part in path.iterdir() if part.suffix in ROS2 and part.is_file()]
        # Why: rosbag2 numbers the parts of a recording at the end of their names, 9 before 10.
        parts.sort(key=lambda p: ([int(k) for k in re.findall(r"\d+", p.stem)[-1:]], p.name))
    if not parts:
        raise LogNotFound(f"{path} has no .db3 or .mcap file", where=path)
    for part in parts:
        if not part.stat().st_size:
            raise BagTruncated(f"{part.name} is empty: nothing was recorded", where=part)
    return parts


# ---------------------------------------------------------------- ROS 2
def _ros2(part: Path, counts: Counter[Topic]) -> Iterator[tuple[Topic, Messages]]:
    """Yield the joint states of a file, and count all messages; ``Broken`` behind those that are readable."""
    with _opened(part) as reader:
        if not reader.connections:
            raise Broken("it names no topic")
        for each in reader.connections:
            topic = Topic(each.topic, each.msgtype.replace("/msg/", "/"), cdr=True)
            counts[topic] += each.msgcount
            if topic.type != JOINT_STATE:
                continue
            messages = ((arrival, raw) for _, arrival, raw in reader.messages([each]))
            while some := list(islice(messages, tuning.MESSAGES)):
                yield topic, some


@contextmanager
def _opened(part: Path) -> Iterator[Reader]:
    """Open one file of a recording of ROS 2; ``Broken`` where it is damaged."""
    from rosbags.rosbag2 import Reader

    journal = part.with_name(f"{part.name}-wal")
    if journal.is_file() and journal.stat().st_size:
        raise BagTruncated(
            f"{part.name} was not closed: messages wait in {journal.name}",
            where=part,
            fix=shell("sqlite3", part, "PRAGMA wal_checkpoint(TRUNCATE)"),
        )
    try:
        with Reader(part) as reader:
            for chunk in getattr(reader.storage, "chunks", ()):
                bounded(chunk.compressed_size, chunk.uncompressed_size, part)
            yield reader
    except (DynidError, PermissionError):
        raise
    # Why all: of damaged bytes rosbags, SQLite and the decompressors raise whatever they meet.
    except Exception as error:  # noqa: BLE001
        raise Broken(str(error) or type(error).__name__) from None


# ---------------------------------------------------------------- ROS 1
def _ros1(path: Path, counts: Counter[Topic]) -> Iterator[tuple[Topic, Messages]]:
    """Yield the joint states of a bag, and count all messages; ``Broken`` behind those that are readable."""
    known: dict[bytes, Topic] = {}
    damage = None
    for op, fields, data in _records(path):
        if op == _CONNECTION:
            counts[_remembered(fields, data, known)] += 0
        if op != _CHUNK:
            continue
        try:
            for topic, messages in _messages(_unpacked(fields, data, path), known):
                counts[topic] += len(messages)
                if topic.type == JOINT_STATE:
                    yield topic, messages
        except Broken as error:
            damage = damage or error
    if damage:
        raise damage


def _records(path: Path) -> Iterator[tuple[bytes, Fields, bytes]]:
    """Yield kind, header and data of each record of a bag.

    Raises:
        Broken: behind the last readable record, or where there is no index.
        LogNotFound: it is no bag that can be read.
    """
    with path.open("rb") as stream:
        start, index = stream.read(len(MAGIC)), 0
        if start != MAGIC:
            raise LogNotFound(
                f"{path.name} is not a ROS 1 bag of version 2.0",
                where=path,
                fix=f"see what it is: {shell('file', path)}",
            )
        while head := stream.read(4):
            fields = _fields(stream.read(whole(head)))
            op, size = fields[b"op"], whole(stream.read(4))
            index = index or whole(fields[b"index_pos"][:8])
            # Why the rest: a chunk is given its size when it is closed; an open one reaches to the end of the file.
            data = stream.read(size or -1 if op == _CHUNK else size)
            yield op, fields, data
            if len(data) < size:
                raise Broken("it ends in the middle of a record")
        if not index or index >= path.stat().st_size:
            raise Broken("it was never closed, or ends before its index: there is no index")


def _messages(chunk: bytes, known: dict[bytes, Topic]) -> Iterator[tuple[Topic, Messages]]:
    """Yield the messages of a chunk, whose topics become known; ``Broken`` behind them where one is damaged."""
    at, found = 0, defaultdict[bytes, Messages](list)
    with suppress(struct.error):
        while at < len(chunk):
            body = at + 8 + _SIZE(chunk, at)[0]
            end = body + _SIZE(chunk, body - 4)[0]
            if end > len(chunk):
                break
            # Why: headers of the messages of a topic differ in the time alone.
            before, _, behind = chunk[at + 4 : body - 4].partition(_TIME)
            arrival = whole(behind[:4]) * 10**9 + whole(behind[4:8])
            found[before + behind[8:]].append((arrival, chunk[body:end]))
            at = end
    for header, messages in found.items():
        fields = _fields(header)
        number = fields[b"conn"]
        if fields[b"op"] == _CONNECTION:
            _remembered(fields, messages[0][1], known)
        elif fields[b"op"] == _MESSAGE and number in known:
            yield known[number], messages
    if at < len(chunk):
        raise Broken("it ends in the middle of a record")


def _fields(header: bytes) -> Fields:
    """Split a header into its fields: length, name=value."""
    fields, stream = Fields(bytes), io.BytesIO(header)
    while head := stream.read(4):
        size = whole(head)
        content = stream.read(size)
        name, equals, value = content.partition(b"=")
        if len(content) != size or not equals:
            raise Broken("a record header is damaged")
        fields[name] = value
    return fields


def _remembered(fields: Fields, data: bytes, known: dict[bytes, Topic]) -> Topic:
    """Return the topic of a connection; messages name it by its number."""
    facts = _fields(data) | fields
    name, kind = (facts.get(key, b"").decode("utf-8", "replace") for key in (b"topic", b"type"))
    topic = known[fields[b"conn"]] = Topic(re.sub("/+", "/", name).removesuffix("/"), kind)
    return topic


def _unpacked(fields: Fields, data: bytes, path: Path) -> bytes:
    """Return the records in a chunk, of one that is cut those before the cut; ``Broken`` where it is damaged."""
    if fields[b"compression"] == b"none":
        return data
    size = whole(fields[b"size"])
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
