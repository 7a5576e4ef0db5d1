"""Figures with matplotlib: functions that take objects and return a figure, and the one writer of figures.

The same functions draw for files, for notebooks and for the report. Estimated against measured motion are the paper's
Figures 3 to 6.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.disk import written_whole
from dynid.estimation.prediction import EstimatedMotion
from dynid.robot import Robot
from dynid.text import TITLE_LENGTH, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

#: Colours that stay apart for colour-blind readers and in print (Okabe and Ito).
MEASURED, ESTIMATED, RESIDUAL = "#8c8c8c", "#0072b2", "#d55e00"
GRID = "#e6e6e6"
#: Width of a figure [inch]: its text is readable on a telephone and on a screen.
WIDTH = 4.6
#: Size of text [points].
TEXT = 8
#: Least and largest value of each of so many parts of a curve are drawn; a screen shows no more.
PARTS = 500


@dataclass(frozen=True)
class Quantity:
    """What one figure shows, and its unit for turning and sliding joints."""

    key: str
    title: str
    units: tuple[str, str]


TORQUE = Quantity("tau", "torque", ("N m", "N"))
QUANTITIES = (
    Quantity("q", "position", ("rad", "m")),
    Quantity("qd", "velocity", ("rad/s", "m/s")),
    Quantity("qdd", "acceleration", ("rad/s²", "m/s²")),
    TORQUE,
)


# ---------------------------------------------------------------- empty figures
def new_figure(height: float, *, spaced: bool = True) -> Figure:
    """Return an empty figure of a height [inch] that a notebook draws by itself, without pyplot.

    Args:
        height: of the figure.
        spaced: whether matplotlib finds the room for labels, which takes longer than drawing.
    """
    return _notebook_figure()(figsize=(WIDTH, height), layout="constrained" if spaced else None)


@cache
def _notebook_figure() -> type[Figure]:
    # Why once: matplotlib documents every class of figures anew, which takes as long as a panel.
    from io import BytesIO

    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        def _repr_png_(self) -> bytes:
            stream = BytesIO()
            self.savefig(stream, format="png", dpi=100)
            return stream.getvalue()

    return NotebookFigure


def joint_panels(
    titles: Sequence[str],
    each: float,
    x_labels: Sequence[str],
    *,
    over_time: bool = False,
    title: str = "",
) -> tuple[Figure, NDArray[np.object_]]:
    """Return a figure with one row of panels per joint, and its axes, (n, columns).

    Args:
        titles: of the rows, over their first panels.
        each: height of a panel [inch].
        x_labels: under the last panel of each column.
        over_time: whether all share an axis, whose numbers stand under the last, and a legend above.
        title: of the figure; "" for none.
    """
    n, columns = len(titles), len(x_labels)
    between, above = (0.26, 0.5) if over_time else (0.4, 0.25)
    above += 0.2 if title else 0.0
    left, right, below = 0.5, 0.1, 0.45
    height = n * each + (n - 1) * between + above + below
    figure = new_figure(height, spaced=False)
    axes = figure.subplots(
        n,
        columns,
        squeeze=False,
        sharex=over_time,
        gridspec_kw={
            "left": left / WIDTH,
            "right": 1 - right / WIDTH,
            "bottom": below / height,
            "top": 1 - above / height,
            "hspace": between / each,
            "wspace": 0.3 * columns / (WIDTH - left - right),
        },
    )
    if title:
        figure.suptitle(title, x=0.01, y=1 - 0.05 / height, ha="left", va="top", fontsize=TEXT + 1)
    for row, words in zip(axes, titles, strict=True):
        # Why with a height, the usual one: else matplotlib looks whether labels are in the way.
        row[0].set_title(words, fontsize=TEXT, loc="left", y=1.0, pad=3)
    for axis in axes.flat:
        plain(axis)
    for axis, words in zip(axes[-1], x_labels, strict=True):
        axis.set_xlabel(words, fontsize=TEXT)
    return figure, axes


def joint_legend(figure: Figure, axes: NDArray[np.object_]) -> None:
    """Write the names of the curves of ``joint_panels`` above the first panel."""
    handles = axes[0, 0].get_legend_handles_labels()
    place = axes[0, 0].get_position()
    corner = (place.x1, place.y1 + 0.2 / figure.get_figheight())
    figure.legend(
        *handles, loc="lower right", bbox_to_anchor=corner, ncols=3, frameon=False, fontsize=TEXT
    )


def plain(axis: Axes) -> None:
    """Give an axis the look of all figures: few ticks, a faint grid, no frame."""
    axis.grid(color=GRID, lw=0.6)
    axis.set_axisbelow(True)
    axis.tick_params(labelsize=TEXT - 1, length=2)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


# ---------------------------------------------------------------- motion
def motion_figure(
    motion: EstimatedMotion,
    robot: Robot,
    joints: tuple[str, ...] = (),
    title: str = "",
    quantity: Quantity = TORQUE,
    *,
    residual_only: bool = False,
) -> Figure:
    """Draw measured and estimated motion, one panel per joint; of torques also the residual, on the same scale.

    Args:
        motion: measured and estimated motion.
        robot: the arm.
        joints: names of the joints that are drawn, all without.
        title: above the figure; "" for none.
        quantity: what is drawn.
        residual_only: draw what is left of the measured values alone, so that it fills the panel.
    """
    numbers = [robot.joint_names.index(name) for name in joints] or list(range(robot.n))
    units = [quantity.units[not robot.joints[j].revolute] for j in numbers]
    titles = [
        f"{label(robot.joints[j].name)} [{unit}]" for j, unit in zip(numbers, units, strict=True)
    ]
    what = f"residual {quantity.title}" if residual_only else quantity.title
    words = f"{label(title, TITLE_LENGTH)}: {what}" * bool(title)
    figure, axes = joint_panels(titles, 0.85, ["time [s]"], over_time=True, title=words)
    for axis, j in zip(axes[:, 0], numbers, strict=True):
        curves = _shown(motion, quantity, j)
        _draw_curves(axis, motion.t, {"residual": curves["residual"]} if residual_only else curves)
    joint_legend(figure, axes)
    return figure


def _shown(
    motion: EstimatedMotion, quantity: Quantity, j: int
) -> dict[str, tuple[Floats, str, float]]:
    """Return values, colour and width of the curves of a quantity of joint j."""
    measured = getattr(motion, f"{quantity.key}_measured")[:, j]
    estimated = getattr(motion, f"{quantity.key}_estimated")[:, j]
    both = {"measured": (measured, MEASURED, 2.2), "estimated": (estimated, ESTIMATED, 0.9)}
    if quantity is TORQUE:
        both["residual"] = (measured - estimated, RESIDUAL, 0.7)
    return both


def _draw_curves(axis: Axes, t: Floats, curves: Mapping[str, tuple[Floats, str, float]]) -> None:
    """Draw curves with label, values, colour and width; a gap in time stays one."""
    for name, (values, color, width) in curves.items():
        axis.plot(*thinned(*broken(t, values)), color=color, lw=width, label=name)
    low, high = np.nanpercentile(
        np.concatenate([values for values, _, _ in curves.values()]), [0.2, 99.8]
    )
    room = 0.12 * max(high - low, 1e-9)
    axis.set_ylim(low - room, high + room)
    axis.locator_params(axis="y", nbins=4)


def thinned(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return a curve by the least and the largest value of each of its parts, in their order; a short one as it is.

    Why not every k-th point: a spike between two of them would not be seen.

    Args:
        x: (M,).
        y: (M,); not a number where the curve breaks.
    """
    if len(x) <= 2 * PARTS:
        return x, y
    edges = np.linspace(0, len(x), PARTS + 1).astype(int)
    breaks = np.flatnonzero(~np.isfinite(y))
    filled = np.where(np.isfinite(y), y, 0.0)
    rows = edges[:-1, None] + np.arange(int(np.diff(edges).max()))
    rows = np.minimum(rows, edges[1:, None] - 1)
    extremes = np.stack([np.argmin(filled[rows], axis=1), np.argmax(filled[rows], axis=1)], axis=1)
    kept = np.unique(np.concatenate([(rows[:, :1] + extremes).ravel(), breaks, [0, len(x) - 1]]))
    return x[kept], y[kept]


