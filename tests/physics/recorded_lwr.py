"""Logs of the LWR4+ that Pinocchio moves: sums of sines of every joint, white noise of the torques."""

from pathlib import Path

import numpy as np

from arms import pinocchio_model, pinocchio_torques
from dynid import Log, load_robot
from dynid.sim.plant import read_plant
from motions import tones

PLANT = read_plant(Path(__file__).parents[2] / "trajectories" / "lwr4plus_truth.yaml")
ROBOT = load_robot("kuka_lwr4plus")
ENGINE = pinocchio_model(ROBOT, PLANT.bodies)
RATE = 200.0
VISCOUS, COULOMB = np.array([3.0, 3, 2, 2, 1, 1, 0.5]), np.array([2.0, 2, 1.5, 1.5, 0.8, 0.6, 0.4])


def recorded(seed, count=4, reach=1.0, seconds=16.0):
    """One log; each joint moves ``reach`` times as far, (n,) or one number."""
    rng, n = np.random.default_rng(seed), ROBOT.n
    t = np.arange(round(seconds * RATE)) / RATE
    f, phase = rng.uniform(0.1, 0.3 if count == 1 else 0.5, (2, count, n))
    size, w = reach * rng.uniform(0.6, 1.0, (count, n)) * 1.2 / count, 2 * np.pi * f
    q, qd, qdd = tones(t, size, w, 2 * np.pi * phase)
    tau = pinocchio_torques(ENGINE, q, qd, qdd)
    tau = tau + VISCOUS * qd + COULOMB * np.tanh(qd / 0.003) + 0.1 * rng.normal(size=q.shape)
    return Log(t, q, tau, ROBOT.joint_names, tau_unit="Nm", dh=True)
