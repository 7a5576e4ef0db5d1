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
import threading
import time
from collections.abc import Mapping, Sequence
from datetime import datetime
from enum import Enum
from math import isfinite
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, TextIO

from rich.console import Console
from rich.table import Table
from rich.text import Text

from dynid.cli.failure import is_terminal, silence_streams, use_color
from dynid.errors import CannotWrite, Finding
from dynid.table import cell_text
from dynid.text import shell, visible, whole_number

if TYPE_CHECKING:
    import rich.progress

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

#: Work shorter than this is not worth a bar [s].
PATIENCE = 0.5

#: A cell is text, or text with a rich style; the style must not be the only thing that says it.
Cell = str | tuple[str, str]


class QuietConsole(Console):
    """A console that goes on working when the reader of its stream has left."""

    def on_broken_pipe(self) -> None:
        """Send the rest nowhere, so that the command still finishes its job."""
        silence_streams()


class Terminal:
    """Both streams of one run, as the common options want them.

    Args:
        json: whether one JSON object is printed on stdout instead of tables; nobody waits for progress then.
        quiet: whether stages and progress are left out.
        verbose: how much detail is wanted: 0, 1 or 2.
        color: ``"auto"``, ``"always"`` or ``"never"``.
        log_file: file that gets a copy of everything said on stderr.
    """

    def __init__(
        self, *, json: bool, quiet: bool, verbose: int, color: str, log_file: Path | None
    ) -> None:
        self.json, self.quiet, self.verbose = json, quiet, verbose
        self.out = _console(sys.stdout, color)
        self.err = _console(sys.stderr, color)
        self._copy: TextIO | None = None
        if log_file is not None:
            try:
                log_file.parent.mkdir(parents=True, exist_ok=True)
                self._copy = _opened(log_file)
            except OSError as error:
                nobody = (
                    "it is a pipe that nobody reads"
                    if error.errno == errno.ENXIO
                    else error.strerror
                )
                what = f"cannot write {log_file}: {nobody}"
                raise CannotWrite(
                    what, where=str(log_file), fix="give another --log-file"
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
        if self.quiet:
            self._copied(visible(line))
        else:
            self.say(line, indent=None if name in COPYABLE else LABEL)

    def detail(self, name: str, text: str, level: int = 1) -> None:
        """Say a stage only with -v (level 1) or -vv (level 2); it always reaches --log-file."""
        if self.verbose >= level:
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
        if why and not self.quiet:
            self.say(f"{'':<{LABEL}}{why}", indent=LABEL)

    def finding(self, finding: Finding) -> None:
        """Say a warning, or with -v an information."""
        line = visible(f"{finding.level}[{finding.code}] {finding.text}")
        if finding.level == "info" and not self.verbose:
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
        if not self.json:
            for line in text.split("\n"):
                for part in folded(visible(line), self.out, indent):
                    self.out.print(Text(part, style=style), soft_wrap=True)

    def page(self, markdown: str) -> None:
        """Print a page of the documentation, laid out on a terminal and as it is elsewhere; nothing with --json."""
        from rich.markdown import Markdown

        if not self.json:
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
        if self.json:
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
        if self.json:
            self.out.out(json.dumps(plain(answer), indent=2, allow_nan=False), highlight=False)

    def emit_json_line(self, answer: Mapping[str, Any]) -> None:
        """Print a JSON object on one line of stdout at once, for a program that follows the work."""
        self.out.out(json.dumps(plain(answer), allow_nan=False), highlight=False)
        self.out.file.flush()


class Bar:
    """A ``dynid.progress.Progress`` for one command; use it in a ``with`` block.

    Nothing is shown for half a second, then a bar on a terminal; one line a stage everywhere else.

    Args:
        terminal: where to say it.
    """

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self._name = ""
        self._began = time.monotonic()
        self._said = False
        self._told: set[tuple[str, ...]] = set()
        self._lock = threading.RLock()
        self._timer: threading.Timer | None = None
        self._bar: rich.progress.Progress | None = None
        # Why: a bar moves the cursor; where colour is off no escape codes may appear at all.
        self._lively = (
            terminal.err.is_terminal
            and terminal.err.color_system is not None
            and not terminal.quiet
        )

    def __enter__(self) -> Bar:
        """Begin."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Take the bar away, also after an error."""
        self._end_stage()

    def stage(self, name: str, text: str = "") -> None:
        """Say a line when there is something to say; otherwise a stage begins that may get a bar."""
        self._end_stage()
        # Why once: a log that several steps of one command read is one log to its reader.
        if text and self._new(name, text):
            self._terminal.stage(name, text)
        with self._lock:
            self._name, self._began, self._said = name, time.monotonic(), bool(text)
            if self._lively:
                self._timer = threading.Timer(PATIENCE, self._show)
                self._timer.daemon = True
                self._timer.start()

    def advance(self, done: float, total: float, text: str = "") -> None:
        """Move the bar; without one, name a silent stage once it takes long."""
        with self._lock:
            if self._bar is not None:
                task = self._bar.task_ids[0]
                self._bar.update(
                    task,
                    completed=done,
                    total=total or None,
                    description=visible(f"{self._name}  {text}"),
                )
            # Why not with --json: what a program reads would depend on how busy the machine is.
            elif self._slow() and not self._terminal.json:
                self._terminal.stage(self._name, text or "...")
                self._said = True

    def findings(self, findings: Sequence[Finding]) -> None:
        """Say warnings below the stage that they belong to."""
        self._end_stage()
        self._terminal.findings([each for each in findings if self._new(each.code, each.text)])

    def pause(self) -> None:
        """Take the bar away until the next stage begins, so that a question can be asked."""
        self._end_stage()

    def _new(self, *words: str) -> bool:
        """Return whether something is said for the first time, and keep it."""
        new = words not in self._told
        self._told.add(words)
        return new

    def _slow(self) -> bool:
        return not self._lively and not self._said and time.monotonic() - self._began > PATIENCE

    def _show(self) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        with self._lock:
            if self._timer is None or self._bar is not None:
                return
            columns = (
                TextColumn("{task.description}", markup=False),
                BarColumn(),
                TimeElapsedColumn(),
            )
            self._bar = Progress(*columns, console=self._terminal.err, transient=True)
            self._bar.add_task(visible(self._name), total=None)
            self._bar.start()

    def _end_stage(self) -> None:
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
            if self._bar is not None:
                self._bar.stop()
                self._bar = None


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
