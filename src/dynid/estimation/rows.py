"""Rows of the observation matrix in time order: what filtered logs say about the parameters (Paper Eq. 23).

    tau = W theta + noise

They are evaluated from conditioned logs and filtered like the torques. Least squares needs only their triangular
factors; estimators that look at residuals have the rows themselves.

Rows at velocity reversals are not fitted. A joint that reverses creeps and sticks for some milliseconds, at
velocities below the encoder's noise. The Coulomb column is wrong there, each time in the same way, and biases
friction and inertia.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dynid.arrays import Floats, Ints, Mask
from dynid.estimation import tuning
from dynid.estimation.factor import triangle
from dynid.model.regressor import Observer
from dynid.signals.conditioned_log import ConditionedLog, Segment
from dynid.signals.filters import Filter, decimate

#: Arrays of rows that are joined and taken.
ARRAYS = ("W", "tau", "use", "t", "log", "block", "begins")


@dataclass(frozen=True)
class Rows:
    """Rows in order of time: M instants of one log after the other, n joints, p columns.

    Attributes:
        W: base regressor after the parallel filter, (M, n, p) [N m or N per unit of each parameter].
        tau: torques after the parallel filter, (M, n) [N m or N].
        use: rows that count, (M, n).
        t: time, (M,) [s].
        log: number of the log, (M,).
        block: number of the block of time, (M,).
        begins: whether there is a gap before, (M,).
        cutoff: cut-off frequency of the parallel filter [Hz]; 0 for none.
        Z: instruments, (M, n, p): the regressor on the commanded motion, which knows no measurement noise.
    """

    W: Floats
    tau: Floats
    use: Mask
    t: Floats
    log: Ints
    block: Ints
    begins: Mask
    cutoff: float = 0.0
    Z: Floats | None = None

    @classmethod
    def of(cls, W: Floats, tau: Floats, t: Floats | None = None) -> Rows:
        """Return the rows of one run without gaps, W (M, n, p) and tau (M, n), at times t, (M,) [s]."""
        t = np.arange(len(tau), dtype=float) if t is None else t
        zero, use = np.zeros(len(tau), dtype=np.int64), np.ones(tau.shape, dtype=bool)
        return cls(W, tau, use, t, zero, zero, np.arange(len(tau)) == 0)

    @property
    def size(self) -> int:
        """Number of columns p."""
        return int(self.W.shape[2])

    @cached_property
    def seen(self) -> Mask:
        """Columns that the rows of a joint have at all, (n, p): the links before it do not load it."""
        return np.asarray(self.W.any(axis=0))

    @property
    def runs(self) -> list[slice]:
        """The runs of rows without gaps."""
        edges = np.append(np.flatnonzero(self.begins), len(self.t)).tolist()
        return [slice(*ends) for ends in pairwise(edges)]

    @property
    def instruments(self) -> Floats:
        """The instruments, (M, n, p); the regressor where there are none."""
        return self.W if self.Z is None else self.Z

    def torque(self, theta: Floats) -> Floats:
        """Return W theta of parameters (p,), (M, n) [N m or N]."""
        return self.W @ theta

    def residual(self, theta: Floats) -> Floats:
        """Return tau - W theta, (M, n) [N m or N]; zero where rows do not count."""
        return np.where(self.use, self.tau - self.torque(theta), 0.0)

    def take(self, chosen: Mask) -> Rows:
        """Return some of the rows, (M,); views of them where they follow each other."""
        k = np.flatnonzero(chosen)
        follow = len(k) and k[-1] - k[0] == len(k) - 1
        at = slice(int(k[0]), int(k[-1]) + 1) if follow else k
        taken = replace(self, **{name: getattr(self, name)[at] for name in ARRAYS})
        begins = taken.begins | (np.diff(k, prepend=-2) != 1)
        return replace(taken, begins=begins, Z=None if self.Z is None else self.Z[at])

    def factors(self, weight: Floats | None = None) -> Floats:
        """Return the triangular factor of [W tau] of each joint, (n, p + 1, p + 1) [N m or N].

        Args:
            weight: factor on each row, (M, n); None for ones.
        """
        factors = np.zeros((len(self.seen), self.size + 1, self.size + 1))
        for j, (use, seen) in enumerate(zip(self.use.T, self.seen, strict=True)):
            rows = np.column_stack([self.W[:, j][np.ix_(use, seen)], self.tau[use, j]])
            if weight is not None:
                rows *= weight[use, j, None]
            place = np.append(np.flatnonzero(seen), self.size)
            factors[j][np.ix_(place, place)] = triangle(rows)
        return factors

    @property
    def counts(self) -> Ints:
        """Number of rows of each joint, (n,)."""
        return self.use.sum(axis=0)


def joined(parts: Sequence[Rows]) -> Rows:
    """Return the rows of several, one after the other; logs as they are numbered, blocks numbered anew."""
    first = np.cumsum([0, *(each.block.max(initial=-1) + 1 for each in parts[:-1])])
    parts = [replace(each, block=k + each.block) for k, each in zip(first, parts, strict=True)]
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(each, name) for each in parts]) for name in ARRAYS
    }
    return replace(parts[-1], **arrays) if len(parts) > 1 else parts[0]


# ---------------------------------------------------------------- evaluation
def rows_of(log: ConditionedLog, observer: Observer, *, reversals: bool = True) -> Rows:
    """Return the filtered rows of one log.

    Args:
        log: the conditioned log.
        observer: the columns to evaluate.
        reversals: count rows at velocity reversals, too.
    """
    chosen, counts, t = log.filter, _counts(log), row_times(log)
    edges = np.cumsum([0, *counts])
    taps, step = chosen.second_kernel.shape[1], chosen.second_step
    usable = [sliding_window_view(s.usable, taps, axis=0)[::step].all(axis=2) for s in pieces(log)]
    use = np.concatenate(usable)
    for segment, at in zip(log.segments, np.split(np.arange(len(t)), edges[1:-1]), strict=True):
        if not reversals and segment.coulomb_sign.size:
            times = reversal_times(segment, chosen.position_cutoff)
            use[at] &= np.array([_far(t[at], each, chosen.cutoff) for each in times]).T
    return Rows(
        W=regressor_of(log, observer),
        tau=at_rows(log, lambda part: part.tau.T),
        use=use,
        t=t,
        log=np.zeros(len(t), dtype=np.int64),
        block=_blocks(counts, chosen),
        begins=np.isin(np.arange(len(t)), edges),
        cutoff=chosen.cutoff,
    )


def regressor_of(log: ConditionedLog, observer: Observer) -> Floats:
    """Return the regressor at the rows of a log, (M, n, p).

    Added effects come with the log, and so do Coulomb signs where it has them: filtered as the torques were.
    """

    def entries(part: Segment) -> Floats:
        sign = part.coulomb_sign if part.coulomb_sign.size else None
        rigid = observer.entries(part.q, part.qd, part.qdd, sign)
        return np.vstack([rigid, part.effects.T[observer.added_entries]])

    filtered = at_rows(log, entries)
    W = np.zeros((len(filtered), *observer.shape))
    W[:, observer.rows, observer.cols] = filtered
    return W


def on_command(log: ConditionedLog) -> ConditionedLog:
    """Return a log that moved as it was commanded."""

    def moved(segment: Segment) -> Segment:
        q, t = segment.command_q, segment.t
        qd = np.gradient(q, t, axis=0)
        qdd, none = np.gradient(qd, t, axis=0), np.empty((len(t), 0))
        return replace(segment, q=q, qd=qd, qdd=qdd, coulomb_sign=none)

    return replace(log, segments=[moved(segment) for segment in log.segments])


def row_times(log: ConditionedLog) -> Floats:
    """Return the times of the rows of a log, (M,) [s]."""
    half, step = log.filter.second_kernel.shape[1] // 2, log.filter.second_step
    return np.concatenate([part.t[half : len(part) - half : step] for part in pieces(log)])


def at_rows(log: ConditionedLog, made: Callable[[Segment], Floats]) -> Floats:
    """Return what is made of a motion, (C, N), at the rows of a log under the filter of the torques, (M, C)."""
    return np.concatenate([parallel_filtered(made(part), log.filter).T for part in pieces(log)])


def pieces(log: ConditionedLog) -> Iterator[Segment]:
    """Yield the segments of a log in pieces that are evaluated at once, so that the memory of long logs stays small."""
    step, taps = log.filter.second_step, log.filter.second_kernel.shape[1]
    together = max(1, tuning.ROWS_EVALUATED // step)
    for segment, count in zip(log.segments, _counts(log), strict=True):
        for start in range(0, count, together):
            last = min(start + together, count) - 1
            yield segment[start * step : last * step + taps]


def parallel_filtered(signals: Floats, chosen: Filter) -> Floats:
    """Return signals under the filter of the torques, (C, N) -> (C, M)."""
    kernel, step = chosen.second_kernel, chosen.second_step
    return decimate(signals, kernel, step)[0]


def _counts(log: ConditionedLog) -> list[int]:
    """Return how many rows each segment makes."""
    taps, step = log.filter.second_kernel.shape[1], log.filter.second_step
    return [max(0, (len(segment) - taps) // step + 1) for segment in log.segments]


def _blocks(counts: Sequence[int], chosen: Filter) -> Ints:
    """Return the number of the block of time of each row; blocks of a segment are as long as each other."""
    seconds = round(chosen.kept_rate * tuning.BLOCK_SECONDS)
    length = max(1, seconds, -(-sum(counts) // tuning.MOST_BLOCKS))
    numbers, first = [np.zeros(0, dtype=np.int64)], 0
    for count in filter(None, counts):
        edges = np.linspace(0, count, max(1, round(count / length)) + 1).astype(int)
        numbers.append(first + np.searchsorted(edges, np.arange(count), side="right") - 1)
        first += len(edges) - 1
    return np.concatenate(numbers)


def _far(t: Floats, times: Floats, cutoff: float) -> Mask:
    """Return which rows are far from all reversals of a joint, (M,)."""
    ends = np.concatenate([[-np.inf], times, [np.inf]])
    after = np.searchsorted(times, t)
    nearest = np.minimum(t - ends[after], ends[after + 1] - t)
    return nearest >= tuning.REVERSAL / cutoff


def reversal_times(segment: Segment, cutoff: float) -> tuple[Floats, ...]:
    """Return when each joint reverses, n arrays (k,) [s]; several within a period of the cut-off count as one.

    Args:
        segment: conditioned motion with Coulomb signs.
        cutoff: cut-off frequency of the position filter [Hz].
    """
    reversals = []
    for sign in segment.coulomb_sign.T:
        k = np.flatnonzero(np.signbit(sign[1:]) != np.signbit(sign[:-1]))
        times = segment.t[k] + sign[k] / (sign[k] - sign[k + 1]) * np.diff(segment.t)[k]
        first = np.flatnonzero(np.diff(times, prepend=-np.inf) > 1.0 / cutoff)
        if len(times):
            times = np.add.reduceat(times, first) / np.diff(first, append=len(times))
        reversals.append(times)
    return tuple(reversals)


def robust_noise(rows: Rows, theta: Floats) -> Floats:
    """Return the standard deviation that the middle of each joint's residuals suggests, (n,) [N m or N]."""
    size = np.abs(rows.residual(theta))
    middle = [
        np.median(x[use]) if use.any() else 0.0 for x, use in zip(size.T, rows.use.T, strict=True)
    ]
    least = 1e-12 * max(float(size.max(initial=0.0)), 1e-18)
    return np.maximum(1.4826 * np.array(middle), least)
