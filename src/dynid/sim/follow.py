"""What an arm's own controller makes of commands: a smooth reference, one step of the physics at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from dynid.sim import tuning

Floats = NDArray[np.float64]
T = TypeVar("T")


class Follower(ABC, Generic[T]):
    """Turns received commands into the reference of the joint controllers.

    Commands wait in a queue and are taken one per period of 10 ms, in whatever rhythm they came. One that is late is
    bridged, and when it comes one of those that wait is dropped, so that the arm does not fall behind for good.

    A critically damped second-order filter stands for the firmware's smoothing: it follows ramps without lag and turns
    the steps of the commands into accelerations that drives can give.

    Args:
        q: where the arm stands, (n,) [rad or m].
        dt: step of the physics [s].
        frequency: of the smoothing [Hz].

    Attributes:
        goal: where the commands have led, (n,).
        speed: its velocity, (n,).
        fastest: largest speed of the reference, (n,).
        hardest: largest acceleration of the reference while it followed commands, (n,).
        hardest_stop: ... while it braked after a stop, (n,).
    """

    def __init__(
        self, q: Floats, dt: float, frequency: float = tuning.SMOOTHING_FREQUENCY_HZ
    ) -> None:
        self.dt = dt
        self.goal, self.speed = q.copy(), np.zeros_like(q)
        self.stopped = False
        self.longest = 0
        self._q, self._qd = q.copy(), np.zeros_like(q)
        self._omega = 2 * np.pi * frequency
        self._queue: deque[T] = deque(maxlen=tuning.QUEUE_LENGTH)
        self._every = max(1, round(tuning.COMMAND_PERIOD_S / dt))
        self._count = 0
        self._bridged = 0
        self._braking = 0
        self.fastest, self.hardest, self.hardest_stop = (np.zeros_like(q) for _ in range(3))

    @abstractmethod
    def take(self, command: T) -> None:
        """Obey a command from now on."""

    @abstractmethod
    def bridge(self, periods: int) -> None:
        """Do without a command for so many periods already."""

    @abstractmethod
    def move(self) -> None:
        """Move ``goal`` and ``speed`` on by one step."""

    def push(self, command: T) -> None:
        """Receive a command; a stopped arm ignores it."""
        if not self.stopped:
            self._queue.append(command)
            self.longest = max(self.longest, len(self._queue))

    def stop(self) -> None:
        """Erase the queue, brake, and ignore commands until started."""
        self.stopped = True
        self.hold()

    def hold(self) -> None:
        """Erase the queue and stay here."""
        self._queue.clear()
        self._bridged = 0
        self._braking = round(tuning.BRAKING_S / self.dt)
        self.speed = np.zeros_like(self.goal)

    def start(self) -> None:
        """Listen again."""
        self.stopped = False

    def step(self) -> tuple[Floats, Floats, Floats]:
        """Return the reference of this step: position, velocity, acceleration, (n,) each [rad, rad/s, rad/s^2]."""
        if self._count % self._every == 0:
            self._next()
        self._count += 1
        if not self.stopped:
            self.move()
        acceleration = self._omega**2 * (self.goal - self._q) + 2 * self._omega * (
            self.speed - self._qd
        )
        found = self._q.copy(), self._qd.copy(), acceleration
        self._note(acceleration)
        self._qd = self._qd + self.dt * acceleration
        self._q = self._q + self.dt * self._qd
        return found

    def _note(self, acceleration: Floats) -> None:
        """Remember the extremes of the reference."""
        np.maximum(self.fastest, np.abs(self._qd), out=self.fastest)
        kept = self.hardest_stop if self._braking else self.hardest
        np.maximum(kept, np.abs(acceleration), out=kept)
        self._braking = max(0, self._braking - 1)

    def _next(self) -> None:
        if not self._queue:
            self._bridged += 1
            self.bridge(self._bridged)
            return
        while self._bridged > 0 and len(self._queue) > 1:
            self._queue.popleft()
            self._bridged -= 1
        self.take(self._queue.popleft())


class VelocityFollower(Follower[Floats]):
    """Kinova's firmware: velocities [rad/s], one every 10 ms from a queue of 2000.

    Faster publishing fills the queue, and the arm moves on after the stream has ended.
    """

    def __init__(
        self, q: Floats, dt: float, frequency: float = tuning.SMOOTHING_FREQUENCY_HZ
    ) -> None:
        super().__init__(q, dt, frequency)
        self._wanted = np.zeros_like(q)

    def take(self, command: Floats) -> None:
        """Go over to a velocity, (n,) [rad/s], within the period.

        Why: a step at each period would be an acceleration at 100 Hz, which samples at 100 Hz always catch at its peak.
        """
        self._wanted = command

    def hold(self) -> None:
        """Erase the queue and stay here."""
        super().hold()
        self._wanted = np.zeros_like(self.goal)

    def bridge(self, periods: int) -> None:
        """Keep the velocity for a short while, then stop: silence is the usual end of a motion."""
        if periods > tuning.VELOCITY_HELD_PERIODS:
            self._wanted = np.zeros_like(self.goal)
            self._bridged = 0

    def move(self) -> None:
        """Go over to the wanted velocity, and integrate it."""
        left = self._every - (self._count - 1) % self._every
        self.speed = self.speed + (self._wanted - self.speed) / left
        self.goal = self.goal + self.dt * self.speed


class PointFollower(Follower[tuple[Floats, Floats, float]]):
    """A joint_trajectory_controller: a cubic from where it is to a point, or through all points of a trajectory.

    It has no queue: a new point replaces the last one at once.
    """

    def __init__(
        self, q: Floats, dt: float, frequency: float = tuning.SMOOTHING_FREQUENCY_HZ
    ) -> None:
        super().__init__(q, dt, frequency)
        self._from = self._to = (q.copy(), np.zeros_like(q))
        self._length = self._elapsed = dt
        self._path: deque[tuple[Floats, Floats, float]] = deque()
        self._newest: tuple[Floats, Floats, float] | None = None

    def push(self, command: tuple[Floats, Floats, float]) -> None:
        """Receive a point: position and velocity, (n,) each [rad, rad/s], and time [s]; a stopped arm ignores it."""
        if not self.stopped:
            self._newest = command

    @property
    def following(self) -> bool:
        """Whether it is on its way through a trajectory."""
        return bool(self._path) or self._elapsed < self._length

    def take(self, command: tuple[Floats, Floats, float]) -> None:
        """Go to a position with a velocity, (n,) each [rad, rad/s], within a time [s]."""
        q, qd, after = command
        self._path.clear()
        self._from, self._to = (self.goal.copy(), self.speed.copy()), (q, qd)
        self._length, self._elapsed = max(after, self.dt), 0.0

    def play(self, points: Iterable[tuple[Floats, Floats, float]]) -> None:
        """Go through points, each with its velocity, (n,) each [rad, rad/s], and its time from now [s]."""
        if self.stopped:
            return
        begin, path = 0.0, []
        for q, qd, when in points:
            path.append((q, qd, when - begin))
            begin = when
        self._queue.clear()
        self.take(path[0])
        self._path.extend(path[1:])

    def bridge(self, periods: int) -> None:
        """Go on to the last point and stay there."""

    def hold(self) -> None:
        """Erase the queue and stay here."""
        super().hold()
        self._newest = None
        self._path.clear()
        self._from = self._to = (self.goal.copy(), np.zeros_like(self.goal))
        self._elapsed = self._length

    def move(self) -> None:
        """Go on along the cubics; hold at their end."""
        newest, self._newest = self._newest, None
        if newest is not None:
            self.take(newest)
        self._elapsed += self.dt
        while self._path and self._elapsed >= self._length:
            self._elapsed -= self._length
            q, qd, self._length = self._path.popleft()
            self._from, self._to = self._to, (q, qd)
        self._elapsed = min(self._elapsed, self._length)
        s, h = self._elapsed / self._length, self._length
        (a, u), (b, v) = self._from, self._to
        if s >= 1.0:
            self.goal, self.speed = b.copy(), np.zeros_like(b)
            return
        self.goal = (
            (1 + 2 * s) * (1 - s) ** 2 * a
            + s**2 * (3 - 2 * s) * b
            + h * s * (1 - s) * ((1 - s) * u - s * v)
        )
        self.speed = 6 * s * (1 - s) * (b - a) / h + (1 - s) * (1 - 3 * s) * u + s * (3 * s - 2) * v
