"""Seeded inputs that are whole files of their format and say odd things: what a parser accepts and nobody expects."""

from __future__ import annotations

import io
import json
import sqlite3
import xml.etree.ElementTree as ET
from contextlib import closing

import numpy as np
import yaml
from mutate import WORDS, data
from mutate import npz as broken_npz

ODD_NUMBERS = (
    "1e308",
    "-1e308",
    "1e-308",
    "5e-324",
    "1.0e+400",
    ".nan",
    ".inf",
    "-.inf",
    "0",
    "-0.0",
    "-1",
    "1",
    "0.5",
    "1e9",
    "1.0e-9",
    "1.0e9",
    "1.0e15",
    "-1.0e15",
    "3.4028236e38",
    "9007199254740993",
    "9223372036854775808",
    "9" * 400,
    "9" * 4400,
    "0x1F",
    "0o17",
    "0b1",
    "1_000",
    "1:30:00",
    "2020-01-01",
    "2001-12-14t21:59:43.10-05:00",
    "1e-12",
    "1.0e-12",
    "90 deg",
    "1e300 deg",
    "pi/0",
    "1e400*pi",
    "-pi/2",
    "9999999*pi/1",
    "1.0e3",
    "true",
    "~",
    "=",
    "<<",
    "1,5",
    "１２",
    "٣",
)
ODD_PIECES = (
    "[]",
    "{}",
    "[[]]",
    "[{}]",
    "{a: 1}",
    "null",
    "[1, 2, 3, 4, 5, 6, 7, 8, 9]",
    "[1]",
    "[null, null]",
    "[[[[1]]]]",
    "''",
    "!!binary aGVsbG8=",
    "!!set {a, b}",
    "!!omap [a: 1]",
    "!!float 'x'",
    "!!int 'x'",
    "!!timestamp 'x'",
    "!!bool 'x'",
    "!<tag:x> y",
    "!!python/name:os.system",
    "!!python/object/apply:os.system ['touch HACKED']",
    "&x {<<: *x}",
    "*undefined",
    "&a [*a]",
    "{? [a] : b}",
    "{[a]: b}",
    "{<<: {a: 1}}",
    "{<<: [{a: 1}, {b: 2}]}",
    "|\n  text",
    "? x",
    "'\\ud800'",
    '"\\ud800"',
    '"\\0"',
    '"\\x1b]0;x\\x07"',
    "[" + "1, " * 5000 + "1]",
    "{" + ", ".join(f"k{i}: 1" for i in range(2000)) + "}",
    "/dev/zero",
    "/dev/stdin",
    "/proc/self/environ",
    "../../../../etc/passwd",
    "file:///etc/passwd",
    "~root",
    "$HOME",
    "C:\\x",
    "\\\\host\\share",
    "/" * 5000,
)


def _scalars(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.ScalarNode):
        return [node]
    if isinstance(node, yaml.SequenceNode):
        return [leaf for item in node.value for leaf in _scalars(item)] + [node]
    return [leaf for _, item in node.value for leaf in _scalars(item)] + [node]


def encoded(rng: np.random.Generator, text: str) -> bytes:
    """Return text as bytes, now and then with another encoding, line end or mark."""
    kind = rng.integers(0, 30)
    if kind == 0:
        return text.encode("utf-16", "replace")
    if kind == 1:
        return b"\xef\xbb\xbf" + text.encode("utf-8", "replace")
    if kind == 2:
        return text.replace("\n", "\r\n").encode("utf-8", "replace")
    if kind == 3:
        return text.replace("\n", "\r").encode("utf-8", "replace")
    if kind == 4:
        return text.encode("utf-32", "replace")
    if kind == 5:
        return text.encode("latin-1", "replace") + b"\xe9\xff"
    if kind == 6:
        return text.encode("utf-8", "replace") + b"\0" * 100
    return text.encode("utf-8", "surrogatepass")


