"""Distances of an arm to itself, the floor and boxes, with gradients: each link is a capsule.

A capsule holds the cylinder that PyBullet judges the final motion with
(preview.py), so what is clear here is clear there.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dynid.model.kinematics import LinkFrames, link_frames, tip_jacobian
from dynid.model.parameters import cylinders_of, link_cylinders
from dynid.robot import Robot
from dynid.trajectory import tuning
from dynid.trajectory.feasible import position_range
from dynid.trajectory.scene import Box, Scene, nearest_of_segments, segment_to_box

Floats = NDArray[np.float64]


def tool_speed(robot: Robot, q: Floats, qd: Floats) -> Floats:
    """Return the speed of the last frame's origin, (N,) [m/s].

    Args:
        robot: the arm.
        q: joint positions, (N, n) [rad or m].
        qd: joint velocities, (N, n) [rad/s or m/s].
    """
    jacobian = tip_jacobian(robot, link_frames(robot, q))
    return np.asarray(np.linalg.norm(np.sum(jacobian * qd[:, :, None], axis=1), axis=1))


@dataclass(frozen=True)
class Distance:
    """The least distance of two things during a motion.

    Attributes:
        pair: their names, such as ``"link_5 - base"``.
        distance: negative when they overlap [m].
        time: when [s].
        wanted: what it should be at least [m]; less than asked for where the arm is built nearer.
    """

    pair: str
    distance: float
    time: float
    wanted: float


@dataclass
class Capsules:
    """The arm as one capsule a link, for one scene.

    Args:
        robot: the arm.
        scene: what surrounds it.
    """

    robot: Robot
    scene: Scene = field(default_factory=Scene)

    def __post_init__(self) -> None:
        """Place the capsules and learn which of them always touch."""
        self._ends = link_cylinders(self.robot)
        self.radii = np.full(self.robot.n, cylinders_of(self.robot).radius)
        self._first, self._second = np.triu_indices(self.robot.n, 2)
        points = self.ends(self._random_poses())[0]
        distance = self._pairs(points)[0]
        near = (distance < self.scene.self_distance).mean(axis=0) >= tuning.USUALLY_NEAR_SHARE
        rounded = distance - tuning.CAPSULE_ROUNDING_M
        usual, least = np.quantile(rounded, tuning.DEEPEST_POSES_SHARE, axis=0), rounded.min(axis=0)
        # Why: links that pass each other closely in some poses and touch in none are harmless as they are built.
        wanted = np.where(near, usual, np.where(least > 0, least, np.inf))
        #: Distance that each pair of links is wanted to keep [m].
        self._wanted = np.minimum(wanted, tuning.CAPSULE_DISTANCE_SHARE * self.scene.self_distance)
        #: Whether a pair is near in usual poses.
        self._usual = near
        #: Pairs of links that are near in usual poses as capsules of the guessed thickness.
        self.left_out = tuple(self._pair(k) for k in np.flatnonzero(near).tolist())
        floor = -np.inf if self.scene.floor is None else self.scene.floor
        height = points[..., 2] - self.radii[:, None]
        low = (height - floor < self.scene.distance).mean(axis=0) >= tuning.USUALLY_NEAR_SHARE
        # Why: the arm stands on the floor, but only its first link may; the others must not count as built low.
        self._lifted = ~(low & (np.arange(self.robot.n) == 0)[:, None])
        # Why: a shoulder may be built lower than the wanted distance; no motion lifts it.
        self._above_floor = np.minimum(
            self.scene.distance, height.max(axis=0) - floor - tuning.BUILT_LOW_M
        )

    def _pair(self, k: int) -> str:
        return f"link {self._first[k] + 1} - link {self._second[k] + 1}"

    def room(self) -> list[float | None]:
        """Return the distance to the floor that each link is wanted to keep as it is built [m]; None without a say."""
        if self.scene.floor is None:
            return [None] * self.robot.n
        return [
            float(wanted[lifted].min()) if lifted.any() else None
            for wanted, lifted in zip(self._above_floor, self._lifted, strict=True)
        ]

    def _random_poses(self) -> Floats:
        lower, upper = position_range(self.robot)
        return np.random.default_rng(0).uniform(
            lower, upper, (tuning.CAPSULE_LEARNING_POSES, self.robot.n)
        )

    def ends(self, q: Floats) -> tuple[Floats, LinkFrames]:
        """Return both ends of all capsules in the world, (N, n, 2, 3) [m], and the frames of the links there."""
        frames = link_frames(self.robot, q, world=True)
        turned = np.einsum("nlij,lej->nlei", frames.R, self._ends)
        return turned + frames.p[:, :, None], frames

    def _pairs(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """Return distances of pairs of links, (N, pairs), and where they are nearest, (N, pairs, 3) each [m]."""
        p, q = points[:, self._first, 0], points[:, self._second, 0]
        d, e = points[:, self._first, 1] - p, points[:, self._second, 1] - q
        s, t = nearest_of_segments(p, d, q, e)
        here, there = p + s[..., None] * d, q + t[..., None] * e
        apart = np.linalg.norm(here - there, axis=2)
        return apart - self.radii[self._first] - self.radii[self._second], here, there

    def _heights(self, points: Floats) -> Floats:
        """Return how high the ends are above what the floor leaves them, (N, n, 2) [m]; infinity where they may be."""
        assert self.scene.floor is not None
        height = points[..., 2] - self.radii[:, None] - self.scene.floor
        return np.where(self._lifted, height, np.inf)

    def _to_box(self, points: Floats, box: Box) -> tuple[Floats, Floats, Floats]:
        """Return distances of links to a box, (N, n), where they are nearest and the ways out, (N, n, 3) each."""
        p, d = points[:, :, 0], points[:, :, 1] - points[:, :, 0]
        distance, near, direction = segment_to_box(p, d, box)
        return distance - self.radii, near, direction

    def value(self, q: Floats) -> tuple[float, Floats]:
        """Return the penalty of positions, (N, n) [rad or m], and its gradient by them, (N, n) [1/rad or 1/m]."""
        points, frames = self.ends(q)
        scene, n = self.scene, self.robot.n
        force, moment = np.zeros((2, len(q), n, 3))
        tool_force = np.zeros((len(q), 3))

        def push(link: NDArray[np.intp], where: Floats, by: Floats) -> None:
            for k, i in enumerate(link):
                force[:, i] += by[:, k]
                moment[:, i] += np.cross(where[:, k], by[:, k])

        distance, here, there = self._pairs(points)
        total, slope = _charge(
            distance, np.where(self._usual, self._wanted, self._wanted + tuning.SPARE_DISTANCE_M)
        )
        apart = here - there
        way = slope[..., None] * apart / np.maximum(np.linalg.norm(apart, axis=2), 1e-9)[..., None]
        push(self._first, here, way)
        push(self._second, there, -way)
        every = np.arange(n)
        if scene.floor is not None:
            extra, slope = _charge(
                self._heights(points), self._above_floor + tuning.SPARE_DISTANCE_M
            )
            total += extra
            for end in range(2):
                push(every, points[:, :, end], slope[:, :, end, None] * np.array([0.0, 0.0, 1.0]))
        for box in scene.obstacles:
            distance, near, direction = self._to_box(points, box)
            extra, slope = _charge(distance, scene.distance + tuning.SPARE_DISTANCE_M)
            total += extra
            push(every, near, slope[..., None] * direction)
        if scene.workspace is not None:
            tool = frames.p[:, -1]
            for sign, edge in ((1.0, scene.workspace.lower), (-1.0, scene.workspace.upper)):
                extra, slope = _charge(sign * (tool - edge), tuning.SPARE_DISTANCE_M)
                total, tool_force = total + extra, tool_force + sign * slope
            force[:, -1] += tool_force
            moment[:, -1] += np.cross(tool, tool_force)
        return total, self._to_joints(frames, force, moment)

    def _to_joints(self, frames: LinkFrames, force: Floats, moment: Floats) -> Floats:
        """Turn forces on links and their moments about the origin into joint efforts: a joint carries what follows."""
        force, moment = (np.cumsum(x[:, ::-1], axis=1)[:, ::-1] for x in (force, moment))
        turning = np.array([joint.revolute for joint in self.robot.joints])[None, :, None]
        effort: Floats = np.sum(
            frames.axis * np.where(turning, moment - np.cross(frames.point, force), force), axis=2
        )
        return effort

    def keeps_clear(self, q: Floats) -> NDArray[np.bool_]:
        """Return at which poses, (N, n) [rad or m], everything keeps its wanted distance, (N,)."""
        points, frames = self.ends(q)
        clear = np.all(self._pairs(points)[0] >= self._wanted, axis=1)
        if self.scene.floor is not None:
            clear &= np.all(self._heights(points) >= self._above_floor, axis=(1, 2))
        for box in self.scene.obstacles:
            clear &= np.all(self._to_box(points, box)[0] >= self.scene.distance, axis=1)
        if self.scene.workspace is not None:
            tool, inside = frames.p[:, -1], self.scene.workspace
            clear &= np.all((tool >= inside.lower) & (tool <= inside.upper), axis=1)
        return np.asarray(clear)

    def contacts(self, q: Floats, t: Floats | None = None) -> list[Distance]:
        """Return the least clearance between links, to floor and obstacles, and of the tool to its workspace.

        Pairs of links that always overlap come one by one.

        Args:
            q: joint positions, (N, n) [rad or m].
            t: their times, (N,) [s]; 0 when None.
        """
        points, frames = self.ends(q)
        times = np.zeros(len(q)) if t is None else t
        found: list[Distance] = []

        def note(pair: str, distance: Floats, wanted: float, sample: int) -> None:
            found.append(Distance(pair, float(distance), float(times[sample]), wanted))

        distance, usual = self._pairs(points)[0], self._usual
        # Why: links that always overlap are watched too, but the closest pair is that of the others.
        groups = [[k] for k in np.flatnonzero(usual)] + (
            [np.flatnonzero(~usual)] if not usual.all() else []
        )
        for pairs in groups:
            lack = distance[:, pairs] - self._wanted[pairs]
            k, i = np.unravel_index(lack.argmin(), lack.shape)
            pair = int(pairs[i])
            note(self._pair(pair), distance[k, pair], float(self._wanted[pair]), int(k))
        if self.scene.floor is not None and self._lifted.any():
            height = self._heights(points)
            k, i, end = np.unravel_index((height - self._above_floor).argmin(), height.shape)
            note(
                f"link {i + 1} - floor", height[k, i, end], float(self._above_floor[i, end]), int(k)
            )
        for number, box in enumerate(self.scene.obstacles, start=1):
            distance = self._to_box(points, box)[0]
            k, i = np.unravel_index(distance.argmin(), distance.shape)
            note(f"link {i + 1} - obstacle {number}", distance[k, i], self.scene.distance, int(k))
        if self.scene.workspace is not None:
            tool, workspace = frames.p[:, -1], self.scene.workspace
            room = np.minimum(tool - workspace.lower, np.array(workspace.upper) - tool).min(axis=1)
            note("tool - edge of the workspace", room.min(), 0.0, int(room.argmin()))
        return found


def _charge(distance: Floats, wanted: float | Floats) -> tuple[float, Floats]:
    """Return the penalty on distances below the wanted ones, (N, ...), and its gradient."""
    lack = np.maximum(wanted - distance, 0.0) / tuning.CONTACT_SCALE_M
    weight = tuning.PENALTY_WEIGHT / len(distance)
    return weight * float(np.sum(lack**2)), -2 * weight / tuning.CONTACT_SCALE_M * lack
