"""Estimated against measured motion, one panel a joint: the paper's Figures 3 to 6, as PNG and SVG."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.files.artifact import written_whole
from dynid.validate.predict import EstimatedMotion

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
    motion: EstimatedMotion, quantity: Quantity, joints: tuple[str, ...], sliding: tuple[bool, ...], title: str
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


def _panel(axis: Axes, t: Floats, measured: Floats, estimated: Floats, *, residual: bool) -> None:
    step = max(1, len(t) // MOST_POINTS)
    thin = slice(None, None, step)
    # Why: a line across a gap would show motion that nobody measured.
    steps = np.diff(t[thin])
    gaps = np.flatnonzero(np.abs(steps) > 5 * max(np.median(steps), 1e-12)) + 1 if len(steps) > 1 else np.zeros(0, int)

    def broken(x: Floats) -> Floats:
        return np.insert(x[thin].astype(float), gaps, np.nan)

    axis.plot(broken(t), broken(measured), color=MEASURED, lw=2.2, label="measured")
    axis.plot(broken(t), broken(estimated), color=ESTIMATED, lw=0.9, label="estimated")
    if residual:
        axis.plot(broken(t), broken(measured - estimated), color=RESIDUAL, lw=0.7, label="residual")
    shown = [measured, estimated, measured - estimated] if residual else [measured, estimated]
    low, high = np.nanpercentile(np.concatenate(shown), [0.2, 99.8])
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
