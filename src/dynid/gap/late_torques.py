"""Torques that are late by tenths of a second: delays are tried one by one, and the best begins the search.

The slope of the model's torque stands for a short delay alone, and a model that was fitted to late torques has another
slope. Torques that are moved back know of neither.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from dynid.arrays import Floats
from dynid.gap.problem import GapProblem
from dynid.options import LONGEST_DELAY

#: Delays that are tried [s]: closer than half a period of what moves an arm, and further than the slope reaches.
TRIED = np.linspace(-LONGEST_DELAY, LONGEST_DELAY, 21)
#: Drop of twice the log likelihood from which a delay begins the search, and by which no joint may be worse with it:
#: all torques are late, or it is something else.
SURE = 24.0


def late_torques(problem: GapProblem) -> float:
    """Return the delay of all new torques that explains most [s]; 0 where none is sure.

    Args:
        problem: what is searched.
    """
    bare = problem.regression()
    rows, moved = bare.rows, np.zeros((*bare.rows.tau.T.shape, len(TRIED)))
    every = ~rows.is_new
    for part in rows.parts:
        t, new = rows.t[part], rows.is_new[part.start]
        every[part] |= (t >= t[0] + LONGEST_DELAY) & (t <= t[-1] - LONGEST_DELAY)
        wanted = np.clip(t[:, None] + TRIED * new, t[0], t[-1])
        moved[:, part] = CubicSpline(t, rows.tau[part], axis=0)(wanted).transpose(2, 0, 1)
    chosen, right = [], np.zeros((bare.baseline[0].shape[1], len(TRIED)))
    for j, baseline in enumerate(bare.baseline):
        kept = every[bare.noise.counting(rows, j)]
        A, y = baseline[kept], bare.noise.whiten(rows, j, moved[j].T)[:, kept]
        chosen.append((A, y))
        right += A.T @ y.T
    theta = bare.solved(right)
    left = np.array([np.sum((y - (A @ theta).T) ** 2, axis=1) for A, y in chosen])
    total = left.sum(axis=0)
    best, still = int(np.argmin(total)), len(TRIED) // 2
    # Why over what is left: a model that lacks something leaves more than noise, whatever the delay.
    noise = max(float(total[best]) / max(sum(y.shape[1] for _, y in chosen), 1), 1.0)
    gain: Floats = (left[:, still] - left[:, best]) / noise
    if gain.sum() < SURE or gain.min() < -SURE / 2:
        return 0.0
    near = slice(max(best - 1, 0), best + 2)
    bend, slope, _ = np.polyfit(TRIED[near] - TRIED[best], total[near], 2)
    step = -slope / (2 * bend) if bend > 0 else 0.0
    return float(np.clip(TRIED[best] + step, -LONGEST_DELAY, LONGEST_DELAY))
