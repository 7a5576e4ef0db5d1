"""What may be wanted of a motion, declared once for the command line, notebooks and the reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dynid.options import LEAST, Options, numbers, option, quantity

if TYPE_CHECKING:
    from dynid.trajectory.scene import Box, Scene

FAMILIES = ("quintic", "spline")
COSTS = ("i", "d", "condition", "paper")
#: Weights l1 and l2 of the paper's cost where none are given (Eq. 14).
PAPER_WEIGHTS = (1.0, 100.0)


def _weights(value: Any) -> tuple[float, ...]:  # noqa: ANN401
    weights = numbers(value, 2)
    if min(weights) < 0 or sum(weights) < LEAST:
        raise ValueError("they are not weights: none is below 0, not both are 0")
    return weights


def _margin(value: Any) -> float:  # noqa: ANN401
    return 0.0 if str(value) in ("0", "0%", "0.0") else quantity(value)


def _box(value: Any) -> Box:  # noqa: ANN401
    from dynid.trajectory.scene import Box  # here: it needs numpy, and help must be fast

    if isinstance(value, Box):
        return value
    text = value.removeprefix("box").strip(":, ") if isinstance(value, str) else value
    corners = numbers(text, 6)
    x, y, z = zip(corners[:3], corners[3:], strict=True)
    return Box((min(x), min(y), min(z)), (max(x), max(y), max(z)))


def _noise(value: Any) -> tuple[float, ...]:  # noqa: ANN401
    noise = numbers(value)
    if not noise or min(noise) < LEAST:
        raise ValueError("it must be one positive number, or one per joint")
    return noise


#: Options that PLAN.yaml may set, all as numbers or words of the command line.
IN_PLAN_FILE = (
    "alpha",
    "duration",
    "segments",
    "basis",
    "cost",
    "margin",
    "tool_speed",
    "floor",
    "rate",
)


@dataclass(frozen=True)
class PlanOptions(Options):
    """What is wanted of a motion."""

    alpha: float = option(
        0.2,
        "Speed factor of the run: the motion takes duration / alpha, at velocities times alpha.",
        bounds=(1e-3, 1),
    )
    duration: float = option(60.0, "Length of the motion at full speed [s].", bounds=(1, 3600))
    segments: int = option(20, "Number of quintic segments.", bounds=(2, 200))
    basis: str = option("quintic", "Family of motions.", choices=FAMILIES)
    optimise: bool = option(True, "Search for a good motion, or take a random one.")
    cost: str = option(
        "i",
        "What the search makes small: the expected torque error on other motions (i), the volume of the error "
        "ellipsoid (d), the condition number, or the cost of the paper's Eq. 14.",
        choices=COSTS,
    )
    normalise: bool = option(
        False,
        "Scale the columns to equal length in the cost, or take them as they are.",
        pair=True,
        off="--raw",
    )
    weights: tuple[float, float] | None = option(
        None,
        "Weights of the paper's Eq. 14; they choose --cost paper.",
        metavar="L1,L2",
        read=_weights,
    )
    restarts: int = option(
        5,
        "Number of starts of the search; when all finish, equal seeds give equal plans.",
        bounds=(1, None),
    )
    seconds: float = option(
        60.0, "Time limit of the search [s]; the best motion so far is kept.", bounds=(0.1, 1e6)
    )
    margin: float = option(
        "10%", "Share of every limit that stays free.", metavar="SHARE", read=_margin
    )
    tool_speed: float | None = option(
        None, "Largest speed of the tool [m/s].", bounds=(LEAST, None)
    )
    floor: float | None = option(
        "0",
        "Height of the floor in the world [m].",
        metavar="Z|none",
        nothing="none",
        read=lambda value: numbers(value, 1)[0],
    )
    obstacles: tuple[Box, ...] = option(
        (),
        "Box x0,y0,z0,x1,y1,z1 in the world [m] that no link may touch; may be repeated.",
        metavar="BOX",
        repeatable=True,
        flag="--obstacle",
        read=lambda value: tuple(map(_box, value)),
    )
    workspace: Box | None = option(
        None,
        "Box x0,y0,z0,x1,y1,z1 in the world [m] that the tool stays in.",
        metavar="BOX",
        read=_box,
    )
    noise: tuple[float, ...] | None = option(
        None,
        "Standard deviation of the torques [N m], one number or one per joint (default: the robot file's, or "
        "0.3 % of the rating).",
        metavar="NM[,NM...]",
        read=_noise,
    )
    rate: float = option(100.0, "Rate of the samples and of the coming log [Hz].", bounds=(1, 2000))
    seed: int = option(0, "Seed of every random choice.", bounds=(0, None))
    processes: int | None = option(None, "Number of processes that search (default: one per core).")

    @property
    def scene(self) -> Scene:
        """What surrounds the arm, and how far to stay away from it."""
        from dynid.trajectory.scene import Scene

        return Scene(floor=self.floor, obstacles=self.obstacles, workspace=self.workspace)
