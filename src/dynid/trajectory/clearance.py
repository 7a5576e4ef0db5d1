"""Distances of an arm to itself, the floor and boxes, with gradients: each link is a string of spheres.

Good enough to steer a search away from contact within milliseconds; PyBullet judges the final motion (preview.py).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.model.kinematics import LinkFrames, link_frames, tip_jacobian
from dynid.model.prior import link_cylinders
from dynid.robot import Robot
from dynid.trajectory.feasible import CONTINUOUS

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

#: Poses from which is learned which links always touch: those of a shoulder, elbow or wrist, the foot on the floor.
POSES = 300
#: Links that touch in more than this share of random poses meet in a joint, whose limits keep them apart.
USUAL = 0.2
#: Distance of neighbouring spheres over their radius: the string is at its thinnest 20 % thinner than the cylinder.
SPACING = 1.2
#: An arm that is built lower than the wanted distance need only stay this much below what its best pose reaches [m].
BUILT = 1e-3
#: Contact penalties: a violation of this size over the whole path costs as much as the weight [m].
SCALE = 0.05
WEIGHT = 100.0


@dataclass(frozen=True)
class Box:
    """A box in the world, its edges along the axes.

    Attributes:
        lower: least x, y, z [m].
        upper: greatest x, y, z [m].
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]


@dataclass(frozen=True)
class Scene:
    """What surrounds the arm, in world coordinates, and how far to stay away.

    Attributes:
        floor: height of the floor [m]; None without one.
        obstacles: boxes that no link may touch.
        workspace: box that the last frame must not leave; None without one.
        self_distance: wanted distance between links [m].
        distance: wanted distance to floor and boxes [m].
    """

    floor: float | None = 0.0
    obstacles: tuple[Box, ...] = ()
    workspace: Box | None = None
    self_distance: float = 0.02
    distance: float = 0.05

    @property
    def facts(self) -> dict[str, Any]:
        """Return the scene as JSON-able facts, for ``scene_from``."""
        return asdict(self)


def scene_from(facts: Mapping[str, Any]) -> Scene:
    """Return the scene of ``Scene.facts``."""
    boxes = tuple(Box(tuple(box["lower"]), tuple(box["upper"])) for box in facts["obstacles"])
    inside = facts["workspace"]
    return Scene(
        floor=facts["floor"],
        obstacles=boxes,
        workspace=Box(tuple(inside["lower"]), tuple(inside["upper"])) if inside else None,
        self_distance=float(facts["self_distance"]),
        distance=float(facts["distance"]),
    )


def tool_speed(robot: Robot, q: Floats, qd: Floats) -> Floats:
    """Return the speed of the last frame's origin, (N,) [m/s].

    Args:
        robot: the arm.
        q: joint positions, (N, n) [rad or m].
        qd: joint velocities, (N, n) [rad/s or m/s].
    """
    jacobian = tip_jacobian(robot, link_frames(robot, q))
    speed: Floats = np.linalg.norm(np.sum(jacobian * qd[:, :, None], axis=1), axis=1)
    return speed


@dataclass(frozen=True)
class Contact:
    """The least clearance of a motion of one kind.

    Attributes:
        what: the two things, such as ``"link 4 - base"``.
        distance: clearance beyond the sum of radii, negative when they overlap [m].
        index: sample where it is least.
        wanted: what it should be at least [m].
    """

    what: str
    distance: float
    index: int
    wanted: float


