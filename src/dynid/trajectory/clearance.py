"""Distances of an arm to itself, the floor and boxes, with gradients: each link is a capsule.

A capsule holds the cylinder that PyBullet checks the final motion with
(preview.py), so what is clear here is clear there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from dynid.arrays import Floats, Ints, Mask
from dynid.model.kinematics import LinkFrames, link_frames, tip_jacobian
from dynid.model.parameters import cylinders_of, link_cylinders
from dynid.robot import Robot
from dynid.trajectory import tuning
from dynid.trajectory.feasible import position_range
from dynid.trajectory.scene import Distance, Scene, nearest_of_segments, segment_to_box


def tool_speed(robot: Robot, q: Floats, qd: Floats) -> Floats:
    """Return the speed of the last frame's origin, (N,) [m/s].

    Args:
        robot: the arm.
        q: joint positions, (N, n) [rad or m].
        qd: joint velocities, (N, n) [rad/s or m/s].
    """
    jacobian = tip_jacobian(robot, link_frames(robot, q))
    return np.linalg.norm(np.sum(jacobian * qd[:, :, None], axis=1), axis=1)


@dataclass(frozen=True)
class Near:
    """Distances of one kind at many poses, and what would make them larger.

    Attributes:
        distance: (N, k) [m].
        wanted: (k,) [m].
        names: of the k pairs.
        way: which way leads away, (N, k, 3).
        pushes: links, (k,), points of them, (N, k, 3) [m], and 1 for those that go that way, -1 for the others.
        length: of the ways, (N, k, 1).
        spare: what the search keeps more than is wanted, (k,) [m].
        alone: which pairs are reported one by one rather than by their least distance, (k,).
    """

    distance: Floats
    wanted: Floats
    names: Sequence[str]
    way: Floats
    pushes: Sequence[tuple[Ints, Floats, int]]
    length: Floats | float = 1.0
    spare: Floats | float = tuning.SPARE_DISTANCE_M
    alone: Mask | bool = False


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
        n, scene = self.robot.n, self.scene
        self._ends = link_cylinders(self.robot)
        self.radii = np.full(n, cylinders_of(self.robot).radius)
        self._first, self._second = np.triu_indices(n, 2)
        pairs = zip(self._first + 1, self._second + 1, strict=True)
        self._names = [f"link {a} - link {b}" for a, b in pairs]
        lower, upper = position_range(self.robot)
        rng = np.random.default_rng(0)
        points = self.ends(rng.uniform(lower, upper, (tuning.CAPSULE_LEARNING_POSES, n)))[0]
        distance = self._pairs(points)[0]
        near = (distance < scene.self_distance).mean(axis=0) >= tuning.USUALLY_NEAR_SHARE
        rounded = distance - tuning.CAPSULE_ROUNDING_M
        usual, least = np.quantile(rounded, tuning.DEEPEST_POSES_SHARE, axis=0), rounded.min(axis=0)
        # Why: links that pass each other closely in some poses and touch in none are harmless as they are built.
        wanted = np.where(near, usual, np.where(least > 0, least, np.inf))
        #: Distance that each pair of links is wanted to keep [m].
        self._wanted = np.minimum(wanted, tuning.CAPSULE_DISTANCE_SHARE * scene.self_distance)
        #: Whether a pair is near in usual poses.
        self._usual = near
        floor = -np.inf if scene.floor is None else scene.floor
        height = points[..., 2] - self.radii[:, None]
        low = (height - floor < scene.distance).mean(axis=0) >= tuning.USUALLY_NEAR_SHARE
        # Why: the arm stands on the floor, but only its first link may; the others must not count as built low.
        self._lifted = ~(low & (np.arange(n) == 0)[:, None])
        # Why: a shoulder may be built lower than the wanted distance; no motion lifts it.
        self._above_floor = np.minimum(
            scene.distance, height.max(axis=0) - floor - tuning.BUILT_LOW_M
        )

    def room(self) -> list[float | None]:
        """Return the distance to the floor that each link is wanted to keep as it is built [m]; None without a say."""
        if self.scene.floor is None:
            return [None] * self.robot.n
        return [
            float(wanted[lifted].min()) if lifted.any() else None
            for wanted, lifted in zip(self._above_floor, self._lifted, strict=True)
        ]

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
        between = np.linalg.norm(here - there, axis=2)
        return between - self.radii[self._first] - self.radii[self._second], here, there

    def _near(self, points: Floats, frames: LinkFrames) -> Iterator[Near]:
        """Yield what the arm may come near: itself, the floor, the obstacles, the edge of the workspace."""
        scene, links = self.scene, np.arange(self.robot.n)
        distance, here, there = self._pairs(points)
        between = here - there
        yield Near(
            distance,
            self._wanted,
            self._names,
            between,
            [(self._first, here, 1), (self._second, there, -1)],
            np.maximum(np.linalg.norm(between, axis=2), 1e-9)[..., None],
            np.where(self._usual, 0.0, tuning.SPARE_DISTANCE_M),
            self._usual,
        )
        if scene.floor is not None and self._lifted.any():
            height = points[..., 2] - self.radii[:, None] - scene.floor
            both = np.repeat(links, 2)
            yield Near(
                np.where(self._lifted, height, np.inf).reshape(len(points), -1),
                self._above_floor.ravel(),
                [f"link {i + 1} - floor" for i in both],
                np.array([0.0, 0.0, 1.0]),
                [(both, points.reshape(len(points), -1, 3), 1)],
            )
        for number, box in enumerate(scene.obstacles, start=1):
            p, d = points[:, :, 0], points[:, :, 1] - points[:, :, 0]
            distance, nearest, direction = segment_to_box(p, d, box)
            yield Near(
                distance - self.radii,
                np.full(len(links), scene.distance),
                [f"link {i + 1} - obstacle {number}" for i in links],
                direction,
                [(links, nearest, 1)],
            )
        if scene.workspace is not None:
            tool, inside = frames.p[:, -1], scene.workspace
            yield Near(
                np.hstack([tool - inside.lower, inside.upper - tool]),
                np.zeros(6),
                ["tool - edge of the workspace"] * 6,
                np.vstack([np.eye(3), -np.eye(3)]),
                [(np.repeat(links[-1:], 6), np.repeat(tool[:, None], 6, axis=1), 1)],
            )

    def value(self, q: Floats) -> tuple[float, Floats]:
        """Return the penalty of positions, (N, n) [rad or m], and its gradient by them, (N, n) [1/rad or 1/m]."""
        points, frames = self.ends(q)
        force, moment = np.zeros((2, len(q), self.robot.n, 3))
        total = 0.0
        for near in self._near(points, frames):
            lack = np.maximum(near.wanted + near.spare - near.distance, 0) / tuning.CONTACT_SCALE_M
            weight = tuning.PENALTY_WEIGHT / len(q)
            total += weight * float(np.sum(lack**2))
            slope = -2 * weight / tuning.CONTACT_SCALE_M * lack
            away = slope[..., None] * near.way / near.length
            for links, where, sign in near.pushes:
                by = sign * away
                turn = np.cross(where, by)
                for k, i in enumerate(links):
                    force[:, i] += by[:, k]
                    moment[:, i] += turn[:, k]
        # A joint carries all forces on what follows it.
        force, moment = (np.cumsum(x[:, ::-1], axis=1)[:, ::-1] for x in (force, moment))
        turning = self.robot.turning[:, None]
        effort = np.where(turning, moment - np.cross(frames.point, force), force)
        return total, np.sum(frames.axis * effort, axis=2)

    def margin(self, q: Floats) -> Floats:
        """Return by how much everything keeps more than its wanted distance at poses, (N, n) [rad or m]; (N,) [m]."""
        lacks = [(near.distance - near.wanted).T for near in self._near(*self.ends(q))]
        return np.vstack(lacks).min(axis=0, initial=np.inf)

    def distances(self, q: Floats, t: Floats | None = None) -> tuple[Distance, ...]:
        """Return the least clearance between links, to floor and obstacles, and of the tool to its workspace.

        The closest pair comes first; pairs of links that are near in usual poses come one by one.

        Args:
            q: joint positions, (N, n) [rad or m].
            t: their times, (N,) [s]; 0 when None.
        """
        times = np.zeros(len(q)) if t is None else t
        distances = []
        for near in self._near(*self.ends(q)):
            usual = np.broadcast_to(near.alone, near.wanted.shape)
            # Why: links that always overlap are watched too, but the closest pair is that of the others.
            for pairs in (*np.flatnonzero(usual)[:, None], np.flatnonzero(~usual)):
                if len(pairs):
                    lack = near.distance[:, pairs] - near.wanted[pairs]
                    sample, k = np.unravel_index(lack.argmin(), lack.shape)
                    i = int(pairs[k])
                    size, wanted = float(near.distance[sample, i]), float(near.wanted[i])
                    time = float(times[sample])
                    distances.append(Distance(near.names[i], size, time, wanted, bool(usual[i])))
        return tuple(sorted(distances, key=lambda one: one.distance))
