"""See a motion and let PyBullet judge it, in a child process: distances per pair, picture, animation, window."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid import children
from dynid.disk import written_whole
from dynid.errors import Collision, NoDisplay, PackageMissing, WrongRobotFile
from dynid.model.kinematics import link_frames
from dynid.motion import Motion
from dynid.robot import Robot
from dynid.sim.urdf import write_urdf
from dynid.trajectory import tuning
from dynid.trajectory.bullet import HEIGHT, PITCH, VIEW, WIDTH, YAW
from dynid.trajectory.clearance import Capsules, Distance
from dynid.trajectory.feasible import position_range
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.scene import Scene

Floats = NDArray[np.float64]
Sketch = Callable[[Path, Trajectory, Capsules, "Sequence[Distance]", str], None]


@dataclass(frozen=True)
class Distances:
    """What was measured along a motion.

    Attributes:
        least: least distance of every pair that can keep clear, the closest pair first.
        usual: the same of links that are near in usual poses; wanted is not to come nearer than there.
    """

    least: tuple[Distance, ...]
    usual: tuple[Distance, ...] = ()

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the pairs of links that cannot keep clear."""
        return tuple(sorted(distance.pair for distance in self.usual))


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

    @property
    def wanted(self) -> bool:
        """Whether anything is to be drawn."""
        return self.picture is not None or self.animation is not None


def measure_trajectory(
    trajectory: Trajectory, robot: Robot, urdf: Path, scene: Scene, *, guessed: bool = False
) -> Distances:
    """Measure distances all along a motion.

    Args:
        trajectory: the motion.
        robot: the arm.
        urdf: its URDF; a user's own may have other link frames, but must have the same joint axes.
        scene: floor, obstacles, wanted distances.
        guessed: whether the shapes are cylinders along the DH table, whose thickness nobody has measured.

    Returns:
        The least distance of every checked pair, the closest pair first; distances end at 0.3 m.

    Raises:
        PackageMissing: PyBullet is not there.
        WrongRobotFile: the URDF cannot be read, lacks a joint, or describes another arm.
    """
    return measure_poses(*_poses(trajectory), robot, urdf, scene, guessed=guessed)


def measure_poses(
    t: Floats, q: Floats, robot: Robot, urdf: Path, scene: Scene, *, guessed: bool = False
) -> Distances:
    """Measure distances at poses in DH values, (N, n) [rad or m], at times (N,) [s]; see ``measure_trajectory``."""
    near = scene.self_distance if guessed else 0.0
    with _job(t, q, robot, urdf, scene, None, near=near) as job:
        rows = _answer(robot, job, urdf)["distances"]
    found = [
        (
            row["usual"],
            Distance(row["pair"], row["distance_m"], float(t[row["index"]]), row["wanted_m"]),
        )
        for row in rows
    ]
    return Distances(
        *(tuple(one for usual, one in found if usual is kind) for kind in (False, True))
    )


def draw_trajectory(
    trajectory: Trajectory, robot: Robot, urdf: Path, scene: Scene, drawing: Drawing
) -> None:
    """Draw a motion; its pictures are written whole or not at all.

    Raises:
        PackageMissing: PyBullet is not there.
        WrongRobotFile: the URDF cannot be read, lacks a joint, or describes another arm.
    """
    with _job(*_poses(trajectory), robot, urdf, scene, drawing) as job:
        _answer(robot, job, urdf)
        for path in (drawing.picture, drawing.animation):
            if path is not None:
                with written_whole(path) as stream:
                    stream.write((job.parent / path.name).read_bytes())


def _answer(robot: Robot, job: Path, urdf: Path) -> dict[str, Any]:
    """Let the child do a job and return what it found."""
    log = job.with_suffix(".log")
    with log.open("wb") as stream:
        child = subprocess.run(
            _command(job),
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=stream,
            timeout=tuning.DRAWING_TIMEOUT_S,
            check=False,
        )
    answer = job.with_suffix(".answer")
    if not answer.is_file():
        raise _failure(child.returncode, log.read_text(errors="replace"), urdf)
    found: dict[str, Any] = json.loads(answer.read_text(encoding="utf-8"))
    _require_axes(robot, found["axis_errors"], urdf)
    return found


def capsule_distances(capsules: Capsules, motion: Motion) -> Distances:
    """Return the least clearances that capsules along the links have during a motion, the closest first."""
    found = sorted(capsules.contacts(motion.q, motion.t), key=lambda one: one.distance)
    usual = tuple(one for one in found if one.pair in capsules.left_out)
    return Distances(tuple(one for one in found if one not in usual), usual)


