"""The picture of a motion where PyBullet is missing: capsules along the links, drawn with Matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.disk import written_whole
from dynid.trajectory.clearance import Capsules
from dynid.trajectory.drawing import COLORS
from dynid.trajectory.feasible import position_range
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.scene import Distance

Floats = NDArray[np.float64]

#: Poses that are drawn one by one, and poses whose tool path is drawn behind them.
POSES, PATH = 6, 400
#: From where the arm is seen [deg], and the size of a view [inch].
ELEVATION, AZIMUTH, SIZE = 18, -50, 4.0
#: Points an inch, the unit of line widths.
POINTS = 72


def draw_motion(
    path: Path, trajectory: Trajectory, capsules: Capsules, nearest: Sequence[Distance], title: str
) -> None:
    """Write the arm at times spread over a motion, at its nearest point, and the joints' traces below.

    Args:
        path: the PNG file.
        trajectory: the motion.
        capsules: the arm and its surroundings.
        nearest: least distances, the closest first; the pose of the first one is drawn too.
        title: line above the pictures.
    """
    from matplotlib.figure import Figure

    times = np.linspace(0.0, trajectory.duration, POSES)
    if nearest:
        times[np.abs(times - nearest[0].time).argmin()] = nearest[0].time
    figure = Figure(figsize=(3 * SIZE, 2 * SIZE + 3), layout="constrained")
    figure.suptitle(title)
    grid = figure.add_gridspec(3, 3, height_ratios=(SIZE, SIZE, 2.6))
    along = trajectory.motion(np.linspace(0.0, trajectory.duration, PATH))
    everywhere = capsules.ends(along.q)[0]
    poses = capsules.ends(trajectory.motion(times).q)[0]
    for k, (time, ends) in enumerate(zip(times, poses, strict=True)):
        axes: Any = figure.add_subplot(grid[k // 3, k % 3], projection="3d")
        _arm(axes, ends, capsules, everywhere)
        text = f"t = {time:.1f} s"
        if nearest and time == nearest[0].time:
            text += f"\n{nearest[0].pair}: {1000 * nearest[0].distance:.0f} mm"
        axes.set_title(text, fontsize=10)
    _traces(figure.add_subplot(grid[2, :]), trajectory, capsules, times)
    with written_whole(path) as stream:
        figure.savefig(stream, format="png", dpi=100)


def _arm(axes: Any, ends: Floats, capsules: Capsules, everywhere: Floats) -> None:  # noqa: ANN401
    """Draw the links at one pose, (n, 2, 3) [m], the tool's whole path, the floor and the boxes."""
    scene = capsules.scene
    corners = ([box.lower, box.upper] for box in scene.obstacles)
    points = np.vstack([everywhere.reshape(-1, 3), *corners])
    width = POINTS * SIZE * 0.6 / np.ptp(points, axis=0).max()
    axes.view_init(ELEVATION, AZIMUTH)
    axes.tick_params(labelsize=6)
    axes.plot(*everywhere[:, -1, 1].T, color="#bbbbbb", linewidth=0.7)
    for i, link in enumerate(ends):
        axes.plot(
            *link.T,
            color=COLORS[i % len(COLORS)],
            linewidth=2 * capsules.radii[i] * width,
            solid_capstyle="round",
            alpha=0.8,
        )
    if scene.floor is not None:
        x, y = np.meshgrid(*zip(points.min(axis=0)[:2], points.max(axis=0)[:2], strict=True))
        axes.plot_surface(x, y, np.full((2, 2), scene.floor), color="#999999", alpha=0.2)
    for box in scene.obstacles:
        axes.bar3d(*box.lower, *np.subtract(box.upper, box.lower), color="#d55e00", alpha=0.3)
    axes.set_aspect("equal")


def _traces(axes: Any, trajectory: Trajectory, capsules: Capsules, times: Floats) -> None:  # noqa: ANN401
    """Draw every joint's position as a share of its range."""
    motion = trajectory.motion(np.linspace(0.0, trajectory.duration, PATH))
    lower, upper = position_range(capsules.robot)
    for j, name in enumerate(capsules.robot.joint_names):
        share = (motion.q[:, j] - lower[j]) / (upper[j] - lower[j])
        axes.plot(motion.t, share, color=COLORS[j % len(COLORS)], label=name, linewidth=1.2)
    for time in times:
        axes.axvline(time, color="#bbbbbb", linewidth=0.8)
    axes.set(
        xlabel="t [s]",
        ylabel="position in the joint's range",
        ylim=(0, 1),
        xlim=(0, trajectory.duration),
    )
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize=7, frameon=False)
