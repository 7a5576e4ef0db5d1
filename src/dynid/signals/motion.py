"""How a log moves: speed, which samples move or rest, how much motion there is, and whether two logs have the same."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Floats, Ints, Mask
from dynid.errors import Finding, JointStill, LogTooShort
from dynid.log import Log
from dynid.robot import Robot
from dynid.signals import tuning


def per_joint(pair: tuple[float, float], robot: Robot) -> Floats:
    """Return a threshold for each joint out of one for revolute and one for prismatic joints, (n,)."""
    return np.where(robot.turning, *pair)


def speed(log: Log) -> Floats:
    """Return the change of position over a short window, (N, n) [rad/s or m/s]; needs increasing time."""
    half = max(1, round(tuning.SPEED_WINDOW_S * log.rate))
    q, t = (np.pad(x, ((half, half), (0, 0)), "edge") for x in (log.q, log.t[:, None]))
    rise = q[2 * half :] - q[: -2 * half]
    rise /= t[2 * half :] - t[: -2 * half]
    return rise


def moving(log: Log, robot: Robot) -> Mask:
    """Return which joints move at which sample, (N, n)."""
    return np.abs(speed(log)) > per_joint(tuning.MOVING_SPEED, robot)


def any_moves(log: Log, robot: Robot) -> Mask:
    """Return at which samples a joint moves, (N,)."""
    return np.asarray(moving(log, robot).any(axis=1))


def runs(flags: Mask, least: int) -> list[slice]:
    """Return where flags, (N,), are set for at least so many samples in a row."""
    from scipy.ndimage import find_objects, label  # here: its import takes longer than most logs

    every = (part for (part,) in find_objects(label(flags)[0]))
    return [part for part in every if part.stop - part.start >= least]


def rest_slices(log: Log, robot: Robot) -> list[slice]:
    """Return the samples in which no joint moves, without the first and last tenth of a second of each rest."""
    slow = per_joint(tuning.REST_SPEED, robot)
    still = np.all(np.abs(speed(log)) < slow, axis=1)
    margin = round(0.1 * log.rate)
    least = 2 * margin + max(2, math.ceil((tuning.ARM_REST_S - 0.2) * log.rate))
    return [slice(rest.start + margin, rest.stop - margin) for rest in runs(still, least)]


def bandwidth(log: Log, robot: Robot) -> float:
    """Return the frequency below which nearly all of every moving joint's velocity lies [Hz]."""
    last, window = 0, np.hanning(len(log))
    for v, slow in zip(speed(log).T, per_joint(tuning.MOVING_SPEED, robot), strict=True):
        if np.any(np.abs(v) > slow):
            power = np.cumsum(np.abs(np.fft.rfft(v * window)) ** 2)
            last = max(last, int(np.sum(power < tuning.POWER_SHARE * power[-1])))
    return last * log.rate / len(log)


def swings(log: Log, robot: Robot) -> NDArray[np.int64]:
    """Return how many times each joint swings from one reversal to the next, (n,)."""
    v = speed(log)
    least = np.maximum(per_joint(tuning.MOVING_SPEED, robot), 0.05 * np.abs(v).max(axis=0))
    signs = (np.sign(x[np.abs(x) > level]) for x, level in zip(v.T, least, strict=True))
    return np.array([np.sum(np.diff(sign, prepend=0.0) != 0) for sign in signs])


