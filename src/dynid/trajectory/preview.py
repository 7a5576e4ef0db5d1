"""Check and show a motion with PyBullet, in a child process: distances per pair, picture, animation, window."""

from __future__ import annotations

import os
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from threading import Timer
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.disk import written_whole
from dynid.errors import Collision, NoDisplay, WrongRobotFile
from dynid.model.kinematics import link_frames
from dynid.robot import Robot
from dynid.sim.urdf import write_urdf
from dynid.trajectory import tuning
from dynid.trajectory.bullet import HEIGHT, PITCH, VIEW, WIDTH, YAW, Job, work
from dynid.trajectory.child import answers, working
from dynid.trajectory.clearance import Capsules
from dynid.trajectory.feasible import position_range
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.scene import Distance, Scene

Floats = NDArray[np.float64]
Sketch = Callable[[Path, Trajectory, Capsules, "Sequence[Distance]", str], None]


@dataclass(frozen=True)
class Drawing:
    """What to draw.

    Attributes:
        picture: path of the still; None for none.
        animation: path of the animated picture; None for none.
        title: line above the pictures.
        needed: whether a missing PyBullet is an error.
        sketch: draws the still where PyBullet is missing, from its path, the motion, the arm's capsules, the nearest
            distances and the title.
    """

    picture: Path | None = None
    animation: Path | None = None
    title: str = ""
    needed: bool = False
    sketch: Sketch | None = None


def measure_trajectory(
    trajectory: Trajectory, robot: Robot, urdf: Path | None, scene: Scene
) -> tuple[Distance, ...]:
    """Measure distances all along a motion.

    Args:
        trajectory: the motion.
        robot: the arm.
        urdf: its shapes; may have other link frames, but must have the same joint axes. None for cylinders along the DH
            table, whose thickness nobody has measured.
        scene: floor, obstacles, wanted distances.

    Returns:
        The least distance of every checked pair, the closest pair first; distances end at 0.3 m.

    Raises:
        PackageMissing: PyBullet is not there.
        WrongRobotFile: the URDF cannot be read, lacks a joint, or describes another arm.
    """
    return measure_poses(*_poses(trajectory), robot, urdf, scene)


def measure_poses(
    t: Floats, q: Floats, robot: Robot, urdf: Path | None, scene: Scene
) -> tuple[Distance, ...]:
    """Measure distances at poses in DH values, (N, n) [rad or m], at times (N,) [s]; see ``measure_trajectory``."""
    near = 0.0 if urdf else scene.self_distance
    with _answered(t, q, robot, urdf, scene, near=near) as answer:
        distances: tuple[Distance, ...] = answer
        return distances


def draw_trajectory(
    trajectory: Trajectory, robot: Robot, urdf: Path | None, scene: Scene, drawing: Drawing
) -> None:
    """Draw a motion; its pictures are written whole or not at all.

    Raises:
        PackageMissing: PyBullet is not there.
        WrongRobotFile: the URDF cannot be read, lacks a joint, or describes another arm.
    """
    paths = (drawing.picture, drawing.animation)
    wanted, shown = tuple(path is not None for path in paths), _poses(trajectory)
    with _answered(*shown, robot, urdf, scene, pictures=wanted, title=drawing.title) as pictures:
        for path, picture in zip(paths, pictures, strict=True):
            if path is not None:
                with written_whole(path) as stream:
                    stream.write(picture)


@contextmanager
def window(trajectory: Trajectory, robot: Robot, urdf: Path | None, scene: Scene) -> Iterator[None]:
    """Show a motion in PyBullet's window for the length of the block.

    Raises:
        NoDisplay: there is no display.
    """
    if not has_display():
        raise NoDisplay("no display: PyBullet cannot open its window")
    with _answered(*_poses(trajectory), robot, urdf, scene, window=True):
        yield


def has_display() -> bool:
    """Return whether a window can be opened."""
    return bool(os.environ.get("DISPLAY")) or sys.platform in ("win32", "darwin")


def require_clear(
    distances: Iterable[Distance],
    picture: Path | None = None,
    fix: str = "plan again with another --seed, or move the waypoints, --floor or --obstacle",
    slack: float = 0.0,
) -> None:
    """Refuse a motion that comes too near to anything.

    Args:
        distances: what was measured.
        picture: a drawing of the motion.
        fix: what would help.
        slack: by how much distances may be short [m].

    Raises:
        Collision: with the pair, the time and the distance.
    """
    broken = [d for d in distances if d.distance < d.wanted - slack]
    if not broken:
        return
    worst = min(broken, key=lambda d: d.distance - d.wanted)
    near, wanted = (f"{abs(1000 * size):.0f} mm" for size in (worst.distance, worst.wanted))
    if worst.wanted < 0:
        touch = f"overlap by {near}; in usual poses they do by {wanted}"
    elif worst.distance < 0:
        touch = f"the arm touches it (depth {near})"
    else:
        touch = f"the arm comes within {near}; wanted are {wanted}"
    what = f"{worst.pair.replace(' - ', ' and ', 1)}: {touch} at t = {worst.time:.1f} s"
    if len(broken) > 1:
        what += f"; {len(broken) - 1} more pairs are too close"
    raise Collision(what, where=str(picture) if picture else "", fix=fix)


