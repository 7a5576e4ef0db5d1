"""The child process of a preview: PyBullet loads the arm, measures distances and draws; run by ``preview.py`` only.

PyBullet ends its process when it finds no display and writes to stdout from C, so it never runs in dynid's own process.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.errors import PackageMissing, WrongRobotFile
from dynid.robot import Robot
from dynid.trajectory import tuning
from dynid.trajectory.drawing import Picture, Traces, animation, still
from dynid.trajectory.scene import Distance, Scene

Floats = NDArray[np.float64]
#: Body, link of the arm and link of the body of two things that may come near each other.
Pair = tuple[int, int, int]

#: Size of a rendered picture; the tiny renderer needs no graphics library.
WIDTH, HEIGHT = 480, 360
#: From where the camera looks, in Bullet's angles, and its field of view upwards [deg].
YAW, PITCH, VIEW = 50.0, -20.0, 50.0
#: Tiles of the floor along each side, and the side's length over the arm's reach: size and depth are seen by them.
TILES, FLOOR = 6, 2.4
#: Pictures of the still and of the animation.
STILLS, FRAMES = 6, 60
#: Colours of the links in turn, distinct for colour-blind people too.
_BLUE, _ORANGE = (0.1, 0.45, 0.75, 1), (0.92, 0.62, 0.1, 1)
_TILES = ((0.9, 0.9, 0.88, 1), (0.8, 0.8, 0.78, 1))


@dataclass(frozen=True)
class Job:
    """What a child shall do.

    Attributes:
        robot: the arm.
        urdf: its shapes.
        names: its joints, as the URDF calls them.
        scene: what surrounds it.
        room: distance to the floor that each link is wanted to keep as it is built [m]; None without a say.
        t: times, (N,) [s].
        q: poses in DH values, (N, n) [rad or m].
        random: random poses, from which is learned which links always touch, (K, n) [rad or m].
        axes: direction and a point of every axis at the first of them, (k, n, 6).
        camera: what the camera looks at, and from how far [m].
        traces: what is drawn below the poses.
        near: links that are as near as this in usual poses count as always near [m].
        pictures: whether a still and an animation are drawn; None to measure distances.
        title: line above the pictures.
        window: whether a window opens.
    """

    robot: Robot
    urdf: str
    names: Sequence[str]
    scene: Scene
    room: Sequence[float | None]
    t: Floats
    q: Floats
    random: Floats
    axes: Floats
    camera: tuple[Floats, float]
    traces: Traces
    near: float = 0.0
    pictures: tuple[bool, bool] | None = None
    title: str = ""
    window: bool = False


class World:
    """The arm, the floor and the obstacles in PyBullet.

    Args:
        job: what is wanted.

    Raises:
        PackageMissing: PyBullet is not there.
        WrongRobotFile: PyBullet cannot load the URDF, or an axis points elsewhere or lies elsewhere.
    """

    def __init__(self, job: Job) -> None:
        try:
            import pybullet
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
            self._things["floor"] = self._box((-5, -5, floor - 1), (5, 5, floor), None)
            self._tiles(floor)
        for number, box in enumerate(job.scene.obstacles, start=1):
            self._things[f"obstacle {number}"] = self._box(
                box.lower, box.upper, (0.8, 0.45, 0.2, 0.9)
            )
        for k in self._names:
            pybullet.changeVisualShape(self._arm, k, rgbaColor=_BLUE if k % 2 else _ORANGE)
        self._adopt()

    def _box(
        self, lower: Sequence[float], upper: Sequence[float], color: tuple[float, ...] | None
    ) -> int:
        """Place a box; without a colour it is felt and not seen."""
        # Why: a body without a visual shape is drawn as it is felt; a speck in the middle of the box is not seen.
        half = (np.subtract(upper, lower) / 2).tolist()
        shape = self._bullet.createCollisionShape(self._bullet.GEOM_BOX, halfExtents=half)
        look = self._look(half if color else [1e-4] * 3, color or _TILES[0])
        middle = (np.add(lower, upper) / 2).tolist()
        return int(self._bullet.createMultiBody(0, shape, look, middle))

    def _look(self, half: list[float], color: tuple[float, ...]) -> int:
        return int(
            self._bullet.createVisualShape(self._bullet.GEOM_BOX, halfExtents=half, rgbaColor=color)
        )

    def _tiles(self, height: float) -> None:
        """Lay tiles in two tones around the foot of the arm; they are seen and not felt."""
        robot = self._job.robot
        reach = float(sum(np.hypot(joint.a, joint.d) for joint in robot.joints)) or 1.0
        side = FLOOR * reach / TILES
        looks = [self._look([side / 2, side / 2, side / 50], color) for color in _TILES]
        for i, j in np.ndindex(TILES, TILES):
            x, y = (np.add((i, j), (1 - TILES) / 2) * side + robot.base_xyz[:2]).tolist()
            self._bullet.createMultiBody(0, -1, looks[(i + j) % 2], [x, y, height - side / 50])

    def _set_pose(self, q: Floats) -> None:
        """Put the arm at a pose in DH values, (n,) [rad or m]."""
        for joint, value in zip(self._joints, (q - self._offset) * self._sign, strict=True):
            self._bullet.resetJointState(self._arm, joint, float(value))

    def _adopt(self) -> None:
        """Take the first map from joint values to DH values under which the joint axes are those of the DH table.

        A URDF may have none (one made here), the simulator's or the driver's: q_dh = sign q + offset.
        """
        robot, urdf, errors = self._job.robot, self._job.urdf, []
        allowed = [tuning.AXIS_ANGLE_RAD, tuning.AXIS_DISTANCE_M]
        unchanged = (np.ones(robot.n), np.zeros(robot.n))
        given = (robot.simulator, robot.driver.map if robot.driver else None)
        for sign, offset in (unchanged, *((each.sign, each.offset) for each in given if each)):
            self._sign, self._offset = np.array(sign), np.array(offset)
            errors.append(self._axis_errors())
            if np.all(errors[-1] < allowed):
                return
        j = int(np.any(errors[0] > allowed, axis=1).argmax())
        angle, across = np.degrees(errors[0][j, 0]), 1000 * errors[0][j, 1]
        raise WrongRobotFile(
            f"{robot.joint_names[j]}: axis in {urdf} is {angle:.1f} deg and {across:.1f} mm off the DH table",
            where=urdf,
            fix="correct the DH table, `base:`, or the signs and offsets under `simulator:` or `driver:`",
        )

    def _axis_errors(self) -> Floats:
        """Return the largest angle and distance of each joint's axis from where it should be, (n, 2)."""
        bullet, expected = self._bullet, self._job.axes
        measured = np.empty_like(expected)
        for k, q in enumerate(self._job.random[: len(expected)]):
            self._set_pose(q)
            for j, joint in enumerate(self._joints):
                axis = np.array(bullet.getJointInfo(self._arm, joint)[13])
                state = bullet.getLinkState(self._arm, joint, computeForwardKinematics=True)
                # Why: Bullet turns a joint axis into the frame of the link's inertia, not that of the link.
                R = np.array(bullet.getMatrixFromQuaternion(state[1])).reshape(3, 3)
                measured[k, j] = [*(R @ axis * self._sign[j]), *state[4]]
        direction, point = expected[..., :3], expected[..., 3:]
        angle = np.arccos(np.clip(np.sum(direction * measured[..., :3], axis=2), -1, 1))
        across = np.linalg.norm(np.cross(direction, measured[..., 3:] - point), axis=2)
        return np.stack([angle.max(axis=0), across.max(axis=0)], axis=1)

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

    def pictures(self, count: int) -> list[Picture]:
        """Return times [s] spread over the motion, and pictures of the arm there, (HEIGHT, WIDTH, 3)."""
        bullet, job = self._bullet, self._job
        target, distance = job.camera
        view = bullet.computeViewMatrixFromYawPitchRoll(target.tolist(), distance, YAW, PITCH, 0, 2)
        projection = bullet.computeProjectionMatrixFOV(VIEW, WIDTH / HEIGHT, 0.05, 20)
        light = {"lightDirection": [1, -1, 2], "shadow": 1, "renderer": bullet.ER_TINY_RENDERER}
        pictures = []
        for k in np.linspace(0, len(job.q) - 1, count).round().astype(int):
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
    """Send distances, or the still and the animation where they are wanted; of a window that it is there."""
    world = World(job)
    if job.window:
        send("open")
        world.play()
    elif job.pictures is None:
        send(world.distances())
    else:
        kinds = zip(job.pictures, (STILLS, FRAMES), (still, animation), strict=True)
        send(
            [
                draw(world.pictures(count), job.traces, job.title) if wanted else None
                for wanted, count, draw in kinds
            ]
        )
