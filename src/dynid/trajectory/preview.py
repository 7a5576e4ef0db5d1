"""Check and show a motion with PyBullet, in a child process: distances per pair, picture, animation, window."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from threading import Timer
from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.errors import Collision, NoDisplay
from dynid.model.attached import attached
from dynid.model.kinematics import link_frames
from dynid.robot import Robot
from dynid.sim.urdf import urdf_text
from dynid.trajectory import tuning
from dynid.trajectory.bullet import VIEW, Job, Picture, work
from dynid.trajectory.child import answers, working
from dynid.trajectory.clearance import Capsules
from dynid.trajectory.feasible import position_range
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.scene import Distance

#: Draws a motion into the files of a ``Drawing``, with the arm's capsules and PyBullet's pictures; where PyBullet is
#: missing, the still alone without any.
Draw = Callable[["Drawing", Trajectory, Capsules, "Sequence[Picture]"], None]
#: Pictures of an animation, and of a still.
FRAMES, STILLS = 60, 6


@dataclass(frozen=True)
class Drawing:
    """What to draw.

    Attributes:
        picture: path of the still; None for none.
        animation: path of the animated picture; None for none.
        needed: whether a missing PyBullet is an error.
    """

    picture: Path | None = None
    animation: Path | None = None
    needed: bool = False


def measure_poses(
    t: Floats, q: Floats, capsules: Capsules, urdf: Path | None
) -> tuple[Distance, ...]:
    """Measure distances at poses.

    Args:
        t: times, (N,) [s].
        q: poses in DH values, (N, n) [rad or m].
        capsules: the arm, and floor, obstacles and wanted distances.
        urdf: its shapes; may have other link frames, but must have the same joint axes. None for cylinders along the DH
            table, whose thickness nobody has measured.

    Returns:
        The least distance of every checked pair, the closest pair first; distances end at 0.3 m.

    Raises:
        PackageMissing: PyBullet is not there.
        WrongUrdf: the URDF cannot be read, lacks a joint, or describes another arm.
    """
    near = 0.0 if urdf else capsules.scene.self_distance
    with _answered(t, q, capsules, urdf, near=near) as answer:
        distances: tuple[Distance, ...] = answer
        return distances


def photographs(
    trajectory: Trajectory, capsules: Capsules, urdf: Path | None, count: int
) -> list[Picture]:
    """Return so many pictures of a motion, spread over it.

    Raises:
        PackageMissing: PyBullet is not there.
        WrongUrdf: the URDF cannot be read, lacks a joint, or describes another arm.
    """
    with _answered(*poses_of(trajectory), capsules, urdf, pictures=count) as answer:
        pictures: list[Picture] = answer
        return pictures


@contextmanager
def window(trajectory: Trajectory, capsules: Capsules, urdf: Path | None) -> Iterator[None]:
    """Show a motion in PyBullet's window for the length of the block.

    Raises:
        NoDisplay: there is no display.
    """
    if not has_display():
        raise NoDisplay("no display: PyBullet cannot open its window")
    with _answered(*poses_of(trajectory), capsules, urdf, window=True):
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
    raise Collision(what, where=picture or "", fix=fix)


def poses_of(trajectory: Trajectory) -> tuple[Floats, Floats]:
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
    capsules: Capsules,
    urdf: Path | None,
    **wanted: Any,  # noqa: ANN401
) -> Iterator[Any]:
    """Give what the child sends for a job, whose other attributes are ``wanted``, while it runs.

    Raises:
        PackageMissing: PyBullet is not there.
        WrongUrdf: the URDF cannot be read, or describes another arm.
        WrongRobotFile: PyBullet cannot load it.
        NoDisplay: no window opened.
    """
    robot = capsules.robot
    lower, upper = position_range(robot)
    random = np.random.default_rng(0).uniform(lower, upper, (tuning.BULLET_LEARNING_POSES, robot.n))
    with TemporaryDirectory() as folder, TemporaryFile() as log:
        if urdf is None:
            shapes, names = Path(folder) / f"{robot.slug}.urdf", robot.joint_names
            sign, offset = np.ones(robot.n), np.zeros(robot.n)
            shapes.write_text(urdf_text(robot), encoding="utf-8")
        else:
            place = attached(urdf, robot, tuning.SHAPES_WITHIN)
            shapes, names = urdf, place.names
            sign, offset = np.array(place.mapping.sign), np.array(place.mapping.offset)
        job = Job(
            urdf=str(shapes.resolve()),
            names=names,
            scene=capsules.scene,
            room=capsules.room(),
            t=t,
            q=sign * (q - offset),
            random=sign * (random - offset),
            camera=_camera(robot, q),
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
    """Return what the camera looks at and from how far, so that the arm never leaves the picture."""
    some = q[:: max(1, len(q) // tuning.CAMERA_POSES)]
    points = np.vstack([*link_frames(robot, some, world=True).p, [robot.base_xyz]])
    middle = (points.max(axis=0) + points.min(axis=0)) / 2
    reach = np.linalg.norm(points - middle, axis=1).max()
    return middle, float(max(reach / np.sin(np.radians(VIEW / 2)), 0.3))