def document(rng: np.random.Generator, original: str) -> bytes:
    """Return a YAML document that is well formed, with one to three values replaced by what no one expects there."""
    for _ in range(rng.integers(1, 4)):
        try:
            leaves = _scalars(yaml.compose(original))
        except (yaml.YAMLError, AttributeError, TypeError, RecursionError, ValueError):
            break
        node = leaves[rng.integers(len(leaves))]
        begin, end = node.start_mark.index, node.end_mark.index
        kind = rng.integers(0, 10)
        if kind < 5:
            new = str(rng.choice(ODD_NUMBERS))
        elif kind < 7:
            new = ODD_PIECES[rng.integers(len(ODD_PIECES))]
        elif kind < 9:
            new = json.dumps(WORDS[rng.integers(len(WORDS))])
        else:
            other = leaves[rng.integers(len(leaves))]
            new = original[other.start_mark.index : other.end_mark.index]
        original = original[:begin] + new + original[end:]
    if rng.random() < 0.05:
        original = (
            "a: &a [x, x]\n"
            + "".join(
                f"{c}: &{c} [*{p}, *{p}]\n"
                for p, c in zip("abcdefghijklm", "bcdefghijklmn", strict=True)
            )
            + original
        )
    if rng.random() < 0.03:
        original = "---\n" + original + "\n---\n" + original
    return encoded(rng, original)


def urdf(rng: np.random.Generator, original: str) -> bytes:
    """Return a URDF that is well-formed XML: other numbers, names, loops, doubles, long chains, entities."""
    top = ET.fromstring(original)
    for _ in range(rng.integers(1, 4)):
        elements = list(top.iter())
        element = elements[rng.integers(len(elements))]
        kind = rng.integers(0, 9)
        if kind <= 3 and element.attrib:
            key = str(rng.choice(sorted(element.attrib)))
            links = [link.get("name", "") for link in top.findall("link")]
            words = [
                *(w for w in WORDS if w.isprintable()),
                *ODD_NUMBERS,
                "1 2",
                "1 2 3 4",
                "1e308 0 0",
                "nan nan nan",
                *links,
                *links,
                *links,
            ]
            element.set(key, str(words[rng.integers(len(words))]))
        elif kind == 4 and element.attrib:
            del element.attrib[str(rng.choice(sorted(element.attrib)))]
        elif kind == 5:
            parents = {child: parent for parent in top.iter() for child in parent}
            if element in parents:
                parents[element].remove(element)
        elif kind == 6:
            element.append(
                elements[rng.integers(1, len(elements))]
                if element not in elements[1:]
                else ET.Element("mimic", joint="elbow")
            )
        elif kind == 7:
            before = "lower"
            for k in range(int(rng.choice([3, 40, 300]))):
                ET.SubElement(top, "link", name=f"l{k}")
                joint = ET.SubElement(
                    top,
                    "joint",
                    name=f"j{k}",
                    type=str(
                        rng.choice(
                            ["revolute", "fixed", "floating", "planar", "prismatic", "continuous"]
                        )
                    ),
                )
                ET.SubElement(joint, "parent", link=before)
                ET.SubElement(joint, "child", link=f"l{k}")
                if rng.random() < 0.5:
                    ET.SubElement(joint, "axis", xyz="0 0 1")
                before = f"l{k}"
        else:
            ET.SubElement(top, "link", name="ring_a")
            ET.SubElement(top, "link", name="ring_b")
            for one, two in (("ring_a", "ring_b"), ("ring_b", "ring_a")):
                joint = ET.SubElement(top, "joint", name=f"to_{two}", type="revolute")
                ET.SubElement(joint, "parent", link=one)
                ET.SubElement(joint, "child", link=two)
    text = ET.tostring(top, encoding="unicode")
    kind = rng.integers(0, 20)
    if kind == 0:
        lol = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 10))
        text = f'<!DOCTYPE r [<!ENTITY l0 "lol">{lol}]>' + text.replace("<link", "&l9;<link", 1)
    elif kind == 1:
        text = f'<!DOCTYPE r [<!ENTITY a "{"x" * 50_000}">]>' + text.replace(
            "<link", "&a;" * 10_000 + "<link", 1
        )
    elif kind == 2:
        text = '<!DOCTYPE r [<!ENTITY % p SYSTEM "file:///etc/passwd"> %p;]>' + text
    elif kind == 3:
        text = text.replace(
            "<link",
            '<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="/etc/passwd"/><link',
            1,
        )
    elif kind == 4:
        text = "<robot>" * 20_000 + text
    return encoded(rng, text)


