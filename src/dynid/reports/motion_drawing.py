"""The picture of a motion, poses above the traces of all joints, and its animation, as PyBullet shows them.

Where PyBullet is missing, the still shows the links as lines.
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
#: Instants at which a motion is drawn.
PATH = 400
#: Pixels an inch, and length of the animation [ms].
DPI, SHOWN = 100, 6000


def draw_motion(
    drawing: Drawing,
    trajectory: Trajectory,
    capsules: Capsules,
    pictures: Sequence[Picture],
) -> None:
    """Write the still and the animation of a motion, whole or not at all.

    Args:
        drawing: where to.
        trajectory: the motion.
        capsules: the arm and its surroundings.
        pictures: PyBullet's, spread over the motion; lines are drawn in place of none.
    """
    from PIL import Image

    pictures = pictures or _sketched(trajectory, capsules)
    if drawing.picture is not None:
        some = np.linspace(0, len(pictures) - 1, STILLS).round().astype(int)
        sheet = _sheet(trajectory, capsules.robot, [pictures[k] for k in some])
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


def _sheet(trajectory: Trajectory, robot: Robot, pictures: Sequence[Picture]) -> Any:  # noqa: ANN401
    """Draw pictures above the traces of all joints, with lines at their times; return the canvas."""
    rows = -(-len(pictures) // COLUMNS)
    canvas = _canvas(COLUMNS * WIDE, rows * HIGH + TRACES)
    figure = canvas.figure
    figure.set_layout_engine("constrained")
    figure.suptitle(f"{robot.name}, alpha {trajectory.alpha:g}, {trajectory.duration:.1f} s")
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
    """Return pictures of the links, the path of the tool and the obstacles, spread over a motion."""
    path = trajectory.motion(np.linspace(0.0, trajectory.duration, PATH))
    poses, pictures = capsules.ends(path.q)[0], []
    for k in np.linspace(0, PATH - 1, STILLS).round().astype(int):
        canvas = _canvas(WIDE, HIGH)
        axes = canvas.figure.add_subplot(projection="3d")
        axes.plot(*poses[:, -1, 1].T, color="#bbbbbb", lw=0.7)
        for i, link in enumerate(poses[k]):
            axes.plot(*link.T, lw=6, solid_capstyle="round", color=COLORS[i % len(COLORS)])
        for box in capsules.scene.obstacles:
            axes.bar3d(*box.lower, *np.subtract(box.upper, box.lower), color="#d55e00", alpha=0.3)
        axes.set_aspect("equal")
        axes.locator_params(nbins=4)
        canvas.draw()
        pictures.append((float(path.t[k]), np.array(canvas.buffer_rgba())[..., :3]))
    return pictures
