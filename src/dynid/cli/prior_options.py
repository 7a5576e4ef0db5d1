"""What the user knows besides the logs: a prior from a file, bounds on masses and centres of mass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.errors import WrongUsage

if TYPE_CHECKING:
    from dynid.robot import Known, Prior, Robot

BELIEF_OPTIONS: tuple[Callable[[Any], Any], ...] = (
    click.option(
        "--prior", "prior_file", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE",
        help="Link inertias believed before measuring: YAML with `links:` or `cylinders:`, or a URDF of this arm.",
    ),
    click.option("--total-mass", metavar="LOW:HIGH", help="Of all identified links [kg]."),
    click.option("--link-mass", metavar="LINK=LOW:HIGH", multiple=True, help="Of one link [kg]; repeatable."),
    click.option(
        "--com-box", metavar="LINK=X,Y,Z:X,Y,Z", multiple=True,
        help="Corners of the box around a link's centre of mass, in its DH frame [m]; repeatable.",
    ),
)  # fmt: skip
BELIEF_DEFAULTS: dict[str, Any] = {"prior_file": None, "total_mass": None, "link_mass": (), "com_box": ()}


def belief_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options about what is known to a command."""
    for option in reversed(BELIEF_OPTIONS):
        function = option(function)
    return function


def believing(robot: Robot, options: dict[str, Any]) -> Robot:
    """Return the robot with the prior and the bounds of the command line; they go before those of the robot file."""
    if options["prior_file"] is not None:
        robot = replace(robot, prior=read_prior(options["prior_file"], robot))
    return replace(robot, known=_known(robot, options))


def read_prior(path: Path, robot: Robot) -> Prior:
    """Read believed link bodies, from YAML or from a URDF whose frames are found by comparing poses."""
    from dynid.errors import LogNotFound
    from dynid.export.user_urdf import attached
    from dynid.files import robotfile

    if not path.is_file():
        raise LogNotFound(f"no such file {path}", where=str(path), fix="--prior FILE.yaml or --prior FILE.urdf")
    if path.suffix in (".yaml", ".yml"):
        return robotfile.read_prior(path, robot.n)
    return attached(path, robot).prior()


def _known(robot: Robot, options: dict[str, Any]) -> Known:
    known = robot.known
    if options["total_mass"] is not None:
        known = replace(known, total_mass=_range(options["total_mass"], "--total-mass"))
    masses, boxes = dict(known.link_mass), dict(known.com_box)
    for text in options["link_mass"]:
        link, rest = _link(text, "--link-mass", robot.n)
        masses[link] = _range(rest, "--link-mass")
    for text in options["com_box"]:
        link, rest = _link(text, "--com-box", robot.n)
        boxes[link] = _box(rest)
    return replace(known, link_mass=tuple(masses.items()), com_box=tuple(boxes.items()))


def _link(text: str, option: str, n: int) -> tuple[int, str]:
    number, equals, rest = text.partition("=")
    if not equals or not number.strip().isdigit() or not 1 <= int(number) <= n:
        raise WrongUsage(f"{option} '{text}' does not begin with LINK=, a number from 1 to {n}")
    return int(number), rest


def _range(text: str, option: str) -> tuple[float, float]:
    low, high = _two(text, option, 1)
    if not low[0] < high[0]:
        raise WrongUsage(f"{option} '{text}': the first number must be the smaller one")
    return low[0], high[0]


def _box(text: str) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    (a, b, c), (x, y, z) = _two(text, "--com-box", 3)
    if not (a < x and b < y and c < z):
        raise WrongUsage(f"--com-box '{text}': the first corner must be the lower one")
    return (a, b, c), (x, y, z)


def _two(text: str, option: str, count: int) -> tuple[list[float], list[float]]:
    try:
        parts = [[float(word) for word in part.split(",")] for part in text.split(":")]
    except ValueError:
        parts = []
    if len(parts) != 2 or any(len(part) != count for part in parts):
        fix = "such as --total-mass 15:17" if count == 1 else "such as --com-box 7=-0.1,-0.1,0:0.1,0.1,0.2"
        raise WrongUsage(f"{option} '{text}' is not LOW:HIGH", fix=fix)
    return parts[0], parts[1]
