"""The child process of a preview: PyBullet loads the arm, measures distances and draws; run by ``preview.py`` only.

PyBullet ends its process when it finds no display and writes to stdout from C, so it never runs in dynid's own process.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Floats
from dynid.errors import PackageMissing, WrongRobotFile
from dynid.trajectory import tuning
from dynid.trajectory.scene import Box, Distance, Scene

#: Body, link of the arm and link of the body of two things that may come near each other.
Pair = tuple[int, int, int]
#: Time [s] and pixels of a pose, (height, width, 3).
Picture = tuple[float, NDArray[np.uint8]]

#: Size of a rendered picture; the tiny renderer needs no graphics library.
WIDTH, HEIGHT = 480, 360
#: From where the camera looks, in Bullet's angles, and its field of view upwards [deg].
YAW, PITCH, VIEW = 50.0, -20.0, 50.0
#: Length of a tile of the floor, by which size and depth are seen [m].
TILE = 0.4
#: Colours of the links in turn, told apart by colour-blind people too, and of obstacles.
_BLUE, _ORANGE, _BROWN = (0.1, 0.45, 0.75, 1), (0.92, 0.62, 0.1, 1), (0.8, 0.45, 0.2, 0.9)


@dataclass(frozen=True)
class Job:
    """What a child shall do.

    Attributes:
        urdf: the arm's shapes.
        names: its joints, as the URDF calls them.
        scene: what surrounds it.
        room: distance to the floor that each link is wanted to keep as it is built [m]; None without a say.
        t: times, (N,) [s].
        q: positions of the URDF's joints, (N, n) [rad or m].
        random: those of random poses, from which is learned which links always touch, (K, n) [rad or m].
        camera: what the camera looks at, and from how far [m].
        near: links that are as near as this in usual poses count as always near [m].
        pictures: how many pictures are drawn; 0 to measure distances.
        window: whether a window opens.
    """

    urdf: str
    names: Sequence[str]
    scene: Scene
    room: Sequence[float | None]
    t: Floats
    q: Floats
    random: Floats
    camera: tuple[Floats, float]
    near: float = 0.0
    pictures: int = 0
    window: bool = False


class World:
    """The arm, the floor and the obstacles in PyBullet.

    Args:
        job: what is wanted.

    Raises:
        PackageMissing: PyBullet is not there.
        WrongRobotFile: PyBullet cannot load the URDF.
    """

    def __init__(self, job: Job) -> None:
        try:
            import pybullet
            import pybullet_data
        except ImportError:
            raise PackageMissing(
                "the preview needs PyBullet, which is not installed",
                fix="pip install pybullet, which has wheels up to Python 3.11; or use --preview none",
            ) from None
        self._job, self._bullet = job, pybullet
        pybullet.connect(pybullet.GUI if job.window else pybullet.DIRECT)
        flags = pybullet.URDF_USE_SELF_COLLISION | pybullet.URDF_USE_INERTIA_FROM_FILE
        try:
            self._arm = pybullet.loadURDF(job.urdf, useFixedBase=True, flags=flags)
        except pybullet.error as error:
            what = f"PyBullet cannot load {job.urdf}: pybullet.error: {error}"
            fix = "check the URDF and its meshes"
            raise WrongRobotFile(what, where=job.urdf, fix=fix) from None
        rows = [
            pybullet.getJointInfo(self._arm, k) for k in range(pybullet.getNumJoints(self._arm))
        ]
        self._names = {-1: "base"} | {k: row[12].decode() for k, row in enumerate(rows)}
        self._parent = [row[16] for row in rows]
        index = {row[1].decode(): k for k, row in enumerate(rows)}
        self._joints = [index[name] for name in job.names]
        self._things: dict[str, int] = {}
        if (floor := job.scene.floor) is not None:
            tiles = f"{pybullet_data.getDataPath()}/plane.urdf"
            self._things["floor"] = pybullet.loadURDF(tiles, (0, 0, floor), globalScaling=TILE)
        for number, box in enumerate(job.scene.obstacles, start=1):
            self._things[f"obstacle {number}"] = self._box(box)
        for k in self._names:
            pybullet.changeVisualShape(self._arm, k, rgbaColor=_BLUE if k % 2 else _ORANGE)

    def _box(self, box: Box) -> int:
        bullet, half = self._bullet, (np.subtract(box.upper, box.lower) / 2).tolist()
        shape = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=half)
        look = bullet.createVisualShape(bullet.GEOM_BOX, halfExtents=half, rgbaColor=_BROWN)
        middle = (np.add(box.lower, box.upper) / 2).tolist()
        return int(bullet.createMultiBody(0, shape, look, middle))

    def _set_pose(self, q: Floats) -> None:
        """Put the joints at positions, (n,) [rad or m]."""
        for joint, value in zip(self._joints, q.tolist(), strict=True):
            self._bullet.resetJointState(self._arm, joint, value)

    def _distances(self, poses: Floats, pairs: list[Pair]) -> Floats:
        """Return the distances of pairs at poses, (N, pairs) [m]; at most the farthest that is measured."""
        distances = np.full((len(poses), len(pairs)), tuning.FARTHEST_MEASURED_M)
        for row, q in zip(distances, poses, strict=True):
            self._set_pose(q)
            for i, (body, link, other) in enumerate(pairs):
                near = self._bullet.getClosestPoints(self._arm, body, row[i], link, other)
                row[i] = min((float(point[8]) for point in near), default=row[i])
        return distances

    def distances(self) -> tuple[Distance, ...]:
        """Return the least distance along the motion of everything that can collide, the closest pair first.

        Links that meet in a shoulder, an elbow or a wrist always overlap as plain shapes; the joint limits keep those
        apart, and only contact that is deeper than in every pose means something else. The foot stands on the floor.
        """
        scene, names = self._job.scene, self._names
        room = dict(zip(self._joints, self._job.room, strict=True))
        inner = [(self._arm, a, b) for a in names for b in names if a < b and self._parent[b] != a]
        outer = [(body, k, -1) for body in self._things.values() for k in names]
        labels = [f"{names[a]} - {names[b]}" for _, a, b in inner]
        labels += [f"{names[k]} - {name}" for name in self._things for k in names]
        to_floor = [scene.distance if (own := room.get(k)) is None else own for k in names]
        away = [
            min(scene.distance, own) if name == "floor" else scene.distance
            for name in self._things
            for own in to_floor
        ]
        learned = self._distances(self._job.random, [*inner, *outer])
        least, linked = learned.min(axis=0), np.arange(len(labels)) < len(inner)
        usual = linked & ((learned <= self._job.near).mean(axis=0) >= tuning.USUALLY_NEAR_SHARE)
        # Why: links that pass each other closely in some poses and touch in none are harmless as they are built.
        built = usual | (linked & (least > tuning.DEEPER_CONTACT_M))
        wanted = np.array([scene.self_distance] * len(inner) + away)
        wanted = np.where(built, np.minimum(least - tuning.DEEPER_CONTACT_M, wanted), wanted)
        # Why: only what stands on the floor touches it at rest in every pose; an arm may reach down to it in many.
        kept = np.flatnonzero(linked | ~np.all(learned <= 0, axis=0))
        along = self._distances(self._job.q, [[*inner, *outer][k] for k in kept])
        closest, when = along.min(axis=0), self._job.t[along.argmin(axis=0)]
        return tuple(
            Distance(labels[k], float(closest[i]), float(when[i]), float(wanted[k]), bool(usual[k]))
            for i, k in ((i, kept[i]) for i in np.argsort(closest))
        )

    def pictures(self) -> list[Picture]:
        """Return times [s] spread over the motion, and pictures of the arm there, (HEIGHT, WIDTH, 3)."""
        bullet, job = self._bullet, self._job
        target, distance = job.camera
        view = bullet.computeViewMatrixFromYawPitchRoll(target.tolist(), distance, YAW, PITCH, 0, 2)
        projection = bullet.computeProjectionMatrixFOV(VIEW, WIDTH / HEIGHT, 0.05, 3 * distance)
        light = {"lightDirection": [1, -1, 2], "shadow": 1, "renderer": bullet.ER_TINY_RENDERER}
        pictures = []
        for k in np.linspace(0, len(job.q) - 1, job.pictures).round().astype(int):
            self._set_pose(job.q[k])
            image = bullet.getCameraImage(WIDTH, HEIGHT, view, projection, **light)[2]
            pixels = np.reshape(image, (HEIGHT, WIDTH, 4))[:, :, :3].astype(np.uint8)
            pictures.append((float(job.t[k]), pixels))
        return pictures

    def play(self) -> None:
        """Show the motion until the window is closed; the space bar replays."""
        bullet, times = self._bullet, self._job.t
        bullet.configureDebugVisualizer(bullet.COV_ENABLE_GUI, 0)
        while bullet.isConnected():
            begin = time.monotonic()
            while bullet.isConnected() and (now := time.monotonic() - begin) < times[-1]:
                self._set_pose(self._job.q[np.searchsorted(times, now)])
                time.sleep(0.01)
            while (
                bullet.isConnected()
                and not bullet.getKeyboardEvents().get(ord(" "), 0) & bullet.KEY_WAS_TRIGGERED
            ):
                time.sleep(0.02)


def work(job: Job, send: Callable[[object], None]) -> None:
    """Send distances, or pictures where they are wanted; of a window that it is there."""
    world = World(job)
    if job.window:
        send("open")
        world.play()
    else:
        send(world.pictures() if job.pictures else world.distances())
