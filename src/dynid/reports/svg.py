"""Figures as SVG inside a page: they take the page's text colour and font, in the light and in the dark."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dynid.reports.figures import ESTIMATED, GRID, MEASURED, RESIDUAL, save
from dynid.text import html

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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


#: Stands for the page's text colour until the figure is written.
INK = "#010203"
#: What the page shows for the colours of figures; the style sheet has lighter ones for the dark.
_SHOWN = {
    INK: "currentColor",
    GRID: "var(--faint)",
    MEASURED: "var(--measured)",
    ESTIMATED: "var(--estimated)",
    RESIDUAL: "var(--residual)",
}
_OF_TEXT = ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color")
_OF_PAPER = ("figure.facecolor", "axes.facecolor", "savefig.facecolor", "legend.facecolor")


def drawn(draw: Callable[[], Figure], label: str) -> str:
    """Return a figure as an SVG element that fills the width it is given.

    Args:
        draw: draws it.
        label: what it shows, for those who cannot see it; no other figure of the page has the same.
    """
    from matplotlib import rc_context

    stream = io.StringIO()
    style = dict.fromkeys(_OF_TEXT, INK) | dict.fromkeys(_OF_PAPER, "none")
    with rc_context(style):  # type: ignore[arg-type]
        save(draw(), stream, "svg", salt=label)
    return embedded(stream.getvalue(), label)


def embedded(text: str, label: str) -> str:
    """Return the text of an SVG file of matplotlib as an element of a page."""
    head, rest = text[text.index("<svg") :].split(">", 1)
    box = re.search(r'viewBox="[^"]*"', head)
    assert box is not None
    used = set(re.findall(r'(?:url\(|href=")#([^)"]+)', rest))
    # Why: names of groups are the same in every figure, and ids must be unique on a page.
    rest = re.sub(r' id="([^"]+)"', lambda match: match[0] if match[1] in used else "", rest)
    for color, shown in _SHOWN.items():
        rest = rest.replace(color, shown)
    # A hundredth of a point is finer than a screen.
    rest = re.sub(r"(\.\d\d)\d{3,}", r"\1", rest)
    rest = re.sub(r"font: ([0-9.]+)px [^;\"]*", r"font-size: \1px; font-family: inherit", rest)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        f'{box[0]} role="img" aria-label="{html(label)}">{rest}'
    )
