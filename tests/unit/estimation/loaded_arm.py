"""Logs of a simulated LWR4+ with and without a load, with rounded encoders and the noise of its sensors."""

from dataclasses import replace

import numpy as np

from arms import simulated_torques
from dynid import Log
from dynid.model.parameters import joined
from dynid.robot import Body
from dynid.sim.sines import SineSpec, sines
from recorded_lwr import PLANT, ROBOT

LOAD = Body(1.8, (0.03, -0.02, 0.09), (0.006, 0.0004, -0.0003, 0.005, 0.0002, 0.004))


def recorded(seed, load=None, seconds=25.0):
    """Return a log of an arm that follows its command exactly, with torques of PyBullet."""
    rng = np.random.default_rng(seed)
    motion = sines(ROBOT, SineSpec(seconds, 12.0, 0.8, 0.7, 0.7, 0.1), 1 / 200.0, rng)
    carried = () if load is None else (joined(PLANT.bodies[-1], load),)
    arm = replace(PLANT, bodies=(*PLANT.bodies[: 7 - len(carried)], *carried)).arm(ROBOT)
    tau = simulated_torques(arm, motion.q, motion.qd, motion.qdd) + arm.friction.torque(motion.qd)
    tau = tau + rng.normal(size=tau.shape) * np.array(PLANT.sensors.torque_noise)
    step = PLANT.sensors.position_step
    q = np.round(motion.q / step) * step
    return Log(motion.t, q, tau, ROBOT.joint_names, tau_unit="Nm", dh=True)