def table(rng: np.random.Generator, original: str) -> bytes:
    """Return a table in another dialect with odd cells, headings or times."""
    lines = original.strip().split("\n")
    head, rows = (
        lines[0].split(","),
        [line.split(",") for line in lines[1 : int(rng.choice([3, 30, 300, 1201]))]],
    )
    for _ in range(rng.integers(0, 3)):
        kind, column = rng.integers(0, 12), int(rng.integers(0, max(len(head), 1)))
        if not head:
            break
        if kind == 0:
            head[column] = WORDS[rng.integers(len(WORDS))].replace("\n", " ")
        elif kind == 1:
            head[column] = head[int(rng.integers(0, len(head)))]
        elif kind == 2:
            head, rows = (
                [*head, *(f"x{k}" for k in range(2000))],
                [[*row, *["0"] * 2000] for row in rows[:20]],
            )
        elif kind == 3:
            value = str(rng.choice([*ODD_NUMBERS, "", "NA", "-", "1e", "=1+1", '"1', "#N/A"]))
            some = range(len(rows)) if rng.random() < 0.3 else rng.integers(0, max(len(rows), 1), 3)
            for k in some:
                if k < len(rows) and column < len(rows[k]):
                    rows[k][column] = value
        elif kind == 4:
            factor = float(rng.choice([1e-12, 1e-9, 1e-3, 57.3, 1e3, 1e9, 1e300, -1, 0]))
            for row in rows:
                if column < len(row):
                    row[column] = repr(_number(row[column]) * factor)
        elif kind == 5:
            rows = [
                row[: int(rng.integers(0, len(row) + 1))] if rng.random() < 0.1 else row
                for row in rows
            ]
        elif kind == 6:
            rows = [rows[k] for k in rng.permutation(len(rows))]
        elif kind == 7:
            rows = [row for row in rows for _ in range(2)]
        elif kind == 8:
            head = []
        elif kind == 9:
            rows = []
        elif kind == 10:
            head = [name.replace("q_", "pos ").replace("tau_", "effort ") for name in head]
        else:
            for row in filter(None, rows):
                row[0] = repr(_number(row[0]) * 1e-9 + float(rng.choice([0, 1e18, -1e18, 1.7e9])))
    delimiter = str(
        rng.choice([",", ";", "\t", " ", "|", ",,", ""], p=[0.6, 0.1, 0.1, 0.1, 0.04, 0.03, 0.03])
    )
    if rng.random() < 0.1:
        rows = [[cell.replace(".", ",") for cell in row] for row in rows]
    if rng.random() < 0.1:
        head, rows = [f'"{name}"' for name in head], [[f'"{cell}"' for cell in row] for row in rows]
    text = "\n".join(delimiter.join(row) for row in ([head] if head else []) + rows)
    if rng.random() < 0.05:
        text = f"# {'x' * 2_000_000}\n{text}"
    if rng.random() < 0.05:
        text = text.replace("\n", "\n\n# comment\n", 5)
    return encoded(rng, text)


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return 0.0


