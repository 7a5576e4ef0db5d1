"""What is known of an arm before anything is measured: how it may move, and how its base parameters are distributed."""

from __future__ import annotations

import numpy as np

from dynid.arrays import Floats
from dynid.estimation import tuning
from dynid.estimation.possible_arm import constraints_of, curvature, require_possible_prior
from dynid.model.base_model import BaseModel, prior_base_parameters
from dynid.robot import Robot


def exciting_speed(robot: Robot) -> Floats:
    """Return the rms speed of an exciting motion inside the limits, (n,) [rad/s or m/s]."""
    limits = [(joint.limits.velocity, joint.revolute) for joint in robot.joints]
    return np.array(
        [tuning.EXCITING_SPEED * v if v else tuning.FREE_SPEED[turns] for v, turns in limits]
    )


def random_states(
    robot: Robot, speed: Floats, count: int = tuning.RANDOM_STATES, seed: int = 0
) -> tuple[Floats, Floats, Floats]:
    """Return positions inside the limits with velocities and accelerations of the order of a motion, (count, n) each.

    Args:
        robot: the arm.
        speed: rms speed of each joint, (n,) [rad/s or m/s].
        count: number of states.
        seed: of the random draws.
    """
    rng = np.random.default_rng(seed)
    turning, sliding = (tuning.FREE_REACH[kind] for kind in (True, False))
    low, high = robot.travel((-turning, turning), (-sliding, sliding))
    q = rng.uniform(low, high, (count, robot.n))
    qd = rng.uniform(-2.0, 2.0, q.shape) * speed
    return q, qd, rng.uniform(-4.0, 4.0, q.shape) * speed


def exciting_states(
    base: BaseModel, count: int = tuning.RANDOM_STATES
) -> tuple[Floats, Floats, Floats]:
    """Return positions, velocities and accelerations of an exciting motion inside the limits, (count, n) each."""
    speed = exciting_speed(base.robot)
    q, qd, _ = random_states(base.robot, speed, count, seed=1)
    fastest = 2 * np.pi * tuning.EXCITING_FREQUENCY * speed
    return q, qd, np.random.default_rng(2).normal(size=q.shape) * fastest


def prior_covariance(base: BaseModel) -> Floats:
    """Return the covariance of the base parameters before anything is measured, (p, p), in products of their units.

    Bodies are possible and resemble the prior's; nothing else of a joint (friction, rotor) needs more torque on an
    exciting motion than its bodies do.

    Args:
        base: model and base parameters.

    Raises:
        NotPhysical: a body of the prior cannot exist.
    """
    constraints, K = constraints_of(base), base.reduction.K
    require_possible_prior(constraints)
    states, bodies = exciting_states(base), constraints.bodies
    theta = prior_base_parameters(base.model, base.reduction, unknown=0.0)
    torque = np.sqrt(np.mean((base.observer.dense(*states) @ theta) ** 2, axis=0))
    torque = np.maximum(torque, max(tuning.LEAST_TORQUE * float(torque.max()), 1e-6))
    covariance = np.zeros((K.shape[1], K.shape[1]))
    others = np.delete(np.arange(K.shape[1]), bodies)
    columns = base.model.observer(others).dense(*states)
    size = np.sqrt(np.mean(columns**2, axis=0)) / torque[:, None]
    covariance[others, others] = 1.0 / np.maximum(size.max(axis=0, initial=0.0), 1e-9) ** 2
    price = tuning.PRIOR_COUNTED * curvature(constraints, constraints.prior)
    covariance[bodies[:, :, None], bodies[:, None]] = np.linalg.inv(price)
    return np.asarray(K @ covariance @ K.T)
