"""Is everything as it should be while the arm moves? Each rule is a number with a reason; a broken one stops."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dynid.arrays import Floats
from dynid.drivers.joint_state import Sample
from dynid.errors import DynidError, PacingLate, StateStale, TorqueHigh, TrackingLost
from dynid.record import tuning
from dynid.record.recorder import Tally
from dynid.robot import Robot


@dataclass
class Outcome:
    """How a recording ended.

    Attributes:
        tally: what came in.
        seconds: length of the motion that was played, or of listening [s].
        commands: how many were sent.
        skipped: periods without a command because the machine was late.
        largest_lateness: of a command [s].
        largest_deviation: between planned and measured position [rad or m].
        largest_torque_share: of a rating.
        failure: what ended it early; None when it ended as planned.
        stop: what the driver answered to the stop; "" when it was not stopped.
        stop_failure: why it could not be stopped.
        still: whether the arm stood still afterwards; None when that was not seen.
        notes: further sentences for a person.
    """

    tally: Tally = field(default_factory=Tally)
    seconds: float = 0.0
    commands: int = 0
    skipped: int = 0
    largest_lateness: float = 0.0
    largest_deviation: float = 0.0
    largest_torque_share: float = 0.0
    failure: BaseException | None = None
    stop: str = ""
    stop_failure: str = ""
    still: bool | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def verdict(self) -> str:
        """One word or sentence for the manifest."""
        if self.failure is None:
            return "clean"
        if isinstance(self.failure, KeyboardInterrupt):
            return "stopped by the operator"
        code = f"{self.failure.code}: " if isinstance(self.failure, DynidError) else ""
        return f"aborted, {code}{self.failure}"


@dataclass
class Monitor:
    """The monitor of one run.

    Args:
        robot: the arm.
        max_deviation: largest distance between planned and measured position [rad or m].
        outcome: where it writes how near the limits the run came.
    """

    robot: Robot
    max_deviation: float = tuning.STOP_DEVIATION
    outcome: Outcome = field(default_factory=Outcome)
    _high: int = 0
    _last_checked: float = -1.0

    def pace(self, late: float, time: float) -> None:
        """Judge how late a command leaves.

        Raises:
            PacingLate: too late.
        """
        self.outcome.largest_lateness = max(self.outcome.largest_lateness, late)
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
        age, outcome = now - sample.arrival, self.outcome
        if age > tuning.STOP_STALE_S:
            raise StateStale(
                f"no joint state for {age:.2f} s (limit {tuning.STOP_STALE_S:g}): stopped at t = {time:.1f} s"
            )
        if sample.arrival == self._last_checked:
            return
        self._last_checked = sample.arrival
        error = np.abs(sample.q - planned)
        worst = int(np.nanargmax(error)) if np.isfinite(error).any() else 0
        outcome.largest_deviation = max(outcome.largest_deviation, float(error[worst]))
        if not error[worst] <= self.max_deviation:
            unit = "rad" if self.robot.joints[worst].revolute else "m"
            raise TrackingLost(
                f"{self.robot.joint_names[worst]} is {error[worst]:.2f} {unit} from where it should be "
                f"(limit {self.max_deviation:g}): stopped at t = {time:.1f} s, log kept"
            )
        share = np.abs(sample.tau) / self.robot.limits("torque")
        worst = int(share.argmax())
        outcome.largest_torque_share = max(outcome.largest_torque_share, float(share[worst]))
        self._high = self._high + 1 if share[worst] > tuning.STOP_TORQUE_SHARE else 0
        if self._high >= tuning.STOP_TORQUE_STATES:
            raise TorqueHigh(
                f"{self.robot.joint_names[worst]} reads {sample.tau[worst]:.1f} N m, {100 * share[worst]:.0f} % of its "
                f"rating (limit {100 * tuning.STOP_TORQUE_SHARE:.0f} %): stopped at t = {time:.1f} s"
            )
