"""The regressor of any DH table on a few samples, straight from Newton and Euler, without deriving it first.

For questions that are asked of many tables at once, such as which mistake a robot file has; the derived program
(``regressor``) is faster for one table and many samples. The two share only the kinematics.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid.model.kinematics import link_frames
from dynid.robot import Robot

Floats = NDArray[np.float64]


def body_regressor(robot: Robot, q: Floats, qd: Floats, qdd: Floats) -> Floats:
    """Return the columns of the bodies of all links.

    Args:
        robot: the arm; only geometry and gravity matter.
        q: positions, (N, n) [rad or m].
        qd: velocities, (N, n) [rad/s or m/s].
        qdd: accelerations, (N, n) [rad/s^2 or m/s^2].

    Returns:
        Torques per unit of m, mcx, mcy, mcz, Ixx, Ixy, Ixz, Iyy, Iyz, Izz of each link, (N, n, 10 n) [N m or N].
    """
    frames = link_frames(robot, q)
    turning = np.array([joint.revolute for joint in robot.joints])
    count, n = q.shape
    P = np.zeros((count, n, 10 * n))
    omega, alpha = np.zeros((count, 3)), np.zeros((count, 3))
    # Why: an arm that is held against gravity feels as if its base were accelerated upwards.
    at, acceleration = np.zeros((count, 3)), np.broadcast_to(-np.array(robot.gravity), (count, 3))
    for i in range(n):
        axis, p = frames.axis[:, i], frames.p[:, i]
        speed, push = qd[:, i, None], qdd[:, i, None]
        if turning[i]:
            # The link turns about a point on its axis, which still moves with the link before.
            acceleration = _moved(acceleration, omega, alpha, frames.point[:, i] - at)
            alpha = alpha + axis * push + _across(omega, axis * speed)
            omega = omega + axis * speed
            acceleration = _moved(acceleration, omega, alpha, p - frames.point[:, i])
        else:
            acceleration = _moved(acceleration, omega, alpha, p - at)
            acceleration = acceleration + axis * push + 2.0 * _across(omega, axis * speed)
        at = p
        Y = _wrench(*(np.einsum("nji,nj->ni", frames.R[:, i], x) for x in (acceleration, omega, alpha)))
        inward = np.swapaxes(frames.R[:, i], 1, 2)[:, None]
        z = frames.axis[:, : i + 1]
        lever = _across(z, p[:, None] - frames.point[:, : i + 1])
        about = np.where(turning[: i + 1, None], z, 0.0)
        along = np.where(turning[: i + 1, None], lever, z)
        J = np.concatenate([(inward @ along[..., None])[..., 0], (inward @ about[..., None])[..., 0]], axis=2)
        P[:, : i + 1, 10 * i : 10 * i + 10] = J @ Y
    return P


def _moved(acceleration: Floats, omega: Floats, alpha: Floats, arm: Floats) -> Floats:
    """Return the acceleration of another point of the same body, (N, 3)."""
    return np.asarray(acceleration + _across(alpha, arm) + _across(omega, _across(omega, arm)))


def _across(a: Floats, b: Floats) -> Floats:
    """Return the cross product along the last axis; twice as fast as NumPy's for a few hundred vectors."""
    x, y = np.broadcast_arrays(a, b)
    result = np.empty(x.shape)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        result[..., i] = x[..., j] * y[..., k] - x[..., k] * y[..., j]
    return result


def _wrench(a: Floats, w: Floats, dw: Floats) -> Floats:
    """Return force and moment at a link's origin per unit of its ten parameters, in its own frame, (N, 6, 10)."""
    Y = np.zeros((len(a), 6, 10))
    Y[:, :3, 0] = a
    Y[:, :3, 1:4] = _cross(dw) + _cross(w) @ _cross(w)
    Y[:, 3:, 1:4] = -_cross(a)
    Y[:, 3:, 4:] = _inertia(dw) + _cross(w) @ _inertia(w)
    return Y


def _cross(v: Floats) -> Floats:
    M = np.zeros((len(v), 3, 3))
    M[:, 0, 1], M[:, 0, 2], M[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return M - np.swapaxes(M, 1, 2)


def _inertia(v: Floats) -> Floats:
    """Return L with I v = L (Ixx, Ixy, Ixz, Iyy, Iyz, Izz), (N, 3, 6)."""
    x, y, z = v.T
    L = np.zeros((len(v), 3, 6))
    L[:, 0, 0], L[:, 0, 1], L[:, 0, 2] = x, y, z
    L[:, 1, 1], L[:, 1, 3], L[:, 1, 4] = x, y, z
    L[:, 2, 2], L[:, 2, 4], L[:, 2, 5] = x, y, z
    return L