def broken(t: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Return a curve over time that breaks where time does: a line across a gap would show what nobody measured.

    Args:
        t: (M,) [s].
        x: (M,).
    """
    steps = np.diff(t)
    usual = np.median(steps) if len(steps) else 0.0
    gaps = np.flatnonzero(np.abs(steps) > 5 * max(usual, 1e-12)) + 1
    return np.insert(t.astype(float), gaps, np.nan), np.insert(x.astype(float), gaps, np.nan)


# ---------------------------------------------------------------- files
def save(figure: Figure, stream: IO[Any], kind: str, *, salt: str = "dynid") -> None:
    """Write a figure as PNG or SVG; equal figures give equal bytes.

    Why not its own savefig: that draws everything twice, the first time for nothing.

    Args:
        figure: the figure.
        stream: where to.
        kind: ``"png"`` or ``"svg"``.
        salt: keeps ids of several SVG elements on one page apart.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    if kind == "png":
        figure.set_dpi(160)
        FigureCanvasAgg(figure).print_png(  # type: ignore[no-untyped-call]
            stream, metadata={"Software": None}, pil_kwargs={"compress_level": 2}
        )
        return
    figure.set_dpi(72)
    nothing = dict.fromkeys(("Date", "Creator", "Type", "Format"))
    with rc_context({"svg.hashsalt": salt, "svg.fonttype": "none"}):
        FigureCanvasSVG(figure).print_svg(  # type: ignore[no-untyped-call]
            stream, metadata=nothing
        )


def write_figure(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG or SVG, as its suffix says."""
    with written_whole(path) as stream:
        save(figure, stream, path.suffix[1:])
    return path


def write_motion_figures(
    folder: Path, motion: EstimatedMotion, robot: Robot, title: str
) -> list[Path]:
    """Write position, velocity, acceleration and torque as PNG and SVG, and return the paths of the PNGs."""
    paths = []
    for quantity in QUANTITIES:
        figure = motion_figure(motion, robot, (), title, quantity)
        write_figure(figure, folder / f"{quantity.title}.svg")
        paths.append(write_figure(figure, folder / f"{quantity.title}.png"))
    return paths
