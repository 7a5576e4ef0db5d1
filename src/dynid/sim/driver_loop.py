"""A simulated arm behind a driver: physics in real time, sensors with their faults, commands through a follower.

``CommandLog`` is the check at the receiving end: what was sent, and whether it kept the arm's limits.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.files.artifact import write_text
from dynid.robot import Robot
from dynid.sim import tuning
from dynid.sim.arm import ComputedTorque, SimulatedArm
from dynid.sim.follow import Follower
from dynid.text import csv_row

Floats = NDArray[np.float64]

#: What can be made to go wrong, and when it is noticed on a real arm.
FAULTS = {
    "dies": "the driver's process ends",
    "silent": "joint states stop coming, commands are still obeyed",
    "deaf": "commands are ignored, as after a software stop elsewhere",
    "torque": "a joint reads almost its rating",
    "gives-up": "the controller aborts the goal of its action",
    "stop-fails": "the stop service answers with an error, the cancel is ignored",
    "no-stop": "there is no stop service or topic from the beginning",
    "gravity-free": "torques lack gravity, as with the driver's parameter or the estimated external torque",
}


def step_of(rate: float) -> float:
    """Return a step of the physics [s] that divides the time between two samples at a rate [Hz]."""
    return 1 / rate / math.ceil(1 / rate / tuning.LONGEST_STEP_S - 1e-9)


@dataclass(frozen=True)
class Imperfections:
    """What measuring and sending add to the truth.

    Attributes:
        torque_noise: standard deviation, (n,) [N m or N].
        torque_step: resolution of the torques [N m]; 0 for none.
        torque_offset: sensor offset, zeroed by the driver's service, (n,) [N m].
        position_step: resolution of the encoders [rad or m]; 0 for none.
        velocity_noise: standard deviation of the reported velocity [rad/s].
        latency: from sampling to publishing [s].
        jitter: standard deviation added to it, never early [s].
        drop: share of messages that are lost.
        skew: torque and velocity are sampled so much later than the position with its stamp [s].
        fault: a key of ``FAULTS``, or "".
        fault_time: when it begins, after the first command [s].
    """

    torque_noise: tuple[float, ...]
    torque_step: float = 0.0
    torque_offset: tuple[float, ...] = ()
    position_step: float = 0.0
    velocity_noise: float = 0.0
    latency: float = 0.0
    jitter: float = 0.0
    drop: float = 0.0
    skew: float = 0.0
    fault: str = ""
    fault_time: float = 0.0


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


@dataclass
class DriverLoop:
    """The simulation, advanced to the present again and again.

    Args:
        arm: the physics.
        follower: the arm's controller.
        rate: of the joint states [Hz].
        imperfections: of sensors and network.
        rng: source of all noise.
    """

    arm: SimulatedArm
    follower: Follower[Any]
    rate: float
    imperfections: Imperfections
    rng: np.random.Generator
    published: int = 0
    dropped: int = 0
    first_command: float | None = None
    largest_delay: float = 0.0
    _steps: int = 0
    _zero: Floats = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        """Place the arm where its controller holds it."""
        self.robot: Robot = self.arm.robot
        n = self.robot.n
        self.every = max(1, round(1 / (self.rate * self.arm.dt)))
        self._skew = min(round(self.imperfections.skew / self.arm.dt), self.every - 1)
        self._polled = (0.0, self.follower.goal)
        self.controller = ComputedTorque()
        self.arm.reset(self.follower.goal)
        self._offset = np.array(self.imperfections.torque_offset or (0.0,) * n)
        self._zero = np.zeros(n)
        self._true = np.zeros(n)
        self._rating = np.array([joint.limits.torque or np.inf for joint in self.robot.joints])
        self._waiting: list[tuple[float, Measured]] = []

    @property
    def now(self) -> float:
        """Simulated time [s]."""
        return self._steps * self.arm.dt

    def reference_shares(self) -> dict[str, float]:
        """Return what the arm's own reference used of its limits: along commands, and while braking after a stop."""
        velocity, acceleration = (
            np.array([getattr(joint.limits, key) or np.inf for joint in self.robot.joints])
            for key in ("velocity", "acceleration")
        )
        follower = self.follower
        return {
            "reference_velocity_share": float(np.max(follower.fastest / velocity)),
            "reference_acceleration_share": float(np.max(follower.hardest / acceleration)),
            "stop_acceleration_share": float(np.max(follower.hardest_stop / acceleration)),
        }

    def commanded(self) -> None:
        """Note that a command came."""
        if self.first_command is None:
            self.first_command = self.now

    def faulty(self, name: str) -> bool:
        """Return whether a fault has begun."""
        wanted = self.imperfections
        if wanted.fault != name:
            return False
        return self.first_command is not None and self.now - self.first_command >= wanted.fault_time

    def zero_torques(self) -> None:
        """Make the sensors read zero where the arm stands."""
        self._zero = self._true + self._offset

    def run(self, publish: Callable[[Measured], None], alive: Callable[[], bool]) -> None:
        """Simulate in real time until told to end; a late machine is caught up with, never skipped."""
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
        tau = np.clip(
            self.controller.torque(self.arm, q, qd, self.follower.step()),
            -self._rating,
            self._rating,
        )
        if self._steps % self.every == 0:
            self._polled = (self.now, q)
        if self._steps % self.every == self._skew:
            self._sample(*self._polled, qd, tau)
        self.arm.step(tau)
        self._steps += 1

    def _sample(self, elapsed: float, q: Floats, qd: Floats, tau: Floats) -> None:
        """Measure and put the sample on its way."""
        wrong = self.imperfections
        if self.rng.random() < wrong.drop:
            self.dropped += 1
            return
        if wrong.fault == "gravity-free":
            tau = tau - self.arm.inverse_dynamics(q, np.zeros_like(q), np.zeros_like(q))
        self._true = tau
        reading = (
            tau
            + self._offset
            - self._zero
            + self.rng.normal(0.0, 1.0, len(tau)) * np.array(wrong.torque_noise)
        )
        if self.faulty("torque"):
            reading[1] = 0.95 * (self.robot.joints[1].limits.torque or 100.0)
        delay = (
            wrong.latency + abs(self.rng.normal(0.0, wrong.jitter))
            if wrong.jitter
            else wrong.latency
        )
        due = max(self.now + delay, self._waiting[-1][0] if self._waiting else 0.0)
        speed = qd + self.rng.normal(0.0, 1.0, len(qd)) * wrong.velocity_noise
        measured = Measured(
            elapsed, _stepped(q, wrong.position_step), speed, _stepped(reading, wrong.torque_step)
        )
        self._waiting.append((due, measured))

    def _send(self, present: float, publish: Callable[[Measured], None]) -> None:
        while self._waiting and self._waiting[0][0] <= present:
            _, measured = self._waiting.pop(0)
            if not self.faulty("silent"):
                publish(measured)
                self.published += 1


