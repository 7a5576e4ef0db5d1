"""Tables as logs: CSV and TSV in any dialect, Parquet; columns are found by the patterns of the robot file.

Reads block by block and keeps only the columns that are asked for. Stamps in ms, us and ns are recognised (W328).
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid import limits
from dynid.errors import Finding, LogLayout, LogNotFound, PackageMissing
from dynid.files.textlog import BLOCK, TIME_NAMES, lines_of, positive_rate
from dynid.log import Log

Floats = NDArray[np.float64]

SUFFIXES = (".csv", ".tsv", ".parquet")
#: Patterns that are tried where the robot file gives none.
USUAL = {
    "position": ("q_{name}",),
    "velocity": ("qd_{name}",),
    "effort": ("tau_{name}", "i_{name}"),
    "reference": ("q_ref_{name}",),
}
#: Median step between samples, in each unit of time, of recorders from 2.5 Hz to 2 kHz; the ranges do not overlap.
#: Why not faster: a step of 0.2 is a slow log in seconds (E314), not one of 5 kHz in milliseconds.
STEPS = {"s": (0.0, 0.4), "ms": (0.5, 400.0), "us": (500.0, 4e5), "ns": (5e5, 4e8)}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
#: Seconds since 1970 of 2001 and of 2100.
CALENDAR = (1e9, 4.1e9)
#: Fewer stamps than this do not tell their unit.
TOLD = 20
_LONG = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
#: A unit at the end of the name of a time column: time_ms, t[us], stamp (ns).
_UNIT = re.compile(r"(?:^|[_\s\[(./])(ms|msec|us|usec|µs|ns|nsec|nanosec)[\])]?$", re.IGNORECASE)
#: Words of column names and what they stand for, for a suggestion.
_WORDS = {
    "reference": r"ref|target|cmd|command|des|desired|goal|set",
    "velocity": r"qd|dq|vel|velocity|speed|qp",
    "effort": r"tau|torque|trq|effort|moment|load|i|cur|current|iq|ampere",
    "position": r"q|pos|position|angle|theta|joint|j",
}
#: Lines at the start of a text from which its dialect is told.
_SNIFFED = 200


@dataclass(frozen=True)
class Dialect:
    """How a text table is written.

    Attributes:
        delimiter: between cells; None for white space.
        comma: whether numbers have decimal commas.
        names: words of the header, () where there is none.
        header: number of the header line; 0 where there is none.
        width: cells of a row.
    """

    delimiter: str | None
    comma: bool
    names: tuple[str, ...]
    header: int
    width: int


def column_names(path: Path) -> tuple[str, ...]:
    """Return the names of the columns of a table.

    Raises:
        LogNotFound: it cannot be read.
        LogLayout: it has no header.
    """
    names = tuple(_schema(path).names) if path.suffix == ".parquet" else _dialect(path).names
    limits.check("columns", len(names), path)
    limits.check("name_length", max(map(len, names), default=0), path)
    if not names:
        raise LogLayout(f"{path.name}: no header; expected t, q_<joint>, tau_<joint>", where=f"{path}:1")
    return names


def read_table(
    path: Path, joints: Sequence[str], patterns: Mapping[str, str] | None = None, rate: float | None = None
) -> Log:
    """Read a table.

    Args:
        path: .csv, .tsv or .parquet file.
        joints: names of the joints in chain order, () when they are to be taken from the columns ``q_<name>``.
        patterns: names of the columns by ``time``, ``position``, ``velocity``, ``effort``, ``reference``.
        rate: samples per second where there is no time [Hz].

    Raises:
        LogNotFound: it cannot be read.
        LogLayout: columns are missing, or a cell is not a number.
        PackageMissing: Parquet without pyarrow.
    """
    names = column_names(path)
    layout = _layout(path, names, joints, dict(patterns or {}), rate)
    wanted = [name for columns in layout.columns.values() for name in columns]
    chosen = [layout.time, *wanted] if layout.time else wanted
    values = dict(zip(chosen, read_columns(path, chosen).T, strict=True))
    t = values[layout.time] if layout.time else np.arange(len(values[wanted[0]])) / positive_rate(rate)
    t, findings = in_seconds(t, layout.time or "", path.name) if layout.time else (t, ())
    arrays = {key: np.column_stack([values[name] for name in columns]) for key, columns in layout.columns.items()}
    return Log(
        t, arrays["position"], arrays["effort"], layout.joints, arrays.get("velocity"),
        source=path, tau_unit="A" if layout.current else "", findings=findings,
        extra={"q_ref": arrays["reference"]} if "reference" in arrays else {},
    )  # fmt: skip


def in_seconds(t: Floats, name: str, where: str) -> tuple[Floats, tuple[Finding, ...]]:
    """Return stamps in seconds, and what was noticed (W328).

    Args:
        t: stamps as they are in the file, (N,).
        name: of their column, which may end with their unit.
        where: name of the file, for the message.
    """
    finite = t[np.isfinite(t)]
    step = np.diff(finite)
    usual = float(np.median(step[step > 0])) if np.any(step > 0) else 0.0
    named = _UNIT.search(name)
    unit = {"msec": "ms", "usec": "us", "µs": "us", "nsec": "ns", "nanosec": "ns"}.get(
        named.group(1).lower(), named.group(1).lower()
    ) if named else _unit_of(finite, usual)  # fmt: skip
    if unit == "s":
        return t, ()
    # Why subtracted first: stamps of the calendar have more digits in ns than a number holds after the product.
    start = float(finite[0]) if len(finite) else 0.0
    seconds = (t - start) * SECONDS[unit] + (0.0 if abs(start) * SECONDS[unit] > 1e6 else start * SECONDS[unit])
    span = float(finite[-1] - start) * SECONDS[unit] if len(finite) else 0.0
    rate = f" at {1 / (usual * SECONDS[unit]):.4g} Hz" if usual else ""
    said = f"as the name of {name} says" if named else f"a step of {usual:.4g} in {name} can be nothing else"
    text = f"{where}: the stamps are {_LONG[unit]} ({span:.1f} s{rate}), {said}"
    return seconds, (Finding("W328", "info" if named else "warning", text, {"unit": unit, "seconds": span}),)


def _unit_of(t: Floats, step: float) -> str:
    """Return the unit of stamps that name none: from the calendar where they count from 1970, else from their step."""
    for unit, factor in SECONDS.items():
        if len(t) and CALENDAR[0] < t[0] * factor < CALENDAR[1]:
            return unit
    told = next((unit for unit, (low, high) in STEPS.items() if low <= step < high), "s")
    return told if len(t) >= TOLD else "s"


def suggested(names: Sequence[str]) -> dict[str, str]:
    """Return patterns for ``driver: columns:`` that would find columns of these names; {} where none can be told."""
    families: dict[str, set[int]] = {}
    for name in names:
        for number in re.finditer(r"\d+", name):
            pattern = f"{name[: number.start()]}{{i}}{name[number.end() :]}"
            families.setdefault(pattern, set()).add(int(number.group()))
    most = max((len(numbers) for numbers in families.values()), default=0)
    found: dict[str, str] = {}
    for key, words in _WORDS.items():
        for pattern, numbers in families.items():
            plain = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", pattern.replace("{i}", "0")).lower()
            told = re.search(rf"(^|[^a-z])({words})s?([^a-z]|$)", plain)
            if told and len(numbers) == most > 1 and pattern not in found.values() and key not in found:
                found[key] = pattern
    time = next((name for name in names if _is_time(name)), None)
    if time is None:
        time = next((name for name in names if re.search(r"time|stamp", name.lower())), None)
    return ({"time": time} if time else {}) | found if {"position", "effort"} <= set(found) else {}


def template(names: Sequence[str]) -> dict[str, str]:
    """Return patterns to fill in where the names of the columns do not tell what they hold."""
    time = next((name for name in names if _is_time(name)), "TIME")
    return {"time": time, "position": "POSITION_{i}", "effort": "TORQUE_{i}"}


def snippet(patterns: Mapping[str, str]) -> str:
    """Return patterns as they stand in a robot file."""
    order = ("time", "position", "velocity", "effort", "reference")
    inside = ", ".join(f"{key}: {json.dumps(patterns[key])}" for key in order if key in patterns)
    return f"columns: {{{inside}}}"


# ---------------------------------------------------------------- which columns
@dataclass(frozen=True)
class _Layout:
    """Which columns are read.

    Attributes:
        joints: names of the joints.
        time: column of the stamps, None where the rate is given.
        columns: for each quantity, one column a joint.
        current: whether the efforts are currents in A by their name.
    """

    joints: tuple[str, ...]
    time: str | None
    columns: dict[str, list[str]]
    current: bool


def _layout(
    path: Path, names: Sequence[str], joints: Sequence[str], patterns: dict[str, str], rate: float | None
) -> _Layout:
    where = f"{path}:1"
    own = tuple(name[2:] for name in names if name.startswith("q_") and not name.startswith("q_ref_"))
    if "position" not in patterns and own:
        joints = own
    columns: dict[str, list[str]] = {}
    current = False
    for key, usual in USUAL.items():
        tried = (patterns[key],) if key in patterns else usual
        found = next(((p, c) for p in tried if (c := matched(p, names, joints))), None)
        if found:
            columns[key] = found[1]
            current = current or (key == "effort" and found[0] == "i_{name}")
        elif key in patterns or key in ("position", "effort"):
            raise _missing(path, names, tried, joints, key)
    time = patterns.get("time") or next((name for name in names if _is_time(name)), None)
    if time not in names and (rate is None or "time" in patterns):
        guess = suggested(names)
        fix = "add the column t, or give --rate"
        if "time" in guess:
            fix = f"under `driver:` in the robot file: columns: {{time: {guess['time']}}}"
        raise LogLayout(f"{path.name}:1: no column '{time or 't'}'; it has {_listed(names)}", where=where, fix=fix)
    return _Layout(tuple(joints), time, columns, current)


def matched(pattern: str, names: Sequence[str], joints: Sequence[str]) -> list[str]:
    """Return the columns of a pattern in chain order, [] where one is missing; numbers count from 0 or 1."""
    has = set(names)
    if "{i}" not in pattern:
        found = [pattern.replace("{name}", joint) for joint in joints]
        return found if found and set(found) <= has else []
    for first in (1, 0):
        found = [pattern.replace("{i}", str(first + k)).replace("{name}", joint) for k, joint in enumerate(joints)]
        # Why: of an arm with six joints and columns 0 to 6, 0 to 5 are the arm and 6 is its gripper.
        if set(found) <= has and not (first and pattern.replace("{i}", "0") in has):
            return found
    return []


def _missing(path: Path, names: Sequence[str], tried: Sequence[str], joints: Sequence[str], key: str) -> LogLayout:
    guess = suggested(names)
    have = {pattern.split("{")[0] for pattern in tried}
    some = [name for name in names if any(name.startswith(start) for start in have if start)]
    lost = next((wanted for joint in joints if (wanted := tried[0].replace("{name}", joint)) not in names), tried[0])
    fix = f"under `driver:` in the robot file: {snippet(guess or template(names))}"
    if key == "effort" and some and joints:
        text = f"{path.name}:1: joint '{lost.removeprefix('tau_')}' has q_{lost.removeprefix('tau_')} but no {lost}"
        return LogLayout(text, where=f"{path}:1", fix=fix)
    shown = lost if "{name}" not in tried[0] or joints else tried[0].replace("{name}", "<joint>")
    return LogLayout(f"{path.name}:1: no column {shown}; it has {_listed(names)}", where=f"{path}:1", fix=fix)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def _is_time(name: str) -> bool:
    plain = _UNIT.sub("", name.lower()).strip(" _[(") or "t"
    return plain in TIME_NAMES


# ---------------------------------------------------------------- the numbers
def read_columns(path: Path, chosen: Sequence[str]) -> Floats:
    """Return columns of a table by name, (N, k)."""
    parts: list[Floats] = []
    count = 0
    for block in _parquet(path, chosen) if path.suffix == ".parquet" else _text(path, chosen):
        count += len(block)
        limits.check("samples", count, path)
        parts.append(block)
    if not count:
        raise LogLayout(f"{path.name} has no samples", where=str(path))
    return np.concatenate(parts)


def _schema(path: Path) -> Any:  # noqa: ANN401
    return _open_parquet(path).schema_arrow


def pyarrow_of() -> tuple[Any, Any]:
    """Return pyarrow and its module of Parquet.

    Raises:
        PackageMissing: it is not installed.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise PackageMissing(
            "pyarrow is not installed: Parquet cannot be read or written", fix="pip install 'dynid[parquet]'"
        ) from error
    return pyarrow, parquet


