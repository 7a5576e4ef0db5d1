"""Torques of PyBullet for an arm with and without a load, with the noise of its sensors; rounded encoders."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid import Log, load_robot
from dynid.model.parameters import joined
from dynid.robot import Body
from dynid.sim.plant import read_plant
from dynid.sim.sines import SineSpec, sines

TRUTH = Path(__file__).parents[3] / "trajectories" / "lwr4plus_truth.yaml"
LOAD = Body(1.8, (0.03, -0.02, 0.09), (0.006, 0.0004, -0.0003, 0.005, 0.0002, 0.004))
RATE = 200.0


def recorded(seed, load=None, seconds=25.0, rotor=0.0, noise=1.0):
    """Return the robot and one log of the simulated LWR4+."""
    plant, robot = read_plant(TRUTH), load_robot("kuka_lwr4plus")
    bodies = plant.bodies if load is None else (*plant.bodies[:-1], joined(plant.bodies[-1], load))
    plant = replace(plant, bodies=bodies, rotor_inertia=(rotor,) * robot.n)
    rng = np.random.default_rng(seed)
    motion = sines(robot, SineSpec(seconds, 12.0, 0.8, 0.7, 0.7, 0.1), 1 / RATE, rng)
    arm = plant.arm(robot)
    rigid = [
        arm.inverse_dynamics(*state) for state in zip(motion.q, motion.qd, motion.qdd, strict=True)
    ]
    tau = np.array(rigid) + arm.friction.torque(motion.qd) + arm.rotor_inertia * motion.qdd
    tau = tau + noise * rng.normal(size=tau.shape) * np.array(plant.sensors.torque_noise)
    q = np.round(motion.q / plant.sensors.position_step) * plant.sensors.position_step
    return robot, Log(motion.t, q, tau, robot.joint_names, tau_unit="Nm", dh=True)
