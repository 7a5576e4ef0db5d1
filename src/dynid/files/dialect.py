"""How a text table is written: delimiter, decimal sign, header, units; and its cells as numbers."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.errors import LogLayout, LogNotFound
from dynid.files import tuning

Floats = NDArray[np.float64]

DELIMITERS = (";", "\t", ",")
#: Cells that say that there is no number, beside nan.
NONE = ("", "na", "n/a", "null", "none")
_WITH_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True)
class Dialect:
    """How a text table is written.

    Attributes:
        delimiter: between cells; None for white space.
        comma: whether numbers have decimal commas.
        names: words of the header, () where there is none.
        units: words of a line of units below the header, () where there is none.
        start: number of the first line of numbers.
        first: cells of the first row.
    """

    delimiter: str | None
    comma: bool
    names: tuple[str, ...]
    units: tuple[str, ...]
    start: int
    first: tuple[str, ...]

    @property
    def width(self) -> int:
        """Cells of a row; a delimiter at its end begins none."""
        return len(self.names) or len(self.first)

    def read(self, path: Path, places: Sequence[int]) -> Floats:
        """Return some columns of a text, (N, k): at once where all cells are plain numbers.

        Raises:
            LogNotFound: it is no text.
            LogLayout: a cell is not a number, a row has another number of cells, or there is none.
        """
        if not self.first:
            raise LogLayout(f"{path.name} has no samples", where=str(path))
        try:
            return np.loadtxt(
                self._plain(path),
                delimiter=self.delimiter,
                comments=None,
                quotechar='"',
                ndmin=2,
                usecols=places,
            )
        except ValueError:
            rows = self._lines(path)
            return np.array([self._row(f"{path.name}:{k}", path, x, places) for k, x in rows])

    def _lines(self, path: Path) -> Iterator[tuple[int, str]]:
        """Yield the lines of numbers."""
        for number, line in lines_of(path):
            if number >= self.start and line[0] not in "#%":
                yield number, line

    def _plain(self, path: Path) -> Iterator[str]:
        """Yield the lines of numbers with decimal points; ``ValueError`` where one needs a look at its cells."""
        for _, line in self._lines(path):
            # Points beside decimal commas group thousands: 1.234 must not be read.
            grouped = self.comma and "." in line
            if grouped or (self.delimiter and line.count(self.delimiter) != len(self.first) - 1):
                raise ValueError
            yield line.replace(",", ".") if self.comma else line

    def _row(self, place: str, path: Path, line: str, places: Sequence[int]) -> list[float]:
        """Return the numbers of one row; an empty cell is not a number, words are named."""
        cells = cells_of(line, self.delimiter)
        where = f"{path.parent / place}"
        if len(cells) != self.width and not (len(cells) == self.width + 1 and not cells[-1]):
            raise LogLayout(f"{place}: {len(cells)} numbers, expected {self.width}", where=where)
        try:
            return [self._number(cell) for cell in map(cells.__getitem__, places)]
        except ValueError as error:
            raise LogLayout(f"{place}: {error}", where=where) from error

    def _number(self, cell: str) -> float:
        if cell.lower() in NONE:
            return float("nan")
        try:
            return float(cell.replace(".", "?").replace(",", ".") if self.comma else cell)
        except ValueError as error:
            raise ValueError(f"'{cell[:40]}' is not a number") from error


def dialect_of(path: Path) -> Dialect:
    """Tell the dialect of a text from its first lines.

    Why not csv.Sniffer: it takes a decimal comma for a delimiter.

    Raises:
        LogNotFound: it cannot be read, or is no text.
        LogLayout: the header names another number of columns than the rows have.
    """
    head: list[tuple[int, str]] = []
    rows: list[str] = []
    start = 0
    for number, line in lines_of(path):
        if line[0] not in "#%" and (rows or _is_data(line)):
            start = start or number
            rows.append(line)
        elif not rows:
            head.append((number, line))
        if len(rows) >= tuning.FIRST_ROWS or number >= tuning.FIRST_LINES:
            break
    plain = [line for _, line in head if line[0] not in "#%"]
    model = (rows or plain[-1:] or [""])[0]
    delimiter = next((sign for sign in DELIMITERS if sign in model.strip()), None)
    if delimiter == "," and len(model.split()) > 1 and plain and "," not in "".join(plain):
        # White space between decimal commas: the names have no comma.
        delimiter = None
    cells = [cell for line in rows for cell in cells_of(line, delimiter)]
    commas = sum(bool(_WITH_COMMA.fullmatch(cell)) for cell in cells)
    comma = delimiter != "," and commas > sum("." in cell for cell in cells)
    first = tuple(cells_of(model, delimiter))
    names, units = _header(path, head, delimiter, first)
    return Dialect(delimiter, comma, names, units, start, first if rows else ())


def _header(
    path: Path, head: Sequence[tuple[int, str]], delimiter: str | None, first: Sequence[str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the columns, and the words of a line of units below them.

    Raises:
        LogLayout: there are names, but not as many as cells.
    """
    fits = {len(first), len(first) - (len(first) > 1 and not first[-1])}
    plain: list[tuple[str, ...]] = []
    told: list[tuple[str, ...]] = []
    wrong = None
    for number, line in head:
        words = cells_of(line.lstrip("#% "), delimiter)
        if len(words) - 1 in fits and not words[-1]:
            words = words[:-1]
        if len(words) in fits:
            (told if line[0] in "#%" else plain).append(tuple(words))
        elif line[0] not in "#%" and len(words) > 1:
            wrong = number, len(words)
    if not plain and wrong:
        text = f"{path.name}:{wrong[0]}: {wrong[1]} names, but the rows have {len(first)} numbers"
        raise LogLayout(text, where=f"{path}:{wrong[0]}")
    if not plain:
        return (told[-1] if told else ()), ()
    # Why the most words: a spreadsheet fills a title with empty cells.
    at = max(range(len(plain)), key=lambda k: len(set(plain[k]) - {""}))
    below = plain[at + 1 :]
    return plain[at], below[0] if below and len(below[0]) == len(plain[at]) else ()


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
    numbers = [re.match(r"[+-]?\.?\d|nan\b", word, re.IGNORECASE | re.ASCII) for word in words]
    return 2 * sum(map(bool, numbers)) > len(words)


def lines_of(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines that hold something, with their numbers.

    Raises:
        LogNotFound: it cannot be read, or is no text.
    """
    try:
        with path.open(encoding="utf-8-sig") as stream:
            for number, text in enumerate(stream, 1):
                # Why: a tab at an end stands beside an empty cell.
                line = text.strip(" \r\n\f\v")
                # Why: spreadsheets end with rows of delimiters alone.
                if line.strip(';,\t" '):
                    yield number, line
    except OSError as error:
        raise LogNotFound(f"cannot read {path}: {error.strerror}", where=str(path)) from error
    except UnicodeDecodeError as error:
        raise LogNotFound(
            f"{path.name} is not a text file", where=str(path), fix="save it as UTF-8"
        ) from error
