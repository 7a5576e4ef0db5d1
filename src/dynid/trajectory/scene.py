"""What surrounds the arm: a floor, boxes, a workspace, and how far to stay away from them.

Distances of line segments from each other and from boxes, many at once, with the points where they are nearest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.trajectory import tuning

_GOLDEN = (np.sqrt(5) - 1) / 2
#: Segments whose directions differ by less than this (sine squared) count as parallel.
_PARALLEL = 1e-12


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


@dataclass(frozen=True)
class Distance:
    """The least distance of two things during a motion.

    Attributes:
        pair: their names, such as ``"link_5 - base"``.
        distance: negative when they overlap [m].
        time: when [s].
        wanted: what it should be at least [m]; less than asked for where the arm is built nearer.
        usual: whether both are links that are near in usual poses; wanted is not to come nearer than there.
    """

    pair: str
    distance: float
    time: float
    wanted: float
    usual: bool


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


# ---------------------------------------------------------------- distances
def nearest_of_segments(p: Floats, d: Floats, q: Floats, e: Floats) -> tuple[Floats, Floats]:
    """Return where the segments p + s d and q + t e are nearest, s and t in 0..1, (...) each.

    Args:
        p: starts of the first segments, (..., 3) [m].
        d: from start to end, (..., 3) [m]; none of zero length.
        q: starts of the second segments, (..., 3) [m].
        e: from start to end, (..., 3) [m]; none of zero length.

    Source: minimum of a convex quadratic over the unit square: where the free minimum of one side leaves its segment,
        it is moved to the end and the other side follows.
    """
    r = p - q
    dd, ee, de = _dot(d, d), _dot(e, e), _dot(d, e)
    dr, er = _dot(d, r), _dot(e, r)
    across = dd * ee - de**2
    free = np.where(
        across > _PARALLEL * dd * ee, (de * er - dr * ee) / np.maximum(across, 1e-300), 0.0
    )
    t = np.clip((de * np.clip(free, 0, 1) + er) / ee, 0, 1)
    s = np.clip((de * t - dr) / dd, 0, 1)
    return s, t


def _dot(a: Floats, b: Floats) -> Floats:
    product: Floats = np.einsum("...x,...x->...", a, b)
    return product


def box_distance(points: Floats, box: Box) -> tuple[Floats, Floats]:
    """Return distances of points, (..., 3) [m], to a box, negative inside, and the directions away from it."""
    centre, half = np.add(box.upper, box.lower) / 2, np.subtract(box.upper, box.lower) / 2
    beyond = np.abs(points - centre) - half
    outside = np.maximum(beyond, 0.0)
    length = np.sqrt(_dot(outside, outside))
    inner = np.minimum(beyond.max(axis=-1), 0.0)
    deepest = np.eye(3)[beyond.argmax(axis=-1)]
    direction = np.where(
        (length > 0)[..., None], outside / np.maximum(length, 1e-12)[..., None], deepest
    )
    return length + inner, direction * np.where(points < centre, -1.0, 1.0)


def segment_to_box(p: Floats, d: Floats, box: Box) -> tuple[Floats, Floats, Floats]:
    """Return the least distances of the segments p + u d to a box, negative inside, where, and the directions out.

    The distance from a convex body, negative inside, is a convex function along a line: golden section finds its least.
    Inside, that lies where two faces are equally far; the direction is then the one of both that is across the segment.

    Args:
        p: starts, (..., 3) [m].
        d: from start to end, (..., 3) [m].
        box: the box.

    Returns:
        Distances, (...), nearest points, (..., 3) [m], and unit directions or those between two of them, (..., 3).
    """
    low, high = np.zeros(p.shape[:-1]), np.ones(p.shape[:-1])
    for _ in range(tuning.GOLDEN_SECTIONS):
        span = _GOLDEN * (high - low)
        left, right = high - span, low + span
        nearer = (
            box_distance(p + left[..., None] * d, box)[0]
            < box_distance(p + right[..., None] * d, box)[0]
        )
        low, high = np.where(nearer, low, left), np.where(nearer, right, high)
    u = (low + high) / 2
    sides = [
        box_distance(p + np.clip(u + step, 0, 1)[..., None] * d, box)[1]
        for step in (-tuning.KINK_SHARE, tuning.KINK_SHARE)
    ]
    before, after = (_dot(side, d) for side in sides)
    change = after - before
    share = np.clip(
        np.where(np.abs(change) > 1e-12, after / np.where(change == 0, 1, change), 0.5), 0, 1
    )[..., None]
    nearest = p + u[..., None] * d
    return box_distance(nearest, box)[0], nearest, share * sides[0] + (1 - share) * sides[1]
