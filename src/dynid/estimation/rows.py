"""Rows of the observation matrix in time order: what filtered logs say about the parameters (Paper Eq. 23).

    tau = W theta + noise

They are evaluated from conditioned logs and filtered like the torques. Least squares needs only their triangular
factors; estimators that look at residuals have the rows themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from dynid.arrays import Floats, Ints, Mask
from dynid.estimation import tuning
from dynid.estimation.factor import triangle
from dynid.model.regressor import Observer
from dynid.signals.conditioned_log import ConditionedLog, Segment
from dynid.signals.filters import Filter, decimate

#: Arrays of rows that are joined and taken.
ARRAYS = ("W", "tau", "use", "t", "log", "begins")


@dataclass(frozen=True)
class Rows:
    """Rows in order of time: M instants of one log after the other, n joints, p columns.

    W has its columns one after the other. Many are not those of many joints: zeros that nobody wrote take no memory.

    Attributes:
        W: base regressor after the parallel filter, (M, n, p) [N m or N per unit of each parameter].
        tau: torques after the parallel filter, (M, n) [N m or N].
        use: rows that count, (M, n).
        t: time, (M,) [s].
        log: number of the log, (M,).
        begins: whether there is a gap before, (M,).
        cutoff: cut-off frequency of the parallel filter [Hz]; 0 for none.
        Z: instruments, (M, n, p): the regressor on the commanded motion, which knows no measurement noise.
    """

    W: Floats
    tau: Floats
    use: Mask
    t: Floats
    log: Ints
    begins: Mask
    cutoff: float = 0.0
    Z: Floats | None = None

    @classmethod
    def of(cls, W: Floats, tau: Floats, t: Floats | None = None) -> Rows:
        """Return the rows of one run without gaps, W (M, n, p) and tau (M, n), at times t, (M,) [s]."""
        t = np.arange(len(tau), dtype=float) if t is None else t
        zero, use = np.zeros(len(tau), dtype=np.int64), np.ones(tau.shape, dtype=bool)
        return cls(W, tau, use, t, zero, np.arange(len(tau)) == 0)

    @property
    def size(self) -> int:
        """Number of columns p."""
        return int(self.W.shape[2])

    @property
    def runs(self) -> list[slice]:
        """The runs of rows without gaps."""
        edges = np.append(np.flatnonzero(self.begins), len(self.t)).tolist()
        return [slice(*ends) for ends in pairwise(edges)]

    @property
    def progress(self) -> Floats:
        """Which share of the rows of its log comes before each row, (M,)."""
        first, last = (np.searchsorted(self.log, self.log, side) for side in ("left", "right"))
        return (np.arange(len(self.log)) - first) / (last - first)

    @property
    def instruments(self) -> Floats:
        """The instruments, (M, n, p); the regressor where there are none."""
        return self.W if self.Z is None else self.Z

    def torque(self, theta: Floats) -> Floats:
        """Return W theta of parameters (p,), (M, n) [N m or N]."""
        return np.array([of_joint @ theta for of_joint in self.W.swapaxes(0, 1)]).T

    def residual(self, theta: Floats) -> Floats:
        """Return tau - W theta, (M, n) [N m or N]; zero where rows do not count."""
        return np.where(self.use, self.tau - self.torque(theta), 0.0)

    def scores(self, residual: Floats) -> Floats:
        """Return Z^T r of each instant, (M, p), for weighted residuals r, (M, n)."""
        return np.einsum("pjm,jm->pm", self.instruments.T, residual.T).T

    def take(self, chosen: Mask) -> Rows:
        """Return some of the rows, (M,); views of them where they follow each other."""
        k = np.flatnonzero(chosen)
        follow = len(k) and k[-1] - k[0] == len(k) - 1
        at = slice(int(k[0]), int(k[-1]) + 1) if follow else k
        arrays: dict[str, Any] = {name: getattr(self, name).T[..., at].T for name in ARRAYS}
        taken = replace(self, **arrays)
        return replace(taken, begins=taken.begins | (np.diff(k, prepend=-2) != 1))

    def factors(self, weight: Floats | None = None, *more: Floats) -> Floats:
        """Return the triangular factor of [more W tau] of each joint, (n, k + p + 1, k + p + 1) [N m or N].

        Args:
            weight: factor on each row, (M, n); None for ones.
            more: further columns, (M, n, k).
        """
        blocks = *more, self.W, self.tau[:, :, None]
        factors = []
        for j, use in enumerate(self.use.T):
            rows = np.hstack([x[use, j] for x in blocks])
            factors.append(triangle(rows if weight is None else rows * weight[use, j, None]))
        return np.array(factors)

    @property
    def counts(self) -> Ints:
        """Number of rows of each joint, (n,)."""
        return self.use.sum(axis=0)


def joined(parts: Sequence[Rows]) -> Rows:
    """Return the rows of several, one after the other; logs as they are numbered."""
    if len(parts) == 1:
        return parts[0]
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(each, name) for each in parts]) for name in ARRAYS
    }
    return replace(parts[-1], **arrays)


# ---------------------------------------------------------------- evaluation
def rows_of(log: ConditionedLog, observer: Observer) -> Rows:
    """Return the filtered rows of one log.

    Args:
        log: the conditioned log.
        observer: the columns to evaluate.
    """
    chosen, counts, t = log.filter, _counts(log), row_times(log)
    together = np.ones_like(chosen.second_kernel)
    lost = [
        decimate(np.where(part.usable.T, 0.0, 1.0), together, chosen.second_step)[0]
        for _, part in pieces(log)
    ]
    return replace(
        Rows.of(regressor_of(log, observer), at_rows(log, lambda part: part.tau.T), t),
        use=np.concatenate(lost, axis=1).T < 0.5,
        begins=np.isin(np.arange(len(t)), np.cumsum([0, *counts])),
        cutoff=chosen.cutoff,
    )


def regressor_of(log: ConditionedLog, observer: Observer) -> Floats:
    """Return the regressor at the rows of a log, (M, n, p).

    Added effects come with the log, and so do Coulomb signs where it has them: filtered as the torques were.
    """

    def entries(part: Segment) -> Floats:
        rigid = observer.entries(part.q, part.qd, part.qdd, part.coulomb_sign)
        return np.vstack([rigid, part.effects.T[observer.added_entries]])

    W = np.zeros((*observer.shape, sum(_counts(log))))
    for at, part in pieces(log):
        W[observer.rows, observer.cols, at] = parallel_filtered(entries(part), log.filter)
    return np.moveaxis(W, 2, 0)


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
    return np.concatenate([part.t[half : len(part) - half : step] for _, part in pieces(log)])


def at_rows(
    log: ConditionedLog, made: Callable[[Segment], Floats], t: Floats | None = None
) -> Floats:
    """Return what is made of a motion, (C, N), at the rows of a log under the filter of the torques, (M, C).

    Args:
        log: the conditioned log.
        made: what is made of a part of it.
        t: times of the rows that are wanted, (M,) [s]; None for all.
    """
    times = row_times(log)
    wanted = np.isin(times, times if t is None else t)
    parts = ((wanted[at], part) for at, part in pieces(log))
    filtered = [parallel_filtered(made(part), log.filter)[:, k] for k, part in parts if k.any()]
    return np.concatenate(filtered, axis=1).T


def pieces(log: ConditionedLog) -> Iterator[tuple[slice, Segment]]:
    """Yield which rows come from which piece of a log, of so many samples that the memory of long logs stays small."""
    step, taps = log.filter.second_step, log.filter.second_kernel.shape[1]
    together, first = max(1, tuning.ROWS_EVALUATED // step), 0
    for segment, count in zip(log.segments, _counts(log), strict=True):
        for start in range(0, count, together):
            end = min(start + together, count)
            yield slice(first + start, first + end), segment[start * step : (end - 1) * step + taps]
        first += count


def parallel_filtered(signals: Floats, chosen: Filter) -> Floats:
    """Return signals under the filter of the torques, (C, N) -> (C, M)."""
    return decimate(signals, chosen.second_kernel, chosen.second_step)[0]


def _counts(log: ConditionedLog) -> list[int]:
    """Return how many rows each segment makes."""
    taps, step = log.filter.second_kernel.shape[1], log.filter.second_step
    return [max(0, (len(segment) - taps) // step + 1) for segment in log.segments]


def robust_noise(rows: Rows, theta: Floats) -> Floats:
    """Return the standard deviation that the middle of each joint's residuals suggests, (n,) [N m or N]."""
    size = np.abs(rows.residual(theta))
    middle = [
        np.median(x[use]) if use.any() else 0.0 for x, use in zip(size.T, rows.use.T, strict=True)
    ]
    least = 1e-12 * max(float(size.max(initial=0.0)), 1e-18)
    return np.maximum(1.4826 * np.array(middle), least)
