"""Estimated against measured motion, one panel per joint: the paper's Figures 3 to 6, as PNG and SVG."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.prediction import EstimatedMotion
from dynid.npz import written_whole
from dynid.robot import Robot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

#: Colours that stay apart for colour-blind readers and in print (Okabe and Ito).
MEASURED, ESTIMATED, RESIDUAL = "#8c8c8c", "#0072b2", "#d55e00"
GRID = "#e6e6e6"
#: Points a curve is thinned to; a screen shows no more.
MOST_POINTS = 2000


@dataclass(frozen=True)
class Quantity:
    """One figure: what is drawn and its unit for turning and sliding joints."""

    key: str
    title: str
    units: tuple[str, str]


QUANTITIES = (
    Quantity("q", "position", ("rad", "m")),
    Quantity("qd", "velocity", ("rad/s", "m/s")),
    Quantity("qdd", "acceleration", ("rad/s$^2$", "m/s$^2$")),
    Quantity("tau", "torque", ("N m", "N")),
)


def draw(
    motion: EstimatedMotion,
    quantity: Quantity,
    joints: tuple[str, ...],
    sliding: tuple[bool, ...],
    title: str,
    *,
    residual_only: bool = False,
) -> Figure:
    """Draw one quantity of all joints; the torque's figure shows the residual on the same scale."""
    from matplotlib.figure import Figure as NewFigure

    n = len(joints)
    columns = 1 if n <= 3 else 2
    lines = -(-n // columns)
    figure = NewFigure(figsize=(5.2 * columns + 0.6, 1.75 * lines + 1.0), layout="constrained")
    axes = figure.subplots(lines, columns, squeeze=False, sharex=True)
    measured, estimated = getattr(motion, f"{quantity.key}_measured"), getattr(motion, f"{quantity.key}_estimated")
    for j in range(lines * columns):
        axis = axes[j % lines][j // lines]
        if j >= n:
            axis.set_visible(False)
            continue
        if residual_only:
            _curves(axis, motion.t, {"residual": (measured[:, j], RESIDUAL, 0.9)})
        else:
            _panel(axis, motion.t, measured[:, j], estimated[:, j], residual=quantity.key == "tau")
        axis.set_title(joints[j].replace("$", r"\$"), fontsize=9, loc="left")
        axis.set_ylabel(quantity.units[sliding[j]], fontsize=8)
        if j % lines == lines - 1 or j == n - 1:
            axis.set_xlabel("time [s]", fontsize=8)
            axis.tick_params(labelbottom=True)
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3, frameon=False, fontsize=9)
    figure.suptitle(f"{title}: {quantity.title}", x=0.01, ha="left", fontsize=11)
    return figure


def torque_figure(
    motion: EstimatedMotion, robot: Robot, joints: tuple[str, ...], title: str, *, residual_only: bool = False
) -> Figure:
    """Draw the torques of some joints, for notebooks: measured, estimated and residual, or the residual alone.

    Args:
        motion: measured and estimated torques.
        robot: the arm.
        joints: names of the joints that are drawn.
        title: above the figure.
        residual_only: leave out measured and estimated torque, so that the residual fills the panel.
    """
    numbers = [robot.joint_names.index(joint) for joint in joints]
    measured, estimated = motion.tau_measured[:, numbers], motion.tau_estimated[:, numbers]
    if residual_only:
        measured, estimated = measured - estimated, np.zeros_like(estimated)
    shown = replace(motion, tau_measured=measured, tau_estimated=estimated)
    sliding = tuple(not robot.joints[k].revolute for k in numbers)
    quantity = QUANTITIES[3]
    if not residual_only:
        return draw(shown, quantity, joints, sliding, title)
    return draw(shown, replace(quantity, title="residual torque"), joints, sliding, title, residual_only=True)


def _panel(axis: Axes, t: Floats, measured: Floats, estimated: Floats, *, residual: bool) -> None:
    curves = {"measured": (measured, MEASURED, 2.2), "estimated": (estimated, ESTIMATED, 0.9)}
    _curves(axis, t, {**curves, "residual": (measured - estimated, RESIDUAL, 0.7)} if residual else curves)


def _curves(axis: Axes, t: Floats, curves: dict[str, tuple[Floats, str, float]]) -> None:
    """Draw curves with label, values, colour and width; a gap in time stays one."""
    thin = slice(None, None, max(1, len(t) // MOST_POINTS))
    # Why: a line across a gap would show motion that nobody measured.
    steps = np.diff(t[thin])
    gaps = np.flatnonzero(np.abs(steps) > 5 * max(np.median(steps), 1e-12)) + 1 if len(steps) > 1 else np.zeros(0, int)

    def broken(x: Floats) -> Floats:
        return np.insert(x[thin].astype(float), gaps, np.nan)

    for label, (values, color, width) in curves.items():
        axis.plot(broken(t), broken(values), color=color, lw=width, label=label)
    low, high = np.nanpercentile(np.concatenate([values for values, _, _ in curves.values()]), [0.2, 99.8])
    room = 0.12 * max(high - low, 1e-9)
    axis.set_ylim(low - room, high + room)
    axis.grid(color=GRID, lw=0.6)
    axis.tick_params(labelsize=8)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


def write_figures(
    folder: Path, motion: EstimatedMotion, joints: tuple[str, ...], sliding: tuple[bool, ...], title: str
) -> list[Path]:
    """Write the four figures as PNG and SVG and return the paths of the PNGs."""
    import matplotlib as mpl

    paths = []
    # Why: without a fixed salt and date two runs on the same log would give different SVG files.
    with mpl.rc_context({"svg.hashsalt": "dynid", "path.simplify_threshold": 0.2}):
        for quantity in QUANTITIES:
            figure = draw(motion, quantity, joints, sliding, title)
            for suffix, facts in ((".png", {"Software": None}), (".svg", {"Date": None})):
                path = folder / f"{quantity.title}{suffix}"
                with written_whole(path) as stream:
                    figure.savefig(stream, format=suffix[1:], dpi=110, metadata=facts)
                if suffix == ".png":
                    paths.append(path)
    return paths
