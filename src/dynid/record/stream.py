"""Commands to the arm, one per period, from a thread of its own that is paced by absolute deadlines.

A late period is skipped, never caught up: two commands in one period would queue in the driver and outlive the stream.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from dynid.drivers.command_port import CommandPort
from dynid.drivers.joint_state import Sample
from dynid.record.monitor import Monitor
from dynid.record.playing import ReferenceMotion

#: Periods of standing still that end a motion, so that a velocity stream ends with zero.
LAST = 10


class Stream(threading.Thread):
    """Plays a motion.

    Args:
        port: the driver.
        reference: the motion.
        monitor: judges states and lateness, and stops the motion.
        latest: returns the newest joint state.
        sent: told of every command, as (topic, message).
    """

    def __init__(
        self,
        port: CommandPort,
        reference: ReferenceMotion,
        monitor: Monitor,
        latest: Callable[[], Sample | None],
        sent: Callable[[str, Any], None],
    ) -> None:
        super().__init__(name="stream", daemon=True)
        self.port, self.reference, self.monitor, self.latest, self.sent = port, reference, monitor, latest, sent
        self.failure: BaseException | None = None
        self.commands = 0
        self.skipped = 0
        self.time = 0.0
        self._stop_asked = threading.Event()

    def halt(self, reason: BaseException | None = None) -> None:
        """Stop publishing within a period; the first reason counts."""
        self.failure = self.failure or reason
        self._stop_asked.set()

    def run(self) -> None:
        """Send one command per period until the motion is over or something is wrong."""
        try:
            self._play()
        except BaseException as error:  # noqa: BLE001 - the thread that waits for this one raises it
            self.halt(error)

    def _play(self) -> None:
        period = 1.0 / self.port.rate
        start, message = self.port.begin(self.reference.at, self.reference.duration)
        self._keep(message)
        k = 0
        while not self._stop_asked.is_set() and k * period <= self.reference.duration:
            now = self._wait(start + k * period)
            if self._stop_asked.is_set():
                return
            self.time = k * period
            late = now - start - k * period
            self.monitor.pace(late, self.time)
            self._step(now, start)
            following = max(k + 1, int((time.monotonic() - start) / period))
            self.skipped += following - k - 1
            k = following
        self._rest(start, k, period)

    def _step(self, now: float, start: float) -> None:
        """Judge the newest state, then send the command of this period."""
        sample = self.latest()
        assert sample is not None  # preflight has seen one
        planned = self.reference.at(sample.arrival - start)
        self.monitor.state(sample, planned.q, now, now - start)
        # Why: a driver that plays one command per period is told what that period needs, however late it is; others are
        # told what comes after now.
        target = self.reference.at((self.time if self.port.slotted else now - start) + self.port.lead)
        self._keep(self.port.send(target, sample.q))

    def _rest(self, start: float, k: int, period: float) -> None:
        """End with commands that keep the arm where the motion ends."""
        for extra in range(LAST):
            self._wait(start + (k + extra) * period)
            if self._stop_asked.is_set():
                return
            self._keep(self.port.at_rest(self.reference.motion.q[-1]))
        self.port.finish()

    def _keep(self, message: Any) -> None:  # noqa: ANN401
        if message is None:
            return
        self.commands += 1
        self.sent(self.port.command_topic, message)

    def _wait(self, deadline: float) -> float:
        """Sleep until a deadline, or until asked to stop; return the time."""
        left = deadline - time.monotonic()
        if left > 0:
            # Why: an event's wait is as exact as a sleep and ends at once when somebody presses the key.
            self._stop_asked.wait(left)
        return time.monotonic()
