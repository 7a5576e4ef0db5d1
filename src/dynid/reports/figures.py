"""Figures with matplotlib: functions that take objects and return a figure, and the one writer of figures.

The same functions draw for files, for notebooks and for the report. Estimated against measured motion are the paper's
Figures 3 to 6.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from io import BytesIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple, ParamSpec

import numpy as np

from dynid.arrays import Floats
from dynid.disk import written_whole
from dynid.estimation.prediction import EstimatedMotion
from dynid.robot import Robot
from dynid.text import TITLE_LENGTH, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

P = ParamSpec("P")

#: Colours that are distinct for colour-blind readers and in print (Okabe and Ito).
MEASURED, ESTIMATED, RESIDUAL = "#8c8c8c", "#0072b2", "#d55e00"
GRID = "#e6e6e6"
#: Width of a figure [inch]: its text is readable on a telephone and on a screen. Size of text [points].
WIDTH, TEXT = 4.6, 8
#: The look of all figures. Few ticks, a faint grid, no frame; curves lose what is finer than a point, and no spike.
STYLE: dict[Any, Any] = {
    "font.size": TEXT,
    "axes.titlesize": TEXT,
    "axes.titlelocation": "left",
    "figure.titlesize": TEXT + 1,
    "legend.frameon": False,
    "legend.fontsize": TEXT - 1,
    "path.simplify_threshold": 1.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize"), TEXT - 1),
    **dict.fromkeys(("xtick.bottom", "ytick.left"), False),
}


class Quantity(NamedTuple):
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


# ---------------------------------------------------------------- the look
def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Give the figure of a function the look of all."""

    @wraps(draw)
    def drawn(*args: P.args, **given: P.kwargs) -> Figure:
        from matplotlib import rc_context

        with rc_context(STYLE):
            return draw(*args, **given)

    return drawn


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
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        def _repr_png_(self) -> bytes:
            stream = BytesIO()
            self.savefig(stream, format="png", dpi=100)
            return stream.getvalue()

    return NotebookFigure


def joint_panels(
    titles: Sequence[str], each: float, between: float, above: float
) -> tuple[Figure, Sequence[Axes]]:
    """Return a figure with a panel per joint, one below the other, and their axes.

    Args:
        titles: of the panels.
        each: height of a panel [inch].
        between: space between two [inch].
        above: space above the first [inch].
    """
    n, below = len(titles), 0.45
    height = n * (each + between) - between + above + below
    figure = new_figure(height, spaced=False)
    axes = figure.subplots(n, squeeze=False)[:, 0].tolist()
    figure.subplots_adjust(0.11, below / height, 0.98, 1 - above / height, hspace=between / each)
    for axis, words in zip(axes, titles, strict=True):
        # Why with a height, the usual one: else matplotlib looks whether labels are in the way.
        axis.set_title(words, y=1.0, pad=3)
    return figure, axes


def bar_figure(
    names: Sequence[str], each: float, more: float, columns: int = 1, *, spaced: bool = True
) -> tuple[Figure, Sequence[Axes]]:
    """Return a figure with a row of bars per name, the first on top, and its axes; heights in inches.

    Args:
        names: of the rows.
        each: height of a row.
        more: height of the rest.
        columns: number of axes beside each other.
        spaced: as for ``new_figure``; else the names have the room that their letters need.
    """
    height, words = each * len(names) + more, [label(name) for name in names]
    figure = new_figure(height, spaced=spaced)
    axes = figure.subplots(1, columns, sharey=True, squeeze=False)[0]
    axes[0].set_yticks(range(len(names)), words)
    axes[0].set_ylim(len(names) - 0.4, -0.6)
    if not spaced:
        left = 0.03 + 0.014 * max(map(len, words))
        figure.subplots_adjust(left, 0.5 / height, 0.98, 1 - 0.05 / height, 0.06)
    return figure, axes


# ---------------------------------------------------------------- motion
@styled
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
        residual_only: draw the residual alone, so that it fills the panel.
    """
    numbers = [robot.joint_names.index(name) for name in joints] or list(range(robot.n))
    titles, panels = [], []
    for j in numbers:
        joint = robot.joints[j]
        titles.append(f"{label(joint.name)} [{quantity.units[not joint.revolute]}]")
        measured = getattr(motion, f"{quantity.key}_measured")[:, j]
        estimated = getattr(motion, f"{quantity.key}_estimated")[:, j]
        curves = {"measured": (measured, MEASURED, 2.2), "estimated": (estimated, ESTIMATED, 0.9)}
        if quantity is TORQUE:
            residual = {"residual": (measured - estimated, RESIDUAL, 0.7)}
            curves = residual if residual_only else curves | residual
        panels.append(curves)
    what = f"residual {quantity.title}" if residual_only else quantity.title
    head = f"{label(title, TITLE_LENGTH)}: {what}" * bool(title)
    return curves_over_time(titles, motion.t, panels, head)


def curves_over_time(
    titles: Sequence[str],
    t: Floats,
    panels: Sequence[Mapping[str, tuple[Floats, str, float]]],
    head: str,
) -> Figure:
    """Draw curves by name, with colour and width, over times, (M,) [s], a panel for each joint."""
    figure, axes = joint_panels(titles, 0.85, 0.26, 0.7)
    for axis, curves in zip(axes, panels, strict=True):
        for name, (values, color, width) in curves.items():
            axis.plot(*broken(t, values), color=color, lw=width, label=name)
        shown = np.concatenate([values for values, _, _ in curves.values()])
        low, high = np.nanpercentile(shown, [0.2, 99.8])
        room = 0.12 * max(high - low, 1e-9)
        axis.set_ylim(low - room, high + room)
        axis.locator_params(axis="y", nbins=4)
    axes[-1].set_xlabel("time [s]")
    for axis in axes[:-1]:
        # Why: lines are the same as the ticks of all, and take a tenth of the time.
        axis.xaxis.set_visible(False)
        axis.vlines(axes[-1].get_xticks()[1:-1], *axis.get_ylim(), color=GRID, lw=0.6, zorder=0.5)
    inch = 1 / figure.get_figheight()
    figure.suptitle(head, x=0.01, y=1 - 0.05 * inch, ha="left", va="top")
    handles = figure.axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="upper right", bbox_to_anchor=(0.98, 1 - 0.2 * inch), ncols=3)
    return figure


def broken(t: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Return a curve over time, (M,) each, that breaks where time does: nobody measured what a line would show."""
    steps = np.diff(t)
    usual = np.median(steps) if len(steps) else 0.0
    gaps = np.flatnonzero(np.abs(steps) > 5 * max(usual, 1e-12)) + 1
    return np.insert(t.astype(float), gaps, np.nan), np.insert(x.astype(float), gaps, np.nan)


# ---------------------------------------------------------------- files
def save(figure: Figure, stream: IO[Any], kind: str) -> None:
    """Write a figure as PNG or SVG; equal figures give equal bytes.

    Args:
        figure: the figure.
        stream: where to.
        kind: ``"png"`` or ``"svg"``.
    """
    from matplotlib import rc_context

    png: dict[str, Any] = {"dpi": 160, "metadata": {"Software": None}}
    svg = {"dpi": 72, "metadata": dict.fromkeys(("Date", "Creator", "Type", "Format"))}
    with rc_context({**STYLE, "svg.hashsalt": "dynid", "svg.fonttype": "none"}):
        figure.savefig(stream, format=kind, **(png if kind == "png" else svg))


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
