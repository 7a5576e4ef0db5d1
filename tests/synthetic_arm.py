"""A seven-joint arm with known bodies: lengths, masses and limits of an LWR4+, links that are no cylinders."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from arms import cylinder
from dynid import Robot
from dynid.estimation.possible_set import (
    PhysicalConstraints,
    body_parameters,
    make_constraints,
    pseudo_inertia,
    smallest_eigenvalues,
)
from dynid.model import build_model
from dynid.model.kinematics import fixed_poses
from dynid.robot import Joint, Limits
from motions import harmonics, inside

TWIST = np.deg2rad([90, -90, -90, 90, 90, -90, 0])
OFFSET = np.array([0.31, 0, 0.4, 0, 0.39, 0, 0.078])
LENGTH = np.array([0.31, 0.2, 0.2, 0.2, 0.19, 0.1, 0.08])
MASS = np.array([2.9, 3.1, 2.9, 2.0, 2.0, 1.7, 0.27])
#: How much the true links differ from cylinders: relative stretch and shear, shift [m].
SHAPE = np.array([[0.1, 0.1, 0.1, 0.02]] * 3 + [[0, 0, 0, 0]])
#: Limits of position [rad], speed [rad/s] and acceleration [rad/s^2].
LIMITS = np.array(
    [
        0.95 * np.deg2rad([170, 120, 170, 120, 170, 120, 170]),
        np.deg2rad([110, 110, 128, 128, 204, 184, 184]),
        [6, 6, 8, 8, 12, 12, 12],
    ]
)
ROBOT = Robot(
    "LWR",
    "standard",
    tuple(
        Joint(f"joint{k + 1}", twist=twist, d=d, limits=Limits((-reach, reach), speed, hardest))
        for k, (twist, d, reach, speed, hardest) in enumerate(
            zip(TWIST, OFFSET, *LIMITS, strict=True)
        )
    ),
)
#: Viscous [N m s/rad] and Coulomb friction [N m] as measured on such arms: trajectories/lwr4plus_truth.yaml.
MEASURED_FRICTION = np.array(
    [[1.0, 0.9, 0.7, 0.65, 0.4, 0.3, 0.2], [1.3, 1.1, 0.8, 0.75, 0.5, 0.4, 0.3]]
)
NOISE = np.array([0.5, 0.5, 0.3, 0.3, 0.15, 0.1, 0.06])


@dataclass(frozen=True)
class Arm:
    """Regressor, truth and prior."""

    truth: np.ndarray
    prior: np.ndarray
    constraints: PhysicalConstraints

    def motion(self, samples, alpha=1.0, seed=0):
        """Five harmonics of 0.1 Hz at 500 samples in 10 s, slowed down by alpha."""
        return slowed(_harmonics(samples, seed, 0.5), alpha)

    def within_limits(self, samples, alpha=1.0, seed=0):
        """The same kind of motion, each joint scaled to the tightest of its limits, then slowed down by alpha."""
        return slowed(inside(*_harmonics(samples, seed, 1.0), *LIMITS), alpha)

    def whitened(self, samples=2000, alpha=1.0, noise=1.0, seed=1, motion=None):
        """Triangular factor (R, r) of noisy whitened rows."""
        rng = np.random.default_rng(seed)
        W = model().regressor(*(motion or self.motion)(samples, alpha))
        tau = W @ self.truth + noise * NOISE * rng.standard_normal((samples, 7))
        rows = np.concatenate([W, tau[:, :, None]], axis=2) / (noise * NOISE)[:, None]
        F = np.linalg.qr(rows.reshape(-1, 92), mode="r")
        return F[:91, :91], F[:91, 91]


def _harmonics(samples, seed, power):
    sizes = np.random.default_rng(seed).standard_normal((2, 5, 7))
    return harmonics(np.linspace(0, 10, samples), *sizes / np.arange(1, 6)[:, None] ** power)


def slowed(motion, alpha):
    return tuple(alpha**order * x for order, x in enumerate(motion))


@lru_cache
def model():
    joints = (replace(joint, friction=("viscous", "coulomb")) for joint in ROBOT.joints)
    return build_model(replace(ROBOT, joints=tuple(joints)))


@lru_cache
def seven_joint_arm():
    rng = np.random.default_rng(0)
    truth, prior = np.zeros(91), np.zeros(91)
    for i, joint in enumerate(ROBOT.joints):
        # Cylinders along the joint's own axis, in the frame of the DH table behind it.
        turned = np.linalg.inv(fixed_poses(joint, "standard")[1])
        stretch = np.eye(4) + rng.standard_normal((4, 4)) * SHAPE
        true, foreseen = (
            pseudo_inertia(cylinder(mass, LENGTH[i]))
            for mass in (MASS[i], MASS[i] * (1 + 0.2 * rng.standard_normal()))
        )
        truth[11 * i : 11 * i + 10] = body_parameters(
            turned @ stretch @ true @ stretch.T @ turned.T
        )
        prior[11 * i : 11 * i + 10] = body_parameters(turned @ foreseen @ turned.T)
    truth[10:77:11] = [0.3, 0.3, 0.2, 0.2, 0.1, 0.1, 0.05]
    truth[77::2] = truth[78::2] = [3, 3, 2, 2, 1, 1, 0.5]
    return Arm(truth, prior, make_constraints(model().parameters, prior))


def arm_with_measured_friction():
    """The same arm with friction of the size measured on such arms: a third."""
    arm = seven_joint_arm()
    truth = arm.truth.copy()
    truth[77::2], truth[78::2] = MEASURED_FRICTION
    return replace(arm, truth=truth)


def holds(constraints, x):
    """Whether a vector of parameters keeps the bounds and all its links are bodies."""
    bodies = smallest_eigenvalues(x[constraints.bodies])
    return bodies.min() > 0.0 and constraints.slack(x).min() >= 0.0
