"""Text logs: the paper's folder of position.txt, velocity.txt, torque.txt.

Reads text, writes nothing. One row per sample, one column per joint; white space or commas; an optional line of names.
"""

from __future__ import annotations

import codecs
import io
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count as count_from
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from dynid import limits
from dynid.errors import LogLayout, LogNotFound, WrongUsage
from dynid.log import Log

Floats = NDArray[np.float64]

#: Names of a column that is time.
TIME_NAMES = ("t", "time", "stamp", "timestamp", "seconds", "time_s", "t_s", "t[s]", "time[s]")
#: Rows that are turned into numbers together.
BLOCK = 20_000
#: Bytes from which the encoding is told.
ENCODED = 1 << 16
_SPLIT = re.compile(r"[,;\s]+")
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1f]")


@dataclass(frozen=True)
class _Table:
    """One text file.

    Attributes:
        path: the file.
        names: header words, () without header.
        values: (N, columns).
    """

    path: Path
    names: tuple[str, ...]
    values: Floats


def read_folder(path: Path, rate: float | None = None) -> Log:
    """Read the paper's text files from a folder.

    Args:
        path: folder with position.txt, torque.txt and, if recorded, velocity.txt and time.txt.
        rate: samples per second where no file has the time [Hz].

    Raises:
        LogNotFound: position.txt or torque.txt is not there.
        LogLayout: rows or columns do not agree.
        WrongUsage: no file has the time, and no rate is given.
    """
    for name in ("position.txt", "torque.txt"):
        if not (path / name).is_file():
            raise LogNotFound(f"{path} has no {name}", where=str(path))
    position = _read_table(path / "position.txt")
    t, position = _time(path, position, rate)
    tables = {"position": position}
    for key in ("velocity", "torque"):
        if (path / f"{key}.txt").is_file():
            tables[key] = _without_time(_read_table(path / f"{key}.txt"))
    names = next((table.names for table in tables.values() if table.names), ())
    for table in tables.values():
        _check_rows(table, len(t))
    arrays = {key: _in_order(table, names, position.values.shape[1]) for key, table in tables.items()}
    return Log(t, arrays["position"], arrays["torque"], names, arrays.get("velocity"), source=path)


def _read_table(path: Path) -> _Table:
    """Read one text file block by block; its first line may hold names."""
    names: tuple[str, ...] = ()
    rows: list[tuple[int, str]] = []
    blocks: list[Floats] = []
    width = first = count = 0
    try:
        with limits.open_file(path) as stream:
            limits.check("text_bytes", os.fstat(stream.fileno()).st_size, path)
            for number, line in lines_of(stream, path):
                if not first:
                    first = number
                    bare = line.lstrip("#% ")
                    if not _is_numbers(bare):
                        names = tuple(_words(bare))
                        limits.check("columns", len(names), path)
                        limits.check("name_length", max(map(len, names)), path)
                        continue
                if line[0] in "#%":
                    continue
                width = width or len(names) or len(_words(line))
                rows.append((number, line))
                if len(rows) == BLOCK:
                    count += len(rows)
                    limits.check("samples", count, path)
                    blocks.append(_numbers(path, rows, width))
                    rows = []
    except OSError as error:
        raise LogNotFound(f"cannot read {path}: {error.strerror}", where=str(path)) from error
    except UnicodeDecodeError as error:
        raise LogNotFound(f"{path.name} is not a text file", where=str(path)) from error
    if rows:
        blocks.append(_numbers(path, rows, width))
    if not blocks:
        raise LogLayout(f"{path.name} has no samples", where=str(path))
    return _Table(path, names, blocks[0] if len(blocks) == 1 else np.concatenate(blocks))


