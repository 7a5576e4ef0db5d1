"""Pictures of torques from outside and of simulated beside measured motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dynid.reports.figures import new_figure
from dynid.text import label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dynid.estimation.contacts import ExternalTorque
    from dynid.robot import Robot
    from dynid.sim.comparison import SimulatorGap


def contacts_figure(external: ExternalTorque, robot: Robot, title: str) -> Figure:
    """Return the torque from outside, its threshold, and the contacts, one panel per joint.

    Args:
        external: what the observer found.
        robot: the arm.
        title: of the figure.
    """
    n = robot.n
    figure = new_figure(8.0, 1.3 * n + 0.8)
    axes = figure.subplots(n, 1, sharex=True, squeeze=False)[:, 0]
    t = external.t - external.begin
    # Why a gap in the line: nothing is known where the log has none.
    gaps = np.flatnonzero(np.diff(t) > 5.0 / external.rate) + 1
    t = np.insert(t, gaps, np.nan)
    for j, (axis, joint) in enumerate(zip(axes, robot.joints, strict=True)):
        torque, threshold = (
            np.insert(x[:, j], gaps, np.nan) for x in (external.torque, external.threshold)
        )
        axis.fill_between(t, -threshold, threshold, color="0.88", linewidth=0)
        axis.plot(t, torque, linewidth=0.9)
        for each in external.contacts:
            if each.joint == joint.name:
                axis.axvspan(
                    each.start - external.begin,
                    each.end - external.begin,
                    color="tab:red",
                    alpha=0.3,
                )
        axis.set_ylabel(f"{label(joint.name)}\n[{joint.torque_unit}]", fontsize=8)
    axes[0].set_title(
        f"torque from outside; grey: below the threshold; red: contact\n{label(title)}", fontsize=9
    )
    axes[-1].set_xlabel("time [s]")
    return figure


def simulator_figure(gap: SimulatorGap) -> Figure:
    """Return the position error of each model in the simulator, one panel per joint.

    Args:
        gap: simulated beside measured motion.
    """
    n = gap.robot.n
    figure = new_figure(8.0, 1.3 * n + 0.8)
    axes = figure.subplots(n, 1, sharex=True, squeeze=False)[:, 0]
    for j, (axis, joint) in enumerate(zip(axes, gap.robot.joints, strict=True)):
        for k, name in enumerate(gap.models):
            axis.plot(
                gap.t,
                1000 * (gap.simulated[k, :, j] - gap.q[:, j]),
                linewidth=0.9,
                label=label(name),
            )
        axis.set_ylabel(f"{label(joint.name)}\n[{'mrad' if joint.revolute else 'mm'}]", fontsize=8)
    axes[0].legend(fontsize=8, loc="upper right")
    axes[0].set_title(
        f"simulated less measured position, {gap.engine}\n{label(gap.log)}", fontsize=9
    )
    axes[-1].set_xlabel("time [s]")
    return figure
