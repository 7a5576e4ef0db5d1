"""The numbers that ``dynid check LOG`` shows: samples, rate, columns, units, motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.log import Log
from dynid.robot import Robot
from dynid.signals import tuning
from dynid.signals.checks import measurable, slopes, unwrapped
from dynid.signals.columns import (
    in_si,
    matching_columns,
    robot_columns,
    take_samples,
    to_dh,
)
from dynid.signals.motion import speed


@dataclass(frozen=True)
class LogSummary:
    """What a log holds; numbers per joint are in the robot's order and DH quantities.

    Attributes:
        samples: number of samples.
        duration: from first to last sample [s].
        rate: median sample rate [Hz].
        jitter: half the spread of the middle 95 % of the sample times, as a share of the median.
        gaps: number of gaps.
        longest_gap: longest step between samples [s].
        matched: the log's own names of the joints' columns, () when it names none.
        ignored: names of the columns that belong to no joint.
        span: range of each position [rad or m].
        rms_velocity: [rad/s or m/s].
        velocity_slope: measured velocity over the change of position, None where not measured or not moving.
        torque_max: largest torque [N m, N, or A].
        torque_share: the same as a share of the rating, None where the rating is unknown.
        torque_unit: ``"Nm"`` or ``"A"``.
        least_moving: name of the joint with the smallest rms velocity in relation to its speed limit.
    """

    samples: int
    duration: float
    rate: float
    jitter: float
    gaps: int
    longest_gap: float
    matched: tuple[str, ...]
    ignored: tuple[str, ...]
    span: tuple[float, ...]
    rms_velocity: tuple[float, ...]
    velocity_slope: tuple[float | None, ...]
    torque_max: tuple[float, ...]
    torque_share: tuple[float | None, ...]
    torque_unit: str
    least_moving: str


def describe(log: Log, robot: Robot) -> LogSummary:
    """Return the numbers of a log, raw or prepared; samples that are not numbers are passed over.

    Raises:
        JointCountDiffers: fewer columns than joints.
        JointNamesDiffer: names of the robot file are not in the log.
    """
    columns, ignored = matching_columns(log, robot)
    samples = len(log)
    whole = _whole_rows(robot_columns(log, robot))
    clean = unwrapped(to_dh(in_si(whole, robot), robot), robot)
    step = np.diff(clean.t) if len(clean) > 1 else np.zeros(1)
    usual = float(np.median(step)) or float("nan")
    low, high = np.percentile(step, [2.5, 97.5])
    rms, top, span = np.zeros(robot.n), np.zeros(robot.n), np.zeros(robot.n)
    if len(clean):
        top, span = np.abs(clean.tau).max(axis=0), np.ptp(clean.q, axis=0)
    if len(clean) > 2:
        rms = np.sqrt(np.mean(speed(clean) ** 2, axis=0))
    slope = slopes(clean, robot) if len(clean) > 2 else np.full(robot.n, np.nan)
    ratings = [None if clean.tau_unit == "A" else joint.limits.torque for joint in robot.joints]
    relative = rms / robot.limits("velocity", 1.0)
    return LogSummary(
        samples=samples,
        duration=clean.duration,
        rate=1.0 / usual,
        jitter=float(high - low) / 2 / usual,
        gaps=int(np.sum(step > tuning.GAP_SAMPLES * usual)),
        longest_gap=float(step.max()),
        matched=tuple(log.names[i] for i in columns) if log.names else (),
        ignored=tuple(ignored),
        span=tuple(span.tolist()),
        rms_velocity=tuple(rms.tolist()),
        velocity_slope=tuple(None if np.isnan(value) else float(value) for value in slope),
        torque_max=tuple(top.tolist()),
        torque_share=tuple(
            None if r is None else float(value) / r for value, r in zip(top, ratings, strict=True)
        ),
        torque_unit=clean.tau_unit,
        least_moving=robot.joint_names[int(np.argmin(relative))],
    )


def _whole_rows(log: Log) -> Log:
    """Return the samples that are numbers throughout and later than the one before."""
    before = np.fmax.accumulate(np.concatenate([[-np.inf], log.t]))[:-1]
    good = np.isfinite(log.t) & (log.t > before)
    good &= measurable(log.q).all(axis=1) & measurable(log.tau).all(axis=1)
    if log.qd is not None and not measurable(log.qd).all():
        log = replace(log, qd=None)
    return log if good.all() else take_samples(log, np.flatnonzero(good))