def _open_parquet(path: Path) -> Any:  # noqa: ANN401
    pyarrow, parquet = pyarrow_of()
    try:
        with limits.open_file(path):
            pass
        return parquet.ParquetFile(path, thrift_string_size_limit=limits.MIB, thrift_container_size_limit=limits.MIB)
    except (pyarrow.ArrowException, OSError, ValueError) as error:
        raise LogNotFound(f"{path.name} is no Parquet file, or is damaged: {error}", where=str(path)) from error


def _parquet(path: Path, chosen: Sequence[str]) -> Iterator[Floats]:
    import pyarrow

    file = _open_parquet(path)
    limits.check("samples", file.metadata.num_rows, path)
    try:
        for batch in file.iter_batches(batch_size=BLOCK, columns=list(dict.fromkeys(chosen))):
            yield np.column_stack([_floats(batch.column(name), name, path) for name in chosen])
    except (pyarrow.ArrowException, OSError) as error:
        raise LogNotFound(f"{path.name} is damaged: {error}", where=str(path)) from error


def _floats(column: Any, name: str, path: Path) -> Floats:  # noqa: ANN401
    import pyarrow

    kind = column.type
    if pyarrow.types.is_timestamp(kind) or pyarrow.types.is_duration(kind):
        # Unit: whole numbers of the column's own unit; what they are in seconds is told by their step.
        column = column.cast(pyarrow.int64())
    elif not (pyarrow.types.is_integer(kind) or pyarrow.types.is_floating(kind)):
        raise LogLayout(f"{path.name}: column '{name}' holds {kind}, no numbers", where=str(path))
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=float)


