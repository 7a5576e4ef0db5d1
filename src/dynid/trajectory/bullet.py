"""The child process of a preview: PyBullet loads the arm, measures distances and draws; run by ``preview.py`` only.

PyBullet ends its process when it finds no display and writes to stdout from C, so it never runs in dynid's own process.
Reads a job (JSON and an .npz of positions), writes distances as JSON, a picture and an animation.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.trajectory import tuning
from dynid.trajectory.drawing import animation, still

Floats = NDArray[np.float64]

#: Size of a rendered picture; the tiny renderer needs no graphics library.
WIDTH, HEIGHT = 480, 360
#: From where the camera looks, in Bullet's angles, and its field of view upwards [deg].
YAW, PITCH, VIEW = 50.0, -20.0, 50.0
#: Tiles of the floor along each side, and the side's length over the arm's reach: size and depth are seen by them.
TILES, FLOOR = 6, 2.4
#: Pictures of the still and of the animation.
STILLS, FRAMES = 6, 60
#: Colours of the links in turn, told apart by colour-blind people too.
_BLUE, _ORANGE = (0.1, 0.45, 0.75, 1), (0.92, 0.62, 0.1, 1)
_TILES = ((0.9, 0.9, 0.88, 1), (0.8, 0.8, 0.78, 1))


@dataclass(frozen=True)
class Pair:
    """Two things that may come near each other.

    Attributes:
        name: both names.
        body: PyBullet's number of the second body.
        link: link of the arm.
        other: link of the second body.
        wanted: distance that they are wanted to keep [m].
        usual: whether they are near in usual poses.
    """

    name: str
    body: int
    link: int
    other: int
    wanted: float
    usual: bool = False


class World:
    """The arm, the floor and the obstacles in PyBullet.

    Args:
        job: what ``preview.py`` wrote.
        window: open a window instead of working in memory.
    """

    def __init__(self, job: dict[str, Any], *, window: bool) -> None:
        import pybullet

        self._bullet = pybullet
        pybullet.connect(pybullet.GUI if window else pybullet.DIRECT)
        flags = pybullet.URDF_USE_SELF_COLLISION | pybullet.URDF_USE_INERTIA_FROM_FILE
        self._arm = pybullet.loadURDF(job["urdf"], useFixedBase=True, flags=flags)
        count = pybullet.getNumJoints(self._arm)
        rows = [pybullet.getJointInfo(self._arm, k) for k in range(count)]
        self._index = {row[1].decode(): k for k, row in enumerate(rows)}
        self._names = {k: row[12].decode() for k, row in enumerate(rows)} | {-1: "base"}
        self._parent = {k: row[16] for k, row in enumerate(rows)}
        self._joints = [self._index[name] for name in job["joints"]]
        self._sign, self._offset = np.ones(len(self._joints)), np.zeros(len(self._joints))
        self._things: dict[str, int] = {}
        self._room = dict(zip(self._joints, job["room"], strict=True))
        if job["floor"] is not None:
            self._things["floor"] = self._box(
                [-5, -5, job["floor"] - 1], [5, 5, job["floor"]], None
            )
            self._tiles(job["floor"], job["foot"], FLOOR * job["reach"] / TILES)
        for number, (lower, upper) in enumerate(job["obstacles"], start=1):
            self._things[f"obstacle {number}"] = self._box(lower, upper, (0.8, 0.45, 0.2, 0.9))
        for k in range(-1, count):
            color = _BLUE if k % 2 else _ORANGE
            pybullet.changeVisualShape(self._arm, k, rgbaColor=color)

    def _box(self, lower: list[float], upper: list[float], color: tuple[float, ...] | None) -> int:
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

    def _tiles(self, height: float, foot: list[float], side: float) -> None:
        """Lay tiles in two tones around the foot of the arm; they are seen and not felt."""
        looks = [self._look([side / 2, side / 2, side / 50], color) for color in _TILES]
        for i in range(TILES):
            for j in range(TILES):
                x, y = (foot[axis] + (k - (TILES - 1) / 2) * side for axis, k in enumerate((i, j)))
                self._bullet.createMultiBody(0, -1, looks[(i + j) % 2], [x, y, height - side / 50])

    def set_pose(self, q: Floats) -> None:
        """Put the arm at a pose in DH values, (n,) [rad or m]."""
        for joint, value in zip(self._joints, (q - self._offset) * self._sign, strict=True):
            self._bullet.resetJointState(self._arm, joint, float(value))

    def adopt(
        self, maps: list[list[list[float]]], poses: Floats, expected: Floats
    ) -> Floats | None:
        """Take the first map from joint values to DH values under which the joint axes are those of the DH table.

        Args:
            maps: signs and offsets, as q_dh = sign q + offset.
            poses: poses in DH values, (K, n).
            expected: direction and a point of every axis at those poses, (K, n, 6).

        Returns:
            None, or when no map fits the errors of the first one: angle [rad] and distance [m], (n, 2).
        """
        errors = []
        for sign, offset in maps:
            self._sign, self._offset = np.array(sign), np.array(offset)
            errors.append(_axis_errors(self._axes(poses), expected))
            if np.all(errors[-1] < [tuning.AXIS_ANGLE_RAD, tuning.AXIS_DISTANCE_M]):
                return None
        return errors[0]

    def _axes(self, poses: Floats) -> Floats:
        """Return direction, seen the way of the DH table, and a point of every joint axis at each pose, (K, n, 6)."""
        found = np.empty((len(poses), len(self._joints), 6))
        for k, q in enumerate(poses):
            self.set_pose(q)
            for j, joint in enumerate(self._joints):
                axis = np.array(self._bullet.getJointInfo(self._arm, joint)[13])
                state = self._bullet.getLinkState(self._arm, joint, computeForwardKinematics=True)
                # Why: Bullet turns a joint axis into the frame of the link's inertia, not that of the link.
                R = np.array(self._bullet.getMatrixFromQuaternion(state[1])).reshape(3, 3)
                found[k, j] = [*(R @ axis * self._sign[j]), *state[4]]
        return found

    def _pairs(self) -> list[tuple[int, int]]:
        """Return the pairs of links that are not joined to each other."""
        links = sorted(self._names)
        return [
            (a, b) for i, a in enumerate(links) for b in links[i + 1 :] if self._parent.get(b) != a
        ]

    def _distance(self, pair: Pair) -> float:
        """Return the distance of two links, or of a link and a thing; at most the farthest that is measured."""
        found = self._bullet.getClosestPoints(
            self._arm, pair.body, tuning.FARTHEST_MEASURED_M, pair.link, pair.other
        )
        return min((float(row[8]) for row in found), default=tuning.FARTHEST_MEASURED_M)

    def pairs_to_check(self, poses: Floats, job: dict[str, Any]) -> list[Pair]:
        """Return what can collide, with the distance that it is wanted to keep.

        Links that meet in a shoulder, an elbow or a wrist always overlap as plain shapes; the joint limits keep those
        apart, and only contact that is deeper than in every pose tells of something else. The foot stands on the floor.

        Args:
            poses: random poses, (K, n) [rad or m].
            job: wanted distances, and how near links are in usual poses that count as always near.
        """
        links = [
            Pair(f"{self._names[a]} - {self._names[b]}", self._arm, a, b, job["self"])
            for a, b in self._pairs()
        ]
        things = [
            Pair(f"{self._names[k]} - {name}", body, k, -1, self._wanted(job, name, k))
            for name, body in self._things.items()
            for k in sorted(self._names)
        ]
        least = np.empty((len(poses), len(links) + len(things)))
        for i, q in enumerate(poses):
            self.set_pose(q)
            least[i] = [self._distance(pair) for pair in (*links, *things)]
        usual = (least[:, : len(links)] <= job["near"]).mean(axis=0) >= tuning.USUALLY_NEAR_SHARE
        deepest = np.minimum(least.min(axis=0) - tuning.DEEPER_CONTACT_M, job["self"])
        # Why: links that pass each other closely in some poses and touch in none are harmless as they are built.
        built = usual | (least[:, : len(links)].min(axis=0) > tuning.DEEPER_CONTACT_M)
        watched = [
            replace(pair, wanted=float(deepest[i]), usual=bool(usual[i])) if built[i] else pair
            for i, pair in enumerate(links)
        ]
        # Why: only what stands on the floor touches it at rest in every pose; an arm may reach down to it in many.
        fixed = np.all(least[:, len(links) :] <= 0, axis=0).tolist()
        return watched + [pair for pair, stands in zip(things, fixed, strict=True) if not stands]

    def _wanted(self, job: dict[str, Any], thing: str, link: int) -> float:
        """Return the distance that a link is wanted to keep from the floor or an obstacle [m]."""
        room = self._room.get(link) if thing == "floor" else None
        return float(job["distance"] if room is None else min(job["distance"], room))

    def distances(self, poses: Floats, checked: list[Pair]) -> list[dict[str, Any]]:
        """Return the least distance [m] of every pair over poses, (N, n) [rad or m], the closest pair first."""
        least = np.full(len(checked), np.inf)
        where = np.zeros(len(checked), dtype=int)
        for k, q in enumerate(poses):
            self.set_pose(q)
            for i, pair in enumerate(checked):
                distance = self._distance(pair)
                if distance < least[i]:
                    least[i], where[i] = distance, k
        return [
            {
                "pair": checked[i].name,
                "distance_m": float(least[i]),
                "index": int(where[i]),
                "wanted_m": checked[i].wanted,
                "usual": checked[i].usual,
            }
            for i in np.argsort(least)
        ]

    def picture(self, q: Floats, target: list[float], distance: float) -> NDArray[np.uint8]:
        """Return a picture, (HEIGHT, WIDTH, 3), of a pose, (n,) [rad or m], seen from a distance [m]."""
        bullet = self._bullet
        self.set_pose(q)
        view = bullet.computeViewMatrixFromYawPitchRoll(target, distance, YAW, PITCH, 0, 2)
        projection = bullet.computeProjectionMatrixFOV(VIEW, WIDTH / HEIGHT, 0.05, 20)
        light = {"lightDirection": [1, -1, 2], "shadow": 1, "renderer": bullet.ER_TINY_RENDERER}
        image = bullet.getCameraImage(WIDTH, HEIGHT, view, projection, **light)[2]
        return np.reshape(image, (HEIGHT, WIDTH, 4))[:, :, :3].astype(np.uint8)

    def play(self, times: Floats, poses: Floats) -> None:
        """Show poses, (N, n) [rad or m], at times, (N,) [s], until the window is closed; the space bar replays."""
        bullet = self._bullet
        bullet.configureDebugVisualizer(bullet.COV_ENABLE_GUI, 0)
        while bullet.isConnected():
            begin = time.monotonic()
            while bullet.isConnected() and (now := time.monotonic() - begin) < times[-1]:
                self.set_pose(poses[min(int(np.searchsorted(times, now)), len(poses) - 1)])
                time.sleep(0.01)
            while (
                bullet.isConnected()
                and not bullet.getKeyboardEvents().get(ord(" "), 0) & bullet.KEY_WAS_TRIGGERED
            ):
                time.sleep(0.02)


def _draw(world: World, job: dict[str, Any], times: Floats, poses: Floats) -> None:
    """Write the still and the animation."""
    traces = (job["labels"], times, poses, job["lower"], job["upper"])
    for kind, count, write in (("picture", STILLS, still), ("animation", FRAMES, animation)):
        if job[kind]:
            at = np.linspace(0, len(poses) - 1, count).round().astype(int).tolist()
            shown = [(float(times[k]), world.picture(poses[k], *job["camera"])) for k in at]
            write(Path(job[kind]), shown, traces, job["title"])


def run(job_path: Path) -> None:
    """Do a job and write its answer beside it."""
    job = json.loads(job_path.read_text(encoding="utf-8"))
    with np.load(job_path.with_suffix(".npz"), allow_pickle=False) as arrays:
        times, poses, random, expected = (arrays[name] for name in ("t", "q", "random", "axes"))
    world = World(job, window=job["window"])
    errors = world.adopt(job["maps"], random[: len(expected)], expected)
    answer: dict[str, Any] = {
        "axis_errors": None if errors is None else errors.tolist(),
        "distances": [],
    }
    if errors is None and job["window"]:
        job_path.with_suffix(".ready").touch()
        world.play(times, poses)
    elif errors is None:
        if job["measure"]:
            answer["distances"] = world.distances(
                poses, world.pairs_to_check(random[: tuning.BULLET_LEARNING_POSES], job)
            )
        _draw(world, job, times, poses)
    job_path.with_suffix(".answer").write_text(json.dumps(answer), encoding="utf-8")


def _axis_errors(found: Floats, expected: Floats) -> Floats:
    """Return the largest angle and distance of each joint's axis from where it should be, (n, 2)."""
    direction, point = expected[..., :3], expected[..., 3:]
    angle = np.arccos(np.clip(np.sum(direction * found[..., :3], axis=2), -1, 1))
    across = np.linalg.norm(np.cross(direction, found[..., 3:] - point), axis=2)
    return np.stack([angle.max(axis=0), across.max(axis=0)], axis=1)


def main() -> None:
    """Do the job that the command line names."""
    run(Path(sys.argv[1]))