def _poses(trajectory: Trajectory) -> tuple[Floats, Floats]:
    """Return times and poses that are measured, (N,) and (N, n)."""
    wanted = tuning.MEASURED_RATE_HZ * trajectory.basis.duration
    count = int(np.clip(wanted, 2, tuning.MOST_MEASURED_POSES)) + 1
    t = np.linspace(0.0, trajectory.duration, count)
    return t, trajectory.motion(t).q


# ---------------------------------------------------------------- the child
@contextmanager
def _answered(
    t: Floats,
    q: Floats,
    robot: Robot,
    urdf: Path | None,
    scene: Scene,
    **wanted: Any,  # noqa: ANN401
) -> Iterator[Any]:
    """Give what the child sends for a job, whose other attributes are ``wanted``, while it runs.

    Raises:
        PackageMissing: PyBullet is not there.
        WrongRobotFile: PyBullet cannot load the URDF, or an axis points elsewhere or lies elsewhere.
        NoDisplay: no window opened.
    """
    lower, upper = position_range(robot)
    random = np.random.default_rng(0).uniform(lower, upper, (tuning.BULLET_LEARNING_POSES, robot.n))
    frames = link_frames(robot, random[: tuning.AXIS_POSES], world=True)
    with TemporaryDirectory() as folder, TemporaryFile() as log:
        shapes = urdf or Path(folder) / f"{robot.slug}.urdf"
        if urdf is None:
            write_urdf(robot, None, shapes)
        job = Job(
            robot=robot,
            urdf=str(shapes.resolve()),
            names=_urdf_names(robot, shapes),
            scene=scene,
            room=Capsules(robot, scene).room(),
            t=t,
            q=q,
            random=random,
            axes=np.concatenate([frames.axis, frames.point], axis=2),
            camera=_camera(robot, q),
            traces=(robot.joint_names, t, (q - lower) / (upper - lower)),
            **wanted,
        )
        patience = tuning.WINDOW_TIMEOUT_S if job.window else tuning.DRAWING_TIMEOUT_S
        with working(work, job, log) as process:
            late = Timer(patience, process.kill)
            late.start()
            try:
                answer = next(answers(process), None)
            finally:
                late.cancel()
            if isinstance(answer, Exception):
                raise answer
            if answer is None:
                log.seek(0)
                said = log.read()[-2000:].decode(errors="replace")
                if job.window:
                    raise NoDisplay("PyBullet could not open its window", why=said[-300:])
                raise RuntimeError(f"the preview process ended without an answer:\n{said}")
            yield answer


def _camera(robot: Robot, q: Floats) -> tuple[Floats, float]:
    """Return what the camera looks at and from how far, so that the arm fills the picture and never leaves it."""
    some = q[:: max(1, len(q) // tuning.CAMERA_POSES)]
    points = np.vstack([*link_frames(robot, some, world=True).p, [robot.base_xyz]])
    yaw, pitch = np.radians([YAW, PITCH])
    ahead = np.array([-np.sin(yaw) * np.cos(pitch), np.cos(yaw) * np.cos(pitch), np.sin(pitch)])
    right = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    axes = np.array([right, np.cross(right, ahead), ahead])
    seen = points @ axes.T
    middle = (seen.max(axis=0) + seen.min(axis=0)) / 2
    opening = tuning.CAMERA_FILLED_SHARE * np.tan(np.radians(VIEW / 2))
    away = np.abs(seen - middle)[:, :2] / [opening * WIDTH / HEIGHT, opening]
    return middle @ axes, float(max((away - (seen - middle)[:, 2:]).max(), 0.3))


def _urdf_names(robot: Robot, urdf: Path) -> Sequence[str]:
    """Return the robot's joints by the names that the URDF uses: the robot file's or the driver's."""
    try:
        root = ET.fromstring(urdf.read_bytes())
    except (OSError, ET.ParseError, LookupError, ValueError) as error:
        raise WrongRobotFile(
            f"{urdf} is not a URDF: {error}", where=str(urdf), fix="give another --urdf"
        ) from None
    moving = ("revolute", "continuous", "prismatic")
    there = [j.get("name", "") for j in root.iter("joint") if j.get("type") in moving]
    for names in (robot.joint_names, robot.log_names):
        if set(names) <= set(there):
            return names
    missing = ", ".join(name for name in robot.joint_names if name not in there)
    what = f"{urdf} lacks the joints {missing}; it has {', '.join(there)}"
    raise WrongRobotFile(what, where=str(urdf), fix="rename the joints")
