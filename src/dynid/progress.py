"""A progress report without a user interface: the command line installs a real one, the library sees this."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from dynid.errors import Finding


class Progress(Protocol):
    """What the library tells about long work."""

    def stage(self, name: str, text: str = "") -> None:
        """Say that a stage begins or what it found."""

    def advance(self, done: float, total: float, text: str = "") -> None:
        """Say how much of the current stage is done."""

    def findings(self, findings: Sequence[Finding]) -> None:
        """Say warnings as soon as they are known; results keep them as well."""


class Silent:
    """A progress report that says nothing."""

    def stage(self, name: str, text: str = "") -> None:
        """Say nothing."""

    def advance(self, done: float, total: float, text: str = "") -> None:
        """Say nothing."""

    def findings(self, findings: Sequence[Finding]) -> None:
        """Say nothing."""


SILENT: Progress = Silent()