@dataclass
class Spheres:
    """The arm as spheres, for one scene.

    Args:
        robot: the arm.
        scene: what surrounds it.
    """

    robot: Robot
    scene: Scene = field(default_factory=Scene)

    def __post_init__(self) -> None:
        """Place the spheres and learn which of them always touch."""
        links, centres, radii = [], [], []
        for i, shape in enumerate(link_cylinders(self.robot)):
            count = max(2, math.ceil(shape.length / (SPACING * shape.radius)) + 1)
            for s in np.linspace(0.0, 1.0, count):
                links.append(i)
                centres.append((1 - s) * np.array(shape.start) + s * np.array(shape.end))
                radii.append(shape.radius)
        self.links, self._centres, self._radii = np.array(links), np.array(centres), np.array(radii)
        first, second = np.triu_indices(len(links), 1)
        apart = self.links[second] - self.links[first] > 1
        first, second = first[apart], second[apart]
        points = self.points(self._random_poses())[0]
        touching = self._pair_distance(points, first, second)[0] < self.scene.self_distance
        names = self.links[first] * self.robot.n + self.links[second]
        usual = [name for name in np.unique(names) if touching[:, names == name].any(axis=1).mean() >= USUAL]
        #: Pairs of links that are near in usual poses, as spheres of the guessed thickness, and are not watched.
        self.left_out = tuple(f"link {k // self.robot.n + 1} - link {k % self.robot.n + 1}" for k in usual)
        kept = ~np.isin(names, usual)
        self._first, self._second = first[kept], second[kept]
        floor = -np.inf if self.scene.floor is None else self.scene.floor
        low = (points[:, :, 2] - self._radii - floor < self.scene.distance).mean(axis=0) >= USUAL
        # Why: the arm stands on the floor, but only its first link may; the others must not count as built low.
        self._lifted = ~(low & (self.links == 0))
        best = (points[:, self._lifted, 2] - self._radii[self._lifted]).max(axis=0) - floor
        # Why: a shoulder may be built lower than the wanted distance; no motion lifts it.
        self._above_floor = np.minimum(self.scene.distance, best - BUILT)

    def room(self) -> list[float | None]:
        """Return the distance to the floor that each link is wanted to keep as it is built [m]; None without a say."""
        links = self.links[self._lifted]
        if self.scene.floor is None:
            return [None] * self.robot.n
        return [float(self._above_floor[links == i].min()) if (links == i).any() else None for i in range(self.robot.n)]

    def _random_poses(self) -> Floats:
        lower, upper = np.array([joint.limits.position or CONTINUOUS for joint in self.robot.joints]).T
        return np.random.default_rng(0).uniform(lower, upper, (POSES, self.robot.n))

    def points(self, q: Floats) -> tuple[Floats, LinkFrames]:
        """Return centres of all spheres in the world, (N, S, 3) [m], and the frames of the links there."""
        frames = link_frames(self.robot, q, world=True)
        turned = np.einsum("nsij,sj->nsi", frames.R[:, self.links], self._centres)
        return turned + frames.p[:, self.links], frames

    def _pair_distance(self, points: Floats, first: Ints, second: Ints) -> tuple[Floats, Floats]:
        """Return distances of pairs, (N, pairs), and the vectors between their centres."""
        apart = points[:, first] - points[:, second]
        length = np.sqrt(np.einsum("nkx,nkx->nk", apart, apart)) + 1e-12
        return length - self._radii[first] - self._radii[second], apart

    def _box_distance(self, points: Floats, box: Box) -> tuple[Floats, Floats]:
        """Return distances to a box, negative inside, and their gradients by the points."""
        centre, half = (np.add(box.upper, box.lower)) / 2, (np.subtract(box.upper, box.lower)) / 2
        beyond = np.abs(points - centre) - half
        outside = np.maximum(beyond, 0.0)
        length = np.sqrt(np.sum(outside**2, axis=2))
        inner = np.minimum(beyond.max(axis=2), 0.0)
        direction = np.where((length > 0)[..., None], outside / np.maximum(length, 1e-12)[..., None], 0.0)
        deepest = np.eye(3)[beyond.argmax(axis=2)]
        direction = np.where((length > 0)[..., None], direction, deepest) * np.sign(points - centre)
        return length + inner - self._radii, direction

    def _floor_distance(self, points: Floats) -> Floats:
        assert self.scene.floor is not None
        height: Floats = points[:, self._lifted, 2] - self._radii[self._lifted] - self.scene.floor
        return height

    def value(self, q: Floats) -> tuple[float, Floats]:
        """Return the penalty of positions, (N, n) [rad or m], and its gradient by them, (N, n) [1/rad or 1/m]."""
        points, frames = self.points(q)
        scene = self.scene
        point_force, tool_force = np.zeros_like(points), np.zeros((len(q), 3))
        distance, apart = self._pair_distance(points, self._first, self._second)
        total, slope = _charge(distance, scene.self_distance)
        close = np.nonzero(slope)
        if len(close[0]):
            sample, pair = close
            length = (distance[close] + self._radii[self._first[pair]] + self._radii[self._second[pair]])[:, None]
            pair_force = slope[close][:, None] * apart[close] / length
            np.add.at(point_force, (sample, self._first[pair]), pair_force)
            np.add.at(point_force, (sample, self._second[pair]), -pair_force)
        if scene.floor is not None:
            extra, slope = _charge(self._floor_distance(points), self._above_floor)
            total, point_force[:, self._lifted, 2] = total + extra, point_force[:, self._lifted, 2] + slope
        for box in scene.obstacles:
            distance, direction = self._box_distance(points, box)
            extra, slope = _charge(distance, scene.distance)
            total, point_force = total + extra, point_force + slope[:, :, None] * direction
        if scene.workspace is not None:
            tool = frames.p[:, -1]
            for sign, edge in ((1.0, scene.workspace.lower), (-1.0, scene.workspace.upper)):
                extra, slope = _charge(sign * (tool - edge), 0.0)
                total, tool_force = total + extra, tool_force + sign * slope
        return total, self._to_joints(points, frames, point_force, tool_force)

    def _to_joints(self, points: Floats, frames: LinkFrames, point_force: Floats, tool_force: Floats) -> Floats:
        """Turn forces on spheres and tool into joint efforts: every joint carries the links after it."""
        n = self.robot.n
        force, moment = np.zeros((2, len(points), n, 3))
        turned = np.cross(points, point_force)
        for i in range(n):
            here = self.links == i
            force[:, i], moment[:, i] = point_force[:, here].sum(axis=1), turned[:, here].sum(axis=1)
        force[:, -1] += tool_force
        moment[:, -1] += np.cross(frames.p[:, -1], tool_force)
        force, moment = (np.cumsum(x[:, ::-1], axis=1)[:, ::-1] for x in (force, moment))
        turning = np.array([joint.revolute for joint in self.robot.joints])[None, :, None]
        effort: Floats = np.sum(frames.axis * np.where(turning, moment - np.cross(frames.point, force), force), axis=2)
        return effort

    def keeps_clear(self, q: Floats) -> NDArray[np.bool_]:
        """Return at which poses, (N, n) [rad or m], everything keeps its wanted distance, (N,)."""
        points, frames = self.points(q)
        clear = np.all(self._pair_distance(points, self._first, self._second)[0] >= self.scene.self_distance, axis=1)
        if self.scene.floor is not None:
            clear &= np.all(self._floor_distance(points) >= self._above_floor, axis=1)
        for box in self.scene.obstacles:
            clear &= np.all(self._box_distance(points, box)[0] >= self.scene.distance, axis=1)
        if self.scene.workspace is not None:
            tool, inside = frames.p[:, -1], self.scene.workspace
            clear &= np.all((tool >= inside.lower) & (tool <= inside.upper), axis=1)
        return np.asarray(clear)

    def contacts(self, q: Floats) -> list[Contact]:
        """Return the least clearance between links, to floor and obstacles, and of the tool to its workspace.

        Args:
            q: joint positions, (N, n) [rad or m].
        """
        points, frames = self.points(q)
        found = []
        distance = self._pair_distance(points, self._first, self._second)[0]
        if distance.size:
            k, pair = np.unravel_index(distance.argmin(), distance.shape)
            names = f"link {self.links[self._first[pair]] + 1} - link {self.links[self._second[pair]] + 1}"
            found.append(Contact(names, float(distance[k, pair]), int(k), self.scene.self_distance))
        if self.scene.floor is not None:
            distance = self._floor_distance(points)
            k, s = np.unravel_index((distance - self._above_floor).argmin(), distance.shape)
            what, wanted = f"link {self.links[self._lifted][s] + 1} - floor", float(self._above_floor[s])
            found.append(Contact(what, float(distance[k, s]), int(k), wanted))
        for number, box in enumerate(self.scene.obstacles, start=1):
            distance = self._box_distance(points, box)[0]
            k, s = np.unravel_index(distance.argmin(), distance.shape)
            what = f"link {self.links[s] + 1} - obstacle {number}"
            found.append(Contact(what, float(distance[k, s]), int(k), self.scene.distance))
        if self.scene.workspace is not None:
            tool, workspace = frames.p[:, -1], self.scene.workspace
            room = np.minimum(tool - workspace.lower, np.array(workspace.upper) - tool).min(axis=1)
            found.append(Contact("tool - edge of the workspace", float(room.min()), int(room.argmin()), 0.0))
        return found


def _charge(distance: Floats, wanted: float | Floats) -> tuple[float, Floats]:
    """Return the penalty on distances below the wanted ones, (N, ...), and its gradient."""
    lack = np.maximum(wanted - distance, 0.0) / SCALE
    return WEIGHT * float(np.sum(lack**2)) / len(distance), -2 * WEIGHT / SCALE / len(distance) * lack
