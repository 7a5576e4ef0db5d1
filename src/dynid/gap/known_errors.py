"""What recorders, encoders and filters do to every log, as columns with sizes of their own: errors, and no effects.

A column without a bound swallows whatever is like it; without the column, what recorders do passes for an effect. So
each column is scaled to one standard deviation of what it stands for, which follows from encoder, pass band and rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.gap import tuning
from dynid.gap.segments import SegmentRows
from dynid.model.base_model import BaseModel
from dynid.model.effects.friction import sign_of
from dynid.model.effects.interface import Floats
from dynid.robot import FRICTION_PARAMETERS, Robot
from dynid.signals.filters import Filter, white_noise

#: Columns of reversals that are sharper or rounder than the model's, which come first.
SHARP = 4


def velocity_error(raw_q: Floats, filtered: Filter) -> Floats:
    """Return the error of velocities by the steps or the noise of an encoder, (n,) [rad/s or m/s].

    White noise of positions, differentiated below the cut-off of the position filter.

    Args:
        raw_q: positions as recorded, (N, n) [rad or m].
        filtered: the filters.
    """
    steps = [np.unique(np.abs(np.diff(x))) for x in raw_q.T]
    least = np.array([x[x > 0][0] if np.any(x > 0) else 0.0 for x in steps])
    share = min(1.0, 2 * filtered.position_cutoff / filtered.rate)
    noise = np.maximum(white_noise(raw_q), least / np.sqrt(12.0))
    return np.asarray(2 * np.pi * filtered.position_cutoff / np.sqrt(3.0) * noise * np.sqrt(share))


def reversal_width(robot: Robot, error: Floats) -> Floats:
    """Return the speed within which nobody knows how friction turns, (n,) [rad/s or m/s].

    Args:
        robot: the arm, with the shape of its Coulomb sign.
        error: of the velocities, (n,) [rad/s or m/s].
    """
    least = np.array(
        [tuning.SLOW_RAD if joint.revolute else tuning.SLOW_M for joint in robot.joints]
    )
    return np.asarray(np.hypot(np.maximum(robot.coulomb_shape.velocity, least), error))


def coulomb_sizes(base: BaseModel, theta: Floats) -> Floats:
    """Return each joint's Coulomb friction, 0 where the model has none, (n,) [N m or N]."""
    names = {name: k for k, name in enumerate(base.reduction.base_names)}
    kind = FRICTION_PARAMETERS["coulomb"]
    places = [names.get(f"{kind}{j + 1}") for j in range(base.robot.n)]
    return np.array([0.0 if k is None else abs(float(theta[k])) for k in places])


def with_reversals(
    segments: Sequence[SegmentRows], base: BaseModel, theta: Floats
) -> list[SegmentRows]:
    """Return segments that know how large friction is, and within which speed its reversals are not known.

    Args:
        segments: rows.
        base: model and base parameters.
        theta: base parameters of a first fit, (p,).
    """
    sizes = coulomb_sizes(base, theta)
    errors = [velocity_error(x.raw_q, s.log.filter) for s in segments for x in s.log.segments]
    width = reversal_width(base.robot, np.median(errors, axis=0))
    return [replace(s, coulomb=sizes, reversal=width) for s in segments]


def reversal_columns(segment: SegmentRows, joint: int) -> Floats:
    """Return what another shape of a joint's reversals would change of its torque, each one standard deviation, (7, M).

    Args:
        segment: rows.
        joint: 0-based.
    """
    qd, sign, w = (
        segment.motion.qd[:, joint],
        sign_of(segment.motion, joint),
        segment.reversal[joint],
    )
    sharp = np.tanh(qd / (0.25 * w))
    columns = [
        tuning.SHARPER * (sharp - sign),
        tuning.SHARPER * (np.tanh(qd / (0.5 * w)) - sign),
        tuning.SHARPER * sharp * np.exp(-((qd / (0.6 * w)) ** 2)),
        tuning.SHARPER * sharp * np.exp(-((qd / (1.2 * w)) ** 4)),
        tuning.WIDER * (np.tanh(qd / (2.0 * w)) - sign),
        tuning.WIDER * sharp * np.exp(-((qd / (1.8 * w)) ** 2)),
        tuning.WIDER * sharp * np.exp(-((qd / (2.4 * w)) ** 4)),
    ]
    return segment.filtered(segment.coulomb[joint] * np.array(columns))


