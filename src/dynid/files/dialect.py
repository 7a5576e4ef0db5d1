"""How a text table is written: encoding, delimiter, decimal sign, header, dates; and its cells as numbers.

Told from the first lines: exports of spreadsheets in any country, of recorders and of plotting tools.
"""

from __future__ import annotations

import codecs
import csv
import io
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from itertools import count as count_from
from itertools import pairwise
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from dynid import limits
from dynid.errors import LogLayout, LogNotFound
from dynid.files import tuning

Floats = NDArray[np.float64]

DELIMITERS = (";", "\t", "|", ",")
#: Cells that say that there is no number.
NONE = {"", "nan", "na", "n/a", "null", "none", "-", "--", "#n/a"}
_SPACES = "'\u2019\u00a0\u202f "
_EXPONENT = r"(?:[eE][+-]?\d+)?"
#: Numbers with groups of three, by whether their decimals follow a comma.
_GROUPED = {
    True: re.compile(rf"[+-]?\d{{1,3}}(?:[.{_SPACES}]\d{{3}})+(?:,\d*)?{_EXPONENT}", re.ASCII),
    False: re.compile(rf"[+-]?\d{{1,3}}(?:[,{_SPACES}]\d{{3}})+(?:\.\d*)?{_EXPONENT}", re.ASCII),
}
_WITH_COMMA = re.compile(rf"[+-]?\d*,\d+{_EXPONENT}", re.ASCII)
_WITH_POINT = re.compile(rf"[+-]?\d*\.\d+{_EXPONENT}", re.ASCII)

_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1f]")
#: Seconds of a day, and days from year 1 to 1970.
DAY, EPOCH = 86400.0, date(1970, 1, 1).toordinal()
_STAMP = re.compile(
    r"""(?:(?:(?P<year>\d{4})[-/.](?P<month>\d\d?)[-/.](?P<day>\d\d?)
          |(?P<first>\d\d?)(?P<mark>[./-])(?P<second>\d\d?)(?P=mark)(?P<last>\d{4}))
        (?:T|\s+))?
        (?P<hour>\d{1,3}):(?P<minute>[0-5]\d):(?P<whole>[0-5]\d)(?:[.,](?P<part>\d{1,12}))?
        \s*(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?""",
    re.VERBOSE | re.ASCII,
)


@dataclass(frozen=True)
class Dialect:
    """How a text table is written.

    Attributes:
        delimiter: between cells; None for white space.
        comma: whether numbers have decimal commas.
        names: words of the header, () where there is none.
        start: number of the first line of numbers.
        width: cells of a row.
        first: cells of the first row.
        units: words of a line of units below the header, () where there is none.
    """

    delimiter: str | None
    comma: bool
    names: tuple[str, ...]
    start: int
    width: int
    first: tuple[str, ...]
    units: tuple[str, ...] = ()

    def date(self, place: int) -> int | None:
        """Return what the dates of a column are counted from [whole seconds]; None where it holds numbers."""
        stamp = seconds_of(self.first[place]) if place < len(self.first) else None
        return stamp[0] if stamp else None

    def read(self, path: Path, places: Sequence[int]) -> Iterator[Floats]:
        """Yield some columns of a text, block by block, (N, k).

        Raises:
            LogNotFound: it is no text.
            LogLayout: a cell is not a number, or a row has another number of cells.
            TooLarge: the text or a line of it is longer than the limit.
        """
        rows: list[tuple[int, str]] = []
        try:
            with limits.open_file(path) as stream:
                limits.check("text_bytes", os.fstat(stream.fileno()).st_size, path)
                for number, line in lines_of(stream, path):
                    if number < self.start or not self.start or line[0] in "#%":
                        continue
                    rows.append((number, line))
                    if len(rows) == tuning.ROWS:
                        yield self._numbers(path, rows, places)
                        rows = []
        except UnicodeDecodeError as error:
            raise LogNotFound(f"{path.name} is not a text file", where=str(path)) from error
        if rows:
            yield self._numbers(path, rows, places)

    def _numbers(
        self, path: Path, rows: Sequence[tuple[int, str]], places: Sequence[int]
    ) -> Floats:
        """Return some columns of some rows, (N, k): at once where all cells are plain numbers."""
        lines = [line for _, line in rows]
        dates = [self.date(place) for place in places]
        # Why: a quoted comma is no delimiter, and a point beside decimal commas groups thousands.
        plain = not any(day is not None for day in dates) and not any('"' in line for line in lines)
        if plain and not (self.comma and any("." in line for line in lines)):
            if (
                self.delimiter is not None
                and len({line.count(self.delimiter) for line in lines}) > 1
            ):
                return np.array(
                    [self._row(path, number, line, places, dates) for number, line in rows]
                )
            ready = [line.replace(",", ".") for line in lines] if self.comma else lines
            try:
                return np.asarray(
                    np.loadtxt(
                        ready, delimiter=self.delimiter, comments=None, ndmin=2, usecols=places
                    )
                )
            except ValueError:
                pass
        return np.array([self._row(path, number, line, places, dates) for number, line in rows])

    def _row(
        self, path: Path, number: int, line: str, places: Sequence[int], dates: Sequence[int | None]
    ) -> list[float]:
        """Return the numbers of one row; an empty cell is not a number, words are named."""
        cells = cells_of(line, self.delimiter)
        if len(cells) != self.width and not (len(cells) == self.width + 1 and not cells[-1]):
            text = f"{path.name}:{number}: {len(cells)} numbers, expected {self.width}"
            raise LogLayout(text, where=f"{path}:{number}")
        values = []
        for place, day in zip(places, dates, strict=True):
            value = (
                as_number(cells[place], comma=self.comma)
                if day is None
                else _since(cells[place], day)
            )
            if value is None:
                text = f"{path.name}:{number}: '{cells[place][:40]}' is not a number"
                raise LogLayout(text, where=f"{path}:{number}")
            values.append(value)
        return values


