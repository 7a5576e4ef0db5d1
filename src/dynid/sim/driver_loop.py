"""A simulated arm behind a driver: physics in real time, imperfect sensors, commands through a follower."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynid.arrays import Floats
from dynid.sim import tuning
from dynid.sim.arm import SimulatedArm
from dynid.sim.follow import Follower
from dynid.sim.options import SimDriverOptions
from dynid.sim.plant import Sensors, stepped


def step_of(rate: float) -> float:
    """Return a step of the physics [s] that divides the time between two samples at a rate [Hz]."""
    return 1 / rate / math.ceil(1 / rate / tuning.LONGEST_STEP_S - 1e-9)


@dataclass
class Measured:
    """One sample of the simulated arm as its driver would publish it, in DH quantities.

    Attributes:
        elapsed: time of the sample since the start [s].
        q: (n,).
        qd: (n,).
        tau: (n,).
    """

    elapsed: float
    q: Floats
    qd: Floats
    tau: Floats


class DriverLoop:
    """The simulation, advanced to the present again and again.

    Args:
        arm: the physics; it is placed where its controller holds it.
        follower: the arm's controller.
        sensors: noise and resolution.
        options: rate, and what else measuring and sending add to the truth.
        rng: source of all noise.

    Attributes:
        published: number of samples that were sent.
        dropped: number of those that were lost on purpose.
        largest_delay: how far the simulation fell behind real time at worst [s].
    """

    def __init__(
        self,
        arm: SimulatedArm,
        follower: Follower,
        sensors: Sensors,
        options: SimDriverOptions,
        rng: np.random.Generator,
    ) -> None:
        self.arm, self.robot, self.follower = arm, arm.robot, follower
        self.sensors, self.options, self.rng = sensors, options, rng
        self.published, self.dropped, self.largest_delay = 0, 0, 0.0
        self._steps = 0
        self.every = max(1, round(1 / (options.rate * arm.dt)))
        self._skew = min(round(options.skew / arm.dt), self.every - 1)
        self._polled = (0.0, follower.goal)
        arm.reset(follower.goal)
        self._true = self._zero = np.zeros(self.robot.n)
        self._rating = self.robot.limits("torque")
        self._waiting: list[tuple[float, Measured]] = []

    @property
    def now(self) -> float:
        """Simulated time [s]."""
        return self._steps * self.arm.dt

    def facts(self) -> dict[str, float]:
        """Return what was sent, for JSON."""
        return {
            "published": self.published,
            "dropped": self.dropped,
            "largest_delay_s": self.largest_delay,
        }

    def zero_torques(self) -> None:
        """Make the sensors read zero where the arm stands."""
        self._zero = self._true + self.options.torque_offset

    def run(self, publish: Callable[[Measured], None], alive: Callable[[], bool]) -> None:
        """Simulate in real time until the end is requested; a late machine is caught up with, never skipped."""
        begin = time.monotonic()
        while alive():
            present = time.monotonic() - begin
            self.largest_delay = max(self.largest_delay, present - self.now)
            while self.now < present:
                self._step()
                if self._steps % tuning.STEPS_AT_ONCE == 0 and self.now < present:
                    # Why: commands that came while this machine was busy are to be read before time goes on.
                    time.sleep(tuning.LATE_PAUSE_S)
            self._send(present, publish)
            time.sleep(max(0.0, min(begin + self.now + self.arm.dt - time.monotonic(), 1e-3)))

    def _step(self) -> None:
        q, qd = self.arm.state()
        wanted = self.arm.computed_torque(self.follower.step())
        tau = np.clip(wanted, -self._rating, self._rating)
        if self._steps % self.every == 0:
            self._polled = (self.now, q)
        if self._steps % self.every == self._skew:
            self._sample(*self._polled, qd, tau)
        self.arm.step(tau)
        self._steps += 1

    def _sample(self, elapsed: float, q: Floats, qd: Floats, tau: Floats) -> None:
        """Measure and put the sample on its way."""
        sensors, options = self.sensors, self.options
        if self.rng.random() < options.drop:
            self.dropped += 1
            return
        self._true = tau
        reading = tau + options.torque_offset - self._zero
        reading = reading + self.rng.normal(0.0, sensors.torque_noise)
        delay = options.latency + abs(self.rng.normal(0.0, options.jitter))
        due = max(self.now + delay, self._waiting[-1][0] if self._waiting else 0.0)
        speed = qd + self.rng.normal(0.0, sensors.velocity_noise or 0.0, len(qd))
        q, reading = stepped(q, sensors.position_step), stepped(reading, options.torque_step)
        self._waiting.append((due, Measured(elapsed, q, speed, reading)))

    def _send(self, present: float, publish: Callable[[Measured], None]) -> None:
        while self._waiting and self._waiting[0][0] <= present:
            _, measured = self._waiting.pop(0)
            publish(measured)
            self.published += 1