def acceleration_torques(segment: SegmentRows) -> Floats:
    """Return the torque of each joint by the acceleration of each, (n by, n of, N) [N m or N]."""
    motion = segment.motion
    still = np.zeros_like(motion.qdd)
    held = motion.reference.rigid(motion.q, still, still)
    found = []
    for i in range(motion.n):
        alone = np.zeros_like(motion.qdd)
        alone[:, i] = motion.qdd[:, i]
        found.append((motion.reference.rigid(motion.q, still, alone) - held).T)
    return np.array(found)


def without_slow(x: Floats, width: float) -> Floats:
    """Return signals, (..., N), less their mean over a Gauss bell of so many samples."""
    half = max(1, int(np.ceil(4 * width)))
    bell = np.exp(-0.5 * (np.arange(-half, half + 1) / max(width, 1e-6)) ** 2)
    flat = np.pad(x.reshape(-1, x.shape[-1]), ((0, 0), (half, half)), mode="edge")
    size = 1 << (flat.shape[1] + 2 * half).bit_length()
    smooth = np.fft.irfft(np.fft.rfft(flat, size) * np.fft.rfft(bell / bell.sum(), size), size)
    return np.asarray(x - smooth[:, 2 * half : 2 * half + x.shape[-1]].reshape(x.shape))


def common_columns(segment: SegmentRows, torques: Floats) -> Floats:
    """Return errors that all joints share, each one standard deviation, filtered, (1 + 2 n, n, M) [N m or N].

    Args:
        segment: rows.
        torques: of each joint by the acceleration of each, (n by, n of, N).
    """
    motion, n = segment.motion, segment.motion.n
    step = float(np.median(np.diff(motion.t)))
    skew = (
        tuning.SKEW_PERIODS
        / segment.log.filter.rate
        * np.gradient(motion.total, motion.t, axis=0).T
    )
    fast = [tuning.DROOP * without_slow(torques, width / step) for width in tuning.DROOP_WIDTHS_S]
    raw = np.concatenate([skew[None], *fast])
    return segment.filtered(raw.reshape(-1, len(motion))).reshape(len(raw), n, -1)


def own_columns(segment: SegmentRows, joint: int, torques: Floats) -> Floats:
    """Return errors of one joint alone, each one standard deviation, filtered, (7 + 2 n, M) [N m or N].

    Args:
        segment: rows.
        joint: 0-based.
        torques: of each joint by the acceleration of each, (n by, n of, N).
    """
    step = float(np.median(np.diff(segment.motion.t)))
    own = torques[:, joint]
    inertial = tuning.ACCELERATION * np.concatenate([own, 3.0 * without_slow(own, 0.08 / step)])
    return np.concatenate([reversal_columns(segment, joint), segment.filtered(inertial)])


@dataclass(frozen=True)
class KnownErrors:
    """What no effect has to explain: known errors, each in its own standard deviations, and unsure base parameters.

    Attributes:
        common: errors that all joints share, (1 + 2 n,).
        own: errors of one joint alone, (n, 7 + 2 n).
        covariance: of the base parameters, (p, p).
    """

    common: Floats
    own: Floats
    covariance: Floats

    def power(self, segment: SegmentRows) -> Floats:
        """Return the expected square of all of them in the rows of a segment, filtered, (M, n)."""
        unsure = np.einsum("mjp,pq,mjq->mj", segment.W, self.covariance, segment.W, optimize=True)
        return np.asarray(unsure + self.torques(segment).T ** 2)

    def torques(self, segment: SegmentRows) -> Floats:
        """Return the torque of known errors in the rows of a segment, filtered, (n, M) [N m or N]."""
        by_acceleration = acceleration_torques(segment)
        shared = np.einsum("c,cnm->nm", self.common, common_columns(segment, by_acceleration))
        alone = [w @ own_columns(segment, j, by_acceleration) for j, w in enumerate(self.own)]
        return np.asarray(shared + np.array(alone))