def _text(path: Path, chosen: Sequence[str]) -> Iterator[Floats]:
    dialect = _dialect(path)
    places = [dialect.names.index(name) for name in chosen]
    rows: list[tuple[int, str]] = []
    try:
        with limits.open_file(path) as stream:
            limits.check("text_bytes", os.fstat(stream.fileno()).st_size, path)
            for number, line in lines_of(stream, path):
                if number == dialect.header or line[0] in "#%":
                    continue
                rows.append((number, line))
                if len(rows) == BLOCK:
                    yield _numbers(path, rows, dialect, places)
                    rows = []
    except UnicodeDecodeError as error:
        raise LogNotFound(f"{path.name} is not a text file", where=str(path)) from error
    if rows:
        yield _numbers(path, rows, dialect, places)


def _numbers(path: Path, rows: list[tuple[int, str]], dialect: Dialect, places: list[int]) -> Floats:
    lines = [line.replace(",", ".") if dialect.comma else line for _, line in rows]
    try:
        return np.asarray(np.loadtxt(lines, delimiter=dialect.delimiter, comments=None, ndmin=2, usecols=places))
    except ValueError:
        return np.array([_row(path, number, line, dialect, places) for number, line in rows])


def _row(path: Path, number: int, line: str, dialect: Dialect, places: list[int]) -> list[float]:
    """Return the numbers of one row; an empty cell is not a number, words are named."""
    cells = _cells(line, dialect.delimiter)
    if len(cells) != dialect.width:
        text = f"{path.name}:{number}: {len(cells)} numbers, expected {dialect.width}"
        raise LogLayout(text, where=f"{path}:{number}")
    values = []
    for place in places:
        word = cells[place].replace(",", ".") if dialect.comma else cells[place]
        try:
            values.append(float(word) if word else float("nan"))
        except ValueError:
            text = f"{path.name}:{number}: '{word[:40]}' is not a number"
            raise LogLayout(text, where=f"{path}:{number}") from None
    return values


