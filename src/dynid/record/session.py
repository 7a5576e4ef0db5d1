"""One recording: files open, arm moving, watched; whatever happens the arm is stopped first and the log is kept.

Commands leave from a thread of its own, one a period, paced by absolute deadlines. A late period is skipped, never
caught up: two commands in one period would queue in the driver and outlive the stream.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from dynid.drivers.command_port import CommandPort
from dynid.drivers.ros import Node, ping_master
from dynid.errors import DynidError, MasterSilent
from dynid.record import tuning
from dynid.record.monitor import Monitor, Outcome
from dynid.record.playing import ReferenceMotion
from dynid.record.recorder import Listener, LogRecorder

#: Called about twenty times a second with what has come of the recording so far; True ends it.
Poll = Callable[[Outcome], bool]


def play(
    port: CommandPort,
    reference: ReferenceMotion,
    max_deviation: float,
    recorder: LogRecorder,
    poll: Poll,
) -> Outcome:
    """Play a motion and record; the recorder runs already and is closed by the caller.

    Args:
        port: the driver, ready.
        reference: the motion.
        max_deviation: distance from the plan at which it stops [rad or m].
        recorder: running.
        poll: True stops the motion like the operator's key.
    """
    listener, outcome, over = recorder.listener, Outcome(), threading.Event()
    monitor = Monitor(port.robot, max_deviation, outcome)
    stream = Stream(port, reference, monitor, recorder)
    words = (port.node, over, stream.halt)
    guard = threading.Thread(target=_watch_master, args=words, name="master guard", daemon=True)
    with _signals(lambda: stream.halt(KeyboardInterrupt())):
        stream.start()
        guard.start()
        try:
            while stream.is_alive() and outcome.failure is None:
                stream.join(tuning.GLANCE_S)
                if recorder.failure is not None:
                    stream.halt(recorder.failure)
                elif poll(outcome):
                    stream.halt(KeyboardInterrupt())
        except BaseException as error:  # noqa: BLE001 - the arm is stopped first
            stream.halt(error)
        stream.join(5 / port.rate + 1.0)
        over.set()
        if outcome.failure is not None:
            _stop(port, listener, outcome)
    if outcome.failure is None:
        time.sleep(tuning.TAIL_S)
    return outcome


@contextmanager
def _signals(halt: Callable[[], None]) -> Iterator[None]:
    """Let SIGINT and SIGTERM end the stream instead of raising somewhere.

    Why: a second Ctrl-C must not interrupt the call of the stop service.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    previous = {number: signal.signal(number, lambda *_: halt()) for number in numbers}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def listen_only(recorder: LogRecorder, seconds: float | None, stale: float, poll: Poll) -> Outcome:
    """Record while another program moves the arm, until a stop is requested.

    Args:
        recorder: running.
        seconds: how long; None until the operator's key or Ctrl-C.
        stale: silence after which it ends [s].
        poll: True ends it.
    """
    ended, outcome, begin = threading.Event(), Outcome(), time.monotonic()

    def silence() -> float:
        latest = recorder.listener.latest
        return time.monotonic() - latest.arrival if latest is not None else 0.0

    with _signals(ended.set):
        try:
            while not ended.wait(tuning.GLANCE_S):
                outcome.seconds = time.monotonic() - begin
                over = seconds is not None and outcome.seconds >= seconds
                if over or poll(outcome) or silence() > stale:
                    break
                if recorder.failure is not None:
                    outcome.failure = recorder.failure
                    break
        except BaseException as error:  # noqa: BLE001 - files are closed by the caller
            outcome.failure = error
    outcome.seconds = time.monotonic() - begin
    if (silence_s := silence()) > stale:
        outcome.notes.append(f"joint states ended {silence_s:.1f} s before the recording")
    return outcome


def _stop(port: CommandPort, listener: Listener, outcome: Outcome) -> None:
    """Stop the arm and see whether it stands still."""
    try:
        outcome.stop = port.stop()
    except DynidError as error:
        outcome.stop_failure = error.what
    except Exception as error:  # noqa: BLE001 - a stop that failed in an unknown way must still be reported
        outcome.stop_failure = f"{type(error).__name__}: {error}"
    outcome.still = _stands_still(listener)


