"""How a log moves: speed, which samples move or rest, how fast the motion changes, how much of it there is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.errors import JointStill, LogTooShort
from dynid.log import Log
from dynid.robot import Robot

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Half of the time [s] that a speed is taken over: encoder steps vanish, the fastest arm motions (3 Hz) do not.
SPEED_WINDOW = 0.05
#: Faster than this the joint moves [rad/s, m/s]: ten times what encoder noise makes over the window.
MOVING_SPEED = (0.02, 0.002)
#: Slower than this it rests [rad/s, m/s].
REST_SPEED = (0.01, 0.001)
#: A rest shorter than this [s] still has the arm's own vibration in it.
LEAST_REST = 0.3
#: A joint that spans less [rad, m] has not moved: Coulomb friction is not even broken loose.
STILL_SPAN = (0.01, 0.001)
#: Share of the velocity's power that defines the fastest motion.
POWER_SHARE = 0.99
#: Swings (from one reversal to the next, summed over joints) below this share of the number of parameters are too few:
#: each swing gives about four independent numbers (two accelerations, speed, position). One per parameter is plenty.
SWINGS_PER_PARAMETER = 0.4
GOOD_SWINGS_PER_PARAMETER = 1.0
#: Base parameters of the rigid bodies per joint, on average; a seven-joint arm has 48.
BASE_PER_JOINT = 7


def per_joint(pair: tuple[float, float], robot: Robot) -> Floats:
    """Return a threshold for each joint out of one for revolute and one for prismatic joints, (n,)."""
    return np.array([pair[0] if joint.revolute else pair[1] for joint in robot.joints])


def speed(log: Log) -> Floats:
    """Return the change of position over a short window, (N, n) [rad/s or m/s]; needs increasing time."""
    half = min(max(1, round(SPEED_WINDOW * log.rate)), max(1, (len(log) - 1) // 2))
    index = np.arange(len(log))
    before, after = np.maximum(index - half, 0), np.minimum(index + half, len(log) - 1)
    # Why in place: of a long log, three more copies would not fit into memory.
    result: Floats = log.q[after]
    for j in range(log.n):
        result[:, j] -= log.q[before, j]
    result /= (log.t[after] - log.t[before])[:, None]
    return result


def moving(log: Log, robot: Robot) -> Flags:
    """Return which joints move at which sample, (N, n)."""
    return np.asarray(np.abs(speed(log)) > per_joint(MOVING_SPEED, robot), dtype=bool)


def runs(flags: Flags, least: int = 1) -> list[slice]:
    """Return where flags, (N,), are set for at least so many samples in a row.

    Why not scipy.ndimage: it takes as long, and importing it 0.06 s.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int))).tolist()
    return [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= least]


def rest_slices(log: Log, robot: Robot) -> list[slice]:
    """Return the samples in which no joint moves, without the first and last tenth of a second of each rest."""
    still = np.all(np.abs(speed(log)) < per_joint(REST_SPEED, robot), axis=1)
    margin = round(0.1 * log.rate)
    found = [slice(rest.start + margin, rest.stop - margin) for rest in runs(still)]
    return [part for part in found if part.stop - part.start >= max(2, (LEAST_REST - 0.2) * log.rate)]


def bandwidth(log: Log, robot: Robot) -> float:
    """Return the frequency below which nearly all of every moving joint's velocity lies [Hz]."""
    v = speed(log)[:, moving(log, robot).any(axis=0)]
    if not v.shape[1]:
        return 0.0
    power = np.abs(np.fft.rfft(v * np.hanning(len(v))[:, None], axis=0)) ** 2
    share = np.cumsum(power, axis=0) / np.sum(power, axis=0)
    frequency = np.fft.rfftfreq(len(v), 1.0 / log.rate)
    return float(max(frequency[np.searchsorted(column, POWER_SHARE)] for column in share.T))


def swings(log: Log, robot: Robot) -> NDArray[np.int64]:
    """Return how many times each joint swings from one reversal to the next, (n,)."""
    v = speed(log)
    counts = []
    for column, threshold in zip(v.T, per_joint(MOVING_SPEED, robot), strict=True):
        sign = np.sign(column[np.abs(column) > max(threshold, 0.05 * np.max(np.abs(column)))])
        counts.append(1 + int(np.sum(np.diff(sign) != 0)) if len(sign) else 0)
    return np.array(counts)


def check_amount(logs: Sequence[Log], robot: Robot) -> None:
    """Raise when there is too little motion to identify from in all logs together.

    Raises:
        JointStill: some joints move, but not this one.
        LogTooShort: too few swings for the number of parameters.
    """
    span = np.max([np.ptp(log.q, axis=0) for log in logs], axis=0)
    still = span < per_joint(STILL_SPAN, robot)
    if still.any() and not still.all():
        j = int(np.flatnonzero(still)[0])
        unit = "rad" if robot.joints[j].revolute else "m"
        columns = 1 + len(robot.joints[j].friction) + robot.joints[j].motor_inertia
        others = ", ".join(robot.joint_names[i] for i in np.flatnonzero(still)[1:])
        raise JointStill(
            f"{robot.joint_names[j]} moves {span[j]:.2g} {unit}: its {columns} own parameters cannot be found"
            + (f"; nor those of {others}" if others else ""),
            where=logs[0].topic,
        )
    seconds = sum(float(np.sum(moving(log, robot).any(axis=1))) / log.rate for log in logs)
    wanted = sum(BASE_PER_JOINT + len(joint.friction) for joint in robot.joints)
    count = sum(int(np.sum(swings(log, robot))) for log in logs)
    if count < SWINGS_PER_PARAMETER * wanted:
        enough = seconds * GOOD_SWINGS_PER_PARAMETER * wanted / max(count, 1)
        about = f"about {enough:.0f} s here" if count else "a motion of every joint"
        raise LogTooShort(f"{seconds:.1f} s of motion; about {wanted} parameters need {about}", where=logs[0].topic)
