"""Recordings of ROS 2 by rosbags, chunks of MCAP by mcap: folders of rosbag2, single .db3 and .mcap files."""

from __future__ import annotations

import re
import struct
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.errors import BagTruncated, DynidError, LogNotFound
from dynid.files import tuning
from dynid.files.messages import (
    Broken,
    Messages,
    Topic,
    nothing_readable,
    topics_of,
)
from dynid.npz import bounded
from dynid.text import shell

if TYPE_CHECKING:
    from rosbags.rosbag2 import Reader

SUFFIXES = (".db3", ".mcap")
#: Head of a record of MCAP, of a message with its channel, number and times; before its own bytes [byte].
_HEAD, _BEFORE = struct.Struct("<BQHIQ").unpack_from, 31


def list_topics(path: Path) -> dict[str, Topic]:
    """Return the topics of a recording by name.

    Raises:
        BagTruncated: a file is cut.
        LogNotFound: not a recording.
    """
    counts = Counter[Topic]()
    for part in parts_of(path):
        try:
            with _opened(part) as reader:
                for each in reader.connections:
                    counts[_topic(each)] += each.msgcount
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


def scan(part: Path, topics: Collection[str]) -> Iterator[Messages]:
    """Yield the messages of some topics.

    Raises:
        Broken: what comes behind the last message that was yielded cannot be read.
        TooLarge: a chunk unpacks like a bomb.
    """
    with _opened(part) as reader:
        wanted = [each for each in reader.connections if each.topic in topics]
        if getattr(reader.storage, "chunks", None):
            yield from _in_chunks(part, {each.id: _topic(each) for each in wanted})
            return
        for each in wanted:
            messages = reader.messages([each])
            while some := list(islice(messages, tuning.MESSAGES)):
                _, arrival, raws = zip(*some, strict=True)
                edges = np.cumsum([0, *map(len, raws)])
                content = np.frombuffer(b"".join(raws), np.uint8)
                yield Messages(_topic(each), np.array(arrival), content, edges[:-1], edges[1:])


def _in_chunks(part: Path, known: Mapping[int, Topic]) -> Iterator[Messages]:
    """Yield the messages in the chunks of an MCAP file, of topics by the number of their channel."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, get_chunk_data_stream

    with part.open("rb") as stream:
        for chunk in StreamReader(stream, emit_chunks=True).records:
            if not isinstance(chunk, Chunk):
                continue
            bounded(len(chunk.data), chunk.uncompressed_size, part)
            inside, size = get_chunk_data_stream(chunk, validate_crc=True)
            data, at = inside.read(size), 0
            found = defaultdict[int, list[int]](list)
            while at < size:
                op, length, channel, _, arrival = _HEAD(data, at)
                end = at + 9 + length
                if op == 5 and channel in known:
                    found[channel] += arrival, at + _BEFORE, end
                at = end
            content = np.frombuffer(data, np.uint8)
            for channel, numbers in found.items():
                arrivals, starts, ends = np.reshape(numbers, (-1, 3)).T
                yield Messages(known[channel], arrivals, content, starts, ends)


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
        raise BagTruncated(
            f"{part.name} is empty: nothing was recorded", where=part, fix="record again"
        )
    journal = part.with_name(f"{part.name}-wal")
    if journal.is_file() and journal.stat().st_size:
        raise BagTruncated(
            f"{part.name} was not closed: messages wait in {journal.name}",
            where=part,
            fix=shell("sqlite3", part, "PRAGMA wal_checkpoint(TRUNCATE)"),
        )
    try:
        with Reader(part) as reader:
            yield reader
    except (DynidError, PermissionError):
        raise
    # Why all: of damaged bytes rosbags, SQLite and the decompressors raise whatever they meet.
    except Exception as error:  # noqa: BLE001
        raise Broken(str(error) or type(error).__name__) from None
