"""Logs for benchmarks/mapping.py: arms with random bodies in Pinocchio, on random motions. No equation of dynid is used.

The arms have what the model lacks (a ripple of the torque with the position), friction, noise and encoder steps.
"""

import sys
from pathlib import Path

import numpy as np

from dynid.files.robotfile import load_robot
from dynid.log import Log
from dynid.model.kinematics import link_frames
from dynid.robot import Body

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "physics"))
import arms

RATE, SECONDS, HARMONICS, BASE = 200, 20, 5, 0.1


def simulated(name, seed, speed=0.5):
    """Return a log of a shipped robot in its driver's columns.

    Args:
        name: shipped robot.
        seed: of bodies, motion and noise.
        speed: share of the rated speed that the fastest instant of each joint reaches.
    """
    robot, rng = load_robot(name), np.random.default_rng(seed)
    limits = [joint.limits for joint in robot.joints]
    rated = np.array([each.torque for each in limits])
    fastest = np.minimum([each.velocity or 1.0 for each in limits], 2.5)
    motor = robot.torque.source != "joint_sensor"
    rotor = np.where(
        [j.revolute for j in robot.joints], rated / fastest / (40 if motor else 400), 2.0
    )
    t = np.arange(0, SECONDS, 1 / RATE)
    q, qd, qdd = _motion(t, robot, rng, speed * fastest)
    tau = arms.pinocchio_torques(
        arms.pinocchio_model(robot, _bodies(robot, rng), rotor), q, qd, qdd
    )
    viscous, coulomb = (0.02, 0.04) if motor else (0.004, 0.005)
    tau += viscous * rated / fastest * qd + coulomb * rated * np.tanh(qd / 0.02)
    size = np.sqrt(np.mean((tau - tau.mean(axis=0)) ** 2, axis=0))
    tau += 0.02 * size * np.sin(
        8 * q + rng.uniform(0, 6, robot.n)
    ) + 0.02 * size * rng.standard_normal(tau.shape)
    q = np.round(q / 2e-5) * 2e-5
    if robot.coupling is not None:
        matrix = np.array(robot.coupling.matrix)
        q, tau = q @ matrix.T, tau @ np.linalg.inv(matrix)
    return robot, Log(
        t, q, tau, robot.log_names, tau_unit="Nm", motor_side=robot.coupling is not None
    )


def _motion(t, robot, rng, fastest):
    n, w = robot.n, 2 * np.pi * BASE * np.arange(1, HARMONICS + 1)
    low, high = np.array([joint.limits.position or (-2.5, 2.5) for joint in robot.joints]).T
    a, b = rng.standard_normal((2, HARMONICS, n)) / np.arange(1, HARMONICS + 1)[:, None]
    sin, cos = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    q, qd, qdd = (
        sin @ a + cos @ b,
        (cos * w) @ a - (sin * w) @ b,
        -(sin * w**2) @ a - (cos * w**2) @ b,
    )
    middle = (q.max(axis=0) + q.min(axis=0)) / 2
    reach = 0.8 * np.minimum((high - low) / 2, 2.0)
    scale = np.minimum(reach / np.abs(q - middle).max(axis=0), fastest / np.abs(qd).max(axis=0))
    return (q - middle) * scale + (low + high) / 2, qd * scale, qdd * scale


def _bodies(robot, rng):
    """Return clouds of eight point masses between each joint and the next, lighter towards the tip."""
    frames = link_frames(robot, np.zeros((1, robot.n)))
    R, p = frames.R[0], np.concatenate([np.zeros((1, 3)), frames.p[0]])
    reach = sum(np.hypot(joint.a, joint.d) for joint in robot.joints)
    share = np.linspace(1.6, 0.4, robot.n) * rng.uniform(0.7, 1.3, robot.n)
    bodies = []
    for i, mass in enumerate((5 + 10 * reach) * share / share.sum()):
        ends = p[i : i + 3] @ R[i] - p[i + 1] @ R[i]
        along = ends[0] if robot.convention == "standard" or i + 1 == robot.n else ends[2]
        com = 0.5 * along + rng.uniform(-0.03, 0.03, 3)
        cloud = rng.standard_normal((8, 3)) * (0.04 + 0.2 * np.abs(along))
        arm = cloud - cloud.mean(axis=0)
        tensor = mass / 8 * sum(r @ r * np.eye(3) - np.outer(r, r) for r in arm)
        bodies.append(Body(float(mass), tuple(com), tuple(tensor[np.triu_indices(3)])))
    return bodies
