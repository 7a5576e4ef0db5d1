"""Recordings of ROS 2, and MCAP files of either ROS: folders with metadata.yaml, single .db3 and .mcap files.

Reads message by message; hands over the same logs as ``bag`` does for ROS 1. What is damaged comes with finding W305.
"""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynid import limits
from dynid.drivers.interface import JOINT_STATE
from dynid.errors import BagTruncated, Finding, LogNotFound, TooLarge, WrongMessageType
from dynid.files import cdr, mcap_records
from dynid.files.bag import Topic, recovered
from dynid.files.bag_records import Connection
from dynid.files.mcap_records import BrokenMcap
from dynid.files.messages import BLOCK, BLOCK_BYTES, CHECKSUMS, BrokenMessage, Collector
from dynid.log import Log
from dynid.text import shell

SQLITE = b"SQLite format 3\0"
#: First bytes of the journal of a store, of either byte order.
_JOURNALS = (b"\x37\x7f\x06\x82", b"\x37\x7f\x06\x83")
SUFFIXES = (".db3", ".mcap")
#: Steps of SQLite that are counted together, those that every file may take, and those for each of its bytes.
#: Why they are counted: pages that name each other as their children hold rows without end. A row takes about 15.
_STEPS, _FREE_STEPS, _STEPS_PER_BYTE = 10_000, 1_000_000, 4
#: Fields of the ROS 2 definitions that the decoders were written for; other types in them follow after a line of ``=``.
_FIELDS = {
    JOINT_STATE: ("Header header", "string[] name", "float64[] position", "float64[] velocity", "float64[] effort"),
    cdr.MULTI_ARRAY: ("MultiArrayLayout layout", "float64[] data"),
}


@dataclass(frozen=True)
class _Message:
    """One message as the container holds it.

    Attributes:
        topic: topic name.
        kind: message type, as ROS 1 writes it.
        encoding: ``"cdr"`` or ``"ros1"``.
        definition: text of the definition, "" where the container has none.
        arrival: time of arrival [ns].
        raw: the bytes.
    """

    topic: str
    kind: str
    encoding: str
    definition: str
    arrival: int
    raw: bytes


class Broken(Exception):
    """A part of the recording cannot be read; says what was met."""


