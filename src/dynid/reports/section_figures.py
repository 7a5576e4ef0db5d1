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
#: Width of a column of the residual, where one begins at each integer.
WIDE = 0.8
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
    figure = new_figure(2.0, spaced=False)
    axis = figure.add_axes((0.17, 0.2, 0.81, 0.75))
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
    figure, axes = bar_figure(robot.joint_names, 0.2, 0.8, 2, spaced=False)
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
    """Draw mean and spread of the residual torque, one row of panels per joint, one column for each of ``AGAINST``.

    Why one panel a row holds all: axes and their ticks take ten times as long as the curves in them.
    """
    from matplotlib.ticker import MaxNLocator

    titles = [f"{label(joint.name)} [{joint.torque_unit}]" for joint in robot.joints]
    figure, axes = joint_panels(titles, 0.5, 0.4, 0.25)
    numbers = MaxNLocator(2, steps=[1, 2, 4, 5, 10])
    for j, axis in enumerate(axes):
        places, words = [], []
        for k, against in enumerate(AGAINST):
            centre, mean, spread, size = residual_averages(motion, j, against)
            # Why more: a joint that did not move has an axis too.
            ends = (centre[0], centre[-1] + 1e-6) if len(centre) else (0.0, 1.0)
            column = k, k + WIDE
            x = np.interp(centre, ends, column)
            axis.fill_between(x, mean - spread, mean + spread, color=ESTIMATED, alpha=0.25, lw=0)
            axis.plot(x, mean, color=ESTIMATED, lw=1.2)
            round_ones = numbers.tick_values(*ends)[1:-1]
            places += [*np.interp(round_ones, ends, column)]
            words += [f"{number:g}".replace("-", "−") for number in round_ones]
        axis.set_xticks(places, words)
        axis.axhline(0.0, color=MEASURED, lw=0.8)
        axis.set_ylim(-3.2 * max(size, 1e-9), 3.2 * max(size, 1e-9))
        axis.locator_params(axis="y", nbins=3)
    for k, against in enumerate(AGAINST):
        head, under = _with_unit(against, robot), axis.get_xaxis_transform()
        axis.text(k + WIDE / 2, -0.6, head, transform=under, ha="center")
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
    edges = np.linspace(0, len(x), min(BINS, len(x) // 2) + 1).astype(int)
    order, size = np.argsort(x), np.diff(edges)
    x, y = x[order], y[order]
    centre, mean = np.add.reduceat([x, y], edges[:-1], axis=1) / size
    spread = np.sqrt(np.add.reduceat((y - np.repeat(mean, size)) ** 2, edges[:-1]) / size)
    return centre, mean, spread


# ---------------------------------------------------------------- parts of figures
def _with_unit(against: str, robot: Robot) -> str:
    """Return one of ``AGAINST`` with its units for the joints of an arm."""
    units = dict.fromkeys(AGAINST[against][1 + (not joint.revolute)] for joint in robot.joints)
    return f"{against} [{', '.join(units)}]"
