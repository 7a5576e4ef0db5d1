"""What the library tells about long work, to whoever listens: the command line does, and notebooks may."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol, runtime_checkable

from dynid.errors import Finding


@runtime_checkable
class Progress(Protocol):
    """A listener."""

    def stage(self, name: str, text: str = "") -> None:
        """Hear that a stage begins or what it found."""
        return

    def advance(self, done: float, total: float, text: str = "") -> None:
        """Hear how much of the current stage is done."""
        return

    def findings(self, findings: Sequence[Finding]) -> None:
        """Hear warnings as soon as they are known; results keep them as well."""
        return


class Silent(Progress):
    """A listener that does nothing."""


SILENCE = Silent()
#: Who listens in this thread.
LISTENER: ContextVar[Progress] = ContextVar("listener", default=SILENCE)


@contextmanager
def heard_by(listener: Progress = SILENCE) -> Iterator[None]:
    """Tell what happens in a ``with`` block, or in a function, to a listener, or to nobody."""
    token = LISTENER.set(listener)
    try:
        yield
    finally:
        LISTENER.reset(token)


def stage(name: str, text: str = "") -> None:
    """Say that a stage begins or what it found."""
    LISTENER.get().stage(name, text)


def advance(done: float, total: float, text: str = "") -> None:
    """Say how much of the current stage is done."""
    LISTENER.get().advance(done, total, text)


def notice(findings: Sequence[Finding]) -> None:
    """Say warnings."""
    LISTENER.get().findings(findings)
