"""Small charts of curves as SVG, written directly: a report has dozens of them, and matplotlib takes 60 ms for each.

They take the page's text colour, font and line colours (``style.css``), in the light and in the dark.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.text import html

Floats = NDArray[np.float64]

#: Least and largest value of each of so many parts of a curve are drawn; a screen shows no more.
PARTS = 500
#: Height of a line of text, and room beside the axes [px].
LINE, LEFT, RIGHT = 12.0, 36.0, 8.0


@dataclass(frozen=True)
class Curve:
    """A line of a chart.

    Attributes:
        x: (M,).
        y: (M,).
        color: name of a colour of the style sheet.
        width: [px].
    """

    x: Floats
    y: Floats
    color: str
    width: float


@dataclass(frozen=True)
class Panel:
    """Curves over one pair of axes.

    Attributes:
        title: above it.
        curves: what is drawn, the last on top.
        low: lower end of the axis of y.
        high: upper end.
        band: x, lower and upper edge of a shaded band, (M,) each; None without.
        unit: beside the axis of y.
    """

    title: str
    curves: tuple[Curve, ...]
    low: float
    high: float
    band: tuple[Floats, Floats, Floats] | None = None
    unit: str = ""


def chart(panels: Sequence[Panel], x_label: str, label: str, *, width: float, height: float) -> str:
    """Return panels below each other as one SVG element.

    Args:
        panels: what is drawn.
        x_label: under the last panel.
        label: what it shows, for those who cannot see it.
        width: of all [px].
        height: of the axes of each panel [px].
    """
    parts, top = [], 0.0
    for panel in panels:
        parts.append(_drawn(panel, top + 1.4 * LINE, width, height))
        top += height + 2.7 * LINE
    parts.append(text(LEFT + 0.5 * (width - LEFT - RIGHT), top + 0.4 * LINE, x_label, "middle"))
    return framed(parts, width, top + 0.8 * LINE, label)


def framed(parts: Sequence[str], width: float, height: float, label: str) -> str:
    """Return elements as one SVG element of a size [px]; the label is for those who cannot see it."""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" role="img" '
        f'aria-label="{html(label)}" fill="none" font-size="9">{"".join(parts)}</svg>'
    )


def standalone(drawing: str, title: str, colors: Mapping[str, str]) -> str:
    """Return a chart as the text of a file of its own: with a title above it, white paper, and the colours by name."""
    found = re.fullmatch(
        r'(<svg .*? viewBox=")0 0 ([0-9.]+) ([0-9.]+)(".*?>)(.*)', drawing, flags=re.S
    )
    assert found is not None
    head, width, height, rest, inside = found.groups()
    names = "".join(f"--{name}:{color};" for name, color in colors.items())
    box = f"0 -{2 * LINE:g} {width} {float(height) + 2 * LINE:g}"
    paper = f'<rect y="-{2 * LINE:g}" width="100%" height="100%" fill="white"/>'
    style = f"<style>svg{{{names}color:black;font-family:sans-serif}}</style>"
    opening = f'<?xml version="1.0" encoding="utf-8"?>\n{head}{box}{rest}'
    return f"{opening}{style}{paper}{text(LEFT, -0.7 * LINE, title, 'start')}{inside}"


def rectangle(
    x: float, y: float, width: float, height: float, color: str, opacity: float = 1.0
) -> str:
    """Return a filled rectangle [px] in a colour of the style sheet, or one that begins with #."""
    fill = color if color.startswith("#") else f"var(--{color})"
    faint = f' fill-opacity="{opacity:g}"' if opacity < 1.0 else ""
    return f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" fill="{fill}"{faint}/>'


def stroke(path: str, color: str = "faint", width: float = 0.6, dash: str = "") -> str:
    """Return a line from the data of a path, in a colour of the style sheet or that of the text ("")."""
    ink = f"var(--{color})" if color else "currentColor"
    dashed = f' stroke-dasharray="{dash}"' if dash else ""
    return f'<path d="{path}" stroke="{ink}" stroke-width="{width:g}"{dashed}/>'


