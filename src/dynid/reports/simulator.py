"""Pictures of torques from outside and of simulated beside measured motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dynid.reports.figures import new_figure
from dynid.text import label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dynid.sim.comparison import SimulatorGap


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
