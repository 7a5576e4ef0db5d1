"""Figures of results: functions that take objects and return a matplotlib figure, and the one writer of figures.

Estimated against measured motion are the paper's Figures 3 to 6.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.covariance import NEGLIGIBLE
from dynid.estimation.model_error import GROUP_NAMES
from dynid.estimation.prediction import EstimatedMotion
from dynid.estimation.result import Identification
from dynid.npz import written_whole
from dynid.robot import Robot
from dynid.text import TITLE_LENGTH, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

#: Colours that stay apart for colour-blind readers and in print (Okabe and Ito).
MEASURED, ESTIMATED, RESIDUAL = "#8c8c8c", "#0072b2", "#d55e00"
GRID = "#e6e6e6"
#: Points a curve is thinned to; a screen shows no more.
MOST_POINTS = 2000
#: Bins of the residual's mean and spread.
BINS = 24
#: Share of the largest singular value below which noise is amplified a thousandfold.
WEAK_DIRECTION = 1e-3


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
    Quantity("qdd", "acceleration", ("rad/s$^2$", "m/s$^2$")),
    TORQUE,
)


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size [inch] that a notebook draws by itself, without a window or pyplot."""
    from io import BytesIO

    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        def _repr_png_(self) -> bytes:
            stream = BytesIO()
            self.savefig(stream, format="png", dpi=100)
            return stream.getvalue()

    return NotebookFigure(figsize=(width, height), layout="constrained")


