"""Recordings whose container is the trap: chunks, pages and journals, each small, that hold more than any disk."""

from __future__ import annotations

import bz2
import io
import os
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path

from dynid.log import Log

MAGIC = b"\x89MCAP0\r\n"

PAGE = 4096


def _record(op: int, content: bytes) -> bytes:
    return struct.pack("<BQ", op, len(content)) + content


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def many_chunks(path: Path) -> None:
    """An MCAP file of 1 MB with 1500 chunks, each of which unpacks to 15 MB."""
    import zstandard

    inner = _record(77, bytes(15 << 20))
    packed = zstandard.compress(inner)
    head = (
        struct.pack("<QQQI", 0, 10**9, len(inner), 0)
        + _text("zstd")
        + struct.pack("<Q", len(packed))
    )
    path.write_bytes(
        MAGIC + _record(1, _text("ros2") + _text("x")) + _record(6, head + packed) * 1500
    )


def stamped_late(log: Log) -> Callable[[Path], None]:
    """Return what writes a recording as MCAP whose second half arrives after the year 2262."""
    from mcap.reader import make_reader
    from mcap.writer import Writer

    from dynid.files.convert import write_log

    def made(path: Path) -> None:
        write_log(log, path)
        messages = list(make_reader(io.BytesIO(path.read_bytes())).iter_messages())
        with path.open("wb") as stream:
            writer = Writer(stream)
            writer.start("ros2", "x")
            schema, channel, _ = messages[0]
            kind = writer.register_schema(schema.name, schema.encoding, schema.data)
            number = writer.register_channel(channel.topic, channel.message_encoding, kind)
            for k, (_, _, message) in enumerate(messages):
                late = 2**63 if k > len(messages) // 2 else 0
                writer.add_message(
                    number, message.log_time + late, message.data, message.publish_time
                )
            writer.finish()

    return made


def many_bag_chunks(path: Path) -> None:
    """A bag of ROS 1 of 30 kB with 500 chunks, each of which unpacks to 60 MB."""

    def fields(**values: bytes) -> bytes:
        return b"".join(
            struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v
            for k, v in values.items()
        )

    def record(head: bytes, data: bytes) -> bytes:
        return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data

    none, size = bytes(4), struct.pack("<I", 60 << 20)
    first = record(
        fields(op=b"\3", index_pos=bytes(8), conn_count=none, chunk_count=none), b" " * 4000
    )
    chunk = record(fields(op=b"\5", compression=b"bz2", size=size), bz2.compress(bytes(60 << 20)))
    path.write_bytes(b"#ROSBAG V2.0\n" + first + chunk * 500)


def pages_without_end(path: Path) -> None:
    """A store of rosbag2 of 300 kB, of which six pages name the next one 300 times each: 10^15 rows."""
    path.unlink(missing_ok=True)
    base = sqlite3.connect(path)
    base.executescript(
        f"PRAGMA page_size = {PAGE}; CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format);"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data);"
        "INSERT INTO topics VALUES (1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr')"
    )
    row = b"\0\1\0\0" + bytes(40)
    base.executemany("INSERT INTO messages VALUES (?, 1, ?, ?)", [(k, k, row) for k in range(4000)])
    base.commit()
    ((root,),) = base.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'")
    base.close()
    raw = bytearray(path.read_bytes())
    begin, count = PAGE * (root - 1), len(raw) // PAGE
    (leaf,) = struct.unpack_from(">I", raw, begin + 8)
    for k in range(6):
        raw += _inner_page(count + k + 2 if k < 5 else leaf)
    raw[begin : begin + PAGE] = _inner_page(count + 1)
    struct.pack_into(">I", raw, 28, len(raw) // PAGE)
    path.write_bytes(raw)


def _inner_page(child: int, cells: int = 300) -> bytes:
    page = bytearray(PAGE)
    for k in range(cells):
        at = PAGE - 6 * (k + 1)
        struct.pack_into(">IBB", page, at, child, 0x81, k % 128)
        struct.pack_into(">H", page, 12 + 2 * k, at)
    struct.pack_into(">BHHHBI", page, 0, 5, 0, cells, PAGE - 6 * cells, 0, child)
    return bytes(page)


def with_journal(log: Log, kind: str) -> Callable[[Path], None]:
    """Return what makes a store whose journal is missing its table, a pipe, a device, or debris."""
    from dynid.files.convert import write_log

    def made(path: Path) -> None:
        write_log(log, path)
        raw = bytearray(path.read_bytes())
        raw[18] = raw[19] = 2  # Unit: versions of the file format; 2 says that there is a journal.
        path.write_bytes(raw)
        journal = path.with_name(f"{path.name}-wal")
        if kind == "pipe":
            os.mkfifo(journal)
        elif kind == "device":
            journal.symlink_to("/dev/zero")
        else:
            journal.write_bytes(bytes(range(256)) * 400)

    return made


def shared_pages(column: str, *, text: bool = False, pages: int = 8) -> Callable[[Path], None]:
    """Return what makes a store of 0.9 MB of 650 rows a page, whose one column of 0.9 MB lies in the same pages for all of them."""

    def made(path: Path) -> None:
        path.unlink(missing_ok=True)
        base = sqlite3.connect(path)
        behind = ("topic_id", "timestamp", "data")
        names = behind if column in behind else (column, *behind)
        base.executescript(
            f"PRAGMA page_size = {PAGE}; CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format);"
            f"CREATE TABLE messages(id INTEGER PRIMARY KEY, {', '.join(names)});"
            "INSERT INTO topics VALUES (1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr')"
        )
        # Why this size: 449 of its bytes stay in the page of the row, so that there is room for the other rows.
        size = 449 + 220 * (PAGE - 4)
        values = {"topic_id": 1, "timestamp": 1, "data": b"\0\1\0\0" + bytes(40)} | {
            column: "x" * size if text else bytes(size)
        }
        base.execute(
            f"INSERT INTO messages VALUES (1, {', '.join('?' * len(names))})",
            [values[name] for name in names],
        )
        base.commit()
        ((root,),) = base.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'")
        base.close()
        raw = bytearray(path.read_bytes())
        at, count = PAGE * (root - 1), len(raw) // PAGE
        (row,) = struct.unpack_from(">H", raw, at + 8)
        struct.pack_into(">H", raw, at + 3, 650)
        struct.pack_into(">650H", raw, at + 8, *[row] * 650)
        raw += raw[at : at + PAGE]
        raw[at : at + PAGE] = _inner_page(count + 1, pages)
        struct.pack_into(">I", raw, 28, len(raw) // PAGE)
        path.write_bytes(raw)

    return made


def short_map(log: Log, op: int, said: int) -> Callable[[Path], None]:
    """Return what writes an MCAP file whose statistics (op 11) or indices of chunks (op 8) hold a map of another length than they say."""
    from dynid.files.convert import write_log

    def made(path: Path) -> None:
        write_log(log, path)
        raw, at = path.read_bytes(), len(MAGIC)
        out = bytearray(MAGIC)
        while at < len(raw) - len(MAGIC):
            kind, size = struct.unpack_from("<BQ", raw, at)
            content = bytearray(raw[at + 9 : at + 9 + size])
            if kind == op:
                struct.pack_into("<I", content, 42 if op == 11 else 32, said)
            out += _record(kind, bytes(content))
            at += 9 + size
        path.write_bytes(out + MAGIC)

    return made
