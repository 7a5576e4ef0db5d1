"""What surrounds the arm: a floor, boxes, a workspace, and how far to stay away from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any


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
