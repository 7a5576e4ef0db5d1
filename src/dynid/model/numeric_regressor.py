"""The regressor of any DH table on a few samples, straight from Newton and Euler, without deriving it first.

For questions that are asked of many tables at once, such as which mistake a robot file has; the derived program
(``regressor``) is faster for one table and many samples. The two share only the kinematics.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid.model import tuning
from dynid.model.kinematics import link_frames
from dynid.model.parameters import prior_parameters
from dynid.robot import Robot

Floats = NDArray[np.float64]


def body_regressor(
    robot: Robot, q: Floats, qd: Floats, qdd: Floats, gravity: Floats | None = None
) -> Floats:
    """Return the columns of the bodies of all links.

    Args:
        robot: the arm; only geometry and gravity matter.
        q: positions, (N, n) [rad or m].
        qd: velocities, (N, n) [rad/s or m/s].
        qdd: accelerations, (N, n) [rad/s^2 or m/s^2].
        gravity: in frame 0 where it is not that of the arm, (N, 3) [m/s^2].

    Returns:
        Torques per unit of m, mcx, mcy, mcz, Ixx, Ixy, Ixz, Iyy, Iyz, Izz of each link, (N, n, 10 n) [N m or N].
    """
    frames = link_frames(robot, q)
    # Why samples last: every operation runs along them, and a motion has hundreds of samples and few joints.
    R, p, axis, point = (
        np.ascontiguousarray(np.moveaxis(x, 0, -1))
        for x in (frames.R, frames.p, frames.axis, frames.point)
    )
    turning = [joint.revolute for joint in robot.joints]
    slides = ~np.array(turning)
    count, n = q.shape
    P = np.zeros((n, 10 * n, count))
    omega, alpha, at = np.zeros((3, 3, count))
    # Why: an arm that is held against gravity feels as if its base were accelerated upwards.
    acceleration = -np.broadcast_to(
        np.array(robot.gravity) if gravity is None else gravity, (count, 3)
    ).T
    for i in range(n):
        z, speed, push = axis[i], qd[:, i], qdd[:, i]
        if turning[i]:
            # The link turns about a point on its axis, which still moves with the link before.
            acceleration = _moved(acceleration, omega, alpha, point[i] - at)
            alpha = alpha + z * push + _across(omega, z * speed)
            omega = omega + z * speed
            acceleration = _moved(acceleration, omega, alpha, p[i] - point[i])
        else:
            acceleration = _moved(acceleration, omega, alpha, p[i] - at)
            acceleration = acceleration + z * push + 2.0 * _across(omega, z * speed)
        at = p[i]
        a, w, dw = (_turned(R[i], x) for x in (acceleration, omega, alpha))
        z = np.moveaxis(axis[: i + 1], 0, 1)
        along, about = _across(z, at[:, None] - np.moveaxis(point[: i + 1], 0, 1)), z
        if not all(turning[: i + 1]):
            still = slides[: i + 1]
            along[:, still], about = z[:, still], np.where(still[:, None], 0.0, z)
        _columns(
            P[: i + 1, 10 * i : 10 * i + 10], _turned(R[i], along), _turned(R[i], about), a, w, dw
        )
    return np.moveaxis(P, 2, 0)


def expected_torque(
    q: Floats,
    robot: Robot,
    qd: Floats | None = None,
    qdd: Floats | None = None,
    gravity: Floats | None = None,
) -> Floats:
    """Return the torques of the prior bodies without friction, (N, n) [N m or N]; at rest where no motion is given.

    Of bodies about which the robot file says nothing only the pattern over the poses means something.
    """
    still, bodies = np.zeros_like(q), prior_parameters(robot)
    if not (robot.prior and (robot.prior.links or robot.prior.cylinders)):
        bodies *= tuning.UNKNOWN_LINK_MASS_KG * robot.n / bodies[::10].sum()
    P = body_regressor(
        robot, q, still if qd is None else qd, still if qdd is None else qdd, gravity
    )
    return np.asarray(P @ bodies)


def _columns(found: Floats, f: Floats, m: Floats, a: Floats, w: Floats, dw: Floats) -> None:
    """Write the torques of some joints per unit of a link's ten parameters, (joints, 10, N).

    Args:
        found: where to.
        f: what each joint moves the link's origin by, in the link's frame like all others, (3, joints, N).
        m: what it turns the link by, (3, joints, N).
        a: acceleration of the link's origin, (3, N) [m/s^2].
        w: angular velocity, (3, N) [rad/s].
        dw: angular acceleration, (3, N) [rad/s^2].
    """
    (x, y, z), (dx, dy, dz) = w, dw
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    force = (
        (-yy - zz, xy - dz, xz + dy),
        (xy + dz, -xx - zz, yz - dx),
        (xz - dy, yz + dx, -xx - yy),
    )
    moment = (
        (dx, dy - xz, dz + xy, -yz, yy - zz, yz),
        (xz, dx + yz, zz - xx, dy, dz - xy, -xz),
        (-xy, xx - yy, dx - yz, xy, dy + xz, dz),
    )
    found[:, 0] = f[0] * a[0] + f[1] * a[1] + f[2] * a[2]
    turned = _across(a[:, None], m)
    for k in range(3):
        found[:, 1 + k] = f[0] * force[0][k] + f[1] * force[1][k] + f[2] * force[2][k] + turned[k]
    np.einsum("ikt,ijt->kjt", m, np.array(moment), out=found[:, 4:])


def _turned(R: Floats, x: Floats) -> Floats:
    """Return vectors (3, ..., N) in the frame whose rotation is R, (3, 3, N)."""
    return np.asarray(np.einsum("ij...,i...->j...", R if x.ndim == 2 else R[:, :, None], x))


def _moved(acceleration: Floats, omega: Floats, alpha: Floats, arm: Floats) -> Floats:
    """Return the acceleration of another point of the same body, (3, N)."""
    return np.asarray(acceleration + _across(alpha, arm) + _across(omega, _across(omega, arm)))


def _across(a: Floats, b: Floats) -> Floats:
    """Return the cross product along the first axis."""
    return np.stack([a[j] * b[k] - a[k] * b[j] for j, k in ((1, 2), (2, 0), (0, 1))])
