"""Arguments that the shell completes: robots, effects, codes; any text is accepted."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem


class Completed(click.ParamType):  # type: ignore[type-arg]  # generic from click 8.2 on
    """Text with words to choose from.

    Args:
        words: returns the words.
        files: whether a file may be named instead.
        listed: whether several words may follow each other with commas between.
    """

    name = "text"

    def __init__(self, words: Callable[[], Iterable[str]], *, files: bool = False, listed: bool = False) -> None:
        self._words, self._files, self._listed = words, files, listed

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:  # noqa: ANN401
        """Return the text as it is."""
        return str(value)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return the words that begin with what was typed, and files where a path was begun or no word fits."""
        before, comma, begun = incomplete.rpartition(",") if self._listed else ("", "", incomplete)
        found = [CompletionItem(f"{before}{comma}{word}") for word in self._words() if word.startswith(begun)]
        path = "/" in incomplete or Path(incomplete).suffix
        return [*found, CompletionItem(incomplete, type="file")] if self._files and (path or not found) else found


def _robots() -> Iterable[str]:
    from dynid.files.robotfile import known_robots

    return known_robots()


def _effects() -> Iterable[str]:
    from dynid.model.effects.catalogue import CATALOGUE

    return ["all", *CATALOGUE]


def _codes() -> Iterable[str]:
    from dynid.codes import codes
    from dynid.files import pages

    return [*codes(), *pages()]


ROBOT = Completed(_robots, files=True)
EFFECTS = Completed(_effects, listed=True)
CODE = Completed(_codes)
