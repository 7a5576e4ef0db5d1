"""The picture and the animation of a preview: rendered poses above the traces of all joints, drawn with Pillow."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.disk import written_whole

if TYPE_CHECKING:
    from PIL import Image

Floats = NDArray[np.float64]
Picture = tuple[float, NDArray[np.uint8]]
#: Labels, times, positions (N, n) and the limits of the joints.
Traces = tuple[list[str], Floats, Floats, list[float], list[float]]

#: Colours that colour-blind people tell apart (Okabe and Ito); repeated for arms of more joints.
COLORS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#000000", "#9a8a00")
#: Height of the traces and width of their labels [pixels].
TRACES, MARGIN = 230, 150
#: Length of the animation [ms].
SHOWN = 6000
_TITLE = 26
#: Space between the poses of a still [pixels].
_GAP = 4


def still(path: Path, pictures: list[Picture], traces: Traces, title: str) -> None:
    """Write poses of a motion, in reading order, above the joints' traces."""
    from PIL import Image, ImageDraw

    columns = 3
    height, width = pictures[0][1].shape[:2]
    rows = -(-len(pictures) // columns)
    across, down = width + _GAP, height + _GAP
    sheet = Image.new("RGB", (columns * across - _GAP, _TITLE + rows * down + TRACES), "white")
    draw = ImageDraw.Draw(sheet)
    draw.text((8, 3), title, "black", font_size=16)
    for k, (time, picture) in enumerate(pictures):
        corner = (k % columns * across, _TITLE + k // columns * down)
        sheet.paste(Image.fromarray(picture), corner)
        draw.text((corner[0] + 8, corner[1] + 6), f"t = {time:.1f} s", "black", font_size=16)
    box = (0, _TITLE + rows * down, sheet.width, sheet.height)
    _traces(draw, box, traces, [time for time, _ in pictures])
    _save(sheet, path)


def animation(path: Path, pictures: list[Picture], traces: Traces, title: str) -> None:
    """Write an animated picture of a motion with a line that moves along the joints' traces."""
    from PIL import Image, ImageDraw

    frames = []
    height, width = pictures[0][1].shape[:2]
    for time, picture in pictures:
        frame = Image.new("RGB", (width, _TITLE + height + TRACES), "white")
        draw = ImageDraw.Draw(frame)
        draw.text((8, 4), f"{title}   t = {time:.1f} s", "black", font_size=13)
        frame.paste(Image.fromarray(picture), (0, _TITLE))
        _traces(draw, (0, _TITLE + height, width, frame.height), traces, [time])
        frames.append(frame.quantize(64))
    with written_whole(path) as stream:
        frames[0].save(
            stream,
            "GIF",
            save_all=True,
            append_images=frames[1:],
            duration=SHOWN // len(frames),
            loop=0,
        )


def _save(sheet: Image.Image, path: Path) -> None:
    with written_whole(path) as stream:
        sheet.save(stream, "PNG", optimize=True)


def _traces(draw: Any, box: tuple[int, int, int, int], traces: Traces, marks: list[float]) -> None:  # noqa: ANN401
    """Draw every joint's position as a share of its range, 0 at the lower and 1 at the upper limit."""
    labels, t, q, lower, upper = traces
    left, top, right, bottom = box[0] + 46, box[1] + 10, box[2] - MARGIN, box[3] - 34
    draw.rectangle((left, top, right, bottom), outline="#999999")
    for share, text in ((0.0, "lower"), (0.5, "middle"), (1.0, "upper")):
        y = bottom - share * (bottom - top)
        draw.line((left, y, right, y), "#dddddd" if share == 0.5 else "#999999")
        draw.text((box[0] + 4, y - 7), text, "#555555", font_size=11)
    for mark in marks:
        at = left + mark / float(t[-1]) * (right - left)
        draw.line((at, top, at, bottom), "#bbbbbb" if len(marks) > 1 else "#333333", width=2)
    step = max(1, len(t) // 600)
    across = left + t[::step] / t[-1] * (right - left)
    for j, label in enumerate(labels):
        height = bottom - (q[::step, j] - lower[j]) / (upper[j] - lower[j]) * (bottom - top)
        color = COLORS[j % len(COLORS)]
        draw.line(list(zip(across.tolist(), height.tolist(), strict=True)), color, width=2)
        draw.text((right + 8, top + 2 + j * 22), label[-22:], color, font_size=12)
    draw.text((left, bottom + 6), "0 s", "#555555", font_size=12)
    draw.text((right - 40, bottom + 6), f"{t[-1]:.1f} s", "#555555", font_size=12)
    draw.text(
        ((left + right) / 2 - 80, bottom + 6),
        "position in the joint's range",
        "#555555",
        font_size=12,
    )
