"""Torques that are late by tenths of a second: delays are tried one by one, and the best begins the search.

The slope of the model's torque stands for a short delay alone, and a model that was fitted to late torques has another
slope. Torques that are moved back know of neither.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynid.gap.problem import GapProblem
from dynid.gap.segments import cut
from dynid.gap.selected_effects import SelectedEffect
from dynid.gap.significance import SignificanceTest, significance_test
from dynid.gap.stepwise_selection import EQUAL
from dynid.gap.whitened_regression import WhitenedRegression
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.effects.interface import Floats
from dynid.options import LONGEST_DELAY

#: Delays that are tried [s]: closer than half a period of what moves an arm, and further than the slope reaches.
TRIED = np.linspace(-LONGEST_DELAY, LONGEST_DELAY, 21)
#: Half the time over which the slope of measured torques is taken at last [s]: less is noise.
NEAR = 0.01


def late_torques(problem: GapProblem) -> SelectedEffect | None:
    """Return the delay of all new torques that explains most, and how sure it is; None where none is of use.

    Args:
        problem: what is searched.
    """
    from scipy import special

    bare = _inside(problem.regression())
    if not all(len(rows.y) for rows in bare.joints):
        return None
    moved = _moved(bare, TRIED)
    right = sum(rows.A.T @ y.T for rows, y in zip(bare.joints, moved, strict=True))
    if bare.prior is not None:
        right = right + (bare.prior[:, :-1].T @ bare.prior[:, -1])[:, None]
    theta = bare.fit.root @ (bare.fit.root.T @ right)
    squares = [
        np.square(y - (rows.A @ theta).T) for rows, y in zip(bare.joints, moved, strict=True)
    ]
    left = np.sum([x.sum(axis=1) for x in squares], axis=0)
    best, still = np.argmin(left), len(TRIED) // 2
    # Why not zero: where no new row is left, all delays leave the same but for rounding.
    if left[best] > left[still] - EQUAL:
        return None
    lost = [x[still] - x[best] for x in squares]
    # Why: all torques are late, or it is something else.
    if min(float(x.sum()) for x in lost) < -EQUAL:
        return None
    delay, near = float(TRIED[best]), None
    # Why twice: the slope is one over a tenth of a second first, and then one where the torques belong.
    for step in (TRIED[1] - TRIED[0], NEAR):
        near = _delay_test(bare, delay, step)
        delay = float(np.clip(delay + near.amplitudes[0], -LONGEST_DELAY, LONGEST_DELAY))
    assert near is not None
    gains = _by_block(bare, lost)
    visible = [
        np.sqrt(c * max(float(x.mean()), 0.0))
        for c, x in zip(problem.noise.count, lost, strict=True)
    ]
    test = replace(
        near,
        amplitudes=np.array([delay]),
        p_value=float(
            special.fdtrc(
                1, max(len(gains) - 1, 1), delay**2 / max(float(near.covariance[0, 0]), 1e-300)
            )
        ),
        visible_rms=float(max(visible)),
        joint=int(np.argmax(visible)),
        gains=gains,
    )
    price = np.log(sum(map(len, lost))) + 2 * np.log(len(TRIED))
    return SelectedEffect(CATALOGUE["torque_delay"], (), {}, test, test.gain - float(price))


def _delay_test(regression: WhitenedRegression, delay: float, step: float) -> SignificanceTest:
    """Return the test of what torques are late by jointly with a delay, their slope taken over twice a step [s]."""
    moved = _moved(regression, np.array([delay - step, delay, delay + step]))
    rows = zip(regression.joints, moved, strict=True)
    there = replace(regression, joints=tuple(replace(each, y=y[1]) for each, y in rows))
    slopes = [(y[:1] - y[2:]) / (2 * step) for y in moved]
    return significance_test(
        there, {each.joint: x for each, x in zip(regression.joints, slopes, strict=True)}
    )


def _inside(regression: WhitenedRegression) -> WhitenedRegression:
    """Return the rows that have a torque at every delay that is tried; those of earlier logs stay as they are."""
    inside = [
        (s.t >= s.t[0] + LONGEST_DELAY) & (s.t <= s.t[-1] - LONGEST_DELAY) | (not s.is_new)
        for s in regression.segments
    ]
    every, joints = np.concatenate(inside), []
    for rows in regression.joints:
        kept = every[rows.index]
        joints.append(
            replace(
                rows,
                A=rows.A[kept],
                y=rows.y[kept],
                block=rows.block[kept],
                log=rows.log[kept],
                index=rows.index[kept],
            )
        )
    return replace(regression, segments=cut(regression.segments, inside), joints=tuple(joints))


def _moved(regression: WhitenedRegression, delays: Floats) -> list[Floats]:
    """Return the whitened torques of each joint, those of new logs moved back by delays, (T,) [s], each (T, M_j)."""
    from scipy.interpolate import CubicSpline

    torques = []
    for s in regression.segments:
        wanted = np.clip(s.t + (delays if s.is_new else 0.0 * delays)[:, None], s.t[0], s.t[-1])
        torques.append(np.asarray(CubicSpline(s.t, s.tau, axis=0)(wanted)))
    return [
        regression.whiten(rows.joint, [tau[:, :, rows.joint] for tau in torques])
        for rows in regression.joints
    ]


def _by_block(regression: WhitenedRegression, values: list[Floats]) -> Floats:
    """Return sums of values of the rows of each joint over blocks of time, (B,)."""
    names, index = np.unique(
        np.concatenate([rows.block for rows in regression.joints]), return_inverse=True
    )
    return np.asarray(np.bincount(index, np.concatenate(values), len(names)), dtype=np.float64)
