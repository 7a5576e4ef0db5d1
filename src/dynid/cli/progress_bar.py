"""Progress on stderr: nothing for half a second, then a bar on a terminal; one line a stage everywhere else."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Protocol

from dynid.errors import Finding
from dynid.text import visible

if TYPE_CHECKING:
    import rich.progress
    from rich.console import Console

#: Work shorter than this is not worth a bar [s].
PATIENCE = 0.5


class Speaker(Protocol):
    """Where progress is said."""

    @property
    def err(self) -> Console:
        """Console on stderr."""

    @property
    def quiet(self) -> bool:
        """Whether nothing but warnings and errors is wanted."""

    @property
    def unwatched(self) -> bool:
        """Whether a program waits for the answer, and nobody for its progress."""

    def stage(self, name: str, text: str) -> None:
        """Say what a stage found."""

    def findings(self, findings: Sequence[Finding]) -> None:
        """Say warnings."""


class Bar:
    """A ``dynid.progress.Progress`` for one command; use it in a ``with`` block.

    Args:
        terminal: where to say it.
    """

    def __init__(self, terminal: Speaker) -> None:
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
            elif self._slow() and not self._terminal.unwatched:
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
