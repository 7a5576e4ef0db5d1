"""What recorders, encoders and filters do to every log, as columns with sizes of their own: errors, and no effects.

A column without a bound swallows whatever is like it; without the column, what recorders do passes for an effect. So
each column is scaled to one standard deviation of what it stands for, which follows from encoder, pass band and rate.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from dynid.arrays import Floats
from dynid.gap import tuning
from dynid.gap.gap_rows import GapRows, accelerated
from dynid.model.base_model import BaseModel
from dynid.model.effects.friction import sign_of
from dynid.model.effects.laws import presliding
from dynid.signals.filters import Filter, white_noise

#: Distances within which friction builds up after a reversal (Dahl) that are an error and no effect [rad or m].
#: evidence: benchmarks/gap_choices.md, clean arms with such friction.
LAGS = (0.0005, 0.0015)
#: Reversals that are sharper or rounder than the model's, in widths of it: steps, and with a power humps upon the
#: sharpest one.
REVERSALS = ((0.25, 0), (0.5, 0), (0.6, 2), (1.2, 4), (2.0, 0), (1.8, 2), (2.4, 4))
#: The first so many columns, lags included, end within twice the width.
SHARP = 6


def velocity_error(raw_q: Floats, filtered: Filter) -> Floats:
    """Return the error of velocities by the steps or the noise of an encoder, (n,) [rad/s or m/s].

    White noise of positions, differentiated below the cut-off of the position filter.

    Args:
        raw_q: positions as recorded, (N, n) [rad or m].
        filtered: the filters.
    """
    share = min(1.0, 2 * filtered.position_cutoff / filtered.rate)
    return 2 * np.pi * filtered.position_cutoff * np.sqrt(share / 3.0) * white_noise(raw_q)


def with_reversals(rows: GapRows, base: BaseModel, theta: Floats) -> GapRows:
    """Return rows that know how large friction is, and within which speed its reversals are not known.

    Args:
        rows: the rows.
        base: model and base parameters.
        theta: base parameters of a first fit, (p,); friction that is not among them is none.
    """
    sizes, joints = dict(zip(base.names, theta.tolist(), strict=True)), base.robot.joints
    coulomb = np.array([abs(sizes.get(f"fc{j}", 0.0)) for j in range(1, len(joints) + 1)])
    errors = [velocity_error(log.segments[0].raw_q, log.filter) for log in rows.logs]
    least = np.array([tuning.SLOW_RAD if x.revolute else tuning.SLOW_M for x in joints])
    width = np.maximum(base.robot.coulomb_shape.velocity, least)
    known = replace(rows, coulomb=coulomb, reversal=np.hypot(width, np.median(errors, axis=0)))
    return replace(known, turns=np.array([reversal_columns(known, j) for j in range(len(joints))]))


def with_known_friction(rows: GapRows, noise: Floats) -> GapRows:
    """Return rows of which those do not count whose friction nobody knows: a joint that stops may keep all of it.

    Args:
        rows: the rows.
        noise: of each joint, (n,) [N m or N].
    """
    slow = rows.filtered([(np.abs(x.qd) < rows.reversal).astype(float).T for x in rows.motions])
    unknown = rows.coulomb * slow.T
    return replace(rows, use=rows.use & (unknown < tuning.UNKNOWN_FRICTION * noise))


def reversal_columns(rows: GapRows, joint: int) -> Floats:
    """Return what another shape of a joint's reversals would change of its torque, each one standard deviation, (9, M).

    Args:
        rows: the rows.
        joint: 0-based.
    """
    columns = []
    for motion in rows.motions:
        x, sign = motion.qd[:, joint] / rows.reversal[joint], sign_of(motion, joint)
        shapes = [presliding(motion.q[:, joint], lag) - sign for lag in LAGS]
        shapes += [
            np.tanh(x / 0.25) * np.exp(-((x / width) ** power))
            if power
            else np.tanh(x / width) - sign
            for width, power in REVERSALS
        ]
        shares = np.repeat([tuning.SHARPER, tuning.WIDER], [SHARP, len(shapes) - SHARP])
        columns.append(rows.coulomb[joint] * shares[:, None] * np.array(shapes))
    return rows.filtered(columns)


def without_slow(x: Floats, seconds: float, t: Floats) -> Floats:
    """Return signals at times t, (..., N), less their mean over a Gauss bell of so many seconds."""
    width = seconds / float(np.median(np.diff(t)))
    return x - gaussian_filter1d(x, width, mode="nearest")


def error_columns(rows: GapRows) -> tuple[Floats, Floats]:
    """Return columns of known errors, each one standard deviation, filtered [N m or N].

    Returns:
        Of errors that all joints share, (1 + 2 n, n, M), and of those of one joint alone, reversals first,
        (n, 9 + 2 n, M).
    """
    common, inertial = [], []
    for motion, log in zip(rows.motions, rows.logs, strict=True):
        torques = accelerated(motion.reference, motion.q, motion.qdd).swapaxes(1, 2)
        skew = tuning.SKEW_PERIODS / log.filter.rate
        late = skew * np.gradient(motion.total, motion.t, axis=0).T
        droop = (without_slow(torques, width, motion.t) for width in tuning.DROOP_WIDTHS_S)
        common.append(np.concatenate([late[None], *(tuning.DROOP * each for each in droop)]))
        fast = 3.0 * without_slow(torques, 0.08, motion.t)
        inertial.append(tuning.ACCELERATION * np.concatenate([torques, fast]))
    own = rows.filtered(inertial).swapaxes(0, 1)
    return rows.filtered(common), np.concatenate([rows.turns, own], axis=1)
