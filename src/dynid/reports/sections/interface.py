"""What a section gives to the page: a title, an anchor, and the values that its template is filled with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dynid.reports.evidence import Evidence


@dataclass(frozen=True)
class Picture:
    """A figure with what a reader needs to judge it.

    Attributes:
        svgs: the drawings; several stand side by side where there is room.
        read: how to read it, one sentence.
        worry: which value would be worrying, one sentence.
        narrow: whether two drawings fit side by side on a telephone.
    """

    svgs: tuple[str, ...]
    read: str
    worry: str
    narrow: bool = False


@dataclass(frozen=True)
class Section:
    """One section of the report.

    Attributes:
        title: heading.
        anchor: name in links, and of the template ``templates/<anchor>.html``.
        context: returns the values of the template.
    """

    title: str
    anchor: str
    context: Callable[[Evidence], dict[str, Any]]