def is_recording(path: Path) -> bool:
    """Return whether a path is a folder of rosbag2, or a single .db3 or .mcap file, by its content."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or any(part.suffix in SUFFIXES for part in path.iterdir())
    return path.suffix in SUFFIXES or _start(path).startswith((SQLITE, mcap_records.MAGIC))


def list_topics(path: Path) -> dict[str, Topic]:
    """Return the topics of a recording by name; those of a damaged one as far as it can be read.

    Raises:
        BagTruncated: nothing is readable.
        LogNotFound: not a recording.
    """
    found: dict[str, Topic] = {}
    for part in parts_of(path):
        for name, kind, count in _topics(part):
            before = found[name].count if name in found else 0
            found[name] = Topic(name, kind, before + count)
    if not found:
        raise _nothing(path)
    return found


def read_topics(path: Path, names: Collection[str]) -> tuple[dict[str, list[Log]], tuple[Finding, ...]]:
    """Read topics of a recording.

    Returns:
        for each topic its raw logs, one for each set of joint names, the largest first; and what was noticed.

    Raises:
        BagTruncated: nothing of these topics is readable.
        WrongMessageType: the layout of the messages is not the known one of their type.
        TooLarge: a chunk, a message or a name is larger than the limit.
    """
    try:
        collectors, reasons = _collected(path, names, lenient=False)
        groups = {name: logs for name, collector in collectors.items() if (logs := collector.logs())}
    except BrokenMessage as error:
        collectors, reasons = _collected(path, names, lenient=True)
        groups = {name: logs for name, collector in collectors.items() if (logs := collector.logs())}
        reasons = [str(error), *reasons]
    if reasons and not groups:
        raise _nothing(path, reasons[0])
    return groups, (recovered(path, "; ".join(reasons[:3]), groups),) if reasons else ()


def _collected(path: Path, names: Collection[str], *, lenient: bool) -> tuple[dict[str, Collector], list[str]]:
    """Return the numbers of some topics, and why parts of the recording could not be read."""
    collectors: dict[str, Collector] = {}
    waiting: dict[str, list[_Message]] = {}
    reasons = []
    for part in parts_of(path):
        try:
            for message in _messages(part, names):
                limits.check("message_bytes", len(message.raw), message.topic)
                some = waiting.setdefault(message.topic, [])
                if some and (len(some) == BLOCK or len(some) * len(message.raw) > BLOCK_BYTES):
                    _collect(some, collectors, lenient=lenient)
                    some.clear()
                some.append(message)
        except Broken as error:
            reasons.append(f"{part.name}: {error}" if part != path else str(error))
    for some in waiting.values():
        _collect(some, collectors, lenient=lenient)
    return collectors, reasons


def parts_of(path: Path) -> list[Path]:
    """Return the files of a recording in the order of time.

    Raises:
        LogNotFound: a folder without any.
    """
    if not path.is_dir():
        return [path]
    parts = [part for part in path.iterdir() if part.suffix in SUFFIXES and part.is_file()]
    if not parts:
        packed = [part.name for part in path.iterdir() if part.name.endswith(".zstd")]
        fix = f"unpack it with: {shell('zstd', '-d', path / packed[0])}" if packed else "check the path"
        raise LogNotFound(f"{path} has no .db3 or .mcap file", where=str(path), fix=fix)

    def place(part: Path) -> tuple[list[int], str]:
        # Why: rosbag2 numbers the parts of a recording at the end of their names, 9 before 10.
        return [int(number) for number in re.findall(r"\d+", part.stem)[-1:]], part.name

    return sorted(parts, key=place)


def _collect(messages: Sequence[_Message], collectors: dict[str, Collector], *, lenient: bool) -> None:
    """Hand messages of one topic on as those of ROS 1: at once where all are alike."""
    first = messages[0]
    if first.topic not in collectors:
        # Why: the first message says whether its type and layout are known.
        _collect_one(first, collectors, lenient=lenient)
        messages = messages[1:]
    if messages and all((message.encoding, message.kind) == ("cdr", JOINT_STATE) for message in messages):
        try:
            block = cdr.joint_states([message.raw for message in messages])
        except (BrokenMessage, TooLarge):
            block = None
        if block is not None:
            arrival = np.array([message.arrival for message in messages], dtype=np.int64)
            collectors[first.topic].add_alike(arrival, block)
            return
    for message in messages:
        _collect_one(message, collectors, lenient=lenient)


def _collect_one(message: _Message, collectors: dict[str, Collector], *, lenient: bool) -> None:
    """Hand a message on as one of ROS 1; a damaged one is passed over if ``lenient``."""
    collector = collectors.get(message.topic)
    if collector is None:
        _check_definition(message)
        kind, md5 = message.kind, ""
        if message.encoding == "cdr" or kind == cdr.MULTI_ARRAY:
            kind, md5 = JOINT_STATE, CHECKSUMS[JOINT_STATE]
        connection = Connection(message.topic, kind, message.definition, md5)
        collector = collectors[message.topic] = Collector(connection, lenient=lenient)
    try:
        if message.kind == cdr.MULTI_ARRAY:
            convert = cdr.multi_array if message.encoding == "cdr" else cdr.multi_array_ros1
            collector.add(message.arrival, convert(message.raw))
        elif message.encoding == "cdr":
            collector.add(message.arrival, cdr.joint_state(message.raw))
        else:
            collector.add(message.arrival, message.raw)
    except (BrokenMessage, TooLarge):
        if not lenient:
            raise


def _check_definition(message: _Message) -> None:
    """Raise when messages cannot be decoded: another type, or another layout than the known one."""
    if message.encoding == "ros1" and message.kind != cdr.MULTI_ARRAY:
        return  # the collector compares these definitions
    if message.kind not in _FIELDS or message.encoding not in ("cdr", "ros1"):
        text = f"{message.topic} has messages of the type {message.kind} ({message.encoding})"
        raise WrongMessageType(text, where=message.topic)
    lines = []
    for raw in message.definition.splitlines():
        line = " ".join(raw.partition("#")[0].split())
        if line and set(line) == {"="}:
            break
        if line:
            lines.append(line.replace("std_msgs/msg/", "").replace("std_msgs/", ""))
    if lines and tuple(lines) != _FIELDS[message.kind]:
        raise WrongMessageType(
            f"the {message.kind} of {message.topic} has another layout than the known one",
            where=message.topic,
            why="only the known layout is decoded",
            fix="record with the standard definition of this message",
        )


def _start(path: Path) -> bytes:
    try:
        with limits.open_file(path) as stream:
            return stream.read(16)
    except OSError as error:
        raise LogNotFound(f"cannot read {path}: {error.strerror}", where=str(path)) from error


def _is_sqlite(part: Path) -> bool:
    start = _start(part)
    if not start:
        raise BagTruncated(f"{part.name} is empty: nothing was recorded", where=str(part), fix="record again")
    if start.startswith(SQLITE):
        return True
    if start.startswith(mcap_records.MAGIC):
        return False
    raise LogNotFound(f"{part.name} is neither an SQLite nor an MCAP file", where=str(part))


def _ros1_name(kind: str) -> str:
    return kind.replace("/msg/", "/")


# ---------------------------------------------------------------- either container
def _topics(part: Path) -> list[tuple[str, str, int]]:
    """Return name, type and number of messages of the topics of one file."""
    if _is_sqlite(part):
        try:
            with _opened(part) as base:
                names = _table(base, part)
                counts = dict(base.execute("SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id"))
        except sqlite3.Error:
            return _counted(part)
        return [(name, _ros1_name(kind), counts.get(number, 0)) for number, (name, kind, _) in names.items()]
    try:
        summary = mcap_records.read_summary(part)
    except (BrokenMcap, TooLarge):
        return _counted(part)
    return [
        (channel.topic, _ros1_name(channel.schema), summary.counts.get(number, 0))
        for number, channel in summary.channels.items()
    ]


def _counted(part: Path) -> list[tuple[str, str, int]]:
    """Count the messages that can be read one by one."""
    counts: dict[tuple[str, str], int] = {}
    try:
        for message in _messages(part, None):
            key = (message.topic, message.kind)
            counts[key] = counts.get(key, 0) + 1
    except Broken:
        pass
    return [(*key, count) for key, count in counts.items()]


def _messages(part: Path, names: Collection[str] | None) -> Iterator[_Message]:
    """Yield the messages of some topics (all when None).

    Raises:
        Broken: what follows cannot be read.
    """
    if _is_sqlite(part):
        yield from _rows(part, names)
        return
    try:
        summary = mcap_records.read_summary(part)
    except BrokenMcap:
        summary = None
    try:
        for channel, arrival, raw in mcap_records.scan(part, names, summary):
            kind = _ros1_name(channel.schema)
            text = channel.definition if channel.definition_encoding in ("ros2msg", "ros1msg") else ""
            yield _Message(channel.topic, kind, channel.encoding, text, arrival, raw)
    except BrokenMcap as error:
        raise Broken(str(error)) from None


@contextmanager
def _opened(part: Path) -> Iterator[sqlite3.Connection]:
    """Open a store to read, with what its journal holds where that can be read; nothing beside it changes."""
    journal = _has_journal(part)
    index = part.with_name(f"{part.name}-shm")
    made = journal and not index.exists()
    base = sqlite3.connect(f"{part.resolve().as_uri()}?mode=ro{'' if journal else '&immutable=1'}", uri=True)
    try:
        left = iter(range((_FREE_STEPS + _STEPS_PER_BYTE * _size(part)) // _STEPS))
        base.set_progress_handler(lambda: next(left, None) is None, _STEPS)
        base.execute("PRAGMA trusted_schema = OFF")
        if hasattr(base, "setlimit"):  # Python 3.11
            base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, int(limits.limit("chunk_bytes")))
        yield base
    finally:
        base.close()
        if made:
            with suppress(OSError):
                index.unlink(missing_ok=True)


def _has_journal(part: Path) -> bool:
    """Return whether there is a journal beside a store, and not a pipe, a device or debris in its place."""
    try:
        with limits.open_file(part.with_name(f"{part.name}-wal")) as stream:
            return stream.read(4) in _JOURNALS
    except OSError:
        return False


def _table(base: sqlite3.Connection, part: Path) -> dict[int, tuple[str, str, str]]:
    """Return name, type and serialisation of the topics by their number.

    Raises:
        Broken: it is not a store of rosbag2.
    """
    # Why: a view could be made to compute for ever; the recorder makes plain tables.
    plain = {
        str(name) for name, text in base.execute("SELECT name, sql FROM sqlite_master WHERE type = 'table'")
        if str(text).upper().startswith("CREATE TABLE")
    }  # fmt: skip
    for table in ("topics", "messages"):
        # Why: a column that is computed could be made to fill the memory.
        if any(column[-1] for column in base.execute(f"PRAGMA table_xinfo({table})")):
            raise LogNotFound(f"{part.name} computes its {table}: it is not of rosbag2", where=str(part))
    if not {"topics", "messages"} <= plain:
        raise LogNotFound(f"{part.name} has no tables of rosbag2", where=str(part))
    rows = base.execute("SELECT id, name, type, serialization_format FROM topics")
    found = {}
    for number, name, kind, form in rows:
        found[int(number)] = (str(name), str(kind), str(form))
        limits.check("connections", len(found), part)
    return found


def _rows(part: Path, names: Collection[str] | None) -> Iterator[_Message]:
    try:
        with _opened(part) as base:
            topics = _table(base, part)
            wanted = [number for number, (name, _, _) in topics.items() if names is None or name in names]
            marks = ", ".join("?" * len(wanted))
            query = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks})"
            left = _size(part)
            for number, arrival, raw in base.execute(query, wanted):
                left -= len(raw) if isinstance(raw, bytes) else 0
                if left < 0:
                    raise Broken("its rows hold more than its file: pages are used twice")
                name, kind, form = topics[number]
                if isinstance(raw, bytes) and isinstance(arrival, int):
                    yield _Message(name, _ros1_name(kind), form, "", arrival, raw)
    except (sqlite3.Error, OverflowError) as error:
        raise Broken(str(error)) from None


def _size(part: Path) -> int:
    """Return the bytes of a store and of its journal."""
    journal = part.with_name(f"{part.name}-wal")
    return part.stat().st_size + (journal.stat().st_size if journal.is_file() else 0)


def _nothing(path: Path, reason: str = "") -> BagTruncated:
    tail = f": {reason}" if reason else ""
    return BagTruncated(
        f"{path.name}: nothing is readable{tail}", where=str(path),
        fix="record again, or try: ros2 bag reindex FOLDER; mcap recover FILE",
    )  # fmt: skip