def as_number(word: str, *, comma: bool) -> float | None:
    """Return the number of a cell, NaN for one that says it has none, None for other words."""
    if word.lower() in NONE:
        return float("nan")
    if _GROUPED[comma].fullmatch(word):
        word = re.sub(rf"[{'.' if comma else ','}{_SPACES}]", "", word)
    try:
        return float(word.replace(",", ".") if comma else word)
    except ValueError:
        return None


def _since(word: str, day: int) -> float | None:
    if word.lower() in NONE:
        return float("nan")
    stamp = seconds_of(word)
    return None if stamp is None else (stamp[0] - day) + stamp[1]


def cells_of(line: str, delimiter: str | None) -> list[str]:
    """Return the cells of a line, without quotes."""
    if delimiter is None:
        return [word.strip('"') for word in line.split()]
    if '"' in line:
        try:
            return [
                cell.strip()
                for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
            ]
        except csv.Error:
            pass
    return [cell.strip() for cell in line.split(delimiter)]


def dialect_of(path: Path) -> Dialect:
    """Tell the dialect of a text from its first lines.

    Why not csv.Sniffer: it takes a decimal comma for a delimiter.

    Raises:
        LogNotFound: it cannot be read, or is no text.
        LogLayout: the header names another number of columns than the rows have.
    """
    lines: list[tuple[int, str]] = []
    try:
        with limits.open_file(path) as stream:
            for number, line in lines_of(stream, path):
                lines.append((number, line))
                if len(lines) >= tuning.FIRST_LINES:
                    break
    except OSError as error:
        raise LogNotFound(f"cannot read {path}: {error.strerror}", where=str(path)) from error
    except UnicodeDecodeError as error:
        raise LogNotFound(f"{path.name} is not a text file", where=str(path)) from error
    plain = [(number, line) for number, line in lines if line[0] not in "#%"]
    told = [_is_data(line) for _, line in plain]
    # Why: a title may be a number and a date; numbers are a table where the next line has numbers as well.
    at = next((k for k, data in enumerate(told) if data and all(told[k : k + 2])), len(plain))
    if (
        0 < at < len(plain) - 1
        and plain[at][1][0] in ";,\t|"
        and plain[at + 1][1][0] not in ";,\t|"
    ):
        # A row without a stamp before rows with one counts the joints, below a line of what is theirs.
        at += 1
    start, sample = (
        plain[at][0] if at < len(plain) else 0,
        [line for _, line in plain[at : at + tuning.FIRST_ROWS]],
    )
    head = [(number, line) for number, line in lines if not start or number < start]
    words = [line for _, line in head if line[0] not in "#%"]
    model = sample[0] if sample else words[-1] if words else ""
    delimiter = next((sign for sign in DELIMITERS if sign in model.strip()), None)
    if (
        delimiter == ","
        and len(model.split()) > 1
        and words
        and not any("," in line for line in words)
    ):
        # In a table of white space and decimal commas, each cell has one comma and the header has none.
        delimiter = None
    comma = delimiter != "," and _decimal_comma([cells_of(line, delimiter) for line in sample])
    first = cells_of(model, delimiter)
    names, units, width = _header(path, head, delimiter, first, has_rows=bool(sample))
    return Dialect(delimiter, comma, names, start, width, tuple(first) if sample else (), units)


def _is_data(line: str) -> bool:
    """Return whether most words of a line are numbers or dates."""
    words = [word for word in re.split(r"[;,|\s]+", line.replace('"', " ")) if word]
    told = [
        as_number(word, comma=False) is not None or bool(re.fullmatch(r"\d[\d:./TZ+-]*", word))
        for word in words
    ]
    return 2 * sum(told) > len(words)


