"""Simulate an arm behind the very topics of its driver, in real time, to rehearse a recording with."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid.answer import Answer
from dynid.arrays import Floats
from dynid.drivers.ros import connect
from dynid.errors import WrongUsage
from dynid.files.trajectoryfile import read_trajectory
from dynid.options import numbers
from dynid.robot import Robot
from dynid.sim.driver_loop import DriverLoop, step_of
from dynid.sim.follow import PointFollower, VelocityFollower
from dynid.sim.options import SimDriverOptions
from dynid.sim.plant import Plant, Sensors, plant_of, read_plant
from dynid.sim.ros_drivers import simulated_driver


def simulate_driver(
    robot: Robot,
    options: SimDriverOptions,
    *,
    started: Callable[[str, str], None],
) -> Answer:
    """Simulate an arm behind its driver's topics until the time is over or Ctrl-C is pressed.

    Args:
        robot: the arm.
        options: what is simulated.
        started: told the topic of the joint states and the address of the master once the driver is there.
    """
    topic = options.topic or robot.columns.topic or "/joint_states"
    node = connect("dynid_sim_driver", options.master)
    try:
        plant = plant_of(robot) if options.truth is None else read_plant(options.truth)
        arm = plant.arm(robot, step_of(options.rate))
        kind = VelocityFollower if is_kinova(robot) else PointFollower
        follower = kind(start_pose(robot, options.pose), arm.dt)
        rng = np.random.default_rng(options.seed)
        loop = DriverLoop(arm, follower, _sensors(plant, options), options, rng)
        driver = simulated_driver(node, loop, topic)
        started(topic, node.uri)
        end = time.monotonic() + (options.duration or float("inf"))
        with suppress(KeyboardInterrupt):
            loop.run(driver.publish, lambda: time.monotonic() < end)
    finally:
        node.close()
    facts = {"schema": "dynid/sim-driver/1", "robot": robot.name, **loop.facts()}
    said = f"{loop.published} joint states, {loop.dropped} dropped"
    return Answer(facts, parts=[("published", said)])


def is_kinova(robot: Robot) -> bool:
    """Return whether the arm is a Kinova Gen2, which takes velocities and stands upright at 180 deg."""
    return robot.driver is not None and robot.driver.kind == "kinova_gen2"


def _sensors(plant: Plant, options: SimDriverOptions) -> Sensors:
    """Return the sensors of a truth file, with what is wanted otherwise."""
    sensors, noise, step = plant.sensors, options.torque_noise, options.position_step
    return replace(
        sensors,
        torque_noise=sensors.torque_noise if noise is None else (noise,) * len(plant.bodies),
        position_step=sensors.position_step if step is None else step,
    )


def start_pose(robot: Robot, given: str | None) -> Floats:
    """Return where the arm stands at the beginning, (n,) [rad or m].

    Args:
        robot: the arm.
        given: a file of a trajectory, or positions as text; the middle of all ranges when None.
    """
    if given is None:
        # Why: a Kinova Gen2 points up with all joints at 180 deg, which is also the middle of its ranges.
        endless = np.pi if is_kinova(robot) else 0.0
        ranges = [joint.limits.position or (endless, endless) for joint in robot.joints]
        return np.array([(lower + upper) / 2 for lower, upper in ranges])
    if Path(given).exists():
        return np.array(read_trajectory(Path(given), robot).motion.q[0])
    try:
        return np.array(numbers(given, robot.n))
    except ValueError as error:
        what = f"--pose {given} is no file, and {error}"
        raise WrongUsage(
            what, fix=f"dynid trajectory {robot.word}, or one per joint [rad]"
        ) from None