def _cells(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    cells = [cell.strip().strip('"') for cell in line.split(delimiter)]
    return cells[:-1] if len(cells) > 1 and not cells[-1] and line.rstrip().endswith(delimiter) else cells


def _dialect(path: Path) -> Dialect:
    """Tell delimiter, decimal sign and header from the first lines of a text.

    Why not csv.Sniffer: it takes a decimal comma for a delimiter.
    """
    shown: list[tuple[int, str]] = []
    data: list[str] = []
    try:
        with limits.open_file(path) as stream:
            for number, line in lines_of(stream, path):
                if line[0] not in "#%" and _starts_with_number(line):
                    data.append(line)
                else:
                    shown.append((number, line))
                if len(data) > 4 or len(shown) > _SNIFFED:
                    break
    except OSError as error:
        raise LogNotFound(f"cannot read {path}: {error.strerror}", where=str(path)) from error
    except UnicodeDecodeError as error:
        raise LogNotFound(f"{path.name} is not a text file", where=str(path)) from error
    plain = [entry for entry in shown if entry[1][0] not in "#%"]
    sample = data[0] if data else plain[-1][1] if plain else ""
    delimiter = next((sign for sign in (";", "\t", ",") if sign in sample), None)
    # Why: in a table of white space and decimal commas, each cell has one comma and the header has none.
    comma = delimiter in (";", "\t") and any("," in line for line in data)
    if delimiter == "," and len(sample.split()) > 1 and plain and "," not in plain[-1][1]:
        delimiter, comma = None, True
    width = len(_cells(sample, delimiter))
    # The last line of words before the numbers; in a comment only when it has a name for each cell.
    candidates = [(n, _cells(line.lstrip("#% "), delimiter)) for n, line in reversed(shown) if line[0] not in "#%"]
    candidates += [
        (n, words) for n, line in reversed(shown)
        if line[0] in "#%" and len(words := _cells(line.lstrip("#% "), delimiter)) == width > 1
    ]  # fmt: skip
    number, words = candidates[0] if candidates else (0, [])
    if words and len(words) != width and data:
        raise LogLayout(
            f"{path.name}:{number}: {len(words)} names, but the rows have {width} numbers", where=f"{path}:{number}"
        )
    return Dialect(delimiter, comma, tuple(words), number, width)


def _starts_with_number(line: str) -> bool:
    word = re.split(r"[;\t\s]", line.strip('"'), maxsplit=1)[0].split(",")[0].strip('"')
    try:
        float(word)
    except ValueError:
        return not word
    return True
