"""What can be hidden in a simulated arm, for the demonstration of the gap search.

Shares nothing with ``dynid.model.effects``: a test by the same equations would only show that they equal themselves.
The spring is stiffer than the catalogue's, and ringing is in no catalogue.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.log import Log
from dynid.motion import Motion
from dynid.robot import Robot
from dynid.sim import tuning
from dynid.sim.arm import SimulatedArm, SimulatedRun, track
from dynid.sim.plant import Plant
from dynid.sim.sines import SineSpec, sines

Floats = NDArray[np.float64]
Law = Callable[[float, Floats, Floats], float]

#: Laws that are in no catalogue.
OUTSIDE = ("knock",)


@dataclass(frozen=True)
class Hidden:
    """What is hidden.

    Attributes:
        name: identifier of the catalogue, one of ``OUTSIDE``, or ``"nothing"``.
        joint: 0-based.
        size: roughly its torque [N m], or share.
    """

    name: str
    joint: int
    size: float


#: One case each, of a size that an arm like the LWR4+ can show.
CASES = (
    Hidden("nothing", 2, 0.0),
    Hidden("spring", 1, 1.5),
    Hidden("torque_gain", 3, 0.06),
    Hidden("knock", 2, 0.6),
)
#: Random numbers that are passed over: motions and noise of a seed stay those of earlier versions.
PASSED_OVER = 15


def law_of(hidden: Hidden) -> Law | None:
    """Return the further torque at the joint by time, positions and velocities; None for sensor faults."""
    j, a = hidden.joint, hidden.size
    laws: dict[str, Law] = {
        "spring": lambda t, q, v: a * q[j] + 0.1 * a * q[j] ** 3,
        "knock": _Ringing(hidden),
    }
    return laws.get(hidden.name)


class _Ringing:
    """Ringing after each reversal, as of play in a gear."""

    def __init__(self, hidden: Hidden) -> None:
        self._j, self._a, self._elapsed, self._sign = hidden.joint, hidden.size, math.inf, 0.0

    def __call__(self, t: float, q: Floats, v: Floats) -> float:
        sign = math.copysign(1.0, float(v[self._j]))
        self._elapsed = 0.0 if sign != self._sign else self._elapsed + tuning.HIDDEN_STEP_S
        self._sign = sign
        if self._elapsed >= 2:
            return 0.0
        return self._a * sign * math.exp(-self._elapsed / 0.15) * math.sin(34.0 * self._elapsed)


def hidden_logs(
    robot: Robot,
    plant: Plant,
    hidden: Hidden,
    rng: np.random.Generator,
    *,
    motions: int = 3,
    repeats: int = 2,
    seconds: float = 20.0,
) -> list[Log]:
    """Simulate an arm in closed loop with something hidden in it.

    Args:
        robot: the arm.
        plant: its truth.
        hidden: what is hidden.
        rng: source of motions and noise.
        motions: number of different motions.
        repeats: how often each is driven.
        seconds: length of each.
    """
    spec = SineSpec(seconds, seconds, 0.5, 0.6, 0.4, 0.05)
    logs: list[Log] = []
    with SimulatedArm(
        robot, plant.bodies, plant.friction, plant.rotor_inertia, dt=tuning.HIDDEN_STEP_S
    ) as arm:
        law = law_of(hidden)
        rng.bit_generator.advance(PASSED_OVER)  # type: ignore[attr-defined]
        if law is not None:

            def extra(t: float, q: Floats, v: Floats) -> Floats:
                tau = np.zeros(robot.n)
                tau[hidden.joint] = law(t, q, v)
                return tau

            arm.extra = extra
        for _ in range(motions):
            motion = sines(robot, spec, tuning.HIDDEN_STEP_S, rng)
            for _ in range(repeats):
                logs.append(_log(arm, motion, hidden, plant, rng, len(logs) * (seconds + 1.0)))
    return logs


def _log(
    arm: SimulatedArm,
    motion: Motion,
    hidden: Hidden,
    plant: Plant,
    rng: np.random.Generator,
    start: float,
) -> Log:
    done = track(arm, motion)
    # Why: a torque acts from its sample to the next, so the mean of two belongs to the sample between them.
    tau = done.tau.copy()
    tau[1:] = 0.5 * (done.tau[1:] + done.tau[:-1])
    j = hidden.joint
    if hidden.name == "torque_gain":
        tau[:, j] *= 1 + hidden.size
    every = tuning.HIDDEN_STEPS_A_SAMPLE
    truth = SimulatedRun(
        done.t[::every] + start,
        done.q[::every],
        done.qd[::every],
        tau[::every],
        done.q_ref[::every],
    )
    return replace(plant.sensors.measure(truth, arm.robot.joint_names, rng), dh=True)
