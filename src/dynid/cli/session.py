"""One run of a command: the options that every command has, and its two streams.

stdout carries the answer and nothing else, stderr everything else. No text from outside is ever read as markup or as an
escape code; colour never carries meaning alone.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import textwrap
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, is_dataclass
from datetime import datetime
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click
from rich.console import Console
from rich.text import Text

from dynid.answer import LABEL, Answer, Facts, Part
from dynid.cli.failure import is_terminal, silence_streams, use_color
from dynid.errors import CannotWrite, Finding
from dynid.judgement.rules import Judgement
from dynid.options import Options, option
from dynid.progress import heard_by
from dynid.table import Table, cell_text
from dynid.text import shell, visible

if TYPE_CHECKING:
    from rich.progress import Progress

#: How far the further lines of a sentence are moved in.
SENTENCE = 2
#: Labels of lines that are copied from the terminal, and so never folded.
COPYABLE = ("wrote", "next")
#: Width of tables that go to a file or a pipe: nothing is folded there.
UNLIMITED = 400
#: Work shorter than this is not worth a bar [s].
PATIENCE = 0.5
#: Steps that are shown without -v.
STEPS = 2


class QuietConsole(Console):
    """A console that goes on working when the reader of its stream has left."""

    def on_broken_pipe(self) -> None:
        """Send the rest nowhere, so that the command still finishes its job."""
        silence_streams()


@dataclass(frozen=True)
class Session(Options):
    """What every command is given: the common options and the streams."""

    out: Path | None = option(None, "Folder of the results (default: out/ROBOT).", metavar="DIR")
    force: bool = option(False, "Overwrite results without asking.", deliberate=True)
    yes: bool = option(
        False, "Answer questions with yes; never those that move the arm.", deliberate=True
    )
    no_input: bool = option(False, "Ask nothing, take the documented answers.")
    json: bool = option(False, "Print one JSON object on stdout.")
    quiet: bool = option(False, "Only the answer, warnings and errors.")
    verbose: int = option(0, "More detail; twice for all.", kind="level")
    color: str = option("auto", "Colour on the terminal.", choices=("auto", "always", "never"))
    log_file: Path | None = option(None, "Append what is said on stderr to FILE.", metavar="FILE")
    seed: int = option(0, "Seed of every random choice.", metavar="INTEGER", bounds=(0, None))
    debug: bool = option(False, "Show tracebacks.")

    @contextmanager
    def heard(self) -> Iterator[None]:
        """Show the progress of the library in a ``with`` block; an error that ends it goes to the log file."""
        self._copied("")  # what cannot be written is noticed before the work
        try:
            with heard_by(self.progress):
                yield
        except BaseException as error:
            self._copied(f"{getattr(error, 'code', type(error).__name__)} {error}")
            raise
        finally:
            self.progress.end()

    def folder(self, slug: str) -> Path:
        """Return the folder of the results of a robot."""
        return self.out or Path("out") / slug

    def header(self, inputs: Mapping[str, str]) -> Facts:
        """Return what every result's header says about the run: command line, seed, hashes of the inputs."""
        command = shell("dynid", *sys.argv[1:])
        return {"command": command, "seed": self.seed, "inputs": dict(inputs)}

    # ------------------------------------------------------------ streams
    @cached_property
    def stdout(self) -> Console:
        """Where the answer goes."""
        return _console(sys.stdout, self.color)

    @cached_property
    def stderr(self) -> Console:
        """Where everything else goes."""
        return _console(sys.stderr, self.color)

    @cached_property
    def progress(self) -> Bar:
        """What the library tells about long work."""
        return Bar(self)

    def _copied(self, text: str) -> None:
        """Append a line to the file of --log-file."""
        path, now = self.log_file, datetime.now().astimezone()
        if path is None:
            return
        line = f"{now:%Y-%m-%d %H:%M:%S} {visible(text)}\n" if text else ""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("a", encoding="utf-8", errors="backslashreplace") as stream:
                stream.write(line)
        except OSError as error:
            what = f"cannot write {path}: {error.strerror}"
            raise CannotWrite(what, where=path, fix="give another --log-file") from error

    def _print(self, console: Console, text: str, style: str, indent: int | None) -> None:
        """Print one line; with an indent it is folded between words where a terminal ends."""
        self.progress.end()
        line = visible(text)
        if indent is not None and is_terminal(console.file):
            line = textwrap.fill(
                line,
                console.width,
                subsequent_indent=" " * indent,
                break_long_words=False,
                break_on_hyphens=False,
            )
        console.print(Text(line, style), soft_wrap=True)

    # ------------------------------------------------------------ stderr
    def say(
        self, text: str, style: str = "", indent: int | None = None, *, shown: bool = True
    ) -> None:
        """Say a line on stderr; --log-file has it in any case."""
        self._copied(text)
        if shown:
            self._print(self.stderr, text, style, indent)

    def stage(self, name: str, text: str, *, shown: bool = True) -> None:
        """Say what a stage found: a short label and a sentence; not with --quiet."""
        indent = None if name in COPYABLE else LABEL
        self.say(f"{name:<{LABEL}}{text}", indent=indent, shown=shown and not self.quiet)

    @cached_property
    def written(self) -> list[Path]:
        """What was written, for the JSON answer."""
        return []

    def wrote(self, *paths: Path, note: str = "") -> None:
        """Say what was written."""
        self.written.extend(paths)
        for path in paths:
            self.stage("wrote", f"{path}{f'       ({note})' * bool(note)}")

    # ------------------------------------------------------------ stdout; nothing of it but JSON with --json
    def answer(self, text: str, style: str = "", indent: int | None = None) -> None:
        """Print lines of the answer, folded as ``say`` does."""
        for line in [] if self.json else text.split("\n"):
            self._print(self.stdout, line, style, indent)

    def part(self, part: Part) -> None:
        """Print a part of an answer; warnings go to stderr, tables wider than the terminal have one line a cell."""
        match part:
            case Finding():
                self.progress.findings([part])
            case Judgement():
                self.answer(part.sentence, "bold", SENTENCE)
                for text in (*part.reasons, *part.warnings, ""):
                    self.answer(text, indent=SENTENCE)
            case Table():
                head, *lines = repr(part).splitlines() or [""]
                if max(map(len, (head, *lines))) > self.stdout.width:
                    width = max(map(len, part[0]))
                    lines = [
                        f"{name:<{width}}  {cell_text(value)}"
                        for row in part
                        for name, value in row.items()
                    ]
                elif part:
                    self.answer(head, "bold")
                for line in lines:
                    self.answer(line)
            case str():
                self.answer(part, indent=SENTENCE)
            case label, text:
                self.answer(f"{label:<{LABEL}}{text}", indent=LABEL if label else None)

    def show(self, answer: Answer) -> None:
        """Print an answer, and say what was written and what to do next; with -v all of it."""
        if answer.sentence:
            self.answer(answer.sentence, "bold", SENTENCE)
        for part in (*answer.parts, *(answer.details if self.verbose else ())):
            self.part(part)
        for name, text in answer.notes:
            self.stage(name, text)
        for text in answer.limits:
            self.say(f"{'limit':<{LABEL}}{text}")
        self.wrote(*answer.wrote)
        # Where another command goes on, its next steps are not those of this one.
        inner = click.get_current_context().obj is not None
        for step in () if inner else answer.next[: None if self.verbose else STEPS]:
            self.stage("next", step.command.replace("dynid", program(), 1))
            if step.why:
                self.say(" " * LABEL + step.why, indent=LABEL, shown=not self.quiet)

    def emit_json(self, answer: Mapping[str, Any], indent: int | None = 2) -> None:
        """Print a JSON object on stdout at once, in so many lines or, without an indent, on one."""
        self.progress.end()
        self.stdout.out(json.dumps(plain(answer), indent=indent, allow_nan=False), highlight=False)
        self.stdout.file.flush()


