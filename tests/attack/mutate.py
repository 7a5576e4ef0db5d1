"""Seeded mutations: the same seed gives the same broken inputs on any machine."""

from __future__ import annotations

import io
import json
import re
import struct
import zipfile
from pathlib import Path

import numpy as np

NUMBERS = (
    "1e308",
    "-1e308",
    "1e-308",
    "1e400",
    "nan",
    ".inf",
    "-inf",
    "0",
    "-0.0",
    "-1",
    "1e9",
    "123456789012345678901234567890",
    "1e-9",
    "0x10",
    "1_000",
    "010",
    "1:30",
    "''",
    "true",
    "[]",
    "{}",
    "null",
    "1e",
)
WORDS = (
    "\x1b[31mred\x1b[0m",
    "<script>alert(1)</script>",
    "'\"><img src=x onerror=alert(1)>",
    "../../HACKED",
    "/etc/HACKED",
    "$(touch HACKED)",
    "`touch HACKED`",
    "; touch HACKED",
    "a" * 5000,
    "\u202egnp",
    "\x00",
    "\x07",
    "&a *a",
    "=1+1",
    "%s%n",
    "--force",
    "$x_{1}$",
    "\\input{HACKED}",
    "*/ int x; /*",
    '"""\nopen("HACKED","w")\n"""',
    "\ud7ff",
    "",
    " ",
    "\r\n",
    "!!python/object/apply:os.system ['touch HACKED']",
    "{{7*7}}",
    "%{raw}",
    "'''",
    "-",
    "~",
    "é" * 300,
)
BLOBS = (
    "[" * 3000,
    "{" * 3000,
    "- " * 3000,
    "(" * 3000,
    "a: " * 500,
    "&a [*a, *a]",
    "\t",
    "\n" * 1000,
    "#" * 100_000,
    "\ufeff",
    "<!ENTITY a 'b'>",
    "<!DOCTYPE x [<!ENTITY e SYSTEM 'file:///etc/passwd'>]>&e;",
    "<a>" * 2000,
    '<?xml version="1.0" encoding="utf-99"?>',
    "1,2,3\n" * 10,
    "nan " * 50,
)


def text(rng: np.random.Generator, original: str) -> bytes:
    """Return a text file with one to four mistakes."""
    content = original
    for _ in range(rng.integers(1, 5)):
        kind = rng.integers(0, 8)
        lines = content.split("\n")
        place = int(rng.integers(0, len(lines)))
        if kind <= 2:
            found = list(re.finditer(r"-?\d+\.?\d*(?:e-?\d+)?", content))
            if found:
                match = found[rng.integers(len(found))]
                content = (
                    content[: match.start()] + str(rng.choice(NUMBERS)) + content[match.end() :]
                )
        elif kind <= 4:
            found = list(re.finditer(r"[A-Za-z_]{2,}", content))
            if found:
                match = found[rng.integers(len(found))]
                word = WORDS[rng.integers(len(WORDS))]
                if rng.random() < 0.5:
                    word = json.dumps(word)
                content = content[: match.start()] + word + content[match.end() :]
        elif kind == 5:
            lines.insert(place, BLOBS[rng.integers(len(BLOBS))])
            content = "\n".join(lines)
        elif kind == 6:
            lines[place : place + 1] = (
                [] if rng.random() < 0.5 else [lines[place]] * int(rng.integers(2, 40))
            )
            content = "\n".join(lines)
        else:
            content = content[: int(rng.integers(0, len(content) + 1))]
    raw = content.encode("utf-8", "surrogatepass")
    return raw if rng.random() < 0.85 else data(rng, raw)


