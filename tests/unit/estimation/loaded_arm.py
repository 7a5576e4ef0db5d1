"""Logs of a simulated LWR4+ with and without a load, with rounded encoders and the noise of its sensors."""

from dataclasses import replace

import numpy as np

from arms import pinocchio_model, simulated_torques
from dynid import Log
from dynid.model.parameters import joined
from dynid.robot import Body
from dynid.sim.sines import SineSpec, sines
from follower import follow_motion
from recorded_lwr import PLANT, ROBOT

LOAD = Body(1.8, (0.03, -0.02, 0.09), (0.006, 0.0004, -0.0003, 0.005, 0.0002, 0.004))
ROTOR = (0.3, 0.3, 0.2, 0.2, 0.1, 0.1, 0.05)
CONTROLLER = (2000.0, 2000, 1500, 1500, 800, 500, 250), (100.0, 100, 60, 60, 25, 15, 8)
ENCODER = np.deg2rad(1e-3)


def drawn(seed, load, seconds, rate):
    """Return random numbers, a motion, and the bodies of the arm."""
    rng = np.random.default_rng(seed)
    motion = sines(ROBOT, SineSpec(seconds, 12.0, 0.8, 0.7, 0.7, 0.1), 1 / rate, rng)
    carried = () if load is None else (joined(PLANT.bodies[-1], load),)
    return rng, motion, (*PLANT.bodies[: 7 - len(carried)], *carried)


def logged(t, q, tau, **extra):
    return Log(t, q, tau, ROBOT.joint_names, tau_unit="Nm", dh=True, extra=extra)


def recorded(seed, load=None, seconds=25.0):
    """Return a log of an arm that follows its command exactly, with torques of PyBullet."""
    rng, motion, bodies = drawn(seed, load, seconds, 200.0)
    arm, step = replace(PLANT, bodies=bodies).arm(ROBOT), PLANT.sensors.position_step
    tau = simulated_torques(arm, motion.q, motion.qd, motion.qdd) + arm.friction.torque(motion.qd)
    tau = tau + rng.normal(size=tau.shape) * np.array(PLANT.sensors.torque_noise)
    return logged(motion.t, np.round(motion.q / step) * step, tau)


def followed(seed, load=None):
    """Return a log of an arm with rotors that Pinocchio moves in closed loop, the noise of its encoders fed back."""
    rng, motion, bodies = drawn(seed, load, 25.0, 500.0)
    encoder = ENCODER * rng.standard_normal(motion.q.shape)
    plant = pinocchio_model(ROBOT, bodies, ROTOR)
    seen, tau = follow_motion(plant, PLANT.friction.torque, motion, CONTROLLER, encoder)
    # A torque is held from its sample to the next, so the mean of two belongs to the sample between them.
    tau[1:] = 0.5 * (tau[1:] + tau[:-1])
    tau += np.array(PLANT.sensors.torque_noise) * rng.standard_normal(tau.shape)
    return logged(motion.t, seen, tau, q_ref=motion.q)
