"""How a text table is written: delimiter, decimal sign, header, units; and its cells as numbers."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dynid.arrays import Floats
from dynid.errors import LogLayout, LogNotFound
from dynid.files import tuning

Words = tuple[str, ...]

DELIMITERS = (";", "\t", ",")
#: What lines that hold no numbers begin with, of which the last may be the header.
COMMENT = "#%"
#: Cells that mean no number, as nan does.
NONE = ("", "na", "n/a", "null", "none")
_WITH_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", re.ASCII)
_NUMBER = re.compile(r"[+-]?\.?\d|nan\b", re.IGNORECASE | re.ASCII)


@dataclass(frozen=True)
class TextTable:
    """A text table, and how it is written.

    Attributes:
        path: the file.
        delimiter: between cells; None for white space.
        comma: whether numbers have decimal commas.
        names: words of the header, () where there is none.
        units: words of a line of units below the header, () where there is none.
        start: number of the first line of numbers.
        first: cells of the first row.
    """

    path: Path
    delimiter: str | None
    comma: bool
    names: Words
    units: Words
    start: int
    first: Words

    @property
    def width(self) -> int:
        """Cells of a row; a delimiter at its end begins none."""
        return len(self.names) or len(self.first)

    def wrong(self, text: str, fix: str = "", line: int = 1) -> LogLayout:
        """Return a mistake in a line of the table."""
        return LogLayout(f"{self.path.name}:{line}: {text}", where=f"{self.path}:{line}", fix=fix)

    def read(self, places: Sequence[int]) -> Floats:
        """Return some columns, (N, k): at once where all cells are plain numbers.

        Raises:
            LogNotFound: it is no text.
            LogLayout: a cell is not a number, a row has another number of cells, or there is none.
        """
        if not self.first:
            raise LogLayout(f"{self.path.name} has no samples", where=self.path)
        try:
            return np.loadtxt(
                self._decimal_lines(),
                delimiter=self.delimiter,
                comments=None,
                quotechar='"',
                ndmin=2,
                usecols=places,
            )
        except ValueError:
            return np.array([self._row(number, line, places) for number, line in self._lines()])

    def _lines(self) -> Iterator[tuple[int, str]]:
        """Yield the lines of numbers."""
        for number, line in lines_of(self.path):
            if number >= self.start and line[0] not in COMMENT:
                yield number, line

    def _decimal_lines(self) -> Iterator[str]:
        """Yield the lines of numbers with decimal points; ``ValueError`` where one has to be read by cells."""
        for _, line in self._lines():
            # Points next to decimal commas group thousands: 1.234 must not be read.
            grouped = self.comma and "." in line
            if grouped or (self.delimiter and line.count(self.delimiter) != len(self.first) - 1):
                raise ValueError
            yield line.replace(",", ".") if self.comma else line

    def _row(self, number: int, line: str, places: Sequence[int]) -> list[float]:
        """Return the numbers of one row; an empty cell is not a number, words are named."""
        cells = cells_of(line, self.delimiter)
        if len(cells) != self.width and not (len(cells) == self.width + 1 and not cells[-1]):
            raise self.wrong(f"{len(cells)} numbers, expected {self.width}", line=number)
        row = []
        for cell in map(cells.__getitem__, places):
            try:
                decimal = cell.replace(".", "?").replace(",", ".") if self.comma else cell
                row.append(float("nan" if cell.lower() in NONE else decimal))
            except ValueError as error:
                raise self.wrong(f"'{cell[:40]}' is not a number", line=number) from error
        return row


def text_table(path: Path) -> TextTable:
    """Tell how a text is written from its first lines.

    Why not csv.Sniffer: it takes a decimal comma for a delimiter.

    Raises:
        LogNotFound: it cannot be read, or is no text.
        LogLayout: the header names another number of columns than the rows have.
    """
    head = []
    rows: list[str] = []
    start = 0
    for number, line in lines_of(path):
        if line[0] not in COMMENT and (rows or _is_data(line)):
            start = start or number
            rows.append(line)
        elif not rows:
            head.append((number, line))
        if len(rows) >= tuning.FIRST_ROWS or number >= tuning.FIRST_LINES:
            break
    texts = [line for _, line in head if line[0] not in COMMENT]
    model = (rows or texts[-1:] or [""])[0]
    delimiter = next((sign for sign in DELIMITERS if sign in model.strip()), None)
    if delimiter == "," and len(model.split()) > 1 and texts and "," not in "".join(texts):
        # White space between decimal commas: the names have no comma.
        delimiter = None
    cells = [cell for line in rows for cell in cells_of(line, delimiter)]
    commas = sum(bool(_WITH_COMMA.fullmatch(cell)) for cell in cells)
    comma = delimiter != "," and commas > sum("." in cell for cell in cells)
    first = tuple(cells_of(model, delimiter))
    table = TextTable(path, delimiter, comma, (), (), start, first)
    names, units = _header(table, head)
    return replace(table, names=names, units=units, first=first if rows else ())


def _header(table: TextTable, head: Sequence[tuple[int, str]]) -> tuple[Words, Words]:
    """Return the names of the columns, and the words of a line of units below them.

    Raises:
        LogLayout: there are names, but not as many as cells.
    """
    n = len(table.first)
    fits = {n, n - (n > 1 and not table.first[-1])}
    texts: list[Words] = []
    comments: list[Words] = [()]
    wrong = []
    for number, line in head:
        words = tuple(cells_of(line.lstrip("#% "), table.delimiter))
        if len(words) - 1 in fits and not words[-1]:
            words = words[:-1]
        if len(words) in fits:
            (comments if line[0] in COMMENT else texts).append(words)
        elif line[0] not in COMMENT and len(words) > 1:
            wrong.append((number, len(words)))
    if not texts and wrong:
        number, count = wrong[-1]
        raise table.wrong(f"{count} names, but the rows have {n} numbers", line=number)
    if not texts:
        return comments[-1], ()
    # Why the most words: a spreadsheet fills a title with empty cells.
    at = max(range(len(texts)), key=lambda k: len(set(texts[k]) - {""}))
    below = next(iter(texts[at + 1 :]), ())
    return texts[at], below if len(below) == len(texts[at]) else ()


def cells_of(line: str, delimiter: str | None) -> list[str]:
    """Return the cells of a line, without quotes."""
    if delimiter is not None and '"' in line:
        try:
            (cells,) = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
            return [cell.strip() for cell in cells]
        except (csv.Error, ValueError):
            pass
    return [cell.strip().strip('"') for cell in line.split(delimiter)]


def _is_data(line: str) -> bool:
    """Return whether most words of a line begin like numbers."""
    words = [word for word in re.split(r'[;,\s"]+', line) if word]
    return 2 * sum(bool(_NUMBER.match(word)) for word in words) > len(words)


def lines_of(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines that hold something, with their numbers.

    Raises:
        LogNotFound: it cannot be read, or is no text.
    """
    try:
        with path.open(encoding="utf-8-sig") as stream:
            for number, text in enumerate(stream, 1):
                # Why: a tab at an end means an empty cell.
                line = text.strip(" \r\n\f\v")
                # Why: spreadsheets end with rows of delimiters alone.
                if line.strip(';,\t" '):
                    yield number, line
    except OSError as error:
        raise LogNotFound(f"cannot read {path}: {error.strerror}", where=path) from error
    except UnicodeDecodeError as error:
        raise LogNotFound(
            f"{path.name} is not a text file", where=path, fix="save it as UTF-8"
        ) from error
