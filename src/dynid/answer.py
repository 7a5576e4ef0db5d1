"""What a command found: a table for people and facts for programs, the same on a terminal, in a notebook, as JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dynid.judgement.evidence import Evidence
from dynid.judgement.judge import Judgement, judge
from dynid.table import Table

if TYPE_CHECKING:
    from pandas import DataFrame


def picked(source: object, *same: str, **renamed: str) -> dict[str, Any]:
    """Return attributes of an object as facts, by their own names and by others."""
    renamed |= {name: name for name in same}
    return {name: getattr(source, own) for name, own in renamed.items()}


class Answer:
    """Base of what public functions return."""

    def table(self) -> Table:
        """Return what a person reads; its title and footer say what it is about."""
        raise NotImplementedError

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of its command says."""
        raise NotImplementedError

    def to_dataframe(self) -> DataFrame:
        """Return the table as a pandas DataFrame."""
        return self.table().to_dataframe()

    def __repr__(self) -> str:
        """Return the table as text."""
        return repr(self.table())

    def _repr_html_(self) -> str:
        return self.table()._repr_html_()


class Judged(Answer):
    """An answer that is judged."""

    @property
    def evidence(self) -> Evidence:
        """What is known of the model."""
        raise NotImplementedError

    @property
    def judgement(self) -> Judgement:
        """What is said of it: lights, the first sentence, what to do next."""
        return judge(self.evidence)