@contextmanager
def urdf_of(robot: Robot, own: Path | None) -> Iterator[Path]:
    """Give the user's own URDF, or one made from the DH table that is removed afterwards."""
    if own is not None:
        yield own
        return
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"{robot.slug}.urdf"
        write_urdf(robot, None, path)
        yield path


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
    if worst.wanted < 0:
        touch = f"overlap by {-1000 * worst.distance:.0f} mm; in usual poses they do by {-1000 * worst.wanted:.0f} mm"
    elif worst.distance < 0:
        touch = f"the arm touches it (depth {-1000 * worst.distance:.0f} mm)"
    else:
        touch = f"the arm comes within {1000 * worst.distance:.0f} mm; wanted are {1000 * worst.wanted:.0f} mm"
    first, second = worst.pair.split(" - ", 1)
    what = f"{first} and {second}: {touch} at t = {worst.time:.1f} s"
    if len(broken) > 1:
        what += f"; {len(broken) - 1} more pairs are too close"
    raise Collision(what, where=str(picture) if picture else "", fix=fix)


@contextmanager
def window(trajectory: Trajectory, robot: Robot, urdf: Path, scene: Scene) -> Iterator[None]:
    """Show a motion in PyBullet's window for the length of the block.

    Raises:
        NoDisplay: there is no display.
    """
    if not has_display():
        raise NoDisplay("no display: PyBullet cannot open its window")
    with (
        _job(*_poses(trajectory), robot, urdf, scene, None, window=True) as job,
        job.with_suffix(".log").open("wb") as stream,
    ):
        child = subprocess.Popen(
            _command(job),
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=stream,
        )
        try:
            _await(child, job)
            yield
        finally:
            child.terminate()
            child.wait()


def _await(child: subprocess.Popen[bytes], job: Path) -> None:
    """Wait until the window is there."""
    begin = time.monotonic()
    while not job.with_suffix(".ready").exists():
        if child.poll() is not None or time.monotonic() - begin > tuning.WINDOW_TIMEOUT_S:
            raise NoDisplay(
                "PyBullet could not open its window", why=job.with_suffix(".log").read_text()[-300:]
            )
        time.sleep(0.05)


def has_display() -> bool:
    """Return whether a window can be opened."""
    return bool(os.environ.get("DISPLAY")) or sys.platform in ("win32", "darwin")


def _poses(trajectory: Trajectory) -> tuple[Floats, Floats]:
    """Return times and poses that are measured, (N,) and (N, n)."""
    count = (
        int(
            np.clip(
                tuning.MEASURED_RATE_HZ * trajectory.basis.duration, 2, tuning.MOST_MEASURED_POSES
            )
        )
        + 1
    )
    t = np.linspace(0.0, trajectory.duration, count)
    return t, trajectory.motion(t).q


@contextmanager
def _job(
    t: Floats,
    q: Floats,
    robot: Robot,
    urdf: Path,
    scene: Scene,
    drawing: Drawing | None,
    *,
    near: float | None = None,
    window: bool = False,
) -> Iterator[Path]:
    """Write a job for the child into a folder that is removed afterwards: to measure, to draw, or to show a window.

    Args:
        t: times, (N,) [s].
        q: poses in DH values, (N, n) [rad or m].
        robot: the arm.
        urdf: its shapes.
        scene: what surrounds it.
        drawing: what to draw.
        near: links that are as near as this in usual poses count as always near [m]; None to measure nothing.
        window: whether a window opens.
    """
    lower, upper = position_range(robot)
    random = np.random.default_rng(0).uniform(lower, upper, (300, robot.n))
    facts: dict[str, Any] = {
        "urdf": str(urdf.resolve()),
        "joints": _urdf_names(robot, urdf),
        "labels": list(robot.joint_names),
        "lower": lower.tolist(),
        "upper": upper.tolist(),
        "floor": scene.floor,
        "obstacles": [[box.lower, box.upper] for box in scene.obstacles],
        "reach": float(sum(np.hypot(joint.a, joint.d) for joint in robot.joints)) or 1.0,
        "foot": list(robot.base_xyz),
        "camera": _camera(robot, q),
        "room": Capsules(robot, scene).room(),
        "title": drawing.title if drawing else "",
        "window": window,
        "measure": near is not None,
        "near": near,
        "self": scene.self_distance,
        "distance": scene.distance,
        "maps": _maps(robot),
    }
    with TemporaryDirectory() as folder:
        job = Path(folder) / "job.json"
        for kind in ("picture", "animation"):
            path = getattr(drawing, kind, None)
            facts[kind] = str(job.parent / path.name) if path else None
        job.write_text(json.dumps(facts), encoding="utf-8")
        frames = link_frames(robot, random[: tuning.AXIS_POSES], world=True)
        axes = np.concatenate([frames.axis, frames.point], axis=2)
        np.savez(job.with_suffix(".npz"), t=t, q=q, random=random, axes=axes)
        yield job