def signals(rng: np.random.Generator, original: bytes) -> bytes:
    """Return an .npz log of the right layout with times and signals that no arm gives."""
    with np.load(io.BytesIO(original), allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    arrays = {
        name: values if name == "header" else values.astype(float)
        for name, values in arrays.items()
    }
    if rng.random() < 0.4:
        count = int(rng.choice([0, 1, 2, 3, 5, 20, 50, 120, 600]))
        arrays = {
            name: values if name == "header" else values[:count] for name, values in arrays.items()
        }
    with np.errstate(all="ignore"):
        for _ in range(rng.integers(1, 4)):
            name = str(rng.choice([key for key in arrays if key != "header"]))
            # Why floating: an earlier change may have made integers of it.
            arrays[name] = _oddly(rng, arrays[name].astype(float), name)
    if rng.random() < 0.3:
        arrays.pop("header", None)
    if rng.random() < 0.2:
        arrays.pop("qd", None)
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def _oddly(rng: np.random.Generator, x: np.ndarray, name: str) -> np.ndarray:
    kind, column = (
        rng.integers(0, 16),
        int(rng.integers(0, x.shape[1])) if x.ndim == 2 and x.shape[1] else 0,
    )
    size = float(
        rng.choice([1e-300, 1e-12, 1e-9, 1e-6, 1e-3, 10, 57.3, 1e3, 1e6, 1e9, 1e150, 1e307])
    )
    if kind <= 2:
        return x * size
    if kind == 3:
        return x + size
    if kind == 4 and x.ndim == 2:
        x[:, column] = float(rng.choice([0, 1, np.nan, np.inf, 1e300]))
        return x
    if kind == 5 and x.ndim == 2:
        x[:, column] *= size
        return x
    if kind == 6 and x.size:
        x.flat[rng.integers(0, x.size, max(1, x.size // int(rng.choice([2, 20, 1000]))))] = (
            rng.choice([np.nan, np.inf, -np.inf, 0, size])
        )
        return x
    if kind == 7:
        return np.round(x, int(rng.integers(-1, 3)))
    if kind == 8:
        return np.zeros_like(x)
    if kind == 9 and len(x) > 3:
        return np.concatenate([x[: len(x) // 2], x[len(x) // 2 :] + size])
    if kind == 10:
        return x[::-1].copy()
    if kind == 11:
        return np.repeat(x[::7], 7, axis=0)[: len(x)] if len(x) > 7 else x
    if kind == 12:
        return x + size * rng.standard_normal(x.shape)
    if kind == 13 and name != "t":
        return np.sign(x) * size
    if kind == 14:
        return x.astype(rng.choice(["f4", "f2", "i1", "i8", "u1", "?"]))
    return np.cumsum(x, axis=0) if rng.random() < 0.5 else x * rng.uniform(0, 2, x.shape)


def store(rng: np.random.Generator, original: bytes) -> bytes:
    """Return a rosbag2 store (SQLite) with another scheme, other types in its rows, or broken messages."""
    if rng.random() < 0.4:
        return data(rng, original)
    with closing(sqlite3.connect(":memory:")) as base:
        base.deserialize(original) if hasattr(base, "deserialize") else None
        if not hasattr(base, "deserialize"):
            return data(rng, original)
        # Some statements double what others have made; one that does not end is left undone.
        base.set_progress_handler(lambda: True, 20_000_000)
        for _ in range(rng.integers(1, 4)):
            statement = STATEMENTS[rng.integers(len(STATEMENTS))]
            try:
                if "{raw}" in statement:
                    some = base.execute(
                        "SELECT rowid, data FROM messages ORDER BY random() LIMIT 5"
                    ).fetchall()
                    for row, raw in some:
                        base.execute(
                            "UPDATE messages SET data = ? WHERE rowid = ?",
                            (data(rng, bytes(raw)), row),
                        )
                else:
                    base.executescript(statement)
            except (sqlite3.Error, TypeError):
                continue
        base.commit()
        return bytes(base.serialize())


STATEMENTS = (
    "{raw}",
    "{raw}",
    "{raw}",
    "UPDATE topics SET name = NULL",
    "UPDATE topics SET name = char(27) || '[31m' || x'00'",
    "UPDATE topics SET type = 'x' || zeroblob(10)",
    "UPDATE topics SET serialization_format = 'json'",
    "UPDATE topics SET id = 'text'",
    "UPDATE topics SET id = 1e300",
    "DELETE FROM topics",
    "UPDATE messages SET timestamp = 'x'",
    "UPDATE messages SET timestamp = 9223372036854775807",
    "UPDATE messages SET timestamp = -1",
    "UPDATE messages SET timestamp = timestamp / 1000000000",
    "UPDATE messages SET timestamp = 1.5",
    "UPDATE messages SET data = 'text'",
    "UPDATE messages SET data = zeroblob(3000000) WHERE rowid = 5",
    "UPDATE messages SET data = NULL WHERE rowid % 3 = 0",
    "UPDATE messages SET data = x'00010000'",
    "UPDATE messages SET topic_id = 99",
    "DELETE FROM messages WHERE rowid > 20",
    "DELETE FROM messages",
    "ALTER TABLE messages RENAME TO m; CREATE VIEW messages AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x AS topic_id, x AS timestamp, x AS data, x AS id FROM c",
    "DROP TABLE messages; CREATE TABLE messages(id, topic_id, timestamp, data AS (zeroblob(900000000))); INSERT INTO messages VALUES (1, 1, 1), (2, 1, 2)",
    "DROP TABLE messages; CREATE TABLE messages(id, topic_id AS (abs(id)), timestamp AS (id), data AS (CAST(printf('%.900000000d', id) AS BLOB))); INSERT INTO messages VALUES (1)",
    "DROP TABLE topics; CREATE TABLE topics(id, name AS (printf('%.900000000d', id)), type, serialization_format); INSERT INTO topics VALUES (1, 'a', 'cdr')",
    "DROP TABLE topics; CREATE VIRTUAL TABLE topics USING fts5(id, name, type, serialization_format)",
    "CREATE TRIGGER t AFTER INSERT ON messages BEGIN SELECT load_extension('/tmp/x'); END",
    "INSERT INTO topics(id, name, type, serialization_format) SELECT 10 + value, 'n' || value, 'sensor_msgs/msg/JointState', 'cdr' FROM (WITH RECURSIVE c(value) AS (SELECT 1 UNION ALL SELECT value + 1 FROM c WHERE value < 20000) SELECT value FROM c)",
    "UPDATE topics SET id = printf('%.5000d', 9)",
    "UPDATE topics SET id = 9e999",
    "UPDATE messages SET topic_id = zeroblob(900000) WHERE rowid < 9",
    "UPDATE messages SET timestamp = printf('%.900000d', 1) WHERE rowid < 9",
    "UPDATE messages SET topic_id = NULL WHERE rowid % 2",
    "ALTER TABLE messages ADD COLUMN pad",
    "PRAGMA user_version = 5",
    "PRAGMA encoding = 'UTF-16'",
    "UPDATE topics SET name = '/a', type = 'sensor_msgs/msg/JointState'",
)


def parquet(rng: np.random.Generator, original: bytes) -> bytes:
    """Return a Parquet table with other types, names, nulls, lists, or broken bytes."""
    if rng.random() < 0.4:
        return data(rng, original)
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = {
        name: column.to_numpy()
        for name, column in zip(
            *(lambda t: (t.column_names, t.columns))(pq.read_table(io.BytesIO(original))),
            strict=True,
        )
    }
    for _ in range(rng.integers(1, 3)):
        # Why by number: NumPy drops zero bytes at the end of a word.
        name = sorted(columns)[rng.integers(len(columns))]
        x = columns[name]
        choices = [
            lambda x: pa.array([str(v) for v in x]),
            lambda x: pa.array([[v] for v in x]),
            lambda x: pa.array([None] * len(x), pa.float64()),
            lambda x: pa.array([{"a": v} for v in x]),
            lambda x: pa.array([b"x"] * len(x)),
            lambda x: pa.array(np.arange(len(x)), pa.timestamp("ns")),
            lambda x: pa.array([True] * len(x)),
            lambda x: pa.array(np.full(len(x), 1e308)),
            lambda x: pa.array(np.zeros(len(x), "f2")),
            lambda x: pa.array([None if k % 3 else 1.0 for k in range(len(x))]),
            lambda x: pa.array(np.arange(len(x)), pa.duration("s")),
            lambda x: pa.nulls(len(x)),
            lambda x: pa.array(["a"] * len(x)).dictionary_encode(),
            lambda x: pa.array([10**17] * len(x), pa.decimal128(38, 2)),
            lambda x: (
                pa.array(np.arange(len(x), dtype="i4"), pa.date32())
                if len(x) < 3000
                else pa.nulls(len(x))
            ),
        ]
        if rng.random() < 0.3:
            columns[WORDS[rng.integers(len(WORDS))].encode("utf-8", "replace").decode()] = (
                columns.pop(name)
            )
        else:
            columns[name] = choices[rng.integers(len(choices))](np.asarray(x))
    if rng.random() < 0.1:
        columns = {name: values[:0] for name, values in columns.items()}
    if rng.random() < 0.1:
        columns = {name: np.zeros(30_000_000, "f4") for name in columns}
    stream = io.BytesIO()
    how = str(rng.choice(["snappy", "gzip", "brotli", "zstd", "lz4", "none"]))
    pq.write_table(pa.table(columns), stream, compression=how)
    return stream.getvalue()


def mcap(rng: np.random.Generator, original: bytes) -> bytes:
    """Return an MCAP file with other records, chunks that expand like bombs, or broken bytes."""
    if rng.random() < 0.6:
        return data(rng, original)
    import struct
    import zlib

    import lz4.frame
    import zstandard

    def record(op: int, content: bytes) -> bytes:
        return struct.pack("<BQ", op, len(content)) + content

    def text(s: str | bytes) -> bytes:
        raw = s if isinstance(s, bytes) else s.encode("utf-8", "replace")
        return struct.pack("<I", len(raw)) + raw

    name = WORDS[rng.integers(len(WORDS))] if rng.random() < 0.5 else "/joint_states"
    encoding = str(rng.choice(["cdr", "ros1", "json", "protobuf", ""]))
    fields = "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    inner = record(
        3,
        struct.pack("<H", 1)
        + text("sensor_msgs/msg/JointState")
        + text("ros2msg")
        + text("std_msgs/Header header\n" + fields),
    )
    inner += record(
        4,
        struct.pack("<HH", int(rng.choice([1, 1])), int(rng.choice([1, 1, 0, 9])))
        + text(name)
        + text(encoding)
        + struct.pack("<I", 0),
    )
    for k in range(50):
        raw = bytes([0, int(rng.choice([0, 1, 1, 1, 2])), 0, 0]) + rng.bytes(
            int(rng.choice([0, 10, 100, 300]))
        )
        inner += record(5, struct.pack("<HIQQ", 1, k, k * 10**7, k * 10**7) + raw)
    if rng.random() < 0.5:
        inner += record(int(rng.choice([5, 77, 128])), bytes(int(rng.choice([10, 200 << 20]))))
    how = str(rng.choice(["", "zstd", "lz4", "bz2"]))
    packed = {"zstd": lambda x: zstandard.compress(x), "lz4": lambda x: lz4.frame.compress(x)}.get(
        how, lambda x: x
    )(inner)
    said = int(rng.choice([len(inner), len(inner), 0, 2**62, len(inner) + 1]))
    chunk = (
        struct.pack("<QQQI", 0, 10**9, said, int(rng.choice([0, zlib.crc32(inner), 1])))
        + text(how)
        + struct.pack("<Q", len(packed))
        + packed
    )
    magic = b"\x89MCAP0\r\n"
    out = (
        magic
        + record(1, text("ros2") + text("x"))
        + (record(6, chunk) if rng.random() < 0.8 else inner)
    )
    if rng.random() < 0.7:
        out += (
            record(15, struct.pack("<I", 0))
            + record(2, struct.pack("<QQI", int(rng.choice([0, 8, 2**63, len(out)])), 0, 0))
            + magic
        )
    return out


def result(rng: np.random.Generator, original: bytes) -> bytes:
    """Return a result file that is whole and whose arrays hold values that no computation gives."""
    if rng.random() < 0.5:
        return broken_npz(rng, original)
    with np.load(io.BytesIO(original), allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    name = str(rng.choice([key for key in arrays if key != "header"]))
    x = arrays[name]
    if x.dtype.kind in "fiu" and x.size:
        with np.errstate(all="ignore"):
            if rng.random() < 0.3:
                arrays[name] = (x * rng.choice([0, -1, 1e-300, 1e-9, 1e9, 1e140])).astype(x.dtype)
            else:
                x = x.copy()
                value = (
                    rng.choice([np.nan, np.inf, -1, 0, 1e140, 2**31])
                    if x.dtype.kind == "f"
                    else rng.choice(
                        [
                            0,
                            -1 if x.dtype.kind == "i" else 0,
                            99,
                            2**31 - 1 if x.dtype.itemsize > 2 else 9,
                        ]
                    )
                )
                x.flat[rng.integers(0, x.size, max(1, x.size // 3))] = value
                arrays[name] = x
    header = str(arrays["header"])
    if rng.random() < 0.5:
        for old, new in (
            ("swing", WORDS[rng.integers(len(WORDS))]),
            ("shoulder", WORDS[rng.integers(len(WORDS))]),
        ):
            if rng.random() < 0.5:
                header = header.replace(old, json.dumps(new)[1:-1])
    if rng.random() < 0.2:
        header = header.replace(
            "0.", str(rng.choice(["1e999", "-0.", "0.0e-300", "12345678901234567890."])), 2
        )
    arrays["header"] = np.array(header)
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()
