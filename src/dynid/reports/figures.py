"""Figures of results: functions that take objects and return a matplotlib figure, and the one writer of figures.

Estimated against measured motion are the paper's Figures 3 to 6.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.prediction import EstimatedMotion
from dynid.npz import written_whole
from dynid.reports.chart import Curve, Panel, broken, chart, outline, reach, standalone
from dynid.reports.style import own_style
from dynid.robot import Robot
from dynid.text import TITLE_LENGTH, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.transforms import Transform

Floats = NDArray[np.float64]

#: Colours that stay apart for colour-blind readers and in print (Okabe and Ito).
MEASURED, ESTIMATED, RESIDUAL = "#8c8c8c", "#0072b2", "#d55e00"
GRID = "#e6e6e6"
#: Parts that the axis of time is divided into at most.
TICKS = 6
#: How well PNG files are packed: the usual 6 takes half as long again for 4 %.
PACKED = 2
#: Their names, for legends in words.
COLORS = {"measured": "grey", "estimated": "blue", "residual": "orange"}


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


@own_style()
def new_figure(width: float, height: float, *, spaced: bool = True) -> Figure:
    """Return an empty figure of a size [inch] that a notebook draws by itself, without a window or pyplot.

    Args:
        width: of the figure.
        height: of the figure.
        spaced: whether matplotlib finds the room for labels, which takes longer than drawing.
    """
    return _notebook_figure()(figsize=(width, height), layout="constrained" if spaced else None)


@cache
def _notebook_figure() -> type[Figure]:
    # Why once: matplotlib documents every class of figures anew, which takes as long as drawing a panel.
    from io import BytesIO

    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        def _repr_png_(self) -> bytes:
            stream = BytesIO()
            with own_style():
                self.savefig(stream, format="png", dpi=100)
            return stream.getvalue()

    return NotebookFigure


# ---------------------------------------------------------------- motion
@own_style()
def motion_figure(
    motion: EstimatedMotion,
    robot: Robot,
    quantity: Quantity,
    title: str,
    *,
    joints: tuple[str, ...] = (),
    residual_only: bool = False,
) -> Figure:
    """Draw measured and estimated motion, one panel per joint; of torques also the residual, on the same scale.

    Args:
        motion: measured and estimated motion.
        robot: the arm.
        quantity: what is drawn.
        title: above the figure.
        joints: names of the joints that are drawn, all without.
        residual_only: draw what is left of the measured values alone, so that it fills the panel.
    """
    numbers = [robot.joint_names.index(name) for name in joints] or list(range(robot.n))
    columns = 1 if len(numbers) <= 3 else 2
    lines = -(-len(numbers) // columns)
    width, height = 5.2 * columns + 0.6, 1.75 * lines + 1.0
    figure = new_figure(width, height, spaced=False)
    # Unit: inches, that of the labels, which are as large in every figure.
    inside, each = width - 0.85 - 0.85 * (columns - 1), (height - 1.05 - 0.45 * (lines - 1)) / lines
    grid = figure.add_gridspec(
        lines,
        columns,
        left=0.7 / width,
        right=1 - 0.15 / width,
        bottom=0.45 / height,
        top=1 - 0.6 / height,
        wspace=0.85 * columns / inside,
        hspace=0.45 / each,
    )
    for place, j in enumerate(numbers):
        # Why the last one: a panel alone in its line takes all of it.
        alone = place == len(numbers) - 1 and place % columns == 0
        axis = figure.add_subplot(
            grid[place // columns, :] if alone else grid[place // columns, place % columns]
        )
        _panel(axis, motion, robot, quantity, j, residual_only=residual_only)
        if place // columns == lines - 1:
            axis.set_xlabel("time [s]", fontsize=8)
        _place_labels(axis)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper right", ncols=3, frameon=False, fontsize=9)
    what = f"residual {quantity.title}" if residual_only else quantity.title
    figure.suptitle(f"{label(title, TITLE_LENGTH)}: {what}", x=0.01, ha="left", fontsize=11)
    return figure


def torque_figure(
    motion: EstimatedMotion,
    robot: Robot,
    joints: tuple[str, ...],
    title: str,
    *,
    residual_only: bool = False,
) -> Figure:
    """Draw measured, estimated and residual torque of some joints, or the residual alone."""
    return motion_figure(motion, robot, TORQUE, title, joints=joints, residual_only=residual_only)


def _panel(
    axis: Axes,
    motion: EstimatedMotion,
    robot: Robot,
    quantity: Quantity,
    j: int,
    *,
    residual_only: bool = False,
) -> None:
    """Draw a quantity of joint j, measured and estimated; of torques also the residual."""
    shown = _shown(motion, quantity, j)
    _curves(axis, motion.t, {"residual": shown["residual"]} if residual_only else shown)
    # Why with a height, the usual one: else matplotlib looks whether labels are in the way, twice as long as all else.
    axis.set_title(label(robot.joints[j].name), fontsize=9, loc="left", y=1.0)
    axis.set_ylabel(quantity.units[not robot.joints[j].revolute], fontsize=8)


def _place_labels(axis: Axes) -> None:
    """Put the labels of both axes at distances that leave room for numbers.

    Why: else matplotlib makes all ticks and their texts twice more, to see where they end.
    """
    from matplotlib.transforms import ScaledTranslation

    def moved(x: float, y: float) -> Transform:
        return axis.transAxes + ScaledTranslation(x, y, axis.figure.dpi_scale_trans)

    # Unit: inches.
    axis.xaxis.set_label_coords(0.5, 0.0, transform=moved(0.0, -0.22))
    axis.yaxis.set_label_coords(0.0, 0.5, transform=moved(-0.5, 0.0))


def _shown(
    motion: EstimatedMotion, quantity: Quantity, j: int
) -> dict[str, tuple[Floats, str, float]]:
    """Return values, colour and width of the curves of a quantity of joint j."""
    measured = getattr(motion, f"{quantity.key}_measured")[:, j]
    estimated = getattr(motion, f"{quantity.key}_estimated")[:, j]
    both = {"measured": (measured, MEASURED, 2.2), "estimated": (estimated, ESTIMATED, 0.9)}
    return both | (
        {"residual": (measured - estimated, RESIDUAL, 0.7)} if quantity is TORQUE else {}
    )


def _curves(axis: Axes, t: Floats, curves: Mapping[str, tuple[Floats, str, float]]) -> None:
    """Draw curves with label, values, colour and width; a gap in time stays one."""
    for name, (values, color, width) in curves.items():
        axis.plot(*outline(*broken(t, values)), color=color, lw=width, label=name)
    low, high = reach([values for values, _, _ in curves.values()])
    axis.set_ylim(low, high)
    axis.grid(color=GRID, lw=0.6)
    axis.tick_params(labelsize=8)
    # Why few: a tick takes as long to make as a curve.
    axis.locator_params(axis="x", nbins=TICKS)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


# ---------------------------------------------------------------- files
@own_style()
def save(figure: Figure, stream: IO[Any], kind: str, **options: Any) -> None:  # noqa: ANN401
    """Write a figure as PNG or SVG.

    Why not its own savefig: that draws everything twice, the first time for nothing.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    if kind == "svg":
        draw: Any = FigureCanvasSVG(figure).print_svg
    else:
        draw = partial(FigureCanvasAgg(figure).print_png, pil_kwargs={"compress_level": PACKED})
    draw(stream, **options)