def check_amount(logs: Sequence[Log], robot: Robot) -> tuple[Finding, ...]:
    """Say when there is little motion to identify from in all logs together, W313.

    Raises:
        JointStill: some joints move, but not this one.
        LogTooShort: hardly any motion.
    """
    span = np.max([np.ptp(log.q, axis=0) for log in logs], axis=0)
    still = span < per_joint(tuning.STILL_SPAN, robot)
    if still.any() and not still.all():
        joints = ((robot.joints[j], span[j]) for j in np.flatnonzero(still))
        moves = (
            f"{x.name} moves {reach:.2g} {'rad' if x.revolute else 'm'}" for x, reach in joints
        )
        raise JointStill(
            f"{', '.join(moves)}: its own parameters cannot be found", where=logs[0].topic
        )
    seconds = sum(any_moves(log, robot).sum() / log.rate for log in logs)
    wanted = sum(tuning.BASE_PER_JOINT + len(joint.friction) for joint in robot.joints)
    count = sum(swings(log, robot).sum() for log in logs)
    if count >= tuning.FEW_SWINGS_PER_PARAMETER * wanted:
        return ()
    enough = seconds * wanted / max(count, 1)
    about = f"about {enough:.0f} s here" if count else "a motion of every joint"
    text = f"{seconds:.1f} s of motion; about {wanted} parameters need {about}"
    if count < tuning.SWINGS_PER_PARAMETER * wanted or seconds < tuning.LEAST_MOTION_S:
        raise LogTooShort(text, where=logs[0].topic)
    text = f"{text}; what it does not determine comes from the prior"
    return (Finding("W313", "warning", text, {"seconds": float(seconds)}),)


def sampled(t: Floats, q: Floats) -> Floats:
    """Return positions at the rate at which motions are compared, with short pauses, (M, n) [rad or m].

    Args:
        t: time, (N,) [s].
        q: positions, (N, n) [rad or m].
    """
    clock = np.append(0.0, np.cumsum(np.minimum(np.diff(t), tuning.MOTION_PAUSE_S)))
    grid = np.arange(0.0, clock[-1], 1.0 / tuning.MOTION_HZ)
    return np.column_stack([np.interp(grid, clock, column) for column in q.T])


def same_motion(one: Floats, other: Floats) -> bool:
    """Return whether two motions are one command, at whatever time either recording began.

    Args:
        one: positions from ``sampled``, (M, n) [rad or m].
        other: the same of another recording, (K, n).
    """
    if one.shape[1] != other.shape[1] or min(len(one), len(other)) < 2:
        return False
    reach = np.maximum(np.ptp(one, axis=0), np.ptp(other, axis=0))
    moving = reach > tuning.SAME_STILL * max(float(reach.max()), 1e-12)
    # Why from the middle: squares of what both have in common would drown what differs.
    middle = one[:, moving].mean(axis=0)
    a, b = ((x[:, moving] - middle) / reach[moving] for x in (one, other))
    _, squares, count = squares_apart(a, b)
    enough = count >= max(2.0, tuning.SAME_OVERLAP * min(len(a), len(b)))
    alike = squares < tuning.SAME_MOTION**2 * count[:, None]
    return bool(np.any(enough & alike.all(axis=1)))


def squares_apart(one: Floats, other: Floats) -> tuple[Ints, Floats, Ints]:
    """Return by how many rows the second of two signals is late, and how far they are apart then.

    Args:
        one: a signal, (M, n).
        other: another one at the same rate, (N, n).

    Returns:
        The lags, (L,); the squared differences, summed over the rows in common, (L, n); the number of these, (L,).
    """
    size, lags = len(one) + len(other), np.arange(1 - len(one), len(other))
    first, last = np.maximum(0, -lags), np.minimum(len(one), len(other) - lags)
    spectra = np.conj(np.fft.rfft(one, size, axis=0)) * np.fft.rfft(other, size, axis=0)
    squares = -2.0 * np.fft.irfft(spectra, size, axis=0)[lags]
    for x, start, end in ((one, first, last), (other, first + lags, last + lags)):
        total = np.vstack([np.zeros_like(x[:1]), np.cumsum(x**2, axis=0)])
        squares += total[end] - total[start]
    return lags, squares, last - first


def motion_numbers(motions: Sequence[Floats]) -> tuple[int, ...]:
    """Return the number of the motion that each recording is of: equal numbers, equal commands.

    Args:
        motions: positions of each recording from ``sampled``.
    """
    firsts: list[Floats] = []
    numbers = []
    for motion in motions:
        same = (n for n, first in enumerate(firsts) if same_motion(first, motion))
        numbers.append(next(same, len(firsts)))
        if numbers[-1] == len(firsts):
            firsts.append(motion)
    return tuple(numbers)
