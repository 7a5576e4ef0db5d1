"""What an arm's own controller makes of commands: a smooth reference, one step of the physics at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Follower(ABC):
    """Turns received commands into the reference of the joint controllers.

    A critically damped second-order filter stands for the firmware's smoothing: it follows ramps without lag and turns
    the steps of the commands into accelerations that drives can give.

    Args:
        q: where the arm stands, (n,) [rad or m].
        dt: step of the physics [s].
        frequency: of the smoothing [Hz].
    """

    def __init__(self, q: Floats, dt: float, frequency: float) -> None:
        self.dt = dt
        self.goal, self.speed = q.copy(), np.zeros_like(q)
        self._q, self._qd = q.copy(), np.zeros_like(q)
        self._omega = 2 * np.pi * frequency
        self.stopped = False

    @abstractmethod
    def command(self) -> None:
        """Move ``goal`` and ``speed`` on by one step."""

    @abstractmethod
    def forget(self) -> None:
        """Drop commands that wait."""

    def stop(self) -> None:
        """Brake, and ignore commands until started."""
        self.stopped = True
        self.forget()
        self.speed = np.zeros_like(self.goal)

    def start(self) -> None:
        """Listen again."""
        self.stopped = False

    def step(self) -> tuple[Floats, Floats, Floats]:
        """Return the reference of this step: position, velocity, acceleration, (n,) each."""
        if not self.stopped:
            self.command()
        acceleration = self._omega**2 * (self.goal - self._q) + 2 * self._omega * (self.speed - self._qd)
        found = self._q.copy(), self._qd.copy(), acceleration
        self._qd = self._qd + self.dt * acceleration
        self._q = self._q + self.dt * self._qd
        return found


class VelocityQueue(Follower):
    """Kinova's firmware: one velocity every 10 ms from a queue of 2000, in whatever rhythm they came.

    Faster publishing fills the queue, and the arm moves on after the stream has ended. A message that is a little late
    is bridged by the last one, and played or dropped when it comes, so that the way is the same.
    """

    PERIOD = 0.01
    LENGTH = 2000
    #: Periods that the last velocity is held when no message came.
    PATIENCE = 5

    def __init__(self, q: Floats, dt: float, frequency: float = 5.0) -> None:
        super().__init__(q, dt, frequency)
        self.queue: deque[Floats] = deque(maxlen=self.LENGTH)
        self.longest = 0
        self._bridged = 0
        self._every = max(1, round(self.PERIOD / dt))
        self._count = 0

    def push(self, velocity: Floats) -> None:
        """Take a velocity, (n,) [rad/s]."""
        if not self.stopped:
            self.queue.append(velocity)
            self.longest = max(self.longest, len(self.queue))

    def forget(self) -> None:
        """Erase the queue."""
        self.queue.clear()
        self._bridged = 0

    def command(self) -> None:
        """Take the next velocity when its period begins."""
        if self._count % self._every == 0:
            self._next()
        self._count += 1
        self.goal = self.goal + self.dt * self.speed

    def _next(self) -> None:
        if not self.queue:
            self._bridged += 1
            if self._bridged > self.PATIENCE:
                self.speed = np.zeros_like(self.goal)
            return
        while self._bridged > 0 and len(self.queue) > 1:
            self.queue.popleft()
            self._bridged -= 1
        if self._bridged > self.PATIENCE:
            self._bridged = 0
        self.speed = self.queue.popleft()


class PointFollower(Follower):
    """A joint_trajectory_controller that is given one point at a time: a cubic from where it is to that point."""

    def __init__(self, q: Floats, dt: float, frequency: float = 15.0) -> None:
        super().__init__(q, dt, frequency)
        self._from = (q.copy(), np.zeros_like(q))
        self._to = (q.copy(), np.zeros_like(q))
        self._length, self._elapsed = dt, dt

    def push(self, q: Floats, qd: Floats, after: float) -> None:
        """Take a point to reach after so many seconds, (n,) each."""
        if not self.stopped:
            self._from = (self.goal.copy(), self.speed.copy())
            self._to, self._length, self._elapsed = (q, qd), max(after, self.dt), 0.0

    def forget(self) -> None:
        """Hold where it is."""
        self._to = self._from = (self.goal.copy(), np.zeros_like(self.goal))
        self._elapsed = self._length

    def command(self) -> None:
        """Go on along the cubic; hold at its end."""
        self._elapsed = min(self._elapsed + self.dt, self._length)
        s, h = self._elapsed / self._length, self._length
        (a, u), (b, v) = self._from, self._to
        if s >= 1.0:
            self.goal, self.speed = b.copy(), np.zeros_like(b)
            return
        self.goal = (1 + 2 * s) * (1 - s) ** 2 * a + s**2 * (3 - 2 * s) * b + h * s * (1 - s) * ((1 - s) * u - s * v)
        self.speed = 6 * s * (1 - s) * (b - a) / h + (1 - s) * (1 - 3 * s) * u + s * (3 * s - 2) * v
