"""What an arm's own controller makes of commands: a smooth reference, one step of the physics at a time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from dynid.arrays import Floats
from dynid.sim import tuning

#: Position and velocity, (n,) each [rad or m, and per s], and time from now [s].
Point = tuple[Floats, Floats, float]


class Follower(ABC):
    """Turns received commands into the reference of the joint controllers.

    A critically damped second-order filter stands for the firmware's smoothing: it follows ramps without lag and turns
    the steps of the commands into accelerations that drives can give.

    Args:
        q: where the arm stands, (n,) [rad or m].
        dt: step of the physics [s].

    Attributes:
        goal: where the commands have led, (n,).
        speed: its velocity, (n,).
        stopped: whether commands are ignored.
    """

    def __init__(self, q: Floats, dt: float) -> None:
        self.dt, self.stopped = dt, False
        self.goal, self.speed = q.copy(), np.zeros_like(q)
        self._q, self._qd = q.copy(), np.zeros_like(q)

    @abstractmethod
    def move(self) -> None:
        """Move ``goal`` and ``speed`` on by one step."""

    def hold(self) -> None:
        """Forget all commands and stay here."""
        self.speed = np.zeros_like(self.goal)

    def stop(self) -> None:
        """Brake, and ignore commands until started."""
        self.stopped = True
        self.hold()

    def start(self) -> None:
        """Listen again."""
        self.stopped = False

    def step(self) -> tuple[Floats, Floats, Floats]:
        """Return the reference of this step: position, velocity, acceleration, (n,) each [rad, rad/s, rad/s^2]."""
        if not self.stopped:
            self.move()
        omega = 2 * np.pi * tuning.SMOOTHING_FREQUENCY_HZ
        acceleration = omega**2 * (self.goal - self._q) + 2 * omega * (self.speed - self._qd)
        state = self._q, self._qd, acceleration
        self._qd = self._qd + self.dt * acceleration
        self._q = self._q + self.dt * self._qd
        return state


class VelocityFollower(Follower):
    """Kinova's firmware: velocities [rad/s], one every 10 ms from a queue of 2000, in whatever rhythm they came.

    One that is late is bridged, and when it comes one of those that wait is dropped, so that the arm does not fall
    behind for good. Faster publishing fills the queue, and the arm moves on after the stream has ended.
    """

    def __init__(self, q: Floats, dt: float) -> None:
        super().__init__(q, dt)
        self._queue: deque[Floats] = deque(maxlen=tuning.QUEUE_LENGTH)
        self._every = max(1, round(tuning.COMMAND_PERIOD_S / dt))
        self._count = self._bridged = 0
        self._wanted = np.zeros_like(q)

    def push(self, command: Floats) -> None:
        """Receive a velocity, (n,) [rad/s]; a stopped arm ignores it."""
        if not self.stopped:
            self._queue.append(command)

    def hold(self) -> None:
        """Erase the queue and stay here."""
        super().hold()
        self._queue.clear()
        self._bridged = 0
        self._wanted = np.zeros_like(self.goal)

    def move(self) -> None:
        """Go over to the wanted velocity within the period, and integrate it.

        Why: a step at each period would be an acceleration at 100 Hz, which samples at 100 Hz always catch at its peak.
        """
        phase = self._count % self._every
        if phase == 0:
            self._next()
        self._count += 1
        self.speed = self.speed + (self._wanted - self.speed) / (self._every - phase)
        self.goal = self.goal + self.dt * self.speed

    def _next(self) -> None:
        """Take the next velocity; without one keep the last for a short while: silence is the usual end of a motion."""
        if not self._queue:
            self._bridged += 1
            if self._bridged > tuning.VELOCITY_HELD_PERIODS:
                self._wanted = np.zeros_like(self.goal)
                self._bridged = 0
            return
        while self._bridged > 0 and len(self._queue) > 1:
            self._queue.popleft()
            self._bridged -= 1
        self._wanted = self._queue.popleft()


class PointFollower(Follower):
    """A joint_trajectory_controller: cubics from where it is through the points of a trajectory, or to a single one.

    It has no queue: new points replace the last ones at once.
    """

    def __init__(self, q: Floats, dt: float) -> None:
        super().__init__(q, dt)
        self._path: CubicHermiteSpline | None = None
        self._elapsed = 0.0
        self._newest: Sequence[Point] = ()

    @property
    def following(self) -> bool:
        """Whether it is on its way through a trajectory."""
        return bool(self._newest) or self._path is not None

    def push(self, command: Point) -> None:
        """Receive a point; a stopped arm ignores it."""
        self.play([command])

    def play(self, points: Sequence[Point]) -> None:
        """Go through points; a stopped arm ignores them."""
        if not self.stopped:
            self._newest = points

    def hold(self) -> None:
        """Forget the points and stay here."""
        super().hold()
        self._newest, self._path = (), None

    def move(self) -> None:
        """Go on along the cubics; hold at their end."""
        # Why at the next step: points come in threads of their own.
        newest, self._newest = self._newest, ()
        if newest:
            q, qd, times = zip(*newest, strict=True)
            later = np.maximum(times, self.dt * np.arange(1, len(times) + 1))
            places, speeds = (self.goal, *q), (self.speed, *qd)
            self._path, self._elapsed = CubicHermiteSpline([0.0, *later], places, speeds), 0.0
        if self._path is None:
            return
        self._elapsed = min(self._elapsed + self.dt, self._path.x[-1])
        self.goal, self.speed = self._path(self._elapsed), self._path(self._elapsed, 1)
        if self._elapsed == self._path.x[-1]:
            self.speed, self._path = np.zeros_like(self.goal), None
