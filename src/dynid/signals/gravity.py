"""Checks of the torque against gravity: has the driver removed it, and is the sensor zeroed?

The expectation is rough on purpose: point masses half-way between the DH frames. It only has to know which joint
carries weight in which pose.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dynid.drivers.registry import driver_of
from dynid.errors import Finding, GravityRemoved
from dynid.log import Log
from dynid.model.kinematics import link_frames
from dynid.robot import Robot
from dynid.signals.motion import MOVING_SPEED, any_moves, per_joint, rest_slices

Floats = NDArray[np.float64]

#: Poses at rest from which the change of torque with the pose is judged; with fewer the whole motion is used.
LEAST_POSES = 4
#: A joint takes part when its expected torque changes by this share of the largest change.
SIGNIFICANT = 0.3
#: Expected changes below this [N m] drown in friction.
LEAST_CHANGE = 1.0
#: A counterbalance may carry all that the heaviest joint would; where masses are known, lighter joints of heavy arms
#: then tell: those whose expected torque changes by this share of the largest change, and by so much [N m].
LIGHTER, LEAST_OF_LIGHTER = 0.05, 10.0
#: Measured change over expected one: rough masses are right within a factor of three; with unknown masses of ten.
LEAST_SHARE_KNOWN = 0.1
LEAST_SHARE_UNKNOWN = 0.03
#: A load whose change is, but for this share, also that of friction or inertia shows nothing.
DISTINCT = 0.2
#: Positions are smoothed over this time before they are differentiated [s].
SMOOTHING = 0.15
#: Samples from the middle of a log that moves all the time: a minute at 500 Hz says it as well as an hour.
MOST_SAMPLES = 30_000
#: Mass of a link about which nothing is known [kg].
UNKNOWN_MASS = 1.0
#: A joint carries no weight when its expected torque is below this share of the largest of any joint.
UNLOADED = 0.02
#: Torque sensors of healthy arms are zero within 1 % of the rating; three times that is worth zeroing.
ZERO_SHARE = 0.03


def expected_torque(q: Floats, robot: Robot) -> Floats:
    """Return roughly the torques that hold the arm against gravity, (N, n) [N m or N].

    Args:
        q: joint positions, (N, n) [rad or m].
        robot: the arm.
    """
    return _carried(q, robot, lambda points: -np.broadcast_to(np.array(robot.gravity), points.shape))


def _carried(q: Floats, robot: Robot, accelerations: Callable[[Floats], Floats], some: slice = slice(None)) -> Floats:
    """Return the torques that accelerate point masses, (N, n), from a function of their places, (N, n, 3).

    Only those at some of the samples are worked out.
    """
    frames = link_frames(robot, q)
    masses, offsets = _masses(robot)
    before = np.concatenate([np.zeros((len(q), 1, 3)), frames.p[:, :-1]], axis=1)
    points = 0.5 * (before + frames.p)
    for k, offset in enumerate(offsets):
        if offset is not None:
            points[:, k] = frames.p[:, k] + frames.R[:, k] @ offset
    pushed, points = accelerations(points)[some], points[some]
    axes, places = frames.axis[some], frames.point[some]
    torque = np.zeros(points.shape[:2])
    for i, joint in enumerate(robot.joints):
        for k in range(i, robot.n):
            axis, lever = axes[:, i], points[:, k] - places[:, i]
            velocity = np.cross(axis, lever) if joint.revolute else axis
            torque[:, i] += masses[k] * np.sum(velocity * pushed[:, k], axis=1)
    return torque


def _masses(robot: Robot) -> tuple[list[float], list[Floats | None]]:
    """Return a mass for each link, and its centre in the link frame where the robot file gives it."""
    if robot.prior is not None and robot.prior.links:
        return [body.mass for body in robot.prior.links], [np.array(body.com) for body in robot.prior.links]
    cylinders = robot.prior.cylinders if robot.prior is not None else None
    total = UNKNOWN_MASS * robot.n
    lengths = np.array([np.hypot(joint.a, joint.d) for joint in robot.joints])
    if cylinders is not None and cylinders.mass is not None:
        total = cylinders.mass
    elif cylinders is not None and cylinders.density is not None:
        total = cylinders.density * np.pi * cylinders.radius**2 * float(lengths.sum())
    share = (lengths + 0.1 * lengths.sum()) / np.sum(lengths + 0.1 * lengths.sum()) if lengths.any() else lengths
    return list(total * share), [None] * robot.n


def check_gravity(log: Log, robot: Robot) -> None:
    """Raise when the torques of a log in N m do not change with the pose as the weight of the arm does.

    Raises:
        GravityRemoved: its fix says how the driver publishes the whole torque.
    """
    if robot.torque.source == "gravity_free" or log.tau_unit == "A":
        return
    poses = rest_slices(log, robot)
    at_rest = len(poses) >= LEAST_POSES
    if at_rest:
        q, tau = (np.array([np.mean(values[part], axis=0) for part in poses]) for values in (log.q, log.tau))
        besides: list[Floats] = []
    elif any_moves(log, robot).any():
        q, tau, besides = _in_motion(log, robot)
    else:
        return
    load = expected_torque(q, robot)
    change = np.ptp(load, axis=0)
    known = robot.prior is not None
    carries = (change > SIGNIFICANT * change.max()) & (change > LEAST_CHANGE)
    if known:
        carries |= change > max(LIGHTER * change.max(), LEAST_OF_LIGHTER)
    loaded = np.flatnonzero(carries)
    shares = [share for j in loaded if (share := _share(load[:, j], tau[:, j], [part[:, j] for part in besides])) >= 0]
    if shares and max(shares) < (LEAST_SHARE_KNOWN if known else LEAST_SHARE_UNKNOWN):
        heaviest = int(loaded[np.argmax(change[loaded])])
        seen = f"torques {'at rest ' if at_rest else ''}do not follow the pose: gravity was already removed"
        raise GravityRemoved(
            f"{seen} ({robot.joint_names[heaviest]} changes by {np.ptp(tau[:, heaviest]):.2g} Nm, "
            f"about {change[heaviest]:.0f} Nm expected)",
            where=log.topic,
            fix=driver_of(robot).gravity_fix,
        )


def _in_motion(log: Log, robot: Robot) -> tuple[Floats, Floats, list[Floats]]:
    """Return positions, torques and what else makes torque, (N, n) each, at some thousand instants of a motion."""
    first = max(0, (len(log) - MOST_SAMPLES) // 2)
    part = slice(first, first + MOST_SAMPLES)
    # Why at most: a log so short has fewer samples than the smoothing would take.
    width = min(max(3, round(SMOOTHING * (len(log) - 1) / float(np.ptp(log.t)))), max(3, len(log.t[part]) // 3))
    kernel = np.hanning(width + 2) / np.hanning(width + 2).sum()
    q, tau = (np.apply_along_axis(np.convolve, 0, x, kernel, "valid") for x in (log.q[part], log.tau[part]))
    t = np.convolve(log.t[part], kernel, "valid")

    def slope(x: Floats) -> Floats:
        return np.asarray(np.gradient(x, t, axis=0))

    v, a = slope(q), slope(slope(q))
    # Why: a long log says it no better than a thousand samples of it do; the ends have no second derivative.
    some = slice(2, -2, max(1, len(q) // 1000))
    inertia = _carried(q, robot, lambda points: slope(slope(points)), some)
    friction = np.tanh(v / per_joint(MOVING_SPEED, robot))
    return q[some], tau[some], [v[some], friction[some], a[some], inertia]


def _share(load: Floats, tau: Floats, besides: list[Floats]) -> float:
    """Return the measured change with the load over the expected one; -1 when the rest could explain it as well."""
    rest = np.column_stack([np.ones(len(load)), *besides])
    rest = rest / np.maximum(np.linalg.norm(rest, axis=0), 1e-12)
    own = load - rest @ np.linalg.lstsq(rest, load, rcond=1e-9)[0]
    if np.linalg.norm(own) < DISTINCT * np.linalg.norm(load - load.mean()):
        return -1.0
    return abs(float(own @ tau / (own @ own)))


def check_zero(log: Log, robot: Robot) -> tuple[Finding, ...]:
    """Return findings W316 for joints that read a torque at rest although they carry no weight there.

    Why: only for sensors behind the gear; a motor at rest holds any torque up to its friction.
    """
    poses = rest_slices(log, robot)
    if robot.torque.source not in ("joint_sensor", "gravity_free") or log.tau_unit == "A" or not poses:
        return ()
    q, tau = (np.array([np.mean(values[part], axis=0) for part in poses]) for values in (log.q, log.tau))
    load = np.abs(expected_torque(q, robot))
    if robot.torque.source == "gravity_free":
        load = np.zeros_like(load)
    findings = []
    for j, joint in enumerate(robot.joints):
        rows = load[:, j] <= UNLOADED * max(load.max(), 1e-9)
        rating = joint.limits.torque
        if rating is None or not rows.any():
            continue
        mean = float(np.mean(tau[rows, j]))
        if abs(mean) > ZERO_SHARE * rating:
            unit = joint.torque_unit.replace(" ", "")
            text = (
                f"{joint.name} reads {mean:+.2g} {unit} with the arm at rest and gravity balanced: "
                "zero the sensors before recording"
            )
            findings.append(Finding("W316", "warning", text, {"joint": joint.name, "mean": mean}))
    return tuple(findings)
