"""What Coulomb friction is like at a reversal: a velocity and a distance for each joint, from its own rows.

Friction tends to tanh(qd / velocity), and follows it over the distance that the joint moves (Dahl, LuGre). What is
narrower or wider than the model's leaves pulses in the residual at every reversal. The rows of each joint alone are
fitted once for each pair; the log evidence of a pair is -N_eff / 2 times the logarithm of the squared residual.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from dynid.arrays import Floats
from dynid.estimation import tuning
from dynid.estimation.least_squares import autocorrelation_time
from dynid.estimation.rows import joined, parallel_filtered, rows_of
from dynid.estimation.stack import Stack, _slope, settled
from dynid.log import Log
from dynid.model.base_model import BaseModel
from dynid.robot import Coulomb
from dynid.signals.conditioned_log import signs_of_shapes, with_effects

#: Velocities that are tried, in usual ones; the least is a step for what logs can tell, 0.3 to 30 mrad/s.
WIDTHS = np.geomspace(0.03, 3.0, 13)
#: Distances that are tried [s at the usual velocity], none to 2 mrad in even steps of their logarithm from 0.1 mrad on.
EVEN = np.linspace(0.0, np.log(21.0), 7)
DISTANCES = 0.01 * np.expm1(EVEN)
#: Of each part of a log without gaps this much is looked at [s]: hundreds of reversals tell both.
LOOKED_AT_S = 600.0


def with_coulomb(base: BaseModel, coulomb: Coulomb | None) -> BaseModel:
    """Return a model with the Coulomb shape that was estimated from logs; None for none."""
    robot = replace(base.robot, estimated_coulomb=coulomb)
    return replace(base, model=replace(base.model, robot=robot))


def with_estimated_step(stack: Stack, logs: Sequence[Log]) -> Stack:
    """Return a stack whose Coulomb columns have the widths that are estimated from its logs.

    Args:
        stack: the rows of all logs, with the usual widths.
        logs: the prepared logs that it was made from.
    """
    names, usual = stack.names, stack.base.robot.usual_coulomb
    columns = {
        j: names.index(f"fc{j + 1}") for j in range(len(stack.joints)) if f"fc{j + 1}" in names
    }
    if not columns:
        return stack

    def signs(shapes: Sequence[Coulomb], k: int, most: int | None = None) -> list[Floats]:
        return signs_of_shapes(logs[k], stack.logs[k].filter, usual, shapes, most)

    widths = WIDTHS[:, None] * usual.velocity
    distances = DISTANCES[:, None] * usual.velocity
    pairs = product(map(tuple, distances.tolist()), map(tuple, widths.tolist()))
    tried = [Coulomb("smooth", width, distance=distance) for distance, width in pairs]
    parts, of_rows = [], []
    for k, log in enumerate(stack.logs):
        count = round(LOOKED_AT_S * log.filter.rate / log.filter.first_step)
        some = replace(log, segments=[segment[:count] for segment in log.segments])
        parts.append(rows_of(some, stack.observer))
        # Why one shape at a time: a filter takes several times the memory of what it is given.
        of_rows += [
            np.stack([parallel_filtered(x, log.filter).T for x in each.transpose(2, 1, 0)], axis=2)
            for each in signs(tried, k, count)
        ]
    rows, S = joined(parts), np.concatenate(of_rows)
    late = np.concatenate([_slope(rows.t[run], rows.tau[run]) for run in rows.runs])
    velocity, interval = list(usual.velocity), list(zip(*widths[[0, -1]], strict=True))
    distance = [0.0] * len(velocity)
    for j, column in columns.items():
        others = rows.W[:, j].any(axis=0) & (np.arange(rows.size) != column)
        good = rows.use[:, [j]]
        targets = np.column_stack([rows.tau[:, j], S[:, j]])
        # Why the slope: how late the torques are is not known yet, and is like friction that follows.
        others = np.column_stack([rows.W[:, j, others], late[:, j]])
        (low, mean, high), far = _width(good * others, good * targets)
        unit = usual.velocity[j]
        interval[j] = low * unit, high * unit
        # The usual width stays where the interval holds it: small changes would only move other decisions.
        velocity[j] = unit if low < 1.0 < high and not far else mean * unit
        distance[j] = far * unit
    step = Coulomb("smooth", tuple(velocity), tuple(interval), tuple(distance))
    base, logs_then = with_coulomb(stack.base, step), []
    if step.velocity == usual.velocity and not any(distance):
        return replace(stack, base=base)
    for k, log in enumerate(stack.logs):
        pairs = zip(log.segments, signs([step], k), strict=True)
        segments = [replace(segment, coulomb_sign=sign[..., 0]) for segment, sign in pairs]
        logs_then.append(with_effects(replace(log, segments=segments), base.model))
    return settled(replace(stack, base=base).restacked(logs_then))


def _width(others: Floats, targets: Floats) -> tuple[Floats, float]:
    """Return the end, the mean and the other end of the 95 % interval of a joint's velocity, (3,), and its distance.

    Both in usual velocities; the distance is zero where its interval holds the least one.

    Args:
        others: other columns of the joint, (M, c), zero where rows do not count.
        targets: its torques and its signs with each of the pairs, (M, 1 + D K), zero there too.
    """
    from scipy.interpolate import RectBivariateSpline

    length = np.linalg.norm(others, axis=0)
    A = others / np.where(length > 0.0, length, 1.0)
    targets = targets - A @ np.linalg.lstsq(A, targets, rcond=tuning.RANK_TOLERANCE)[0]
    rest, S = targets[:, :1], targets[:, 1:]
    power = np.sum(S**2, axis=0)
    left = rest - S * (S.T @ rest[:, 0] / np.where(power > 0.0, power, 1.0))
    squares = np.maximum(np.sum(left**2, axis=0), 1e-300)
    rows = len(left) / autocorrelation_time([left[:, int(np.argmin(squares))]])
    of_width = np.log(WIDTHS)
    gain = -0.5 * rows * np.log(squares).reshape(len(DISTANCES), len(WIDTHS))
    fine = np.linspace(of_width[0], of_width[-1], 400)
    even = np.linspace(EVEN[0], EVEN[-1], 200)
    gain = RectBivariateSpline(EVEN, of_width, gain)(even, fine)
    gain = gain - 0.5 * (fine / np.log(3.0)) ** 2
    share = np.exp(gain - gain.max())
    of_far = share.sum(axis=1) / share.sum()
    far = float(0.01 * np.expm1(of_far @ even)) if share[0].max() < 0.15 else 0.0
    share = share.sum(axis=0) if far else share[0]
    share = share / share.sum()
    low, high = np.interp([0.025, 0.975], np.cumsum(share), fine)
    return np.exp([low, share @ fine, high]), far