def _camera(robot: Robot, q: Floats) -> tuple[list[float], float]:
    """Return what the camera looks at and from how far, so that the arm fills the picture and never leaves it."""
    origins = link_frames(robot, q[:: max(1, len(q) // tuning.CAMERA_POSES)], world=True).p.reshape(
        -1, 3
    )
    points = np.vstack([origins, [robot.base_xyz]])
    yaw, pitch = np.radians([YAW, PITCH])
    ahead = np.array([-np.sin(yaw) * np.cos(pitch), np.cos(yaw) * np.cos(pitch), np.sin(pitch)])
    right = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    axes = np.array([right, np.cross(right, ahead), ahead])
    seen = points @ axes.T
    middle = (seen.max(axis=0) + seen.min(axis=0)) / 2
    opening = (
        tuning.CAMERA_FILLED_SHARE * np.tan(np.radians(VIEW / 2)) * np.array([WIDTH / HEIGHT, 1.0])
    )
    away = np.abs(seen - middle)[:, :2] / opening - (seen - middle)[:, 2:]
    return (middle @ axes).tolist(), float(max(away.max(), 0.3))


def _urdf_joints(urdf: Path) -> list[str]:
    """Return the names of the moving joints of a URDF."""
    import xml.etree.ElementTree as ET

    try:
        root = ET.fromstring(urdf.read_bytes())
    except (OSError, ET.ParseError, LookupError, ValueError) as error:
        raise WrongRobotFile(
            f"{urdf} is not a URDF: {error}", where=str(urdf), fix="give another --urdf"
        ) from None
    return [
        j.get("name", "")
        for j in root.iter("joint")
        if j.get("type") in ("revolute", "continuous", "prismatic")
    ]


def _urdf_names(robot: Robot, urdf: Path) -> list[str]:
    """Return the robot's joints by the names that the URDF uses: the robot file's or the driver's."""
    there = _urdf_joints(urdf)
    for names in (robot.joint_names, robot.log_names):
        if set(names) <= set(there):
            return list(names)
    missing = ", ".join(name for name in robot.joint_names if name not in there)
    what = f"{urdf} lacks the joints {missing}; it has {', '.join(there)}"
    raise WrongRobotFile(what, where=str(urdf), fix="rename the joints")


def _maps(robot: Robot) -> list[list[list[float]]]:
    """Return signs and offsets that a URDF may have: none (one made here), the simulator's, the driver's."""
    given = [robot.simulator, robot.driver.map if robot.driver else None]
    plain = [[1.0] * robot.n, [0.0] * robot.n]
    return [
        plain,
        *([list(found.sign), list(found.offset)] for found in given if found is not None),
    ]


def _command(job: Path) -> list[str]:
    return children.python("from dynid.trajectory.bullet import main; main()", str(job))


def _failure(status: int, log: str, urdf: Path) -> Exception:
    """Turn the end of a child into a mistake of the catalogue."""
    if "No module named 'pybullet'" in log:
        return PackageMissing(
            "the preview needs PyBullet, which is not installed",
            fix="pip install pybullet, which has wheels up to Python 3.11; or use --preview none",
        )
    if "Cannot load URDF" in log or "cannot" in log.lower():
        last = next((line for line in reversed(log.splitlines()) if line.strip()), "")
        what = f"PyBullet cannot load {urdf}: {last}"
        return WrongRobotFile(what, where=str(urdf), fix="check the URDF and its meshes")
    return RuntimeError(f"the preview process ended with status {status}:\n{log[-2000:]}")


def _require_axes(robot: Robot, errors: list[list[float]] | None, urdf: Path) -> None:
    """Refuse a URDF whose joint axes are not those of the DH table, whatever its link frames are.

    Raises:
        WrongRobotFile: an axis points elsewhere or lies elsewhere.
    """
    if errors is None:
        return
    wrong = [
        angle > tuning.AXIS_ANGLE_RAD or apart > tuning.AXIS_DISTANCE_M for angle, apart in errors
    ]
    j = wrong.index(True)
    words = f"{np.degrees(errors[j][0]):.1f} deg and {1000 * errors[j][1]:.1f} mm"
    raise WrongRobotFile(
        f"{robot.joint_names[j]}: axis in {urdf} is {words} off the DH table",
        where=str(urdf),
        fix="correct the DH table, `base:`, or the signs and offsets under `simulator:` or `driver:`",
    )
