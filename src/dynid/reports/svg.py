"""Figures as SVG inside a page: they take the page's text colour and font, in the light and in the dark."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dynid.reports.figures import ESTIMATED, GRID, MEASURED, RESIDUAL, save
from dynid.reports.style import own_style
from dynid.text import html

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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


#: Stands for the page's text colour until the figure is written.
INK = "#010203"
#: Stands for the page's faint lines.
FAINT = "#040506"
#: What the page shows for the colours of figures; the style sheet has lighter ones for the dark.
_SHOWN = {
    INK: "currentColor",
    FAINT: "var(--faint)",
    GRID: "var(--faint)",
    MEASURED: "var(--measured)",
    ESTIMATED: "var(--estimated)",
    RESIDUAL: "var(--residual)",
}


@contextmanager
def page_style(name: str) -> Iterator[None]:
    """Draw with the page's colours; ``name`` keeps the ids of several figures on one page apart."""
    style: dict[Any, Any] = {
        "svg.fonttype": "none",
        "svg.hashsalt": name,
        "font.family": "sans-serif",
        "font.size": 8,
        "axes.axisbelow": True,
        "text.color": INK,
        "axes.labelcolor": INK,
        "axes.edgecolor": INK,
        "axes.titlecolor": INK,
        "xtick.color": INK,
        "ytick.color": INK,
        "grid.color": FAINT,
        "figure.facecolor": "none",
        "axes.facecolor": "none",
        "savefig.facecolor": "none",
        "legend.facecolor": "none",
        "path.simplify_threshold": 0.3,
    }
    with own_style(style):
        yield


def drawn(name: str, draw: Callable[[], Figure], label: str) -> str:
    """Return a figure as an SVG element in the style of the page.

    Args:
        name: keeps its ids apart from those of other figures.
        draw: draws it.
        label: what it shows, for those who cannot see it.
    """
    with page_style(name):
        return as_svg(draw(), label)


def as_svg(figure: Figure, label: str) -> str:
    """Return a figure as an SVG element that fills the width it is given.

    Args:
        figure: the figure, drawn in ``page_style``.
        label: what it shows, for those who cannot see it.
    """
    stream = io.StringIO()
    save(
        figure,
        stream,
        "svg",
        metadata={"Date": None, "Creator": None, "Type": None, "Format": None},
    )
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    head, rest = text.split(">", 1)
    box = re.search(r'viewBox="[^"]*"', head)
    assert box is not None
    opening = f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" {box[0]}'
    rest = re.sub(r"<metadata>.*?</metadata>", "", rest, flags=re.S)
    used = set(re.findall(r'(?:url\(|href=")#([^)"]+)', rest))
    # Why: names of groups are the same in every figure, and ids must be unique on a page.
    rest = re.sub(r' id="([^"]+)"', lambda match: match[0] if match[1] in used else "", rest)
    for drawn, shown in _SHOWN.items():
        rest = rest.replace(drawn, shown)
    rest = re.sub(r"font: ([0-9.]+)px [^;\"]*", r"font-size: \1px; font-family: inherit", rest)
    return f'{opening} role="img" aria-label="{html(label)}">{rest}'
