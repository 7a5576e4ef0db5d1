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
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dynid.drivers.command_port import CommandPort
from dynid.drivers.joint_state import Sample
from dynid.drivers.ros import Node, ping_master
from dynid.errors import CannotWrite, DynidError, MasterSilent
from dynid.record import tuning
from dynid.record.monitor import Monitor
from dynid.record.playing import ReferenceMotion
from dynid.record.recorder import Listener, LogRecorder, Tally

Poll = Callable[[float, Monitor], bool]


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
        poll: called about twenty times a second with the time of the motion; True stops it like the operator's key.
    """
    listener = recorder.listener
    monitor = Monitor(port.robot, max_deviation)
    stream = Stream(port, reference, monitor, lambda: listener.latest, recorder.command)
    guard = MasterMonitor(port.node, stream.halt)
    outcome = Outcome()
    with _signals(lambda: stream.halt(KeyboardInterrupt())):
        stream.start()
        guard.start()
        try:
            _attend(stream, monitor, recorder, poll)
        except BaseException as error:  # noqa: BLE001 - the arm is stopped first
            stream.halt(error)
        stream.join(5 / port.rate + 1.0)
        guard.end()
        outcome.failure = stream.failure
        if outcome.failure is not None:
            _stop(port, listener, outcome)
    outcome.seconds, outcome.commands = stream.time, stream.commands
    outcome.skipped = stream.skipped
    outcome.largest_lateness = monitor.largest_lateness
    outcome.largest_deviation = monitor.largest_deviation
    outcome.largest_torque_share = monitor.largest_torque_share
    if outcome.failure is None:
        time.sleep(tuning.TAIL_S)
    return outcome


def _attend(stream: Stream, monitor: Monitor, recorder: LogRecorder, poll: Poll) -> None:
    """Wait for the end of the motion, looking at the recorder and for the operator's key."""
    while stream.is_alive():
        stream.join(tuning.GLANCE_S)
        if recorder.failure is not None:
            raise disk_error(recorder)
        if poll(stream.time, monitor):
            raise KeyboardInterrupt


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


def listen_only(
    recorder: LogRecorder, seconds: float | None, stale: float, poll: Callable[[float], bool]
) -> Outcome:
    """Record while another program moves the arm, until a stop is requested.

    Args:
        recorder: running.
        seconds: how long; None until the operator's key or Ctrl-C.
        stale: silence after which it ends [s].
        poll: called about twenty times a second; True ends it.
    """
    ended, outcome, begin = threading.Event(), Outcome(), time.monotonic()

    def silence() -> float:
        latest = recorder.listener.latest
        return time.monotonic() - latest.arrival if latest is not None else 0.0

    with _signals(ended.set):
        try:
            while not ended.wait(tuning.GLANCE_S):
                passed = time.monotonic() - begin
                over = seconds is not None and passed >= seconds
                if over or poll(passed) or silence() > stale:
                    break
                if recorder.failure is not None:
                    raise disk_error(recorder)
        except BaseException as error:  # noqa: BLE001 - files are closed by the caller
            outcome.failure = error
    outcome.seconds = time.monotonic() - begin
    if (silence_s := silence()) > stale:
        outcome.notes.append(f"joint states ended {silence_s:.1f} s before the recording")
    return outcome


def disk_error(recorder: LogRecorder) -> CannotWrite:
    """Return the error of the catalogue for a recorder that cannot write."""
    reason = recorder.failure.strerror if recorder.failure else "unknown"
    return CannotWrite(
        f"cannot write {recorder.bag_path}: {reason}; {recorder.written} messages are in it",
        where=recorder.bag_path,
        fix="make room, or record elsewhere with --out",
    )


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
            if float(np.abs(after.q - before.q).max()) < tuning.STILL_AFTER_STOP:
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
        latest: returns the newest joint state.
        sent: called with every command, as (topic, message).
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
        self.port, self.reference, self.monitor = port, reference, monitor
        self.latest, self.sent = latest, sent
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
        # Why: a driver that plays one command per period gets what that period needs, however late it is; others are
        # sent what comes after now.
        when = self.time if self.port.slotted else now - start
        self._keep(self.port.send(self.reference.at(when + self.port.lead), sample.q))

    def _rest(self, start: float, k: int, period: float) -> None:
        """End with commands that keep the arm where the motion ends."""
        for extra in range(tuning.RESTING_COMMANDS):
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


class MasterMonitor(threading.Thread):
    """Asks the master now and then whether it lives.

    Why: connections outlive a dead master, but nothing new can be found or called any more; go no further then.
    """

    def __init__(self, node: Node, halt: Callable[[BaseException], None]) -> None:
        super().__init__(name="master guard", daemon=True)
        self._node, self._halt, self._end = node, halt, threading.Event()

    def end(self) -> None:
        """Stop asking."""
        self._end.set()

    def run(self) -> None:
        """Ask until the end is requested."""
        missed = 0
        while not self._end.wait(tuning.MASTER_INTERVAL_S):
            try:
                ping_master(self._node.uri, tuning.MASTER_PATIENCE_S)
                missed = 0
            except OSError:
                missed += 1
            if missed == 2:
                text = f"the ROS master at {self._node.uri} died while the arm moved: stopped, log kept"
                return self._halt(MasterSilent(text))


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
