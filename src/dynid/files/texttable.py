"""How a text table is written: delimiter, decimal sign, header, units; and its cells as numbers."""

from __future__ import annotations

import csv
import re
from array import array
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from dynid.arrays import Floats
from dynid.errors import LogLayout, LogNotFound
from dynid.files import tuning
from dynid.files.columnwords import with_unit

DELIMITERS = (";", "\t", ",")
#: What lines that hold no numbers begin with, of which the last may be the header.
COMMENT = "#%"
_WITH_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", re.ASCII)
_NUMBER = re.compile(r"[+-]?\.?\d|nan\b", re.IGNORECASE | re.ASCII)


@dataclass(frozen=True)
class TextTable:
    """A text table, and how it is written.

    Attributes:
        path: the file.
        delimiter: between cells; None for white space.
        comma: whether numbers have decimal commas.
        start: number of the first line of numbers.
        first: cells of the first row.
        names: words of the header, each with its unit of a line below it in brackets; empty where there is none.
    """

    path: Path
    delimiter: str | None
    comma: bool
    start: int
    first: list[str]
    names: Sequence[str] = ()

    def wrong(self, text: str, fix: str = "", line: int = 1) -> LogLayout:
        """Return a mistake in a line of the table."""
        return LogLayout(f"{self.path.name}:{line}: {text}", where=f"{self.path}:{line}", fix=fix)

    def read(self, names: Sequence[str] = ()) -> Floats:
        """Return some columns by their names, nan for "", and all columns where none is given, (N, k).

        Raises:
            LogNotFound: it is no text.
            LogLayout: a cell is not a number, or a row has another number of cells.
        """
        width = len(self.first)
        places = [self.names.index(name) if name else width for name in names] or range(width)
        values = array("d")
        for number, line in _lines(self.path):
            if number < self.start or line[0] in COMMENT:
                continue
            cells = _cells(line, self.delimiter)
            if len(cells) != width:
                raise self.wrong(f"{len(cells)} numbers, expected {width}", line=number)
            cells.append("")
            values.extend([self._number(cells[k], number) for k in places])
        return np.reshape(values, (-1, len(places)))

    def _number(self, cell: str, line: int) -> float:
        """Return a cell as a number, nan where it is empty."""
        # Points next to decimal commas group thousands: 1.234 must not be read.
        decimal = cell.replace(".", "?").replace(",", ".") if self.comma else cell
        try:
            return float(decimal or "nan")
        except ValueError as error:
            raise self.wrong(f"'{cell[:40]}' is not a number", line=line) from error


def text_table(path: Path) -> TextTable:
    """Tell how a text is written from its first lines.

    Why not csv.Sniffer: it takes a decimal comma for a delimiter.

    Raises:
        LogNotFound: it cannot be read, or is no text.
        LogLayout: there are no rows, or the header names another number of columns than they have.
    """
    lines = list(islice(_lines(path), tuning.FIRST_LINES))
    plain = [k for k, (_, line) in enumerate(lines) if line[0] not in COMMENT]
    begin = next((k for k in plain if _is_data(lines[k][1])), None)
    if begin is None:
        raise LogLayout(f"{path.name} has no samples", where=path)
    start, model = lines[begin]
    delimiter = next((sign for sign in DELIMITERS if sign in model.strip()), None)
    first = _cells(model, delimiter)
    cells = [cell for k in plain if k >= begin for cell in _cells(lines[k][1], delimiter)]
    commas = sum(bool(_WITH_COMMA.fullmatch(cell)) for cell in cells)
    comma = delimiter != "," and commas > sum("." in cell for cell in cells)
    table = TextTable(path, delimiter, comma, start, first)
    return replace(table, names=_header(table, lines[:begin]))


def _header(table: TextTable, head: Sequence[tuple[int, str]]) -> list[str]:
    """Return the names of the columns, with the units of a line below them, from the lines before the rows.

    Raises:
        LogLayout: there are names, but not as many as cells.
    """
    n = len(table.first)
    texts: list[list[str]] = []
    comment: list[str] = []
    wrong = None
    for number, line in head:
        words = _cells(line.lstrip("#% "), table.delimiter)
        if line[0] in COMMENT:
            comment = words if len(words) == n else comment
        elif len(words) == n:
            texts.append(words)
        elif len(words) > 1:
            wrong = table.wrong(f"{len(words)} names, but the rows have {n} numbers", line=number)
    if wrong and not (texts or comment):
        raise wrong
    if not texts:
        return comment
    # Why the most words: a spreadsheet fills a title with empty cells.
    at = max(range(len(texts)), key=lambda k: len(set(texts[k]) - {""}))
    return [*map(with_unit, texts[at], [*texts, [""] * n][at + 1])]


def _cells(line: str, delimiter: str | None) -> list[str]:
    """Return the cells of a line, without quotes."""
    cells = line.split(delimiter)
    if delimiter and '"' in line:
        with suppress(csv.Error):
            (cells,) = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
    return [cell.strip().strip('"') for cell in cells]


def _is_data(line: str) -> bool:
    """Return whether most words of a line begin like numbers."""
    words = re.findall(r'[^;,\s"]+', line)
    return 2 * sum(bool(_NUMBER.match(word)) for word in words) > len(words)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines that hold something, with their numbers.

    Raises:
        LogNotFound: it cannot be read, or is no text.
    """
    try:
        with path.open(encoding="utf-8-sig") as stream:
            for number, text in enumerate(stream, 1):
                # Why: a tab at an end means an empty cell, and spreadsheets end with rows of delimiters alone.
                line = text.strip(" \r\n\f\v")
                if line.strip(';,\t" '):
                    yield number, line
    except OSError as error:
        raise LogNotFound(f"cannot read {path}: {error.strerror}", where=path) from error
    except UnicodeDecodeError as error:
        raise LogNotFound(
            f"{path.name} is not a text file", where=path, fix="save it as UTF-8"
        ) from error
