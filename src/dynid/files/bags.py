"""Recordings of ROS -> raw logs: ROS 1 bags by one walk over their records, those of ROS 2 by rosbags.

A recorder that was killed leaves a bag without index and with its last chunk open. The walk needs no index and gives
everything before the first broken record. Source: bag format 2.0, wiki.ros.org/Bags/Format/2.0.
"""

from __future__ import annotations

import bz2
import io
import re
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

import numpy as np

from dynid.drivers.interface import JOINT_STATE
from dynid.errors import BagTruncated, DynidError, Finding, LogNotFound
from dynid.files import tuning
from dynid.files.messages import Broken, Collector, Message, Topic
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
_whole = partial(int.from_bytes, byteorder="little")
#: Fields of a header by name; b"" for those that are not there.
Fields = defaultdict[bytes, bytes]


class Recording(NamedTuple):
    """What a recording holds.

    Attributes:
        topics: its topics by name, with the number of their messages.
        logs: for each topic of joint states its raw logs, one for each set of joint names, the largest first.
        findings: what was noticed.
    """

    topics: dict[str, Topic]
    logs: dict[str, list[Log]]
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
            for topic, count, some in (_ros2 if part.suffix in ROS2 else _ros1)(part):
                counts[topic] += count
                if topic.type == JOINT_STATE:
                    collectors.setdefault(topic.name, Collector(topic)).add(some)
        except Broken as error:
            reasons.append(f"{part.name}: {error}" if part != path else str(error))
    topics = {topic.name: replace(topic, count=count) for topic, count in counts.items()}
    logs = {name: found for name, each in collectors.items() if (found := each.logs())}
    reasons += [each.reason for each in collectors.values() if each.reason]
    if not reasons:
        return Recording(topics, logs, ())
    if not logs:
        text = "ends early (recorder killed?), and no joint states of it are readable"
        raise BagTruncated(f"{path.name} {text}: {reasons[0]}", where=path)
    every = [log for group in logs.values() for log in group]
    count, reason = sum(map(len, every)), "; ".join(reasons[:3])
    seconds = max(float(np.ptp(log.extra["arrival_ns"])) for log in every) * 1e-9
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
#: Topic, how many messages it has besides those that came before, and the messages of joint states themselves.
Some = tuple[Topic, int, list[Message]]


def _ros2(part: Path) -> Iterator[Some]:
    """Yield what a file holds; ``Broken`` behind what is readable."""
    with _opened(part) as reader:
        if not reader.connections:
            raise Broken("it names no topic")
        for each in reader.connections:
            topic = Topic(each.topic, each.msgtype.replace("/msg/", "/"), cdr=True)
            yield topic, each.msgcount, []
            if topic.type != JOINT_STATE:
                continue
            messages = reader.messages([each])
            while some := list(islice(messages, tuning.MESSAGES)):
                yield topic, 0, [(arrival, raw) for _, arrival, raw in some]


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
def _ros1(path: Path) -> Iterator[Some]:
    """Yield what a bag holds; ``Broken`` behind what is readable."""
    known: dict[bytes, Topic] = {}
    damage, index = None, 0
    with path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise LogNotFound(
                f"{path.name} is not a ROS 1 bag of version 2.0",
                where=path,
                fix=f"see what it is: {shell('file', path)}",
            )
        for fields, data in _records(stream):
            index = index or _whole(fields[b"index_pos"])
            if fields[b"op"] != _CHUNK:
                continue
            found = defaultdict[Topic, list[Message]](list)
            try:
                for topic, message in _messages(_unpacked(fields, data, path), known):
                    found[topic].append(message)
            except Broken as error:
                damage = damage or error
            for topic, some in found.items():
                yield topic, len(some), some
    if not index or index >= path.stat().st_size:
        raise Broken("it was never closed, or ends before its index: there is no index")
    if damage:
        raise damage


def _messages(chunk: bytes, known: dict[bytes, Topic]) -> Iterator[tuple[Topic, Message]]:
    """Yield the messages of a chunk, whose topics become known."""
    for fields, data in _records(io.BytesIO(chunk)):
        if fields[b"op"] == _CONNECTION:
            known[fields[b"conn"]] = _topic(fields, data)
        elif fields[b"op"] == _MESSAGE and (topic := known.get(fields[b"conn"])):
            seconds, rest = (_whole(fields[b"time"][k : k + 4]) for k in (0, 4))
            yield topic, (seconds * 10**9 + rest, data)


def _records(stream: BinaryIO) -> Iterator[tuple[Fields, bytes]]:
    """Yield header and data of each record of a bag or of a chunk; ``Broken`` behind the last that is readable.

    A chunk that is cut or open is readable up to there: its size is written when it is closed.
    """
    while head := stream.read(4):
        fields = _fields(stream.read(_whole(head)))
        chunk, size = fields[b"op"] == _CHUNK, _whole(stream.read(4))
        data = stream.read(size or -1 if chunk else size)
        if chunk or len(data) == size:
            yield fields, data
        if len(data) < size:
            raise Broken("it ends in the middle of a record")


def _fields(header: bytes) -> Fields:
    """Split a header into its fields: length, name=value."""
    fields, stream = Fields(bytes), io.BytesIO(header)
    while head := stream.read(4):
        size = _whole(head)
        content = stream.read(size)
        name, equals, value = content.partition(b"=")
        if len(content) != size or not equals:
            raise Broken("a record header is damaged")
        fields[name] = value
    return fields


def _topic(fields: Fields, data: bytes) -> Topic:
    """Return the topic of a connection; messages name it by its number."""
    facts = _fields(data) | fields
    name, kind = (facts.get(key, b"").decode("utf-8", "replace") for key in (b"topic", b"type"))
    return Topic(re.sub("/+", "/", name).removesuffix("/"), kind)


def _unpacked(fields: Fields, data: bytes, path: Path) -> bytes:
    """Return the records in a chunk, of one that is cut those before the cut; ``Broken`` where it is damaged."""
    if fields[b"compression"] == b"none":
        return data
    size = _whole(fields[b"size"])
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
