"""Recordings of ROS 2, and MCAP files of either ROS: folders with metadata.yaml, single .db3 and .mcap files.

Reads message by message; hands over the same logs as ``bag`` does for ROS 1. What is damaged comes with finding W305.

Why not the reader of rosbags: SQLite works for ever on pages that name each other, and nothing bounds a computed column
(benchmarks/read_bag.md).
"""

from __future__ import annotations

import re
import sqlite3
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from dynid import limits
from dynid.errors import BagTruncated, Finding, LogNotFound, TooLarge
from dynid.files import mcap_records, tuning
from dynid.files.messages import (
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

SUFFIXES = (".db3", ".mcap")
SQLITE = b"SQLite format 3\0"
#: First bytes of the journal of a store, of either byte order.
_JOURNALS = (b"\x37\x7f\x06\x82", b"\x37\x7f\x06\x83")
#: Steps of SQLite that are counted together.
_STEPS = 10_000
#: Columns that the recorder makes; a further one may be of any size, and SQLite walks through it to those behind.
_COLUMNS = {
    "topics": ("id", "name", "type", "serialization_format"),
    "messages": ("id", "topic_id", "timestamp", "data"),
}
#: What holds of every row of the recorder. SQLite tells a type without reading the value, which in rows that share
#: their pages may have more bytes than the file; each is asked before the next, which ``AND`` does not promise.
_PLAIN = (
    "CASE WHEN typeof(topic_id) <> 'integer' THEN 0 WHEN typeof(timestamp) <> 'integer' THEN 0 "
    "WHEN typeof(data) <> 'blob' THEN 0 ELSE {} END"
)
_TWICE = "its rows hold more than its file: pages are used twice"
#: The longest statement that makes a table [byte]; those of the recorder have 200.
_LONGEST_STATEMENT = 10_000


def list_topics(path: Path) -> dict[str, Topic]:
    """Return the topics of a recording by name; those of a damaged one as far as it can be read.

    Raises:
        BagTruncated: nothing is readable.
        LogNotFound: not a recording.
    """
    found: dict[str, Topic] = {}
    for part in parts_of(path):
        for name, topic in _topics(part).items():
            before = found[name].count if name in found else 0
            found[name] = Topic(name, topic.type, before + topic.count)
    if not found:
        raise nothing_readable(path, "it names no topic")
    return found


def read_topics(
    path: Path, names: Collection[str]
) -> tuple[dict[str, list[Log]], tuple[Finding, ...]]:
    """Return for each of some topics its raw logs, one for each set of joint names, the largest first; and findings.

    Raises:
        BagTruncated: nothing of these topics is readable.
        WrongMessageType: the layout of the messages is not the known one of their type.
        TooLarge: a chunk, a message or a name is larger than the limit.
    """
    return collected(path, parts_of(path), lambda part: scan(part, names))


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
        fix = (
            f"unpack it with: {shell('zstd', '-d', path / packed[0])}"
            if packed
            else "check the path"
        )
        raise LogNotFound(f"{path} has no .db3 or .mcap file", where=str(path), fix=fix)

    def place(part: Path) -> tuple[list[int], str]:
        # Why: rosbag2 numbers the parts of a recording at the end of their names, 9 before 10.
        return [int(number) for number in re.findall(r"\d+", part.stem)[-1:]], part.name

    return sorted(parts, key=place)


def _start(path: Path) -> bytes:
    try:
        with limits.open_file(path) as stream:
            return stream.read(16)
    except OSError as error:
        raise LogNotFound(f"cannot read {path}: {error.strerror}", where=str(path)) from error


def _is_sqlite(part: Path) -> bool:
    start = _start(part)
    if not start:
        raise BagTruncated(
            f"{part.name} is empty: nothing was recorded", where=str(part), fix="record again"
        )
    if start.startswith(SQLITE):
        return True
    if start.startswith(mcap_records.MAGIC):
        return False
    raise LogNotFound(f"{part.name} is neither an SQLite nor an MCAP file", where=str(part))


# ---------------------------------------------------------------- either container
def _topics(part: Path) -> dict[str, Topic]:
    if _is_sqlite(part):
        try:
            with _opened(part) as base:
                topics = _table(base, part)
                # Why not in SQLite: it sorts what it groups, on disk, whatever size the rows say that they have.
                counts = Counter(
                    number
                    for (number,) in base.execute(
                        f"SELECT topic_id FROM messages WHERE {_PLAIN.format(1)}"
                    )
                )
        except (sqlite3.Error, OverflowError, Broken):
            return counted(scan(part))
        return topics_of(
            (connection, counts.get(number, 0)) for number, connection in topics.items()
        )
    try:
        summary = mcap_records.read_summary(part)
    except (Broken, TooLarge):
        return counted(scan(part))
    return topics_of(
        (channel, summary.counts.get(number, 0)) for number, channel in summary.channels.items()
    )


def scan(part: Path, topics: Collection[str] | None = None) -> Iterator[Messages]:
    """Yield the messages of some topics (all when None), those together that have one length.

    Raises:
        Broken: after the last readable message, where there were others.
        TooLarge: a chunk or a message is beyond the limit.
    """
    waiting: dict[tuple[int, int], tuple[Connection, list[int], list[bytes]]] = {}
    count = size = 0
    broken = None
    try:
        for connection, arrival, raw in (
            _rows(part, topics) if _is_sqlite(part) else mcap_records.scan(part, topics)
        ):
            limits.check("message_bytes", len(raw), connection.topic)
            if count == tuning.MESSAGES or size + len(raw) > tuning.MESSAGE_BYTES:
                yield from _alike(waiting)
                count = size = 0
            key = (id(connection), len(raw))
            if key not in waiting:
                waiting[key] = (connection, [], [])
            waiting[key][1].append(arrival)
            waiting[key][2].append(raw)
            count, size = count + 1, size + len(raw)
    except Broken as error:
        broken = error
    yield from _alike(waiting)
    if broken is not None:
        raise broken


def _alike(
    waiting: dict[tuple[int, int], tuple[Connection, list[int], list[bytes]]],
) -> Iterator[Messages]:
    """Yield what waits, and forget it."""
    for connection, arrival, raws in waiting.values():
        table = np.frombuffer(b"".join(raws), np.uint8).reshape(len(raws), -1 if raws[0] else 0)
        yield connection, np.array(arrival, dtype=np.int64), table
    waiting.clear()


# ---------------------------------------------------------------- SQLite
@contextmanager
def _opened(part: Path) -> Iterator[sqlite3.Connection]:
    """Open a store to read, with what its journal holds where that can be read; nothing beside it changes."""
    journal = _has_journal(part)
    index = part.with_name(f"{part.name}-shm")
    made = journal and not index.exists()
    base = sqlite3.connect(
        f"{part.resolve().as_uri()}?mode=ro{'' if journal else '&immutable=1'}", uri=True
    )
    try:
        left = iter(
            range((tuning.SQLITE_STEPS + tuning.SQLITE_STEPS_PER_BYTE * _size(part)) // _STEPS)
        )
        base.set_progress_handler(lambda: next(left, None) is None, _STEPS)
        base.execute("PRAGMA trusted_schema = OFF")
        if hasattr(base, "setlimit"):  # Python 3.11
            base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, int(limits.limit("chunk_bytes")))
            base.setlimit(sqlite3.SQLITE_LIMIT_SQL_LENGTH, _LONGEST_STATEMENT)
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


def _table(base: sqlite3.Connection, part: Path) -> dict[int, Connection]:
    """Return the topics by their number.

    Raises:
        Broken: it is not a store of rosbag2.
    """
    # Why: a view could be made to compute for ever; the recorder makes plain tables.
    plain = {
        str(name)
        for name, text in base.execute("SELECT name, sql FROM sqlite_master WHERE type = 'table'")
        if str(text).upper().startswith("CREATE TABLE")
    }
    for table, usual in _COLUMNS.items():
        columns = base.execute(f"PRAGMA table_xinfo({table})").fetchall()
        # Why: a column that is computed could be made to fill the memory.
        if any(column[-1] for column in columns):
            raise LogNotFound(
                f"{part.name} computes its {table}: it is not of rosbag2", where=str(part)
            )
        if table not in plain or tuple(column[1] for column in columns[: len(usual)]) != usual:
            raise LogNotFound(f"{part.name} has no tables of rosbag2", where=str(part))
    text = " AND ".join(f"typeof({column}) = 'text'" for column in _COLUMNS["topics"][1:])
    rows = base.execute(
        f"SELECT {', '.join(_COLUMNS['topics'])} FROM topics WHERE typeof(id) = 'integer' AND {text}"
    )
    found, left = {}, _size(part)
    for number, name, kind, form in rows:
        left -= len(name) + len(kind) + len(form)
        if left < 0:
            raise Broken(_TWICE)
        found[number] = Connection(name, kind.replace("/msg/", "/"), "", encoding=form)
        limits.check("connections", len(found), part)
    return found


def _rows(part: Path, names: Collection[str] | None) -> Iterator[tuple[Connection, int, bytes]]:
    try:
        with _opened(part) as base:
            topics = _table(base, part)
            wanted = [
                number for number, topic in topics.items() if names is None or topic.topic in names
            ]
            marks = ", ".join("?" * len(wanted))
            plain = _PLAIN.format(f"topic_id IN ({marks})")
            left = _size(part)
            for number, arrival, raw in base.execute(
                f"SELECT topic_id, timestamp, data FROM messages WHERE {plain}", wanted
            ):
                left -= len(raw)
                if left < 0:
                    raise Broken(_TWICE)
                yield topics[number], arrival, raw
    except (sqlite3.Error, OverflowError) as error:
        raise Broken(str(error)) from None


def _size(part: Path) -> int:
    """Return the bytes of a store and of its journal."""
    journal = part.with_name(f"{part.name}-wal")
    return part.stat().st_size + (journal.stat().st_size if journal.is_file() else 0)