def data(rng: np.random.Generator, original: bytes) -> bytes:
    """Return a binary file with a few broken bytes, lengths or pieces."""
    content = bytearray(original)
    for _ in range(rng.integers(1, 6)):
        if not content:
            break
        kind, place = rng.integers(0, 7), int(rng.integers(0, len(content)))
        if kind <= 1:
            content[place] ^= 1 << int(rng.integers(0, 8))
        elif kind <= 3:
            value = int(
                rng.choice(
                    [
                        0,
                        1,
                        0xFF,
                        0xFFFF,
                        0x7FFFFFFF,
                        0xFFFFFFFF,
                        0x10000000,
                        int(rng.integers(2**32)),
                    ]
                )
            )
            content[place : place + 4] = struct.pack("<I", value)
        elif kind == 4:
            del content[place : place + int(rng.integers(1, 200))]
        elif kind == 5:
            content[place:place] = content[max(0, place - int(rng.integers(1, 400))) : place]
        else:
            del content[place:]
    return bytes(content)


def _value(rng: np.random.Generator, old: object) -> object:
    choices: list[object] = [
        None,
        True,
        -1,
        0,
        1e308,
        float("inf"),
        float("nan"),
        [],
        {},
        "x",
        WORDS[rng.integers(len(WORDS))],
        [[]] * 50,
        10**30,
        [old, old],
        {"a": old},
        str(old),
        "1" * 400,
    ]
    return choices[rng.integers(len(choices))]


def facts(rng: np.random.Generator, document: object) -> object:
    """Return a JSON document in which one value is another one."""
    places: list[tuple[object, object]] = []

    def walk(node: object) -> None:
        items = (
            node.items()
            if isinstance(node, dict)
            else enumerate(node)
            if isinstance(node, list)
            else ()
        )
        for key, value in list(items):
            places.append((node, key))
            walk(value)

    walk(document)
    if places:
        node, key = places[rng.integers(len(places))]
        if isinstance(node, dict) and rng.random() < 0.25:
            del node[key]
        else:
            node[key] = _value(rng, node[key])
    return document


def array(rng: np.random.Generator, old: np.ndarray) -> np.ndarray:
    """Return an array with wrong values, type or shape."""
    kind = rng.integers(0, 10)
    if old.dtype.kind in "fiu" and old.size and kind <= 3:
        new = old.astype(float).copy()
        new.flat[rng.integers(old.size)] = rng.choice(
            [np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-308, 0, -1, 1e12]
        )
        return new if kind else np.full_like(new, rng.choice([np.nan, 0.0, 1e300, -1.0]))
    if kind == 4:
        return old[: len(old) // 2] if old.ndim else np.array([old, old])
    if kind == 5:
        return old[..., None]
    if kind == 6:
        return old.astype(str)
    if kind == 7:
        return np.array(["2020-01-01"], dtype="datetime64[D]")
    if kind == 8:
        return np.zeros((0, *old.shape[1:]))
    return np.arange(7)[:, None] * np.ones(
        3, dtype=rng.choice([np.complex128, np.int8, np.float16])
    )


def npz(rng: np.random.Generator, original: bytes) -> bytes:
    """Return a result file with another header, other arrays, or another kind of archive."""
    if rng.random() < 0.15:
        return data(rng, original)
    with np.load(io.BytesIO(original), allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = json.loads(str(arrays.pop("header", "{}")))
    for _ in range(rng.integers(1, 3)):
        if rng.random() < 0.5 or not arrays:
            header = facts(rng, header)
        else:
            name = str(rng.choice(sorted(arrays)))
            if rng.random() < 0.2:
                del arrays[name]
            else:
                arrays[name] = array(rng, arrays[name])
    kind = rng.integers(0, 12)
    stream = io.BytesIO()
    how = {0: zipfile.ZIP_BZIP2, 1: zipfile.ZIP_LZMA}.get(int(kind), zipfile.ZIP_DEFLATED)
    with zipfile.ZipFile(stream, "w", how) as archive:
        for name, values in {"header": np.array(json.dumps(header)), **arrays}.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asanyarray(values), allow_pickle=False)
            content = member.getvalue()
            if kind == 2 and rng.random() < 0.3:
                content = re.sub(rb"'shape': \([^)]*\)", b"'shape': (1000000000000,)", content)
            if kind == 3 and rng.random() < 0.3:
                content = content[:10] + b"[" * 4000 + content[10:]
            archive.writestr(f"{name}.npy", content)
        if kind == 4:
            archive.writestr("bomb.npy", bytes(50 << 20))
    return stream.getvalue()


def write(path: Path, content: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path
