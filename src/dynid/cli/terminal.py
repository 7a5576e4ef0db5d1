"""The two streams: stdout carries the answer and nothing else, stderr everything else.

No text from outside is ever read as markup or as an escape code; colour never carries meaning alone.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import sys
import textwrap
from collections.abc import Mapping, Sequence
from datetime import datetime
from enum import Enum
from math import isfinite
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, TextIO

from rich.console import Console
from rich.table import Table
from rich.text import Text

from dynid.cli.failure import is_terminal, silence_streams, use_color
from dynid.cli.progress_bar import Bar
from dynid.errors import CannotWrite, Finding
from dynid.table import cell_text
from dynid.text import shell, visible, whole_number

#: Width of the first column of stage lines.
LABEL = 11
#: Labels of lines that are copied from the terminal, and so never folded.
COPYABLE = ("wrote", "next", "")
#: How far the further lines of a warning or a sentence are moved in.
FOLDED_INDENT = 2
#: Spaces between the columns of a table: two, or one where the terminal is narrow.
GAPS = (2, 1)
#: Width of tables that go to a file or a pipe: nothing is folded there.
UNLIMITED = 400

#: A cell is text, or text with a rich style; the style must not be the only thing that says it.
Cell = str | tuple[str, str]


class OutputOptions(Protocol):
    """Those of the common options that are about the terminal."""

    @property
    def json(self) -> bool:
        """Whether one JSON object is printed on stdout instead of tables."""

    @property
    def quiet(self) -> bool:
        """Whether stages and progress are left out."""

    @property
    def verbose(self) -> int:
        """How much detail is wanted: 0, 1 or 2."""

    @property
    def color(self) -> str:
        """``"auto"``, ``"always"`` or ``"never"``."""

    @property
    def log_file(self) -> Path | None:
        """File that gets a copy of everything said on stderr."""


class QuietConsole(Console):
    """A console that goes on working when the reader of its stream has left."""

    def on_broken_pipe(self) -> None:
        """Send the rest nowhere, so that the command still finishes its job."""
        silence_streams()


class Terminal:
    """Both streams of one run, as the common options want them.

    Args:
        common: the common options.
    """

    def __init__(self, common: OutputOptions) -> None:
        self.common = common
        self.out = _console(sys.stdout, common.color)
        self.err = _console(sys.stderr, common.color)
        self._copy: TextIO | None = None
        if common.log_file is not None:
            try:
                common.log_file.parent.mkdir(parents=True, exist_ok=True)
                self._copy = _opened(common.log_file)
            except OSError as error:
                nobody = (
                    "it is a pipe that nobody reads"
                    if error.errno == errno.ENXIO
                    else error.strerror
                )
                what = f"cannot write {common.log_file}: {nobody}"
                raise CannotWrite(
                    what, where=str(common.log_file), fix="give another --log-file"
                ) from error

    def __enter__(self) -> Terminal:
        """Begin the run."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the copy; what ended the run is its last line."""
        if self._copy is not None:
            if error is not None:
                self._copied(visible(f"{getattr(error, 'code', type(error).__name__)} {error}"))
            self._copy.close()

    @property
    def quiet(self) -> bool:
        """Whether nothing but the answer, warnings and errors is wanted."""
        return self.common.quiet

    @property
    def unwatched(self) -> bool:
        """Whether a program waits for the answer, and nobody for its progress."""
        return self.common.json

    # ------------------------------------------------------------ stderr
    def say(self, text: str, style: str = "", indent: int | None = None) -> None:
        """Say a line on stderr; with an indent it is folded at words where the terminal ends."""
        line = visible(text)
        self._copied(line)
        for part in folded(line, self.err, indent):
            self.err.print(Text(part, style=style), soft_wrap=True)

    def stage(self, name: str, text: str) -> None:
        """Say what a stage found: a short label and a sentence; not with --quiet."""
        line = f"{name:<{LABEL}}{text}"
        if self.common.quiet:
            self._copied(visible(line))
        else:
            self.say(line, indent=None if name in COPYABLE else LABEL)

    def detail(self, name: str, text: str, level: int = 1) -> None:
        """Say a stage only with -v (level 1) or -vv (level 2); it always reaches --log-file."""
        if self.common.verbose >= level:
            self.stage(name, text)
        else:
            self._copied(visible(f"{name:<{LABEL}}{text}"))

    def wrote(self, *paths: Path, note: str = "") -> None:
        """Say what was written."""
        for path in paths:
            self.stage("wrote", f"{path}{'       (' + note + ')' if note else ''}")

    def next(self, command: str, why: str = "") -> None:
        """Say the next sensible command, and below it why; not with --quiet."""
        self.stage(
            "next",
            program() + command.removeprefix("dynid") if command.startswith("dynid ") else command,
        )
        if why and not self.common.quiet:
            self.say(f"{'':<{LABEL}}{why}", indent=LABEL)

    def finding(self, finding: Finding) -> None:
        """Say a warning, or with -v an information."""
        line = visible(f"{finding.level}[{finding.code}] {finding.text}")
        if finding.level == "info" and not self.common.verbose:
            self._copied(line)
            return
        self._copied(line)
        head = line.partition(" ")[0]
        style = "yellow" if finding.level == "warning" else "cyan"
        first, *more = folded(line, self.err, FOLDED_INDENT)
        self.err.print(Text.assemble((head, style), first[len(head) :]), soft_wrap=True)
        for part in more:
            self.err.print(Text(part), soft_wrap=True)

    def findings(self, findings: Sequence[Finding]) -> None:
        """Say several findings."""
        for finding in findings:
            self.finding(finding)

    def progress(self) -> Bar:
        """Return a progress report for the library, to be used in a ``with`` block."""
        return Bar(self)

    def _copied(self, line: str) -> None:
        if self._copy is not None:
            self._copy.write(f"{datetime.now().astimezone():%Y-%m-%d %H:%M:%S} {line}\n")
            self._copy.flush()

    # ------------------------------------------------------------ stdout
    def answer(self, text: str = "", style: str = "", indent: int | None = None) -> None:
        """Print lines of the answer on stdout, with an indent folded as ``say`` does; nothing with --json."""
        if not self.common.json:
            for line in text.split("\n"):
                for part in folded(visible(line), self.out, indent):
                    self.out.print(Text(part, style=style), soft_wrap=True)

    def page(self, markdown: str) -> None:
        """Print a page of the documentation, laid out on a terminal and as it is elsewhere; nothing with --json."""
        from rich.markdown import Markdown

        if not self.common.json:
            self.out.print(
                Markdown(markdown) if is_terminal(self.out.file) else Text(markdown),
                soft_wrap=False,
            )

    def sentence(self, text: str) -> None:
        """Print a long line of the answer, folded where the terminal ends; nothing with --json."""
        self.answer(text, indent=FOLDED_INDENT)

    def fact(self, name: str, text: str) -> None:
        """Print a line of the answer: a short label and a sentence; nothing with --json."""
        self.answer(f"{name:<{LABEL}}{text}", indent=None if name in COPYABLE else LABEL)

    def table(
        self, columns: Sequence[str], rows: Sequence[Sequence[Cell]], *, numbers: bool = True
    ) -> None:
        """Print a table on stdout; nothing with --json.

        Args:
            columns: headings; the first column is text on the left.
            rows: cells, each text or (text, style).
            numbers: whether the columns after the first are aligned on the right.
        """
        if self.common.json:
            return
        for gap in GAPS:
            table = Table(box=None, pad_edge=False, padding=(0, gap, 0, 0), header_style="bold")
            for i, column in enumerate(columns):
                table.add_column(
                    Text(visible(column)),
                    justify="right" if numbers and i else "left",
                    no_wrap=True,
                )
            for row in rows:
                table.add_row(*(_cell(cell) for cell in row))
            if (
                table.__rich_measure__(self.out, self.out.options.update(width=UNLIMITED)).maximum
                <= self.out.width
            ):
                return self._print_trimmed(table)
        return self._records(columns, rows)

    def show(self, rows: Sequence[Mapping[str, object]], *, numbers: bool = True) -> None:
        """Print rows that have the same keys, as a ``Table`` holds them; nothing where there are none."""
        if rows:
            self.table(
                list(rows[0]), [list(map(cell_text, row.values())) for row in rows], numbers=numbers
            )

    def _records(self, columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> None:
        """Print one line a cell, because the table is wider than the terminal."""
        width = max(len(column) for column in columns)
        for row in rows:
            for i, (column, cell) in enumerate(zip(columns, row, strict=True)):
                self.out.print(
                    Text.assemble("  " if i else "", f"{column:<{width}}  ", _cell(cell)),
                    soft_wrap=True,
                )

    def _print_trimmed(self, table: Table) -> None:
        for line in self.out.render_lines(table, pad=False, new_lines=False):
            text = Text.assemble(
                *((segment.text, segment.style or "") for segment in line if not segment.control)
            )
            text.rstrip()
            self.out.print(text, soft_wrap=True)

    def emit_json(self, answer: Mapping[str, Any]) -> None:
        """Print the one JSON object on stdout; nothing without --json."""
        if self.common.json:
            self.out.out(json.dumps(plain(answer), indent=2, allow_nan=False), highlight=False)

    def emit_json_line(self, answer: Mapping[str, Any]) -> None:
        """Print a JSON object on one line of stdout at once, for a program that follows the work."""
        self.out.out(json.dumps(plain(answer), allow_nan=False), highlight=False)
        self.out.file.flush()


def folded(line: str, console: Console, indent: int | None) -> list[str]:
    """Return a line in parts that fit the terminal, broken between words, all but the first moved in.

    A line without an indent, and one that goes to a file or a pipe, stays whole.
    """
    if indent is None or not is_terminal(console.file) or len(line) <= console.width:
        return [line]
    return textwrap.wrap(
        line,
        console.width,
        subsequent_indent=" " * indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def program() -> str:
    """Return the word that starts dynid here: its path where a shell does not find it, as after ``make demo``."""
    here = Path(sys.argv[0])
    if here.name != "dynid" or not here.is_file() or shutil.which("dynid") is not None:
        return "dynid"
    return shell(os.path.relpath(here))


def _console(stream: TextIO, mode: str) -> Console:
    color = use_color(stream, mode)
    terminal = is_terminal(stream)
    return QuietConsole(
        file=stream,
        color_system="auto" if color and terminal else "standard" if color else None,
        force_terminal=color,
        no_color=not color,
        markup=False,
        emoji=False,
        highlight=False,
        width=None if terminal else _columns(),
    )


def _opened(path: Path) -> TextIO:
    """Open a file to append to; a pipe that nobody reads is an error at once, where Python would wait for a reader."""
    handle = os.open(
        path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | getattr(os, "O_NONBLOCK", 0), 0o666
    )
    os.set_blocking(handle, True)
    return os.fdopen(handle, "a", encoding="utf-8", errors="backslashreplace")


def _columns() -> int:
    given = whole_number(os.environ.get("COLUMNS", ""))
    return given if given > 0 else UNLIMITED


def _cell(cell: Cell) -> Text:
    return Text(visible(cell)) if isinstance(cell, str) else Text(visible(cell[0]), style=cell[1])


def plain(value: Any) -> Any:  # noqa: ANN401
    """Return a value as JSON knows it: arrays as lists, paths as text, what is not finite as null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, Enum):
        return plain(value.value)
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if isfinite(value) else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    return str(value)
