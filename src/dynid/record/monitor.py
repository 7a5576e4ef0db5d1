"""Is everything as it should be while the arm moves? Each rule is a number with a reason; a broken one stops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.arrays import Floats
from dynid.drivers.joint_state import Sample
from dynid.errors import PacingLate, StateStale, TorqueHigh, TrackingLost
from dynid.record import tuning
from dynid.robot import Robot


@dataclass
class Monitor:
    """The monitor of one run; it also remembers how near the limits the run came.

    Args:
        robot: the arm.
        max_deviation: largest distance between planned and measured position [rad or m].
    """

    robot: Robot
    max_deviation: float = tuning.STOP_DEVIATION
    largest_deviation: float = 0.0
    largest_lateness: float = 0.0
    largest_torque_share: float = 0.0
    _high: int = 0
    _last_checked: float = -1.0

    def __post_init__(self) -> None:
        """Collect the ratings."""
        self._rating = self.robot.limits("torque")

    def pace(self, late: float, time: float) -> None:
        """Judge how late a command leaves.

        Raises:
            PacingLate: too late.
        """
        self.largest_lateness = max(self.largest_lateness, late)
        if late > tuning.STOP_LATE_S:
            raise PacingLate(
                f"a command was {1e3 * late:.0f} ms late (limit {1e3 * tuning.STOP_LATE_S:.0f}): "
                f"stopped at t = {time:.1f} s"
            )

    def state(self, sample: Sample, planned: Floats, now: float, time: float) -> None:
        """Judge the newest joint state.

        Args:
            sample: the state.
            planned: where the arm should have been when it arrived, (n,).
            now: monotonic clock [s].
            time: since the start of the motion [s].

        Raises:
            StateStale: it is too old.
            TrackingLost: the arm is not where it should be.
            TorqueHigh: a torque is near the rating.
        """
        age = now - sample.arrival
        if age > tuning.STOP_STALE_S:
            raise StateStale(
                f"no joint state for {age:.2f} s (limit {tuning.STOP_STALE_S:g}): stopped at t = {time:.1f} s"
            )
        if sample.arrival == self._last_checked:
            return
        self._last_checked = sample.arrival
        self._tracking(sample, planned, time)
        self._torque(sample, time)

    def _tracking(self, sample: Sample, planned: Floats, time: float) -> None:
        error = np.abs(sample.q - planned)
        worst = int(np.nanargmax(error)) if np.isfinite(error).any() else 0
        self.largest_deviation = max(self.largest_deviation, float(error[worst]))
        if not error[worst] <= self.max_deviation:
            unit = "rad" if self.robot.joints[worst].revolute else "m"
            raise TrackingLost(
                f"{self.robot.joint_names[worst]} is {error[worst]:.2f} {unit} from where it should be "
                f"(limit {self.max_deviation:g}): stopped at t = {time:.1f} s, log kept"
            )

    def _torque(self, sample: Sample, time: float) -> None:
        share = np.abs(sample.tau) / self._rating
        worst = int(share.argmax())
        self.largest_torque_share = max(self.largest_torque_share, float(share[worst]))
        self._high = self._high + 1 if share[worst] > tuning.STOP_TORQUE_SHARE else 0
        if self._high >= tuning.STOP_TORQUE_STATES:
            raise TorqueHigh(
                f"{self.robot.joint_names[worst]} reads {sample.tau[worst]:.1f} N m, {100 * share[worst]:.0f} % of its "
                f"rating (limit {100 * tuning.STOP_TORQUE_SHARE:.0f} %): stopped at t = {time:.1f} s"
            )
