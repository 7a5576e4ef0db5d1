"""The picture and the animation of a preview: rendered poses above the traces of all joints, drawn with Pillow."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from PIL.Image import Image

Floats = NDArray[np.float64]
#: Time [s] and pixels of a pose, (height, width, 3).
Picture = tuple[float, NDArray[np.uint8]]
#: Names of the joints, times, (N,) [s], and positions as shares of the joints' ranges, (N, n).
Traces = tuple[tuple[str, ...], Floats, Floats]

#: Colours that are distinct for colour-blind people (Okabe and Ito); repeated for arms of more joints.
COLORS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#000000", "#9a8a00")
#: Heights of the title and of the traces, and space between poses [pixels].
TITLE, TRACES, GAP = 26, 230, 4
#: Space around the traces: left, top, right, bottom [pixels].
BORDER = 46, 10, 150, 34
#: Poses side by side in a still, and length of the animation [ms].
COLUMNS, SHOWN = 3, 6000


def still(pictures: list[Picture], traces: Traces, title: str) -> bytes:
    """Return a PNG file of poses of a motion, in reading order, above the joints' traces."""
    stream = io.BytesIO()
    _sheet(pictures, traces, title).save(stream, "PNG", optimize=True)
    return stream.getvalue()


def animation(pictures: list[Picture], traces: Traces, title: str) -> bytes:
    """Return a GIF file of a motion with a line that moves along the joints' traces."""
    stream = io.BytesIO()
    first, *others = (_sheet([each], traces, title).quantize(64) for each in pictures)
    each = SHOWN // len(pictures)
    first.save(stream, "GIF", save_all=True, append_images=others, duration=each, loop=0)
    return stream.getvalue()


def _sheet(pictures: list[Picture], traces: Traces, title: str) -> Image:
    """Draw poses, and every joint's position in its range with a line at the time of each pose."""
    from PIL import Image, ImageDraw

    columns = min(COLUMNS, len(pictures))
    down, across = np.add(pictures[0][1].shape[:2], GAP).tolist()
    below = TITLE + -(-len(pictures) // columns) * down
    sheet = Image.new("RGB", (columns * across - GAP, below + TRACES), "white")
    draw = ImageDraw.Draw(sheet)
    draw.text((8, 4), title, "black", font_size=14)
    for k, (time, picture) in enumerate(pictures):
        x, y = k % columns * across, TITLE + k // columns * down
        sheet.paste(Image.fromarray(picture), (x, y))
        draw.text((x + 8, y + 6), f"t = {time:.1f} s", "black", font_size=16)
    names, times, shares = traces
    left, top = BORDER[0], below + BORDER[1]
    width, height = sheet.width - left - BORDER[2], TRACES - BORDER[1] - BORDER[3]
    right, bottom = left + width, top + height
    draw.rectangle((left, top, right, bottom), outline="#999999")
    draw.line((left, top + height / 2, right, top + height / 2), "#dddddd")
    for time, _ in pictures:
        x = left + time / times[-1] * width
        draw.line((x, top, x, bottom), "#bbbbbb" if len(pictures) > 1 else "#333333", width=2)
    words: list[tuple[float, float, str]]
    words = [(4, bottom - 7, "lower"), (4, top + height / 2 - 7, "middle"), (4, top - 7, "upper")]
    words += [(left, bottom + 6, "0 s"), (right - 40, bottom + 6, f"{times[-1]:.1f} s")]
    words += [(left + width / 2 - 80, bottom + 6, "position in the joint's range")]
    for x, y, word in words:
        draw.text((x, y), word, "#555555", font_size=12)
    some = slice(None, None, max(1, len(times) // 600))
    for j, name in enumerate(names):
        color = COLORS[j % len(COLORS)]
        points = np.stack(
            [left + times / times[-1] * width, bottom - shares[:, j] * height], axis=1
        )
        draw.line(points[some].ravel().tolist(), color, width=2)
        draw.text((right + 8, top + 2 + j * 22), name[-22:], color, font_size=12)
    return sheet
