"""Logs of the LWR4+ that Pinocchio moves: sines of every joint, white noise of the torques, and what a test hides.

The rigid bodies are those of trajectories/lwr4plus_truth.yaml. A test writes what it hides in NumPy alone, so that
nothing is shared with the laws of the catalogue.
"""

from pathlib import Path

import numpy as np

from arms import pinocchio_model, pinocchio_torques
from dynid import Log, load_robot
from dynid.sim.plant import read_plant
from motions import tones

PLANT = read_plant(Path(__file__).parents[1] / "trajectories" / "lwr4plus_truth.yaml")
ROBOT = load_robot("kuka_lwr4plus")
ENGINE = pinocchio_model(ROBOT, PLANT.bodies)
RATE = 200.0
VISCOUS, COULOMB = np.array([3.0, 3, 2, 2, 1, 1, 0.5]), np.array([2.0, 2, 1.5, 1.5, 0.8, 0.6, 0.4])


def sharp(qd):
    """The true sign of friction."""
    return np.tanh(qd / 0.003)


def only(joint, torque):
    """Torques (N, 7) of one joint, from 0."""
    return np.outer(torque, np.arange(ROBOT.n) == joint)


def recorded(
    seed,
    count=4,
    reach=1.0,
    seconds=16.0,
    *,
    added=None,
    lead=None,
    noise=None,
    start=0.0,
):
    """One log.

    Args:
        seed: of the motion.
        count: sines of each joint.
        reach: how many times as far each joint moves, (n,) or one number.
        seconds: its length.
        added: torques that are hidden, by ``t, q, qd, rigid``, (N, n) [N m].
        lead: how far motors with their encoders are before the links, by the torques of the bodies, (N, n) [rad].
        noise: seed of the noise, where it is not that of the motion.
        start: its first stamp.
    """
    rng, n = np.random.default_rng(seed), ROBOT.n
    t = np.arange(round(seconds * RATE)) / RATE
    f, phase = rng.uniform(0.1, 0.3 if count == 1 else 0.5, (2, count, n))
    size, w = reach * rng.uniform(0.6, 1.0, (count, n)) * 1.2 / count, 2 * np.pi * f
    q, qd, qdd = tones(t, size, w, 2 * np.pi * phase)
    rigid = pinocchio_torques(ENGINE, q, qd, qdd)
    ahead = np.zeros_like(q) if lead is None else lead(rigid)
    turning = qd + np.gradient(ahead, t, axis=0)
    tau = rigid + VISCOUS * turning + COULOMB * sharp(turning)
    if added is not None:
        tau = tau + added(t + start, q, qd, rigid)
    draws = rng if noise is None else np.random.default_rng(noise)
    tau = tau + 0.1 * draws.normal(size=q.shape)
    return Log(t + start, q + ahead, tau, ROBOT.joint_names, tau_unit="Nm", dh=True)