def _stands_still(listener: Listener) -> bool | None:
    """Return whether the arm stopped; None when no joint states come."""
    end = time.monotonic() + tuning.STANDSTILL_S
    before = listener.latest
    while time.monotonic() < end:
        time.sleep(2 * tuning.GLANCE_S)
        after = listener.latest
        if before is not None and after is not None and after.arrival > before.arrival:
            if np.abs(after.q - before.q).max() < tuning.STILL_AFTER_STOP:
                return True
            before = after
    still_heard = before is not None and time.monotonic() - before.arrival < tuning.STANDSTILL_S / 2
    return False if still_heard else None


class Stream(threading.Thread):
    """Plays a motion.

    Args:
        port: the driver.
        reference: the motion.
        monitor: checks states and lateness, and stops the motion.
        recorder: hears the joint states, and keeps every command.
    """

    def __init__(
        self,
        port: CommandPort,
        reference: ReferenceMotion,
        monitor: Monitor,
        recorder: LogRecorder,
    ) -> None:
        super().__init__(name="stream", daemon=True)
        self.port, self.reference, self.monitor = port, reference, monitor
        self.recorder, self.outcome = recorder, monitor.outcome
        self._stop_asked = threading.Event()

    def halt(self, reason: BaseException) -> None:
        """Stop publishing within a period; the first reason counts."""
        self.outcome.failure = self.outcome.failure or reason
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
        while k * period <= self.reference.duration:
            if self._stopped_before(start + k * period):
                return
            now = time.monotonic()
            self.outcome.seconds = k * period
            self.monitor.pace(now - start - k * period, k * period)
            self._step(now, start)
            following = max(k + 1, int((time.monotonic() - start) / period))
            self.outcome.skipped += following - k - 1
            k = following
        self._rest(start, k, period)

    def _step(self, now: float, start: float) -> None:
        """Judge the newest state, then send the command of this period."""
        sample = self.recorder.listener.latest
        assert sample is not None  # preflight has seen one
        planned = self.reference.at(sample.arrival - start)
        self.monitor.state(sample, planned.q, now, now - start)
        # Why: a driver that plays one command per period gets what that period needs, however late it is; others are
        # sent what comes after now.
        when = self.outcome.seconds if self.port.slotted else now - start
        self._keep(self.port.send(self.reference.at(when + self.port.lead), sample.q))

    def _rest(self, start: float, k: int, period: float) -> None:
        """End with commands that keep the arm where the motion ends."""
        for extra in range(tuning.RESTING_COMMANDS):
            if self._stopped_before(start + (k + extra) * period):
                return
            self._keep(self.port.at_rest(self.reference.motion.q[-1]))
        self.port.finish()

    def _keep(self, message: Any) -> None:  # noqa: ANN401
        if message is not None:
            self.outcome.commands += 1
            self.recorder.command(self.port.command_topic, message)

    def _stopped_before(self, deadline: float) -> bool:
        """Wait until a deadline, or until asked to stop; return whether that was so."""
        # Why: an event's wait is as exact as a sleep and ends at once when somebody presses the key.
        return self._stop_asked.wait(deadline - time.monotonic())


def _watch_master(node: Node, over: threading.Event, halt: Callable[[BaseException], None]) -> None:
    """Ask the master now and then whether it lives, until it is over.

    Why: connections outlive a dead master, but nothing new can be found or called any more; go no further then.
    """
    missed = 0
    while missed < 2:
        if over.wait(tuning.MASTER_INTERVAL_S):
            return
        try:
            ping_master(node.uri, tuning.MASTER_PATIENCE_S)
            missed = 0
        except OSError:
            missed += 1
    halt(MasterSilent(f"the ROS master at {node.uri} died while the arm moved: stopped, log kept"))


def facts(outcome: Outcome) -> dict[str, Any]:
    """Return an outcome as plain facts with units in their names."""
    return {
        "verdict": outcome.verdict,
        "seconds": round(outcome.seconds, 3),
        "messages": outcome.tally.messages,
        "lost": outcome.tally.lost,
        "rate_hz": round(outcome.tally.rate, 2),
        "longest_gap_s": round(outcome.tally.longest_gap, 4),
        "commands": outcome.commands,
        "skipped_periods": outcome.skipped,
        "largest_lateness_s": round(outcome.largest_lateness, 4),
        "largest_deviation_rad": round(outcome.largest_deviation, 5),
        "largest_torque_share": round(outcome.largest_torque_share, 4),
        "stop": outcome.stop or None,
        "stop_failure": outcome.stop_failure or None,
        "stands_still": outcome.still,
        "notes": outcome.notes,
    }
