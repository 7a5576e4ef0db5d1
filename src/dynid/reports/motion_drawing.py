"""The picture of a motion, poses above the traces of all joints, and its animation, as PyBullet shows them.

Where PyBullet is missing, the still shows capsules along the links.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dynid.disk import written_whole
from dynid.robot import Robot
from dynid.trajectory.bullet import Picture
from dynid.trajectory.clearance import Capsules
from dynid.trajectory.feasible import position_range
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.preview import STILLS, Drawing

#: Colours that colour-blind people tell apart (Okabe and Ito); repeated for arms of more joints.
COLORS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#000000", "#9a8a00")
#: Poses beside each other, width and height of one and height of the traces [inch].
COLUMNS, WIDE, HIGH, TRACES = 3, 4.8, 3.6, 2.4
#: Poses whose tool path is drawn behind the capsules, and from where these are seen [deg].
PATH, ELEVATION, AZIMUTH = 400, 18, -50
#: Pixels an inch, points an inch (the unit of line widths), and length of the animation [ms].
DPI, POINTS, SHOWN = 100, 72, 6000


def draw_motion(
    drawing: Drawing,
    trajectory: Trajectory,
    capsules: Capsules,
    pictures: Sequence[Picture],
) -> None:
    """Write the still and the animation of a motion, whole or not at all.

    Args:
        drawing: where to, and the title.
        trajectory: the motion.
        capsules: the arm and its surroundings.
        pictures: PyBullet's, spread over the motion; capsules are drawn in place of none.
    """
    from PIL import Image

    pictures = pictures or _sketched(trajectory, capsules)
    if drawing.picture is not None:
        some = np.linspace(0, len(pictures) - 1, STILLS).round().astype(int)
        sheet = _sheet(drawing.title, trajectory, capsules.robot, [pictures[k] for k in some])
        with written_whole(drawing.picture) as stream:
            sheet.print_png(stream)
    if drawing.animation is not None:
        first, *others = (Image.fromarray(pixels).quantize(64) for _, pixels in pictures)
        each = SHOWN // len(pictures)
        with written_whole(drawing.animation) as stream:
            first.save(stream, "GIF", save_all=True, append_images=others, duration=each, loop=0)


def _canvas(width: float, height: float) -> Any:  # noqa: ANN401
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    return FigureCanvasAgg(Figure(figsize=(width, height), dpi=DPI))


def _sheet(title: str, trajectory: Trajectory, robot: Robot, pictures: Sequence[Picture]) -> Any:  # noqa: ANN401
    """Draw pictures above the traces of all joints, with lines at their times; return the canvas."""
    rows = -(-len(pictures) // COLUMNS)
    canvas = _canvas(COLUMNS * WIDE, rows * HIGH + TRACES)
    figure = canvas.figure
    figure.set_layout_engine("constrained")
    figure.suptitle(title)
    grid = figure.add_gridspec(rows + 1, COLUMNS, height_ratios=[*[HIGH] * rows, TRACES])
    motion = trajectory.motion(np.linspace(0.0, trajectory.duration, PATH))
    (lower, upper), traces = position_range(robot), figure.add_subplot(grid[rows, :])
    shares = ((motion.q - lower) / (upper - lower)).T
    for j, (name, share) in enumerate(zip(robot.joint_names, shares, strict=True)):
        traces.plot(motion.t, share, color=COLORS[j % len(COLORS)], label=name, lw=1.2)
    traces.set(
        xlabel="time [s]", ylabel="in the joint's range", xlim=(0, motion.t[-1]), ylim=(0, 1)
    )
    traces.set_yticks([0, 0.5, 1], ["lower", "middle", "upper"])
    figure.legend(loc="outside lower center", ncols=2 * COLUMNS + 1, fontsize=7, frameon=False)
    for k, (time, pixels) in enumerate(pictures):
        axes = figure.add_subplot(grid[k // COLUMNS, k % COLUMNS])
        axes.set_title(f"t = {time:.1f} s", fontsize=10)
        axes.axis("off")
        axes.imshow(pixels)
        traces.axvline(time, color="#bbbbbb", lw=1.0)
    return canvas


def _sketched(trajectory: Trajectory, capsules: Capsules) -> list[Picture]:
    """Return pictures of capsules spread over a motion."""
    path = trajectory.motion(np.linspace(0.0, trajectory.duration, PATH))
    poses, scene, pictures = capsules.ends(path.q)[0], capsules.scene, []
    corners = [corner for box in scene.obstacles for corner in (box.lower, box.upper)]
    points = np.vstack([poses.reshape(-1, 3), *corners])
    width = 2 * POINTS * HIGH * 0.75 / np.ptp(points, axis=0).max()
    for k in np.linspace(0, PATH - 1, STILLS).round().astype(int):
        canvas = _canvas(WIDE, HIGH)
        axes = canvas.figure.add_axes((-0.15, -0.15, 1.3, 1.3), projection="3d")
        axes.view_init(ELEVATION, AZIMUTH)
        axes.tick_params(labelsize=6)
        axes.plot(*poses[:, -1, 1].T, color="#bbbbbb", lw=0.7)
        for i, (link, radius) in enumerate(zip(poses[k], capsules.radii, strict=True)):
            look = {"color": COLORS[i % len(COLORS)], "alpha": 0.8}
            axes.plot(*link.T, lw=radius * width, solid_capstyle="round", **look)
        if scene.floor is not None:
            x, y = np.meshgrid(*zip(points.min(axis=0)[:2], points.max(axis=0)[:2], strict=True))
            axes.plot_surface(x, y, np.full((2, 2), scene.floor), color="#999999", alpha=0.2)
        for box in scene.obstacles:
            axes.bar3d(*box.lower, *np.subtract(box.upper, box.lower), color="#d55e00", alpha=0.3)
        axes.set_aspect("equal")
        canvas.draw()
        pictures.append((float(path.t[k]), np.array(canvas.buffer_rgba())[..., :3]))
    return pictures
