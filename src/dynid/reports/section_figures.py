"""Figures of the report's sections: excitation and residual."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynid.arrays import Floats
from dynid.estimation.prediction import EstimatedMotion
from dynid.reports.figures import (
    ESTIMATED,
    MEASURED,
    RESIDUAL,
    bar_figure,
    joint_panels,
    new_figure,
    styled,
)
from dynid.robot import Robot
from dynid.text import label

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Share of the largest singular value below which noise is amplified a thousandfold.
WEAK_DIRECTION = 1e-3
#: Bins of the residual's mean and spread.
BINS = 24
#: What the residual is drawn over: the name in a motion, and the units of turning and sliding joints.
AGAINST = {
    "velocity": ("qd_estimated", "rad/s", "m/s"),
    "position": ("q_estimated", "rad", "m"),
    "load": ("tau_estimated", "N m", "N"),
    "time": ("t", "s", "s"),
}


# ---------------------------------------------------------------- excitation
@styled
def spectrum_figure(singular_values: Floats) -> Figure:
    """Draw the singular values of a stack with normalised columns, (p,), over the largest."""
    share = np.maximum(singular_values / singular_values[0], 1e-12)
    figure = new_figure(2.0)
    axis = figure.subplots()
    axis.semilogy(np.arange(1, len(share) + 1), share, "o-", color=ESTIMATED, ms=2.5, lw=0.8)
    # Why as numbers: formulas take longer than the figure.
    axis.yaxis.set_major_formatter("{x:g}")
    axis.minorticks_off()
    axis.axhline(WEAK_DIRECTION, color=RESIDUAL, lw=1.0, ls="--")
    axis.set(xlabel="direction in the space of base parameters", ylabel="singular value / largest")
    return figure


@styled
def coverage_figure(motion: EstimatedMotion, robot: Robot) -> Figure:
    """Draw the range of positions and speeds of each joint beside its limits."""
    figure, axes = bar_figure(robot.joint_names, 0.2, 0.8, 2)
    fastest, none = robot.limits("velocity", np.nan), (np.nan, np.nan)
    shown = (
        ("position", motion.q_estimated, *robot.travel(none, none)),
        ("velocity", motion.qd_estimated, -fastest, fastest),
    )
    for axis, (what, values, low, high) in zip(axes, shown, strict=True):
        axis.barh(range(robot.n), high - low, 0.7, low, color=MEASURED, alpha=0.4)
        low, high = values.min(axis=0), values.max(axis=0)
        axis.barh(range(robot.n), high - low, 0.35, low, color=ESTIMATED)
        axis.set_xlabel(_with_unit(what, robot))
    return figure


# ---------------------------------------------------------------- residual
@styled
def residual_figure(motion: EstimatedMotion, robot: Robot) -> Figure:
    """Draw mean and spread of the residual torque, one row of panels per joint, one column for each of ``AGAINST``."""
    titles = [f"{label(joint.name)} [{joint.torque_unit}]" for joint in robot.joints]
    figure, axes = joint_panels(titles, 0.5, [_with_unit(against, robot) for against in AGAINST])
    for j, row in enumerate(axes):
        for axis, against in zip(row, AGAINST, strict=True):
            centre, mean, spread, size = residual_averages(motion, j, against)
            axis.axhline(0.0, color=MEASURED, lw=0.8)
            axis.fill_between(
                centre, mean - spread, mean + spread, color=ESTIMATED, alpha=0.25, lw=0
            )
            axis.plot(centre, mean, color=ESTIMATED, lw=1.2)
            axis.set_ylim(-3.2 * max(size, 1e-9), 3.2 * max(size, 1e-9))
            axis.locator_params(nbins=3)
            axis.tick_params(labelleft=axis is row[0])
    return figure


def residual_averages(
    motion: EstimatedMotion, joint: int, against: str
) -> tuple[Floats, Floats, Floats, float]:
    """Return bin centres over one of ``AGAINST``, mean and spread of the residual in each, and the spread of all."""
    usable = motion.usable[:, joint]
    residual = (motion.tau_measured[:, joint] - motion.tau_estimated[:, joint])[usable]
    values = getattr(motion, AGAINST[against][0])
    values = (values if values.ndim == 1 else values[:, joint])[usable]
    return *binned(values, residual), float(np.std(residual)) if usable.any() else 1.0


def binned(x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Return centres, means and spreads of y, (M,), in bins of equal count over x, (M,); each (BINS,)."""
    order = np.argsort(x)
    parts = [part for part in np.array_split(order, BINS) if len(part) > 1]
    rows = [(float(x[part].mean()), float(y[part].mean()), float(y[part].std())) for part in parts]
    centre, mean, spread = np.array(rows).reshape(-1, 3).T
    return centre, mean, spread


# ---------------------------------------------------------------- parts of figures
def _with_unit(against: str, robot: Robot) -> str:
    """Return one of ``AGAINST`` with its units for the joints of an arm."""
    units = dict.fromkeys(AGAINST[against][1 + (not joint.revolute)] for joint in robot.joints)
    return f"{against} [{', '.join(units)}]"
