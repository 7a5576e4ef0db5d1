"""Figures of the report's sections: excitation, parameters, residual, bodies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import sqrtm

from dynid.arrays import Floats
from dynid.estimation.covariance import NEGLIGIBLE
from dynid.estimation.prediction import EstimatedMotion
from dynid.estimation.result import Identification
from dynid.model.kinematics import link_frames
from dynid.model.parameters import second_moments
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
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure


#: Share of the largest singular value below which noise is amplified a thousandfold.
WEAK_DIRECTION = 1e-3
#: Errors are cut at these ends of their axis [%].
LEAST_ERROR, MOST_ERROR = 0.05, 300.0
#: The look of a line at a threshold.
DASHED: dict[str, Any] = {"color": RESIDUAL, "lw": 1.0, "ls": "--"}
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
    _decimal_decades(axis.yaxis)
    axis.axhline(WEAK_DIRECTION, **DASHED)
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


# ---------------------------------------------------------------- parameters
@styled
def error_figure(result: Identification) -> Figure:
    """Draw the standard error of each base parameter in percent of its value; nothing where that is not determined."""
    finite = np.isfinite(result.std_error) & (np.abs(result.theta) > 0)
    share = 100 * result.std_error[finite] / np.abs(result.theta[finite])
    negligible = np.array(result.knowledge)[finite] == NEGLIGIBLE
    figure, (axis,) = bar_figure(result.names, 0.115, 0.5)
    axis.barh(
        np.flatnonzero(finite),
        np.clip(share, LEAST_ERROR, MOST_ERROR) - LEAST_ERROR,
        left=LEAST_ERROR,
        color=np.where(negligible, MEASURED, ESTIMATED).tolist(),
    )
    axis.set(xscale="log", xlim=(LEAST_ERROR, MOST_ERROR), xlabel="error / value [%]")
    _decimal_decades(axis.xaxis)
    axis.axvline(10.0, **DASHED)
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


# ---------------------------------------------------------------- bodies
@styled
def bodies_figure(robot: Robot, links: list[dict[str, Any]]) -> Figure:
    """Draw the arm in a bent pose from two sides, each body as the uniform ellipsoid with its mass and inertia."""
    # Why bent: no link hides the next.
    pose = np.array([0.8 if joint.revolute else 0.1 for joint in robot.joints])
    poses = link_frames(robot, pose).poses
    points = np.vstack([np.zeros(3), poses[:, :3, 3]])
    figure = new_figure(3.2)
    for axis, (u, v) in zip(figure.subplots(1, 2), ((0, 2), (1, 2)), strict=True):
        axis.plot(points[:, u], points[:, v], "o-", color=MEASURED, lw=2, ms=3)
        for link in links:
            outline = body_outline(poses[link["link"] - 1], link, (u, v))
            from_data = sum(origin == "data" for origin in link["origin"].values()) >= 5
            color = ESTIMATED if from_data else RESIDUAL
            axis.fill(*outline.T, facecolor=color, alpha=0.35)
            axis.plot(*outline.T, color=color, lw=1)
            axis.text(*outline.mean(axis=0), link["link"], ha="center", va="center")
        axis.set_aspect("equal", adjustable="datalim")
        axis.set(xlabel=f"{'xyz'[u]} [m]", ylabel=f"{'xyz'[v]} [m]")
    return figure


def body_outline(
    pose: Floats, link: dict[str, Any], plane: tuple[int, int], count: int = 48
) -> Floats:
    """Return the outline of a link's ellipsoid in the plane of two axes of frame 0, (count, 2) [m]."""
    R, view = pose[:3, :3], list(plane)
    centre = (R @ np.array(link["com_m"]) + pose[:3, 3])[view]
    # Why 5: a uniform ellipsoid has semi-axes of sqrt(5) standard deviations.
    spread = 5 * second_moments(inertia_tensor(link)) / max(link["mass_kg"], 1e-9)
    angle = np.linspace(0, 2 * np.pi, count)
    root = sqrtm((R @ spread @ R.T)[np.ix_(view, view)]).real
    return np.asarray(centre + np.column_stack([np.cos(angle), np.sin(angle)]) @ root)


def principal_moments(link: dict[str, Any]) -> Floats:
    """Return the principal moments of inertia of a link, the smallest first, (3,) [kg m^2]."""
    return np.asarray(np.linalg.eigvalsh(inertia_tensor(link)))


def inertia_tensor(link: dict[str, Any]) -> Floats:
    """Return the inertia about the centre of mass, (3, 3) [kg m^2]."""
    entries = {name[1:]: value for name, value in link["inertia_com_kg_m2"].items()}
    return np.array([[entries["".join(sorted(a + b))] for b in "xyz"] for a in "xyz"])


# ---------------------------------------------------------------- parts of figures
def _with_unit(against: str, robot: Robot) -> str:
    """Return one of ``AGAINST`` with its units for the joints of an arm."""
    units = dict.fromkeys(AGAINST[against][1 + (not joint.revolute)] for joint in robot.joints)
    return f"{against} [{', '.join(units)}]"


def _decimal_decades(axis: Axis) -> None:
    """Write the decades of a logarithmic axis as numbers: formulas take longer than the figure."""
    axis.set_major_formatter("{x:g}")
    axis.minorticks_off()