def write_figure(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG or SVG, as its suffix says; equal figures give equal bytes."""
    kind = path.suffix[1:]
    figure.set_dpi(110)
    # Why: without a fixed salt and date two runs on the same log would give different SVG files.
    with own_style({"svg.hashsalt": "dynid"}), written_whole(path) as stream:
        save(figure, stream, kind, metadata={"Date": None} if kind == "svg" else {"Software": None})
    return path


def write_motion_figures(
    folder: Path, motion: EstimatedMotion, robot: Robot, title: str
) -> list[Path]:
    """Write position, velocity, acceleration and torque as PNG and SVG, and return the paths of the PNGs."""
    paths = []
    for quantity in QUANTITIES:
        figure = motion_figure(motion, robot, quantity, title)
        paths.append(write_figure(figure, folder / f"{quantity.title}.png"))
        said = ", ".join(
            f"{color} {name}"
            for name, color in COLORS.items()
            if name != "residual" or quantity is TORQUE
        )
        drawing = motion_chart(motion, robot, quantity, f"{title}: {quantity.title} ({said})")
        with written_whole(folder / f"{quantity.title}.svg") as stream:
            stream.write(drawing.encode())
    return paths


def motion_chart(motion: EstimatedMotion, robot: Robot, quantity: Quantity, title: str) -> str:
    """Draw what ``motion_figure`` shows as the text of an SVG file, one panel below the other."""
    panels = []
    for j, joint in enumerate(robot.joints):
        shown = _shown(motion, quantity, j)
        curves = (
            Curve(*broken(motion.t, values), name, width)
            for name, (values, _, width) in shown.items()
        )
        ends = reach([values for values, _, _ in shown.values()])
        panels.append(
            Panel(joint.name, tuple(curves), *ends, unit=quantity.units[not joint.revolute])
        )
    colors = {"measured": MEASURED, "estimated": ESTIMATED, "residual": RESIDUAL, "faint": GRID}
    return standalone(chart(panels, "time [s]", title, width=720.0, height=110.0), title, colors)