class Bar:
    """A ``dynid.progress.Progress``: after half a second a bar on a terminal, one line a stage elsewhere."""

    def __init__(self, session: Session) -> None:
        self._session, self._told = session, set[tuple[str, ...]]()
        self._name, self._began, self._said = "", time.monotonic(), False
        self._bar: Progress | None = None
        self._timer = threading.Timer(PATIENCE, lambda: None)

    def stage(self, name: str, text: str = "") -> None:
        """Say a line when there is something to say; otherwise a stage begins that may get a bar."""
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        self.end()
        # Why once: a log that several steps of one command read is one log to its reader.
        if text and self._new(name, text):
            self._session.stage(name, text)
        self._name, self._began, self._said = name, time.monotonic(), bool(text)
        console = self._session.stderr
        # Why: a bar moves the cursor; where colour is off no escape codes may appear at all.
        if console.color_system and console.is_terminal and not self._session.quiet:
            columns = TextColumn("{task.description}", markup=False), BarColumn()
            self._bar = Progress(*columns, TimeElapsedColumn(), console=console, transient=True)
            self._bar.add_task(visible(name), total=None)
            self._timer = threading.Timer(PATIENCE, self._bar.start)
            self._timer.daemon = True
            self._timer.start()

    def advance(self, done: float, total: float, text: str = "") -> None:
        """Move the bar; without one, name a silent stage once it takes long."""
        slow = time.monotonic() - self._began > PATIENCE
        if self._bar is not None:
            words = visible(f"{self._name}  {text}")
            (task,) = self._bar.task_ids
            self._bar.update(task, completed=done, total=total or None, description=words)
        # Why not with --json: what a program reads would depend on how busy the machine is.
        elif slow and not self._said and not self._session.json:
            self._said = True
            self._session.stage(self._name, "...")

    def findings(self, findings: Sequence[Finding]) -> None:
        """Say warnings below the stage that they belong to, each once; what is only worth knowing with -v."""
        for each in findings:
            known, text = each.level == "info", f"{each.level}[{each.code}] {each.text}"
            shown, style = bool(self._session.verbose) or not known, "cyan" if known else "yellow"
            if self._new(each.code, each.text):
                self._session.say(text, style, SENTENCE, shown=shown)

    def end(self) -> None:
        """Take the bar away until the next stage begins."""
        self._timer.cancel()
        if self._bar is not None:
            self._bar.stop()

    def _new(self, *words: str) -> bool:
        """Return whether something is said for the first time, and keep it."""
        new = words not in self._told
        self._told.add(words)
        return new


def program() -> str:
    """Return the word that starts dynid here: its path where a shell does not find it, as after ``make demo``."""
    here = Path(sys.argv[0])
    if here.name != "dynid" or not here.is_file() or shutil.which("dynid") is not None:
        return "dynid"
    return shell(os.path.relpath(here))


def _console(stream: TextIO, mode: str) -> Console:
    color, terminal = use_color(stream, mode), is_terminal(stream)
    return QuietConsole(
        file=stream,
        color_system=("auto" if terminal else "standard") if color else None,
        force_terminal=color,
        width=None if terminal or "COLUMNS" in os.environ else UNLIMITED,
    )


def plain(value: Any) -> Any:  # noqa: ANN401
    """Return a value as JSON knows it: arrays as lists, objects as maps, paths as text, what is not finite as null."""
    value = vars(value) if is_dataclass(value) else value
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int)) else str(value)