def _drawn(panel: Panel, top: float, width: float, height: float) -> str:
    """Return one panel whose axes begin at a height [px]."""
    inside, bottom = width - LEFT - RIGHT, top + height
    shown = [curve.x[np.isfinite(curve.x)] for curve in panel.curves]
    ends = [float(end) for x in shown if len(x) for end in (x.min(), x.max())] or [0.0, 1.0]
    first, last = min(ends), max(ends)
    per_x, per_y = inside / max(last - first, 1e-12), height / max(panel.high - panel.low, 1e-12)

    def line(x: Floats, y: Floats) -> str:
        return _path(
            LEFT + (x - first) * per_x,
            bottom - (np.clip(y, panel.low, panel.high) - panel.low) * per_y,
        )

    across = [
        (LEFT + (value - first) * per_x, number(value)) for value in ticks(first, last, inside / 40)
    ]
    up = [
        (bottom - (value - panel.low) * per_y, number(value))
        for value in ticks(panel.low, panel.high, 4)
    ]
    grid = [f"M{x:.1f} {top:.1f}v{height:.1f}" for x, _ in across] + [
        f"M{LEFT:g} {y:.1f}h{inside:.1f}" for y, _ in up
    ]
    found = [stroke("".join(grid))]
    found += [text(LEFT - 3, y + 3, words, "end") for y, words in up]
    found += [text(x, bottom + 0.85 * LINE, words, "middle") for x, words in across]
    if panel.band is not None:
        around, low, high = panel.band
        edge = line(np.concatenate([around, around[::-1]]), np.concatenate([low, high[::-1]]))
        found.append(f'<path d="{edge}Z" fill="var(--estimated)" fill-opacity="0.25"/>')
    for curve in panel.curves:
        found.append(stroke(line(*outline(curve.x, curve.y)), curve.color, curve.width))
    found.append(stroke(f"M{LEFT:g} {top:.1f}v{height:.1f}h{inside:.1f}", "", 0.8))
    found.append(
        text(
            LEFT,
            top - 0.4 * LINE,
            panel.title + (f" [{panel.unit}]" if panel.unit else ""),
            "start",
        )
    )
    return "".join(found)


def outline(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return a curve by the least and the largest value of each of its parts, in their order; a short one as it is.

    Why not every k-th point: a spike between two of them would not be seen.

    Args:
        x: (M,).
        y: (M,); not a number where the curve breaks.
    """
    if len(x) <= 2 * PARTS:
        return x, y
    edges = np.linspace(0, len(x), PARTS + 1).astype(int)
    broken = np.flatnonzero(~np.isfinite(y))
    filled = np.where(np.isfinite(y), y, 0.0)
    length = int(np.diff(edges).max())
    rows = np.minimum(edges[:-1, None] + np.arange(length), edges[1:, None] - 1)
    found = np.sort(
        np.stack([np.argmin(filled[rows], axis=1), np.argmax(filled[rows], axis=1)], axis=1), axis=1
    )
    kept = np.unique(np.concatenate([(rows[:, :1] + found).ravel(), broken, [0, len(x) - 1]]))
    return x[kept], y[kept]


def broken(t: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Return a curve over time that breaks where time does: a line across a gap would show what nobody measured.

    Args:
        t: (M,) [s].
        x: (M,).
    """
    steps = np.diff(t)
    gaps = (
        np.flatnonzero(np.abs(steps) > 5 * max(np.median(steps), 1e-12)) + 1
        if len(steps)
        else np.zeros(0, int)
    )
    return np.insert(t.astype(float), gaps, np.nan), np.insert(x.astype(float), gaps, np.nan)


def reach(curves: Sequence[Floats]) -> tuple[float, float]:
    """Return the ends of an axis for curves, (M,) each: nearly all of them and some room."""
    low, high = np.nanpercentile(np.concatenate(list(curves)), [0.2, 99.8])
    room = 0.12 * max(high - low, 1e-9)
    return float(low - room), float(high + room)


#: Fewest ticks of an axis: one tells no scale.
FEWEST = 3


def ticks(low: float, high: float, most: float) -> list[float]:
    """Return round numbers between two, at most about so many, but three where there would be fewer."""
    rough = (high - low) / max(most, 1.0)
    if not math.isfinite(rough) or rough <= 0.0:
        return [low]
    size = 10.0 ** math.floor(math.log10(rough))
    wanted = next(k for k in (1, 2, 5, 10) if size * k >= 0.999 * rough)
    found: list[float] = []
    for step in (size * k for k in (10, 5, 2, 1, 0.5, 0.2) if k <= wanted):
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        found = [k * step for k in range(first, last + 1)]
        if len(found) >= FEWEST:
            break
    return found


def number(value: float) -> str:
    """Return the text of a tick."""
    return f"{value:.6g}".replace("-", "\N{MINUS SIGN}")


def _path(x: Floats, y: Floats) -> str:
    """Return a line as the data of an SVG path, with breaks where a value is not a number."""
    words, start = [], True
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if b != b:  # not a number
            start = True
            continue
        words.append(f"{'M' if start else 'L'}{a:.1f} {b:.1f}")
        start = False
    return "".join(words)


def text(x: float, y: float, words: str, anchor: str, turned: bool = False) -> str:
    """Return a text at a place [px], which is its start, middle or end; turned, it runs upwards."""
    turn = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if turned else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="currentColor"{turn}>{html(words)}</text>'
