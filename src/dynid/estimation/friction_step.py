"""How wide the step of Coulomb friction is at a reversal: one velocity for each joint, from its own rows.

A step that is narrower or wider than the model's leaves pulses in the residual at every reversal. The rows of each
joint alone are fitted once for each width; the log evidence of a width is -N_eff / 2 times the logarithm of the
squared residual.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.covariance import autocorrelation_time
from dynid.estimation.rows import Rows, joined, parallel_filtered, rows_of
from dynid.estimation.stack import Stack, settled_stack
from dynid.log import Log
from dynid.model.base_model import BaseModel
from dynid.robot import Coulomb
from dynid.signals.conditioned_log import (
    ConditionedLog,
    signs_of_shapes,
    with_effects,
)
from dynid.signals.filters import Filter

Floats = NDArray[np.float64]

#: Widths that are tried, in usual widths; the narrowest is a step for what logs can tell, 0.3 to 30 mrad/s. Then as
#: many between the neighbours of the best.
WIDTHS = np.geomspace(0.03, 3.0, 9)
#: Of each part of a log without gaps this much is looked at [s]: hundreds of reversals tell a width.
LOOKED_AT_S = 600.0

#: Makes the signs of some shapes in each segment of each log, (N, n, shapes).
Signs: TypeAlias = Callable[[Sequence[Coulomb]], list[list[Floats]]]


def with_coulomb(base: BaseModel, coulomb: Coulomb | None) -> BaseModel:
    """Return a model with the Coulomb shape that was estimated from logs; None for none."""
    robot = replace(base.robot, estimated_coulomb=coulomb)
    return replace(base, model=replace(base.model, robot=robot))


def with_estimated_step(stack: Stack, logs: Sequence[Log], *, measured_velocity: bool) -> Stack:
    """Return a stack whose Coulomb columns have the widths that are estimated from its logs.

    Args:
        stack: the rows of all logs, with the usual widths.
        logs: the prepared logs that it was made from.
        measured_velocity: as for ``condition``.
    """
    usual = stack.base.robot.usual_coulomb

    def signs(shapes: Sequence[Coulomb], *, whole: bool = False) -> list[list[Floats]]:
        return [
            signs_of_shapes(
                log,
                conditioned.filter,
                usual,
                shapes,
                measured_velocity=measured_velocity,
                most=None if whole else _looked_at(conditioned.filter),
            )
            for log, conditioned in zip(logs, stack.logs, strict=True)
        ]

    found = _estimated(stack, signs, usual)
    if found is None:
        return stack
    base, logs_then = with_coulomb(stack.base, found), []
    if found.velocity == usual.velocity:
        return replace(stack, base=base)
    for log, own in zip(stack.logs, signs([found], whole=True), strict=True):
        pairs = zip(log.segments, own, strict=True)
        segments = [replace(segment, coulomb_sign=sign[..., 0]) for segment, sign in pairs]
        logs_then.append(with_effects(replace(log, segments=segments), base.model))
    return settled_stack(logs_then, base)


def _estimated(stack: Stack, signs: Signs, usual: Coulomb) -> Coulomb | None:
    """Return the width of each joint's step with its 95 % interval; None where no joint has such a column."""
    names, n = stack.names, len(stack.joints)
    columns = {j: names.index(f"fc{j + 1}") for j in range(n) if f"fc{j + 1}" in names}
    if not columns:
        return None
    rows = joined([rows_of(_beginning(log), stack.observer) for log in stack.logs])
    near = WIDTHS[:, None] * usual.velocity
    velocity, interval = list(usual.velocity), list(zip(*near[[0, -1]], strict=True))
    widths, left = near, _left_by(stack, rows, columns, signs, near)
    best = np.clip(np.argmin(np.sum(left**2, axis=0), axis=0), 1, len(WIDTHS) - 2)
    ends = widths[best - 1, range(n)], widths[best + 1, range(n)]
    near = np.geomspace(*ends, len(WIDTHS) + 1)[1:-1]
    widths = np.concatenate([widths, near])
    left = np.concatenate([left, _left_by(stack, rows, columns, signs, near)], axis=1)
    for j in columns:
        low, mean, high = usual.velocity[j] * np.exp(
            _width(np.log(widths[:, j] / usual.velocity[j]), left[:, :, j])
        )
        interval[j] = float(low), float(high)
        # The usual width stays where the interval holds it: small changes would only move other decisions.
        velocity[j] = velocity[j] if low < velocity[j] < high else float(mean)
    return Coulomb("smooth", tuple(velocity), tuple(interval))