# ---------------------------------------------------------------- motion
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
    figure = new_figure(5.2 * columns + 0.6, 1.75 * lines + 1.0)
    grid = figure.add_gridspec(lines, columns)
    for place, j in enumerate(numbers):
        # Why the last one: a panel alone in its line takes all of it.
        alone = place == len(numbers) - 1 and place % columns == 0
        axis = figure.add_subplot(grid[place // columns, :] if alone else grid[place // columns, place % columns])
        _panel(axis, motion, robot, quantity, j, residual_only=residual_only)
        if place // columns == lines - 1:
            axis.set_xlabel("time [s]", fontsize=8)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3, frameon=False, fontsize=9)
    what = f"residual {quantity.title}" if residual_only else quantity.title
    figure.suptitle(f"{label(title, TITLE_LENGTH)}: {what}", x=0.01, ha="left", fontsize=11)
    return figure


def torque_figure(
    motion: EstimatedMotion, robot: Robot, joints: tuple[str, ...], title: str, *, residual_only: bool = False
) -> Figure:
    """Draw measured, estimated and residual torque of some joints, or the residual alone."""
    return motion_figure(motion, robot, TORQUE, title, joints=joints, residual_only=residual_only)


def torque_panel(motion: EstimatedMotion, robot: Robot, joint: int) -> Figure:
    """Draw measured, estimated and residual torque of one joint, counted from 0, small enough for a telephone."""
    figure = new_figure(4.6, 1.7)
    axis = figure.subplots()
    _panel(axis, motion, robot, TORQUE, joint)
    axis.set_xlabel("time [s]", fontsize=8)
    return figure


def _panel(
    axis: Axes, motion: EstimatedMotion, robot: Robot, quantity: Quantity, j: int, *, residual_only: bool = False
) -> None:
    """Draw a quantity of joint j, measured and estimated; of torques also the residual."""
    measured = getattr(motion, f"{quantity.key}_measured")[:, j]
    estimated = getattr(motion, f"{quantity.key}_estimated")[:, j]
    both = {"measured": (measured, MEASURED, 2.2), "estimated": (estimated, ESTIMATED, 0.9)}
    rest = {"residual": (measured - estimated, RESIDUAL, 0.9 if residual_only else 0.7)}
    _curves(axis, motion.t, rest if residual_only else both | rest if quantity is TORQUE else both)
    axis.set_title(label(robot.joints[j].name), fontsize=9, loc="left")
    axis.set_ylabel(quantity.units[not robot.joints[j].revolute], fontsize=8)


def _curves(axis: Axes, t: Floats, curves: Mapping[str, tuple[Floats, str, float]]) -> None:
    """Draw curves with label, values, colour and width; a gap in time stays one."""
    thin = slice(None, None, max(1, len(t) // MOST_POINTS))
    # Why: a line across a gap would show motion that nobody measured.
    steps = np.diff(t[thin])
    gaps = np.flatnonzero(np.abs(steps) > 5 * max(np.median(steps), 1e-12)) + 1 if len(steps) > 1 else np.zeros(0, int)

    def broken(x: Floats) -> Floats:
        return np.insert(x[thin].astype(float), gaps, np.nan)

    for name, (values, color, width) in curves.items():
        axis.plot(broken(t), broken(values), color=color, lw=width, label=name)
    low, high = np.nanpercentile(np.concatenate([values for values, _, _ in curves.values()]), [0.2, 99.8])
    room = 0.12 * max(high - low, 1e-9)
    axis.set_ylim(low - room, high + room)
    axis.grid(color=GRID, lw=0.6)
    axis.tick_params(labelsize=8)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


def coverage_figure(motion: EstimatedMotion, robot: Robot) -> Figure:
    """Draw the range of positions and speeds of each joint beside its limits."""
    figure = new_figure(6.4, 0.8 + 0.34 * robot.n)
    axes = figure.subplots(1, 2, sharey=True)
    rows = np.arange(robot.n)
    for axis, values, what in ((axes[0], motion.q_estimated, "position"), (axes[1], motion.qd_estimated, "velocity")):
        low, high = values.min(axis=0), values.max(axis=0)
        for j, joint in enumerate(robot.joints):
            speed = joint.limits.velocity
            limit = joint.limits.position if what == "position" else (-speed, speed) if speed else None
            if limit:
                axis.barh(j, limit[1] - limit[0], left=limit[0], height=0.7, color=MEASURED, alpha=0.35)
        axis.barh(rows, high - low, left=low, height=0.35, color=ESTIMATED)
        axis.set_xlabel(f"{what} [rad{'/s' if what == 'velocity' else ''}; m for sliding joints]", fontsize=8)
        axis.grid(axis="x", lw=0.5)
        axis.tick_params(labelsize=8)
    axes[0].set_yticks(rows, [label(name) for name in robot.joint_names])
    axes[0].invert_yaxis()
    return figure


#: What the residual is drawn over.
AGAINST = ("velocity", "position", "load", "time")


def residual_figure(motion: EstimatedMotion, robot: Robot, against: str) -> Figure:
    """Draw mean and spread of the residual torque over one of ``AGAINST``, one panel per joint, one below the other."""
    residual = motion.tau_measured - motion.tau_estimated
    values = {
        "velocity": motion.qd_estimated,
        "position": motion.q_estimated,
        "load": motion.tau_estimated,
        "time": np.broadcast_to(motion.t[:, None], residual.shape),
    }[against]
    figure = new_figure(2.3, 0.5 + 1.05 * robot.n)
    axes = figure.subplots(robot.n, 1, squeeze=False)[:, 0]
    for j, (axis, joint) in enumerate(zip(axes, robot.joints, strict=True)):
        usable = motion.usable[:, j]
        size = float(np.std(residual[usable, j])) if usable.any() else 1.0
        centre, mean, spread = binned(values[usable, j], residual[usable, j])
        axis.axhline(0, lw=0.6, color=MEASURED)
        axis.fill_between(centre, mean - spread, mean + spread, color=ESTIMATED, alpha=0.25, lw=0)
        axis.plot(centre, mean, color=ESTIMATED, lw=1.2)
        axis.set_ylim(-3.2 * size, 3.2 * size)
        axis.tick_params(labelsize=6)
        axis.grid(lw=0.4)
        axis.set_title(f"{label(joint.name)} [{joint.torque_unit}]", fontsize=7, loc="left", pad=2)
    units = {"velocity": "rad/s, m/s", "position": "rad, m", "load": "N m, N", "time": "s"}
    axes[-1].set_xlabel(f"{against} [{units[against]}]", fontsize=8)
    return figure


def residual_model_figure(found: Identification) -> Figure:
    """Draw the rms torque that the residual model holds by group, beside what it leaves, one bar pair per joint [%].

    Args:
        found: a result with a residual model.
    """
    error = found.model_error
    assert error is not None, "only results with a residual model have this figure"
    torque = np.array([max(joint.torque_rms, 1e-12) for joint in found.joints])
    held, left = 100 * error.rms[:, :-1] / torque[:, None], 100 * np.array([j.rms for j in found.joints]) / torque
    figure = new_figure(6.4, 0.8 + 0.42 * len(torque))
    axis = figure.subplots()
    y, height = np.arange(len(torque)), 0.2
    for k, (name, colour) in enumerate(zip(GROUP_NAMES, (ESTIMATED, "#009e73", "#cc79a7"), strict=True)):
        axis.barh(y + (k - 1.5) * height, held[:, k], height, color=colour, label=f"held: {name}")
    axis.barh(y + 1.5 * height, left, height, color=RESIDUAL, label="left")
    axis.set_yticks(y, [label(joint.joint) for joint in found.joints], fontsize=8)
    axis.invert_yaxis()
    axis.set_xlabel("rms, percent of the joint's torque", fontsize=8)
    axis.grid(axis="x", lw=0.5)
    axis.legend(fontsize=7)
    return figure


def binned(x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Return centres, means and spreads of y, (M,), in bins of equal count over x, (M,); each (BINS,)."""
    order = np.argsort(x)
    parts = [part for part in np.array_split(order, BINS) if len(part) > 1]
    rows = [(float(x[part].mean()), float(y[part].mean()), float(y[part].std())) for part in parts]
    centre, mean, spread = np.array(rows).reshape(-1, 3).T
    return centre, mean, spread


# ---------------------------------------------------------------- parameters
def spectrum_figure(singular_values: Floats) -> Figure:
    """Draw the singular values of a stack with normalised columns, (p,), over the largest."""
    figure = new_figure(6.4, 2.4)
    axis = figure.subplots()
    numbers = np.arange(1, len(singular_values) + 1)
    axis.semilogy(numbers, singular_values / singular_values[0], "o-", ms=3, lw=0.8, color=ESTIMATED)
    axis.axhline(WEAK_DIRECTION, color=RESIDUAL, lw=1, ls="--")
    axis.set_xlabel("direction in the space of base parameters")
    axis.set_ylabel("singular value / largest")
    axis.grid(lw=0.5)
    return figure


def error_figure(found: Identification) -> Figure:
    """Draw the standard error of each base parameter in percent of its value."""
    finite = np.isfinite(found.std_error) & (np.abs(found.theta) > 0)
    share = np.full(len(found.theta), np.nan)
    share[finite] = 100 * found.std_error[finite] / np.abs(found.theta[finite])
    figure = new_figure(6.4, 2.6)
    axis = figure.subplots()
    place = np.arange(len(share))
    colors = [MEASURED if word == NEGLIGIBLE else ESTIMATED for word in found.knowledge]
    axis.bar(place, np.clip(share, 0.05, 300), width=0.8, color=colors)
    axis.axhline(10, color=RESIDUAL, lw=1, ls="--")
    axis.set_yscale("log")
    axis.set_ylabel("error / value [%]")
    axis.set_xticks(place, [label(name) for name in found.names], rotation=90, fontsize=5.5)
    axis.margins(x=0.01)
    axis.grid(axis="y", lw=0.5)
    return figure


# ---------------------------------------------------------------- files
def write_figure(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG or SVG, as its suffix says; equal figures give equal bytes."""
    import matplotlib as mpl

    kind = path.suffix[1:]
    # Why: without a fixed salt and date two runs on the same log would give different SVG files.
    with mpl.rc_context({"svg.hashsalt": "dynid"}), written_whole(path) as stream:
        figure.savefig(stream, format=kind, dpi=110, metadata={"Date": None} if kind == "svg" else {"Software": None})
    return path


def write_motion_figures(folder: Path, motion: EstimatedMotion, robot: Robot, title: str) -> list[Path]:
    """Write position, velocity, acceleration and torque as PNG and SVG, and return the paths of the PNGs."""
    import matplotlib as mpl

    paths = []
    with mpl.rc_context({"path.simplify_threshold": 0.2}):
        for quantity in QUANTITIES:
            figure = motion_figure(motion, robot, quantity, title)
            paths.append(write_figure(figure, folder / f"{quantity.title}.png"))
            write_figure(figure, folder / f"{quantity.title}.svg")
    return paths
