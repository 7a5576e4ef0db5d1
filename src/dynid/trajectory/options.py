"""What may be wanted of a motion, declared once for the command line, notebooks and the reference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dynid.errors import WrongUsage
from dynid.options import LEAST, MOST, Options, option, share

if TYPE_CHECKING:
    from dynid.trajectory.scene import Box, Scene

FAMILIES = ("quintic", "spline")
COSTS = ("i", "d", "condition", "paper")
#: Weights l1 and l2 of the paper's cost where none are given (Eq. 14).
PAPER_WEIGHTS = (1.0, 100.0)


def _floats(value: Any) -> tuple[float, ...]:  # noqa: ANN401
    """Return numbers, written with commas or given as a sequence; () for anything else."""
    try:
        parts = str(value).split(",") if isinstance(value, (str, float, int)) else value
        return tuple(float(part) for part in parts)
    except (TypeError, ValueError):
        return ()


def numbers(value: Any, count: int, name: str) -> tuple[float, ...]:  # noqa: ANN401
    """Return ``count`` numbers, written with commas or given as a sequence."""
    values = _floats(value)
    if len(values) != count or not all(abs(x) <= MOST for x in values):
        what = f"{name} '{value}' is not {count} number{'s' * (count > 1)}"
        raise WrongUsage(what, fix=f"such as {name} {','.join(['0'] * count)}")
    return values


def _weights(value: Any, name: str) -> tuple[float, float] | None:  # noqa: ANN401
    if value is None:
        return None
    first, second = numbers(value, 2, name)
    if first < 0 or second < 0 or first + second < LEAST:
        raise WrongUsage(
            f"{name} '{value}' are not weights",
            fix=f"such as {name} 1,100: none below 0, not both 0",
        )
    return first, second


def _margin(value: Any, name: str) -> float:  # noqa: ANN401
    return 0.0 if str(value) in ("0", "0%", "0.0") else share(value, name)


def _floor(value: Any, name: str) -> float | None:  # noqa: ANN401
    return None if value is None or value == "none" else numbers(value, 1, name)[0]


def _box(value: Any, name: str) -> Box | None:  # noqa: ANN401
    from dynid.trajectory.scene import Box  # here: it needs numpy, and help must be fast

    if value is None or isinstance(value, Box):
        return value
    text = value.removeprefix("box").strip(":, ") if isinstance(value, str) else value
    corners = numbers(text, 6, name)
    x, y, z = zip(corners[:3], corners[3:], strict=True)
    return Box((min(x), min(y), min(z)), (max(x), max(y), max(z)))


def _boxes(value: Any, name: str) -> tuple[Box, ...]:  # noqa: ANN401
    return tuple(box for item in value if (box := _box(item, name)) is not None)


def _noise(value: Any, name: str) -> tuple[float, ...] | None:  # noqa: ANN401
    if value is None:
        return None
    sigmas = _floats(value)
    if not sigmas or not all(LEAST <= sigma <= MOST for sigma in sigmas):
        what = f"{name} '{value}' must be one positive number, or one per joint"
        raise WrongUsage(what, fix=f"such as {name} 0.1")
    return sigmas


@dataclass(frozen=True)
class PlanOptions(Options):
    """What is wanted of a motion."""

    alpha: float = option(
        0.2,
        "Speed factor of the run: the motion takes duration / alpha, at velocities times alpha.",
    )
    duration: float = option(60.0, "Length of the motion at full speed [s].", bounds=(1, 3600))
    segments: int = option(20, "Number of quintic segments.", bounds=(2, 200))
    basis: str = option("quintic", "Family of motions.", choices=FAMILIES, shown="")
    optimise: bool = option(
        True, "Search for a good motion, or take a random one.", pair=True, shown=""
    )
    cost: str = option(
        "i",
        "What the search makes small: the expected torque error on other motions (i), the volume of the error "
        "ellipsoid (d), the condition number, or the cost of the paper's Eq. 14.",
        choices=COSTS,
        shown="",
    )
    normalise: bool = option(
        False,
        "Scale the columns to equal length in the cost, or take them as they are.",
        pair=True,
        off="--raw",
        shown="",
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
        kind="count",
        shown="",
    )
    seconds: float = option(
        60.0, "Time limit of the search [s]; the best motion so far is kept.", bounds=(0.1, 1e6)
    )
    margin: float = option(
        "10%", "Share of every limit that stays free.", metavar="SHARE", shown="", read=_margin
    )
    tool_speed: float | None = option(None, "Largest speed of the tool [m/s].", kind="positive")
    floor: float | None = option(
        "0", "Height of the floor in the world [m].", metavar="Z|none", shown="", read=_floor
    )
    obstacles: tuple[Box, ...] = option(
        (),
        "Box x0,y0,z0,x1,y1,z1 in the world [m] that no link may touch; may be repeated.",
        metavar="BOX",
        repeatable=True,
        flag="--obstacle",
        read=_boxes,
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
    seed: int = option(0, "Seed of every random choice.")
    processes: int | None = option(None, "Number of processes that search (default: one per core).")

    @property
    def scene(self) -> Scene:
        """What surrounds the arm, and how far to stay away from it."""
        from dynid.trajectory.scene import Scene

        return Scene(floor=self.floor, obstacles=self.obstacles, workspace=self.workspace)
