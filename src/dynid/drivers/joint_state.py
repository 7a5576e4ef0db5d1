"""One joint state at a time between a driver's columns and DH quantities, for use while the arm moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.errors import WrongUsage
from dynid.robot import Robot


@dataclass(frozen=True)
class Sample:
    """One joint state in DH quantities.

    Attributes:
        arrival: when it came, on the monotonic clock [s].
        q: (n,) [rad or m].
        tau: (n,) [N m or N, A for a current].
    """

    arrival: float
    q: Floats
    tau: Floats


class Columns:
    """The columns of a robot's driver.

    Args:
        robot: the arm.

    Raises:
        WrongUsage: the driver's numbers are on the motor side of coupled gears.
    """

    def __init__(self, robot: Robot) -> None:
        if robot.coupling is not None:
            raise WrongUsage(
                f"{robot.name} has coupled joints",
                why="dynid does not command an arm whose motors move several joints",
                fix="record with --listen-only while the arm's own program moves it",
            )
        self.names = robot.log_names
        columns = robot.columns
        self._position, self._velocity, self._effort = robot.unit_factors(columns.units).values()
        self.sign, self._offset = np.array(columns.map.sign), np.array(columns.map.offset)
        self._torque_sign = self.sign * np.array(columns.map.torque_signs)

    def indices(self, names: Sequence[str]) -> list[int] | None:
        """Return where the robot's joints stand in a message; None when one is missing."""
        complete = set(self.names) <= set(names)
        return [names.index(name) for name in self.names] if complete else None

    def sample(self, message: Any, arrival: float) -> Sample | None:  # noqa: ANN401
        """Return a sensor_msgs/JointState in DH quantities; None for one that is not of this arm, or has no torques."""
        where, values = self.indices(message.name), (message.position, message.effort)
        if where is None or any(len(each) != len(message.name) for each in values):
            return None
        q, tau = (np.array(each, dtype=float)[where] for each in values)
        return Sample(arrival, self.positions_dh(q), self.efforts_dh(tau))

    def positions_dh(self, q: Floats) -> Floats:
        """Return driver positions, in its unit, as DH positions, (..., n) [rad or m]."""
        return q * self._position * self.sign + self._offset

    def efforts_dh(self, tau: Floats) -> Floats:
        """Return driver efforts, in its unit, as DH torques, (..., n) [N m or N, A for a current]."""
        return tau * self._effort * self._torque_sign

    def velocities_dh(self, qd: Floats) -> Floats:
        """Return driver velocities, in its unit, as DH velocities, (..., n) [rad/s or m/s]."""
        return qd * self._velocity * self.sign

    def positions(self, q: Floats) -> Floats:
        """Return DH positions, (..., n) [rad or m], in the driver's unit."""
        return (q - self._offset) * self.sign / self._position

    def velocities(self, qd: Floats) -> Floats:
        """Return DH velocities [rad/s] or accelerations [rad/s^2], (..., n), in the driver's unit."""
        return qd * self.sign / self._velocity

    def efforts(self, tau: Floats) -> Floats:
        """Return DH torques, (..., n) [N m or N], in the driver's unit."""
        return tau * self._torque_sign / self._effort
