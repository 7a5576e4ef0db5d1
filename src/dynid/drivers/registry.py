"""The drivers by the names that robot files use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dynid.drivers.generic import Generic
from dynid.drivers.interface import Driver
from dynid.drivers.kinova_gen2 import KinovaGen2
from dynid.drivers.lwr4plus import Lwr4Plus

if TYPE_CHECKING:
    from dynid.robot import Robot

DRIVERS: dict[str, Driver] = {driver.kind: driver for driver in (KinovaGen2(), Lwr4Plus(), Generic())}


def driver_of(robot: Robot) -> Driver:
    """Return the driver that the robot file names, the generic one when it names none."""
    return DRIVERS[robot.driver.kind if robot.driver else "generic"]
