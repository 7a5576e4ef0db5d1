"""One recording: files open, arm moving, watched; whatever happens the arm is stopped first and the log is kept."""

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
from dynid.drivers.ros import Node, ping_master
from dynid.errors import CannotWrite, DynidError, MasterSilent
from dynid.record.monitor import Monitor, StopRules
from dynid.record.playing import ReferenceMotion
from dynid.record.recorder import Listener, LogRecorder, Tally
from dynid.record.stream import Stream

#: The recording goes on this long after the last command, so that the end of the motion is in it [s].
TAIL = 0.5
#: How often the main thread looks around [s].
GLANCE = 0.05
#: The master is asked this often whether it lives, with this patience; it has to miss two in a row [s].
ASK, ASK_PATIENCE = 0.5, 0.5
#: A stopped arm stands still within this time [s]: it changes by less than this between two looks [rad or m].
STANDSTILL, STILL = 1.0, 1e-3

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


def play(port: CommandPort, reference: ReferenceMotion, rules: StopRules, recorder: LogRecorder, poll: Poll) -> Outcome:
    """Play a motion and record; the recorder runs already and is closed by the caller.

    Args:
        port: the driver, ready.
        reference: the motion.
        rules: when to stop.
        recorder: running.
        poll: called about twenty times a second with the time of the motion; True stops it like the operator's key.
    """
    listener = recorder.listener
    monitor = Monitor(port.robot, rules)
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
    outcome.seconds, outcome.commands, outcome.skipped = stream.time, stream.commands, stream.skipped
    outcome.largest_lateness, outcome.largest_deviation = monitor.largest_lateness, monitor.largest_deviation
    outcome.largest_torque_share = monitor.largest_torque_share
    if outcome.failure is None:
        time.sleep(TAIL)
    return outcome


def _attend(stream: Stream, monitor: Monitor, recorder: LogRecorder, poll: Poll) -> None:
    """Wait for the end of the motion, looking at the recorder and for the operator's key."""
    while stream.is_alive():
        stream.join(GLANCE)
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
    previous = {number: signal.signal(number, lambda *_: halt()) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def listen_only(recorder: LogRecorder, seconds: float | None, stale: float, poll: Callable[[float], bool]) -> Outcome:
    """Record while another program moves the arm, until told to stop.

    Args:
        recorder: running.
        seconds: how long; None until the operator's key or Ctrl-C.
        stale: silence after which it ends [s].
        poll: called about twenty times a second; True ends it.
    """
    ended = threading.Event()
    outcome = Outcome()
    begin = time.monotonic()
    with _signals(ended.set):
        try:
            _wait_for_end(recorder, ended, seconds, stale, poll)
        except BaseException as error:  # noqa: BLE001 - files are closed by the caller
            outcome.failure = error
    outcome.seconds = time.monotonic() - begin
    latest = recorder.listener.latest
    if latest is not None and time.monotonic() - latest.arrival > stale:
        outcome.notes.append(f"joint states ended {time.monotonic() - latest.arrival:.1f} s before the recording")
    return outcome


def _wait_for_end(
    recorder: LogRecorder, ended: threading.Event, seconds: float | None, stale: float, poll: Callable[[float], bool]
) -> None:
    """Wait until told to end, the time is over, or nothing comes any more."""
    begin = time.monotonic()
    while not ended.wait(GLANCE):
        now = time.monotonic()
        latest = recorder.listener.latest
        if (seconds is not None and now - begin >= seconds) or poll(now - begin):
            return
        if recorder.failure is not None:
            raise disk_error(recorder)
        if latest is not None and now - latest.arrival > stale:
            return


def disk_error(recorder: LogRecorder) -> CannotWrite:
    """Return the error of the catalogue for a recorder that cannot write."""
    reason = recorder.failure.strerror if recorder.failure else "unknown"
    return CannotWrite(
        f"cannot write {recorder.bag_path}: {reason}; {recorder.written} messages are in it",
        where=str(recorder.bag_path), fix="make room, or record elsewhere with --out",
    )  # fmt: skip


def _stop(port: CommandPort, listener: Listener, outcome: Outcome) -> None:
    """Stop the arm and see whether it stands still."""
    try:
        outcome.stop = port.stop()
    except DynidError as error:
        outcome.stop_failure = error.what
    except Exception as error:  # noqa: BLE001 - a stop that failed in an unknown way must still be told
        outcome.stop_failure = f"{type(error).__name__}: {error}"
    outcome.still = _stands_still(listener)


def _stands_still(listener: Listener) -> bool | None:
    """Return whether the arm stopped; None when no joint states come."""
    end = time.monotonic() + STANDSTILL
    before = listener.latest
    while time.monotonic() < end:
        time.sleep(2 * GLANCE)
        after = listener.latest
        if before is not None and after is not None and after.arrival > before.arrival:
            if float(np.abs(after.q - before.q).max()) < STILL:
                return True
            before = after
    fresh = before is not None and time.monotonic() - before.arrival < STANDSTILL / 2
    return False if fresh else None


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
        """Ask until told to end."""
        missed = 0
        while not self._end.wait(ASK):
            try:
                ping_master(self._node.uri, ASK_PATIENCE)
                missed = 0
            except OSError:
                missed += 1
            if missed == 2:
                self._halt(
                    MasterSilent(f"the ROS master at {self._node.uri} died while the arm moved: stopped, log kept")
                )
                return


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
