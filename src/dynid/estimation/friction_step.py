"""What Coulomb friction is like at a reversal: a velocity and a distance for each joint, from its own rows.

Friction tends to tanh(qd / velocity), and follows it over the distance that the joint moves (Dahl, LuGre). What is
narrower or wider than the model's leaves pulses in the residual at every reversal. The rows of each joint alone are
fitted once for each pair; the log evidence of a pair is -N_eff / 2 times the logarithm of the squared residual.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from dynid.arrays import Floats
from dynid.estimation import tuning
from dynid.estimation.least_squares import autocorrelation_time
from dynid.estimation.rows import joined, parallel_filtered, rows_of
from dynid.estimation.stack import Stack, settled, slopes
from dynid.log import Log
from dynid.model.base_model import BaseModel
from dynid.robot import Coulomb
from dynid.signals.conditioned_log import signs_of_shapes, with_effects

#: Velocities that are tried, in usual ones; the least is a step for what logs can tell, 0.3 to 30 mrad/s.
WIDTHS = np.geomspace(0.03, 3.0, 13)
#: Distances that are tried, in usual velocities times seconds: none to 1 mrad, in equal ratios from 0.1 mrad on.
EVEN_FROM = 0.01
EVEN = np.linspace(0.0, np.log(11.0), 6)
DISTANCES = EVEN_FROM * np.expm1(EVEN)
#: A distance of 5 mrad, in the same unit. What builds up over so much is an effect of its own (presliding_hysteresis):
#: a column of it is beside those that are tried, which would else meet it half-way. evidence: benchmarks/choices.md.
SLOW = 0.5
#: Of each part of a log without gaps this much is looked at [s]: hundreds of reversals tell both.
LOOKED_AT_S = 600.0


def with_coulomb(base: BaseModel, coulomb: Coulomb | None) -> BaseModel:
    """Return a model with the Coulomb shape that was estimated from logs; None for none."""
    robot = replace(base.robot, estimated_coulomb=coulomb)
    return replace(base, model=replace(base.model, robot=robot))


def with_estimated_step(stack: Stack, logs: Sequence[Log]) -> Stack:
    """Return a stack whose Coulomb columns have the velocities and distances that are estimated from its logs.

    Args:
        stack: the rows of all logs, with the usual velocities, torques as they were recorded.
        logs: the prepared logs that it was made from.
    """
    names, usual = stack.names, stack.base.robot.usual_coulomb
    columns = {
        j: names.index(f"fc{j + 1}") for j in range(len(stack.joints)) if f"fc{j + 1}" in names
    }
    if not columns:
        return stack
    tried = [
        Coulomb("smooth", tuple(velocity), distance=tuple(distance))
        for distance in np.outer(DISTANCES, usual.velocity).tolist()
        for velocity in np.outer(WIDTHS, usual.velocity).tolist()
    ]
    tried.append(replace(usual, distance=tuple(SLOW * unit for unit in usual.velocity)))
    parts, of_rows = [], []
    for log, raw in zip(stack.logs, logs, strict=True):
        count = round(LOOKED_AT_S * log.filter.rate / log.filter.first_step)
        some = replace(log, segments=[segment[:count] for segment in log.segments])
        parts.append(rows_of(some, stack.observer))
        filtered = partial(parallel_filtered, chosen=log.filter)
        of_rows += signs_of_shapes(raw, log.filter, usual, tried, count, filtered)
    rows, S = joined(parts), np.concatenate(of_rows)
    late = slopes(rows, rows.tau)
    found = np.array([[WIDTHS[0], 1.0, WIDTHS[-1], 0.0]] * len(stack.joints))
    for j, column in columns.items():
        # Why the slope: how late the torques are is not known yet, and is much like a distance.
        others = [np.delete(rows.W[:, j], column, 1), late[:, j], S[:, j, -1]]
        targets, good = [rows.tau[:, j], S[:, j, :-1]], rows.use[:, [j]]
        found[j] = _reversal(np.column_stack(others) * good, np.column_stack(targets) * good)
    low, velocity, high, distance = (found.T * usual.velocity).tolist()
    interval = tuple(zip(low, high, strict=True))
    step = Coulomb("smooth", tuple(velocity), interval, tuple(distance))
    base, logs_then = with_coulomb(stack.base, step), []
    for log, raw in zip(stack.logs, logs, strict=True):
        pairs = zip(log.segments, signs_of_shapes(raw, log.filter, usual, [step]), strict=True)
        segments = [replace(segment, coulomb_sign=sign[..., 0]) for segment, sign in pairs]
        logs_then.append(with_effects(replace(log, segments=segments), base.model))
    return settled(replace(stack, base=base).restacked(logs_then))


def _reversal(others: Floats, targets: Floats) -> Floats:
    """Return end, mean and other end of the 95 % interval of a joint's velocity, and its distance, in usual ones, (4,).

    The distance is zero where its interval holds that, and the velocity then the usual one where its interval holds
    that: small changes would only move other decisions.

    Args:
        others: other columns of the joint, (M, c), zero where rows do not count.
        targets: its torques and its signs with each of the pairs, (M, 1 + D K), zero there too.
    """
    from scipy.interpolate import RectBivariateSpline

    length = np.linalg.norm(others, axis=0)
    A = others[:, length > 0.0] / length[length > 0.0]
    targets = targets - A @ np.linalg.lstsq(A, targets, rcond=tuning.RANK_TOLERANCE)[0]
    rest, S = targets[:, :1], targets[:, 1:]
    left = rest - S * (S.T @ rest[:, 0] / np.maximum(np.sum(S**2, axis=0), 1e-300))
    squares = np.maximum(np.sum(left**2, axis=0), 1e-300)
    rows = len(left) / autocorrelation_time([left[:, int(np.argmin(squares))]])
    log_evidence = -0.5 * rows * np.log(squares).reshape(len(DISTANCES), len(WIDTHS))
    logs = np.log(WIDTHS)
    width, even = np.linspace(logs[0], logs[-1], 400), np.linspace(0.0, EVEN[-1], 200)
    gain = RectBivariateSpline(EVEN, logs, log_evidence)(even, width)
    gain -= 0.5 * (width / np.log(3.0)) ** 2
    share, distance = np.exp(gain - gain.max()), 0.0
    if share[0].max() < np.exp(-0.5 * 1.96**2):
        distance = EVEN_FROM * np.expm1(share.sum(axis=1) @ even / share.sum())
    else:
        share = share[:1]
    of_width = share.sum(axis=0) / share.sum()
    low, high = np.interp([0.025, 0.975], np.cumsum(of_width), width)
    mean = of_width @ width if distance or not low < 0.0 < high else 0.0
    return np.append(np.exp([low, mean, high]), distance)