def _beginning(log: ConditionedLog) -> ConditionedLog:
    """Return a log of whose segments only what is looked at is left."""
    count = _looked_at(log.filter)
    return replace(log, segments=[segment[:count] for segment in log.segments])


def _looked_at(chosen: Filter) -> int:
    """Return how many samples of a segment are looked at."""
    return round(LOOKED_AT_S * chosen.rate / chosen.first_step)


def _left_by(
    stack: Stack, rows: Rows, columns: dict[int, int], signs: Signs, widths: Floats
) -> Floats:
    """Return the residual of each joint with each of its widths, (K, n), as (M, K, n); zero where rows do not count."""
    tried = signs([Coulomb("smooth", tuple(each)) for each in widths.tolist()])
    of_rows = np.concatenate(
        [
            _of_rows(each, log.filter)
            for log, some in zip(stack.logs, tried, strict=True)
            for each in some
        ]
    )
    found = np.zeros((len(of_rows), *widths.shape))
    for j, column in columns.items():
        good, others = rows.use[:, j], rows.seen[j] & (np.arange(rows.size) != column)
        others = rows.of_joint(j)[np.ix_(good, others)]
        found[good, :, j] = _left(others, rows.tau[good, j], of_rows[good, j])
    return found


def _of_rows(signs: Floats, chosen: Filter) -> Floats:
    """Return signs at the instants of the rows, (M, n, shapes)."""
    # Why one shape at a time: a filter takes several times the memory of what it is given.
    return np.stack([parallel_filtered(x, chosen).T for x in signs.transpose(2, 1, 0)], axis=2)


def _left(others: Floats, tau: Floats, signs: Floats) -> Floats:
    """Return the residual of a joint's torques with each of the signs, (M, shapes)."""
    targets = np.column_stack([tau, signs])
    length = np.linalg.norm(others, axis=0)
    A = others / np.where(length > 0.0, length, 1.0)
    targets = targets - A @ np.linalg.lstsq(A, targets, rcond=tuning.RANK_TOLERANCE)[0]
    rest, S = targets[:, :1], targets[:, 1:]
    power = np.sum(S**2, axis=0)
    return np.asarray(rest - S * (S.T @ rest[:, 0] / np.where(power > 0.0, power, 1.0)))


def _width(logs: Floats, left: Floats) -> Floats:
    """Return the end, the mean and the other end of the 95 % interval of the logarithm of a width, (3,).

    Args:
        logs: what was tried, over the usual width, (K,).
        left: the residual with each, (M, K).
    """
    from scipy.interpolate import CubicSpline

    squares, order = np.sum(left**2, axis=0), np.argsort(logs)
    rows = len(left) / autocorrelation_time([left[:, int(np.argmin(squares))]])
    gain = -0.5 * rows * np.log(np.maximum(squares, 1e-300))
    fine = np.linspace(logs.min(), logs.max(), 4000)
    density = CubicSpline(logs[order], gain[order])(fine) - 0.5 * (fine / np.log(3.0)) ** 2
    share = np.exp(density - density.max())
    share /= share.sum()
    low, high = np.interp([0.025, 0.975], np.cumsum(share), fine)
    return np.array([low, share @ fine, high])
