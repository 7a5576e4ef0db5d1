"""The argument ROBOT: name of a robot file, path of one, or a URDF with ``--tip``."""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from typing import Any

import click

from dynid.cli.completed import ROBOT


def robot_argument(function: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the argument ROBOT and the option ``--tip``; the function gets one word, ``arm.urdf#LINK``."""

    def joined(*args: Any, robot: str, tip: str | None, **values: Any) -> Any:  # noqa: ANN401
        from dynid.errors import WrongUsage
        from dynid.workflows.robots import URDF

        if tip is not None and not robot.lower().endswith(URDF):
            raise WrongUsage(f"{robot} is no URDF: its chain has one tip", fix="leave out --tip")
        return function(*args, robot=robot if tip is None else f"{robot}#{tip}", **values)

    update_wrapper(joined, function)
    option = click.option(
        "--tip", metavar="LINK", help="Last link of the arm, where ROBOT is a URDF whose joints fork."
    )
    return click.argument("robot", type=ROBOT)(option(joined))
