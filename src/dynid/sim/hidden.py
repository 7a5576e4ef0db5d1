"""What can be hidden in a simulated arm, for the demonstration of the gap search.

Shares nothing with ``dynid.model.effects``: a test by the same equations would only show that they equal themselves.
Ringing is in no catalogue.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dynid.log import Log
from dynid.robot import Robot
from dynid.sim import tuning
from dynid.sim.arm import SimulatedRun, track
from dynid.sim.plant import Plant
from dynid.sim.sines import SineSpec, sines

Law = Callable[[float, float], float]

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
    Hidden("spring", 6, 0.5),
    Hidden("torque_gain", 3, 0.06),
    Hidden("knock", 2, 0.6),
)
#: Random numbers that are passed over: motions and noise of a seed stay those of earlier versions.
PASSED_OVER = 15


def _law(hidden: Hidden) -> Law:
    """Return the further torque at the joint by its position and velocity, step by step; none for sensor faults."""
    laws: dict[str, Law] = {"spring": lambda q, v: hidden.size * q, "knock": _ringing(hidden.size)}
    return laws.get(hidden.name, lambda q, v: 0.0)


def _ringing(size: float) -> Law:
    """Return ringing after each reversal, as of play in a gear."""
    elapsed, before = math.inf, 0.0

    def torque(q: float, v: float) -> float:
        nonlocal elapsed, before
        sign = math.copysign(1.0, v)
        elapsed = 0.0 if sign != before else elapsed + tuning.HIDDEN_STEP_S
        before = sign
        if elapsed >= 2:
            return 0.0
        return size * sign * math.exp(-elapsed / 0.15) * math.sin(34.0 * elapsed)

    return torque


def hidden_logs(
    robot: Robot,
    plant: Plant,
    hidden: Hidden,
    rng: np.random.Generator,
    seconds: float,
) -> list[Log]:
    """Simulate an arm in closed loop with something hidden in it: three motions, each driven twice.

    Args:
        robot: the arm.
        plant: its truth.
        hidden: what is hidden.
        rng: source of motions and noise.
        seconds: length of each.
    """
    spec = SineSpec(seconds, seconds, 0.5, 0.6, 0.4, 0.05)
    logs: list[Log] = []
    arm = plant.arm(robot, tuning.HIDDEN_STEP_S)
    law, only = _law(hidden), np.eye(robot.n)[hidden.joint]
    rng.bit_generator.advance(PASSED_OVER)  # type: ignore[attr-defined]
    arm.extra = lambda t, q, v: only * law(float(q[hidden.joint]), float(v[hidden.joint]))
    for _ in range(3):
        motion = sines(robot, spec, tuning.HIDDEN_STEP_S, rng)
        for _ in range(2):
            truth = _truth(track(arm, motion), hidden, len(logs) * (seconds + 1.0))
            log = plant.sensors.measure(truth, arm.robot.joint_names, rng)
            logs.append(replace(log, dh=True))
    return logs


def _truth(done: SimulatedRun, hidden: Hidden, start: float) -> SimulatedRun:
    """Return what sensors measure of a run that begins at a time [s]."""
    # Why: a torque acts from its sample to the next, so the mean of two belongs to the sample between them.
    tau = done.tau.copy()
    tau[1:] = 0.5 * (done.tau[1:] + done.tau[:-1])
    if hidden.name == "torque_gain":
        tau[:, hidden.joint] *= 1 + hidden.size
    columns = (done.t + start, done.q, done.qd, tau, done.q_ref)
    return SimulatedRun(*(x[:: tuning.HIDDEN_STEPS_A_SAMPLE] for x in columns))
