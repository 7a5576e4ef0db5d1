"""From a raw log to a clean one in DH quantities, with every check on the way."""

from __future__ import annotations

from collections.abc import Sequence

from dynid.log import Log
from dynid.quality.columns import in_si, selected, to_dh
from dynid.robot import Robot


def prepare(
    log: Log,
    robot: Robot,
    *,
    exclude: Sequence[tuple[float, float]] = (),
    sort_time: bool = False,
    identify: bool = True,
) -> Log:
    """Return the log in DH quantities of the robot."""
    return to_dh(in_si(selected(log, robot), robot), robot)
