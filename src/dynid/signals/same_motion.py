"""Whether two recordings are of the same commanded motion: they count as one motion, for they teach and judge alike.

A second recording of a command repeats everything that the model lacks along with everything that it has. It tells the
noise; it does not tell what the parameters are worth on other motions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid import limits
from dynid.longarrays import release
from dynid.signals.pieces import samples_where

Floats = NDArray[np.float64]

#: Rate at which positions are compared [Hz].
RATE = 5.0
#: Of a pause in a recording, no more than this is compared [s]: it has no samples, however long it is.
PAUSE = 1.0
#: Instants that are looked up together.
TOGETHER = 4096
#: Two motions are the same when the positions of every joint differ by at most this share of its range ...
ALIKE = 0.05
#: ... over at least this share of the shorter one, wherever in the other it begins.
OVERLAP = 0.7
#: A joint that moves by less than this share of the largest range counts as still.
STILL = 0.02


def sampled(t: Floats, q: Floats, rate: float = RATE) -> Floats:
    """Return positions at the rate at which motions are compared, with short pauses, (M, n) [rad or m].

    Args:
        t: time, (N,) [s].
        q: positions, (N, n) [rad or m].
        rate: [Hz].
    """
    pauses = samples_where(len(t) - 1, lambda part: np.diff(t[part.start : part.stop + 1]) > PAUSE)
    lost = np.concatenate([[0.0], np.cumsum(t[pauses + 1] - t[pauses] - PAUSE)])
    ends = t[pauses + 1] - lost[1:]
    limits.check("samples", (t[-1] - lost[-1] - t[0]) * rate, "a log")
    grid = np.arange(t[0], t[-1] - lost[-1], 1.0 / rate)
    found = np.empty((len(grid), q.shape[1]))
    for start in range(0, len(grid), TOGETHER):
        part = grid[start : start + TOGETHER]
        part = part + lost[np.searchsorted(ends, part, side="right")]
        near = slice(max(0, int(np.searchsorted(t, part[0])) - 1), int(np.searchsorted(t, part[-1])) + 1)
        found[start : start + TOGETHER] = np.column_stack([np.interp(part, t[near], column) for column in q[near].T])
        release()
    return found


def same_motion(one: Floats, other: Floats) -> bool:
    """Return whether two motions are one command, at whatever time either recording began.

    Args:
        one: positions from ``sampled``, (M, n) [rad or m].
        other: the same of another recording, (K, n).
    """
    if one.shape[1] != other.shape[1] or min(len(one), len(other)) < 2:
        return False
    reach = np.maximum(np.ptp(one, axis=0), np.ptp(other, axis=0))
    moving = reach > STILL * max(float(reach.max()), 1e-12)
    # Why from the middle: squares of what both have in common would drown what differs.
    middle = one[:, moving].mean(axis=0)
    a, b = ((x[:, moving] - middle) / reach[moving] for x in (one, other))
    needed = max(2, int(np.ceil(OVERLAP * min(len(a), len(b)))))
    lags = np.arange(needed - len(b), len(a) - needed + 1)
    first = np.maximum(0, lags)
    count = np.minimum(len(a), lags + len(b)) - first
    for x, y in zip(a.T, b.T, strict=True):
        squares = _sums(x, first, count) + _sums(y, first - lags, count) - 2.0 * _products(x, y)[lags]
        alike = squares < ALIKE**2 * count
        if not alike.any():
            return False
        lags, first, count = lags[alike], first[alike], count[alike]
    return True


def _sums(x: Floats, first: NDArray[np.intp], count: NDArray[np.intp]) -> Floats:
    """Return sums of squares of one joint over so many rows from each place, (lags,)."""
    total = np.concatenate([[0.0], np.cumsum(x**2)])
    return np.asarray(total[first + count] - total[first])


def _products(a: Floats, b: Floats) -> Floats:
    """Return sums of products of two motions of a joint by how many rows the second is moved, negative from the end."""
    size = len(a) + len(b)
    return np.asarray(np.fft.irfft(np.fft.rfft(a, size) * np.fft.rfft(b, size).conj(), size))


def motion_numbers(motions: Sequence[Floats]) -> tuple[int, ...]:
    """Return the number of the motion that each recording is of: equal numbers, equal commands.

    Args:
        motions: positions of each recording from ``sampled``.
    """
    firsts: list[int] = []
    numbers = []
    for k, motion in enumerate(motions):
        same = next((n for n, first in enumerate(firsts) if same_motion(motions[first], motion)), len(firsts))
        if same == len(firsts):
            firsts.append(k)
        numbers.append(same)
    return tuple(numbers)
