"""What a section gives to the page: a title, an anchor, a template and the values that it is filled with."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from dynid.reports.evidence import Evidence


@dataclass(frozen=True)
class Picture:
    """A figure with what a reader needs to judge it.

    Attributes:
        svg: the drawing.
        read: how to read it, one sentence.
        worry: which value would be worrying, one sentence.
    """

    svg: str
    read: str
    worry: str


class Section(ABC):
    """One section of the report; its template is ``templates/<anchor>.html``.

    Attributes:
        title: heading.
        anchor: name in links.
    """

    title: str
    anchor: str

    @abstractmethod
    def context(self, evidence: Evidence) -> dict[str, Any]:
        """Return the values of the section's template."""