def _stepped(values: Floats, step: float) -> Floats:
    return np.round(values / step) * step if step else values


@dataclass
class CommandLog:
    """Commands in DH quantities with their time of arrival.

    Args:
        robot: the arm.
        period: time between two commands that the driver expects [s].
    """

    robot: Robot
    period: float
    times: list[float] = field(default_factory=list)
    positions: list[Floats] = field(default_factory=list)
    velocities: list[Floats] = field(default_factory=list)
    accelerations: list[Floats] = field(default_factory=list)

    def velocity(self, time: float, qd: Floats) -> None:
        """Take a velocity command, (n,) [rad/s]; its acceleration is the change since the last one over the period."""
        before = self.velocities[-1] if self.velocities else np.zeros_like(qd)
        self._add(time, np.full_like(qd, np.nan), qd, (qd - before) / self.period)

    def point(self, time: float, q: Floats, qd: Floats, qdd: Floats) -> None:
        """Take a point of a trajectory: (n,) each [rad, rad/s, rad/s^2]."""
        self._add(time, q, qd, qdd)

    def _add(self, time: float, q: Floats, qd: Floats, qdd: Floats) -> None:
        self.times.append(time)
        self.positions.append(q)
        self.velocities.append(qd)
        self.accelerations.append(qdd)

    def facts(self) -> dict[str, Any]:
        """Return how many came, in which rhythm, and how much of each limit they used."""
        if not self.times:
            return {
                "commands": 0,
                "velocity_share": None,
                "acceleration_share": None,
                "violations": [],
            }
        step = np.diff(self.times)
        shares = {name: self._shares(name) for name in ("velocity", "acceleration")}
        broken = [
            f"{joint}: {name} at {100 * value:.0f} % of its limit"
            for name, values in shares.items()
            for joint, value in zip(self.robot.joint_names, values, strict=True)
            if value > 1
        ]
        return {
            "commands": len(self.times),
            "command_rate_hz": float((len(self.times) - 1) / (self.times[-1] - self.times[0]))
            if len(step)
            else None,
            "longest_interval_s": float(step.max()) if len(step) else None,
            **{f"{name}_share": self._largest(name, values) for name, values in shares.items()},
            "violations": broken,
        }

    def _largest(self, name: str, shares: list[float]) -> float | None:
        """Return the largest share; None where no joint has such a limit."""
        return (
            max(shares) if any(getattr(joint.limits, name) for joint in self.robot.joints) else None
        )

    def _shares(self, name: str) -> list[float]:
        peaks = np.abs({"velocity": self.velocities, "acceleration": self.accelerations}[name]).max(
            axis=0
        )
        limits = [getattr(joint.limits, name) or np.inf for joint in self.robot.joints]
        return [float(peak / limit) for peak, limit in zip(peaks, limits, strict=True)]

    def write(self, path: Path) -> None:
        """Write all commands as CSV."""
        kinds = {"q": self.positions, "qd": self.velocities, "qdd": self.accelerations}
        head = ["t", *(f"{kind}_{name}" for kind in kinds for name in self.robot.joint_names)]
        rows = zip(self.times, *kinds.values(), strict=True)
        lines = [
            ",".join(f"{value:.9g}" for value in (time, *np.concatenate(parts)))
            for time, *parts in rows
        ]
        write_text(path, "\n".join([csv_row(head), *lines]) + "\n")
