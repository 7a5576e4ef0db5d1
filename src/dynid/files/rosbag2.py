"""Recordings of ROS 2 by rosbags: folders of rosbag2, single .db3 and .mcap files."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.errors import BagTruncated, DynidError, LogNotFound
from dynid.files.messages import Broken, Message, Topic, nothing_readable, topics_of
from dynid.npz import bounded
from dynid.text import shell

if TYPE_CHECKING:
    from rosbags.rosbag2 import Reader

SUFFIXES = (".db3", ".mcap")


def list_topics(path: Path) -> dict[str, Topic]:
    """Return the topics of a recording by name.

    Raises:
        BagTruncated: a file is cut.
        LogNotFound: not a recording.
    """
    counts: list[tuple[Topic, int]] = []
    for part in parts_of(path):
        try:
            with _opened(part) as reader:
                counts += ((_topic(each), each.msgcount) for each in reader.connections)
        except Broken as error:
            raise nothing_readable(part, str(error)) from None
    if not counts:
        raise nothing_readable(path, "it names no topic")
    return topics_of(counts)


def parts_of(path: Path) -> list[Path]:
    """Return the files of a recording in the order of time.

    Raises:
        LogNotFound: a folder without any.
    """
    if not path.is_dir():
        return [path]
    parts = [part for part in path.iterdir() if part.suffix in SUFFIXES and part.is_file()]
    if not parts:
        fix = "check the path"
        for packed in path.glob("*.zstd"):
            fix = f"unpack it with: {shell('zstd', '-d', packed)}"
        raise LogNotFound(f"{path} has no .db3 or .mcap file", where=path, fix=fix)

    def place(part: Path) -> tuple[list[int], str]:
        # Why: rosbag2 numbers the parts of a recording at the end of their names, 9 before 10.
        return [int(number) for number in re.findall(r"\d+", part.stem)[-1:]], part.name

    return sorted(parts, key=place)


def scan(part: Path, topics: Collection[str]) -> Iterator[Message]:
    """Yield the messages of some topics.

    Raises:
        Broken: what comes behind the last message that was yielded cannot be read.
        TooLarge: a chunk unpacks like a bomb.
    """
    with _opened(part) as reader:
        wanted = [each for each in reader.connections if each.topic in topics]
        known = {each.id: _topic(each) for each in wanted}
        for each, arrival, raw in reader.messages(wanted) if wanted else ():
            yield known[each.id], arrival, raw


def _topic(each: Any) -> Topic:  # noqa: ANN401
    return Topic(each.topic, each.msgtype.replace("/msg/", "/"), True)


@contextmanager
def _opened(part: Path) -> Iterator[Reader]:
    """Open one file of a recording.

    Raises:
        Broken: it is damaged.
    """
    from rosbags.rosbag2 import Reader

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
