"""Mass matrix of identified parameters over random poses: the alarm for a wrong sign in the driver's map.

A wrong sign or offset of one joint can hide in a small residual, but the parameters that it produces belong to an arm
that would accelerate against a push in some pose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.robot import Robot

Floats = NDArray[np.float64]

#: Inverse dynamics (q, qd, qdd) -> tau, all (N, n); linear in qdd.
Torque = Callable[[Floats, Floats, Floats], Floats]


@dataclass(frozen=True)
class SignAlarm:
    """What the mass matrix looks like over random poses.

    Attributes:
        smallest: smallest eigenvalue found, after dividing rows and columns by the root of the largest inertia that
            each joint shows; 1 is the most it can be.
        share: share of the poses in which the matrix is not positive definite.
        pose: the worst pose, (n,).
        asymmetry: largest difference of mirrored entries, same scale; beyond rounding the model itself is broken.
        inertia: smallest inertia seen at each joint, (n,) [kg m^2 or kg].
        push: the joint accelerations that the worst pose would answer with a push against them, (n,), unit length.
    """

    smallest: float
    share: float
    pose: Floats
    asymmetry: float
    inertia: Floats
    push: Floats

    @property
    def raised(self) -> bool:
        """Whether the parameters belong to no arm, in at least one pose."""
        return self.smallest <= 0.0


def mass_matrices(torque: Torque, q: Floats) -> Floats:
    """Return the mass matrix of each pose, column by column: tau(q, 0, e_j) - tau(q, 0, 0).

    Args:
        torque: inverse dynamics.
        q: poses, (N, n) [rad or m].

    Returns:
        (N, n, n), not made symmetric.
    """
    still = np.zeros_like(q)
    gravity = torque(q, still, still)
    columns = [torque(q, still, np.broadcast_to(unit, q.shape).copy()) - gravity for unit in np.eye(q.shape[1])]
    return np.stack(columns, axis=2)


def random_poses(robot: Robot, poses: int = 1000, seed: int = 0) -> Floats:
    """Return poses within the limits, one turn where there are none, (poses, n) [rad or m]."""
    bounds = [joint.limits.position or ((-np.pi, np.pi) if joint.revolute else (-0.5, 0.5)) for joint in robot.joints]
    low, high = np.array(bounds).T
    return np.random.default_rng(seed).uniform(low, high, (poses, robot.n))


def sign_alarm(torque: Torque, q: Floats) -> SignAlarm:
    """Test the mass matrix of identified parameters for positive definiteness.

    Args:
        torque: inverse dynamics of the identified parameters.
        q: poses to test, (N, n) [rad or m]; 1000 random ones take milliseconds.

    Returns:
        The worst pose and what happens there.
    """
    M = mass_matrices(torque, q)
    inertia = np.diagonal(M, axis1=1, axis2=2)
    size = np.sqrt(np.maximum(np.abs(inertia).max(axis=0), np.finfo(float).tiny))
    scaled = M / np.outer(size, size)
    value, vector = np.linalg.eigh(0.5 * (scaled + scaled.swapaxes(1, 2)))
    worst = int(np.argmin(value[:, 0]))
    push = vector[worst, :, 0] / size
    return SignAlarm(
        smallest=float(value[worst, 0]),
        share=float(np.mean(value[:, 0] <= 0.0)),
        pose=q[worst],
        asymmetry=float(np.abs(scaled - scaled.swapaxes(1, 2)).max()),
        inertia=inertia.min(axis=0),
        push=push / np.linalg.norm(push),
    )
