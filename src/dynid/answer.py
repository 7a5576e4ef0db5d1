"""What a command answers: one object that becomes text on a terminal, a cell in a notebook, and JSON."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from dynid.errors import Finding
from dynid.judgement.evidence import Evidence
from dynid.judgement.rules import Judgement, Step, judge
from dynid.table import Table
from dynid.text import html, visible

if TYPE_CHECKING:
    from pandas import DataFrame

#: Width of the column of labels.
LABEL = 11
#: What a JSON answer holds: units are part of the keys.
Facts: TypeAlias = dict[str, Any]
#: A sentence, a label with a sentence, a table, a warning, or what is said of a model.
Part: TypeAlias = str | tuple[str, str] | Table | Finding | Judgement


def picked(source: object, *same: str, **renamed: str) -> Facts:
    """Return attributes of an object as facts, by their own names and by others."""
    renamed |= {name: name for name in same}
    return {name: getattr(source, own) for name, own in renamed.items()}


@dataclass(frozen=True)
class Answer:
    """What a command answers.

    Attributes:
        facts: its JSON answer, without the files that were written.
        sentence: the answer in one sentence.
        parts: what follows it, in this order.
        details: what is behind that; shown with ``-v``.
        notes: how it came about, each a label and a sentence; not part of the answer.
        wrote: the files that were written.
        next: what to do next, most urgent first.
        limits: limits of the user that are not met, in words; with any, the exit status is 1.
        status: another exit status.
    """

    facts: Mapping[str, Any]
    sentence: str = ""
    parts: Sequence[Part] = ()
    details: Sequence[Part] = ()
    notes: Sequence[tuple[str, str]] = ()
    wrote: Sequence[Path] = ()
    next: Sequence[Step] = ()
    limits: Sequence[str] = ()
    status: int = 0

    def text(self, *, details: bool = True) -> str:
        """Return the answer as text."""
        lines = self._lines(self.details if details else ())
        return "\n".join(visible(x) if isinstance(x, str) else repr(x) for x in lines)

    def _repr_html_(self) -> str:
        """Return the answer with its details for notebooks."""
        return "".join(
            f"<p>{html(line)}</p>" if isinstance(line, str) else line._repr_html_()
            for line in self._lines(self.details)
        )

    def _lines(self, details: Sequence[Part]) -> Iterator[str | Table]:
        """Yield lines of text, and tables."""
        if self.sentence:
            yield self.sentence
        for part in (*self.parts, *self.notes, *details):
            match part:
                case Judgement():
                    yield from part.sentences
                case Finding():
                    yield f"{part.code} {part.text}"
                case Table() | str():
                    yield part
                case label, text:
                    yield f"{label:<{LABEL}}{text}"


def judged(
    judgement: Judgement, facts: Mapping[str, Any], *parts: Part, details: Sequence[Part] = ()
) -> Answer:
    """Return the answer of a judgement: its sentences, its sides, and what follows them."""

    def sides(*states: str) -> list[Part]:
        lights = (light for light in judgement.lights if light.state in states and light.text)
        return [(light.shown, f"{light.title}: {light.text}") for light in lights]

    titles = {
        word: ", ".join(light.title for light in judgement.lights if light.shown == word)
        for word in ("good", "untested")
    }
    return Answer(
        facts,
        parts=(judgement, *sides("bad", "fair"), *filter(all, titles.items()), "", *parts),
        details=(*sides("good"), *details),
        next=judgement.steps,
    )


class Answered:
    """Base of what public functions return: it prints as its answer."""

    def answer(self) -> Answer:
        """Return what its command prints."""
        raise NotImplementedError

    def table(self) -> Table:
        """Return the table that a person reads."""
        return next(part for part in self.answer().parts if isinstance(part, Table))

    def to_dataframe(self) -> DataFrame:
        """Return the table as a pandas DataFrame."""
        return self.table().to_dataframe()

    def summary(self) -> str:
        """Return the answer as text, with its details."""
        return self.answer().text()

    def __repr__(self) -> str:
        """Return the answer as text."""
        return self.answer().text(details=False)

    def _repr_html_(self) -> str:
        return self.answer()._repr_html_()


class Judged(Answered):
    """An answer about a model, which is judged."""

    @property
    def evidence(self) -> Evidence:
        """What is known of the model."""
        raise NotImplementedError

    @property
    def judgement(self) -> Judgement:
        """What is said of it: lights, the first sentence, what to do next."""
        return judge(self.evidence)
