"""What is known about an arm besides its logs: a prior from a file, bounds on masses and centres of mass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dynid.errors import LogNotFound, WrongUsage
from dynid.options import Options, option
from dynid.robot import Known, Prior, Robot
from dynid.text import whole_number

Range = tuple[float, float]
Corner = tuple[float, float, float]


def _range(value: Any, name: str) -> Range | None:  # noqa: ANN401
    if value is None:
        return None
    low, high = _two(value, name, 1) if isinstance(value, str) else ((float(value[0]),), (float(value[1]),))
    if not low[0] < high[0]:
        raise WrongUsage(f"{name} '{value}': the first number must be the smaller one")
    return low[0], high[0]


def _ranges(value: Any, name: str) -> tuple[tuple[int, Range], ...]:  # noqa: ANN401
    found = []
    for item in value:
        link, rest = _link(item, name)
        bounds = _range(rest, name)
        assert bounds is not None
        found.append((link, bounds))
    return tuple(found)


def _boxes(value: Any, name: str) -> tuple[tuple[int, tuple[Corner, Corner]], ...]:  # noqa: ANN401
    found = []
    for item in value:
        link, rest = _link(item, name)
        low, high = _two(rest, name, 3) if isinstance(rest, str) else rest
        (a, b, c), (x, y, z) = low, high
        if not (a < x and b < y and c < z):
            raise WrongUsage(f"{name} '{rest}': the first corner must be the lower one")
        found.append((link, ((a, b, c), (x, y, z))))
    return tuple(found)


def _link(item: Any, name: str) -> tuple[int, Any]:  # noqa: ANN401
    if not isinstance(item, str):
        return int(item[0]), item[1]
    number, equals, rest = item.partition("=")
    if not equals or whole_number(number.strip()) < 1:
        raise WrongUsage(f"{name} '{item}' does not begin with LINK=, the number of a link")
    return int(number), rest


def _two(text: str, name: str, count: int) -> tuple[Sequence[float], Sequence[float]]:
    try:
        parts = [[float(word) for word in part.split(",")] for part in text.split(":")]
    except ValueError:
        parts = []
    if len(parts) != 2 or any(len(part) != count for part in parts):
        fix = "such as --total-mass 15:17" if count == 1 else "such as --com-box 7=-0.1,-0.1,0:0.1,0.1,0.2"
        raise WrongUsage(f"{name} '{text}' is not LOW:HIGH", fix=fix)
    return parts[0], parts[1]


def _prior(value: Any, name: str) -> Path | Prior | None:  # noqa: ANN401
    if value is None or isinstance(value, (Path, Prior)):
        return value
    if not isinstance(value, str):
        raise WrongUsage(f"{name} {value!r:.60} is no file", fix=f"such as {name} prior.yaml")
    return Path(value)


@dataclass(frozen=True)
class PriorOptions(Options):
    """What is known about the bodies of an arm before anything is measured."""

    prior: Path | Prior | None = option(
        None,
        "Link inertias that are known before measuring: a YAML file with `links:` or `cylinders:`, or a URDF of this "
        "arm (default: those of the robot file).",
        metavar="FILE", kind="file", read=_prior,
    )  # fmt: skip
    total_mass: Range | None = option(
        None, "Smallest and largest mass of all identified links together [kg].", metavar="LOW:HIGH", read=_range
    )
    link_mass: tuple[tuple[int, Range], ...] = option(
        (), "Smallest and largest mass of one link [kg]; may be repeated.",
        metavar="LINK=LOW:HIGH", repeatable=True, read=_ranges,
    )  # fmt: skip
    com_box: tuple[tuple[int, tuple[Corner, Corner]], ...] = option(
        (), "Corners of the box around a link's centre of mass, in its DH frame [m]; may be repeated.",
        metavar="LINK=X,Y,Z:X,Y,Z", repeatable=True, read=_boxes,
    )  # fmt: skip

    @property
    def given(self) -> bool:
        """Whether any option says what is known of the bodies."""
        return self.prior is not None or self.total_mass is not None or bool(self.link_mass or self.com_box)


def with_prior(robot: Robot, options: PriorOptions) -> Robot:
    """Return the robot with the prior and the bounds of the options, which go before those of the robot file.

    Raises:
        WrongUsage: a bound names a link that the arm does not have.
        LogNotFound: the file of the prior is not there.
    """
    prior = options.prior
    if prior is not None:
        robot = replace(robot, prior=prior if isinstance(prior, Prior) else read_prior(prior, robot))
    for name, bounds in (("--link-mass", options.link_mass), ("--com-box", options.com_box)):
        for link, _ in bounds:
            if link > robot.n:
                raise WrongUsage(f"{name}: there is no link {link}", fix=f"a number from 1 to {robot.n}")
    known = robot.known
    return replace(
        robot,
        known=Known(
            options.total_mass or known.total_mass,
            tuple({**dict(known.link_mass), **dict(options.link_mass)}.items()),
            tuple({**dict(known.com_box), **dict(options.com_box)}.items()),
        ),
    )


def read_prior(path: Path, robot: Robot) -> Prior:
    """Read link bodies from a YAML file, or from a URDF whose frames are found by comparing poses.

    Raises:
        LogNotFound: the file is not there.
    """
    from dynid.exporters.user_urdf import attached
    from dynid.files import robotfile

    if not path.is_file():
        raise LogNotFound(f"no such file {path}", where=str(path), fix="--prior FILE.yaml or --prior FILE.urdf")
    if path.suffix in (".yaml", ".yml"):
        return robotfile.read_prior(path, robot)
    return attached(path, robot).prior()