def lines_of(stream: IO[bytes], path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines that hold something, with their numbers, each no longer than the limit."""
    most = int(limits.limit("line_bytes"))
    text = io.TextIOWrapper(stream, encoding=_encoding(stream))
    for number in count_from(1):
        line = text.readline(most + 1)
        if not line:
            return
        limits.check("line_bytes", len(line), f"{path}:{number}")
        # Why: a tab at an end stands beside an empty cell; spreadsheets fill rows up with delimiters alone.
        if (line := line.strip(" \r\n\f\v")).strip(';,|" \t'):
            yield number, line


def _encoding(stream: IO[bytes]) -> str:
    """Return the encoding of a text: by its mark, UTF-8 where that fits, else that of western Windows."""
    start = stream.read(ENCODED)
    stream.seek(0)
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8-sig")().decode(start)
    except UnicodeDecodeError:
        # Why: a text has no control characters; what has some is another kind of file, and named as that.
        return "utf-8-sig" if _CONTROL.search(start) else "cp1252"
    return "utf-8-sig"


def _numbers(path: Path, rows: list[tuple[int, str]], width: int) -> Floats:
    """Return the numbers of some rows: at once where they are plain, else row by row to name what is wrong."""
    limits.check("columns", width, path)
    delimiter = next((sign for sign in ",;" if sign in rows[0][1]), None)
    try:
        values: Floats = np.loadtxt([line for _, line in rows], delimiter=delimiter, comments=None, ndmin=2)
    except ValueError:
        return np.array([_row(path, i, line, width) for i, line in rows], dtype=float)
    if values.shape == (len(rows), width):
        return values
    return np.array([_row(path, i, line, width) for i, line in rows], dtype=float)


def _words(line: str) -> list[str]:
    """Split at commas if there are any (an empty cell stays a cell), else at white space."""
    if "," in line or ";" in line:
        return [word.strip().strip('"') for word in re.split("[,;]", line.rstrip(",; "))]
    return _SPLIT.split(line.strip())


def _is_numbers(line: str) -> bool:
    return all(_is_number(word) for word in _words(line) if word)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _row(path: Path, number: int, line: str, width: int) -> list[float]:
    words = _words(line)
    if len(words) != width:
        raise LogLayout(f"{path.name}:{number}: {len(words)} numbers, expected {width}", where=f"{path}:{number}")
    try:
        return [float(word) if word else float("nan") for word in words]
    except ValueError:
        bad = next(word for word in words if word and not _is_number(word))
        raise LogLayout(f"{path.name}:{number}: '{bad}' is not a number", where=f"{path}:{number}") from None


def _time(path: Path, position: _Table, rate: float | None) -> tuple[Floats, _Table]:
    """Return the time and the position table without its time column."""
    if (path / "time.txt").is_file():
        time = _read_table(path / "time.txt")
        _check_rows(time, len(position.values))
        return time.values[:, 0], _without_time(position)
    if position.names and position.names[0].lower() in TIME_NAMES:
        return position.values[:, 0], _without_time(position)
    if rate is None:
        raise WrongUsage(
            f"{path} has no time.txt and position.txt no time column",
            where=str(path),
            why="derivatives need the time of each sample",
            fix="give the sample rate: --rate 100",
        )
    return np.arange(len(position.values)) / positive_rate(rate), position


def positive_rate(rate: float | None) -> float:
    """Return the sample rate that the user gave [Hz].

    Raises:
        WrongUsage: it is none.
    """
    if rate is None or not np.isfinite(rate) or rate <= 0:
        raise WrongUsage(f"--rate {rate} is not a sample rate", fix="give samples per second, such as --rate 100")
    return rate


def _without_time(table: _Table) -> _Table:
    if table.names and table.names[0].lower() in TIME_NAMES:
        return _Table(table.path, table.names[1:], table.values[:, 1:])
    return table


def _check_rows(table: _Table, rows: int) -> None:
    if len(table.values) != rows:
        raise LogLayout(f"{table.path.name} has {len(table.values)} rows, expected {rows}", where=str(table.path))


def _in_order(table: _Table, names: Sequence[str], width: int) -> Floats:
    """Return the columns in the order of ``names``; a file without header has the order of the others."""
    if table.values.shape[1] != width:
        raise LogLayout(
            f"{table.path.name} has {table.values.shape[1]} columns, position.txt {width}", where=str(table.path)
        )
    if not table.names or tuple(table.names) == tuple(names):
        return table.values
    missing = [name for name in names if name not in table.names]
    if missing:
        raise LogLayout(f"{table.path.name}:1: no column '{missing[0]}'", where=f"{table.path}:1")
    return table.values[:, [table.names.index(name) for name in names]]