def _decimal_comma(rows: Sequence[Sequence[str]]) -> bool:
    """Return whether the numbers of some rows have decimal commas rather than points."""
    cells = [cell for row in rows for cell in row]
    grouped = [bool(_GROUPED[True].fullmatch(cell)) for cell in cells]
    commas = sum(
        bool(_WITH_COMMA.fullmatch(cell)) or ("," in cell and known)
        for cell, known in zip(cells, grouped, strict=True)
    )
    points = sum(
        bool(_WITH_POINT.fullmatch(cell)) and not known
        for cell, known in zip(cells, grouped, strict=True)
    )
    return commas > points


def _header(
    path: Path,
    head: Sequence[tuple[int, str]],
    delimiter: str | None,
    first: Sequence[str],
    *,
    has_rows: bool,
) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    """Return the names of the columns, a line of units below them, and the number of cells of a row.

    Raises:
        LogLayout: there are names, but not as many as cells.
    """
    fits = {len(first), len(first) - 1} if len(first) > 1 and not first[-1] else {len(first)}
    split = [(line[0] in "#%", _names(line, delimiter, fits)) for _, line in head]
    plain = [words for comment, words in split if not comment and len(words) in fits]
    if not has_rows and plain:
        return tuple(plain[-1]), (), len(plain[-1])
    both = [
        [f"{a} {b}".strip() for a, b in zip(_filled(one), two, strict=True)]
        for one, two in pairwise(plain)
        if len(one) == len(two)
    ]
    names = max(reversed(plain), key=_distinct, default=[])
    if both and _distinct(names) < len(names):
        names = max([*reversed(both), names], key=_distinct)
    if not names and (
        wrong := [
            (number, words)
            for (number, _), (comment, words) in zip(head, split, strict=True)
            if not comment and len(words) > 1
        ]
    ):
        number, words = wrong[-1]
        text = f"{path.name}:{number}: {len(words)} names, but the rows have {len(first)} numbers"
        raise LogLayout(text, where=f"{path}:{number}")
    if not names:
        # In a comment only where it has a name for each cell.
        told = [
            words for comment, words in split if comment and len(words) in fits and len(words) > 1
        ]
        names = told[-1] if told else []
    last = plain[-1] if plain else []
    units = tuple(last) if last and last is not names and len(last) == len(names) else ()
    return tuple(names), units, len(names) or len(first)


def _names(line: str, delimiter: str | None, fits: set[int]) -> list[str]:
    """Return the words of a line that may be a header; its delimiter need not be that of the rows."""
    bare = line.lstrip("#% ") if line[0] in "#%" else line
    for each in dict.fromkeys((delimiter, *DELIMITERS, None)):
        words = cells_of(bare, each)
        if len(words) in fits:
            return words
        if len(words) > 1 and not words[-1] and len(words) - 1 in fits:
            return words[:-1]
    return cells_of(bare, delimiter)


def _distinct(words: Sequence[str]) -> int:
    return len({word for word in words if word})


def _filled(words: Sequence[str]) -> list[str]:
    """Return words with those that are empty replaced by the one before: a spreadsheet joins cells."""
    found: list[str] = []
    for word in words:
        found.append(word or (found[-1] if found else ""))
    return found


# ---------------------------------------------------------------- lines
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
    start = stream.read(tuning.ENCODED_BYTES)
    stream.seek(0)
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8-sig")().decode(start)
    except UnicodeDecodeError:
        # Why: a text has no control characters; what has some is another kind of file, and named as that.
        return "utf-8-sig" if _CONTROL.search(start) else "cp1252"
    return "utf-8-sig"


# ---------------------------------------------------------------- dates
def seconds_of(word: str) -> tuple[int, float] | None:
    """Return a stamp as whole seconds since 1970 (a time of day: since midnight) and the rest; None where it is none.

    Why two: a number that counts from 1970 holds no more than tenths of microseconds.
    """
    found = _STAMP.fullmatch(word)
    if found is None:
        return None
    days = 0
    try:
        if found["year"]:
            days = (
                date(int(found["year"]), int(found["month"]), int(found["day"])).toordinal() - EPOCH
            )
        elif found["last"]:
            # Why: 3/14/2024 can only be American; where both can be meant, only a midnight tells them apart.
            numbers = int(found["first"]), int(found["second"])
            american = found["mark"] == "/" and numbers[0] <= 12
            month, day = numbers if american else numbers[::-1]
            days = date(int(found["last"]), month, day).toordinal() - EPOCH
    except ValueError:
        return None
    whole = (
        int(days * DAY)
        + 3600 * int(found["hour"])
        + 60 * int(found["minute"])
        + int(found["whole"])
    )
    zone = (found["zone"] or "Z").replace(":", "")
    if zone[0] in "+-":
        whole -= int(zone[0] + "1") * (3600 * int(zone[1:3]) + 60 * int(zone[3:5]))
    return whole, float(f"0.{found['part'] or 0}")
