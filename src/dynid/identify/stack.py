"""Stack the base regressor over logs without ever storing it whole (Paper Eq. 23).

Rows are made block by block, filtered like the torques, and folded into one small triangular factor for each joint and
each block of time. Everything linear (ordinary and weighted least squares, hold-out, block bootstrap) needs only those;
methods that look at single rows walk over them again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dynid.identify.least_squares import accumulate, merge
from dynid.model.regressor import Observer
from dynid.progress import SILENT, Progress
from dynid.quality.condition import Filter, Segment
from dynid.quality.filters import decimate

Floats = NDArray[np.float64]

#: Length of a block of time [s]: longer than the correlation of the residuals, short enough for a fine hold-out.
BLOCK_SECONDS = 1.0
#: At most this many blocks a log, so that the factors of an hour stay small.
MOST_BLOCKS = 64
#: Samples evaluated at once.
_EVALUATED = 4096


@dataclass(frozen=True)
class Rows:
    """Rows of one stretch of time.

    Attributes:
        t: (M,) [s].
        W: base regressor after the parallel filter, (M, n, p).
        tau: torques after the parallel filter, (M, n).
        usable: rows that count, (M, n).
        block: number of the block of time they belong to.
        starts_segment: whether a stretch without gaps begins here.
    """

    t: Floats
    W: Floats
    tau: Floats
    usable: NDArray[np.bool_]
    block: int
    starts_segment: bool


@dataclass(frozen=True)
class Source:
    """One conditioned log: what rows are made from.

    Attributes:
        segments: stretches without gaps.
        chosen: its filters.
        name: where it came from.
    """

    segments: Sequence[Segment]
    chosen: Filter
    name: str


def rows_of(source: Source, observer: Observer) -> Iterator[Rows]:
    """Yield the filtered rows of one log, block of time by block of time.

    Args:
        source: the conditioned log.
        observer: the columns to evaluate.
    """
    chosen = source.chosen
    kernel, step = chosen.second_kernel, chosen.second_step
    taps = kernel.shape[1]
    outputs = [max(0, (len(s) - taps) // step + 1) for s in source.segments]
    total = sum(outputs)
    per_block = max(1, round(chosen.kept_rate * BLOCK_SECONDS), -(-total // MOST_BLOCKS))
    block = 0
    for segment, count in zip(source.segments, outputs, strict=True):
        blocks = max(1, round(count / per_block)) if count else 0
        edges = np.linspace(0, count, blocks + 1).astype(int)
        for start, end in zip(edges[:-1], edges[1:], strict=True):
            most = max(1, _EVALUATED // step)
            for first in range(start, end, most):
                yield _rows(segment, observer, kernel, step, first, min(first + most, end), block)
            block += 1


def _rows(segment: Segment, observer: Observer, kernel: Floats, step: int, first: int, last: int, block: int) -> Rows:
    taps = kernel.shape[1]
    part = slice(first * step, (last - 1) * step + taps)
    evaluated = [e.copy() for _, e in observer.blocks(segment.q[part], segment.qd[part], segment.qdd[part])]
    signals = np.concatenate(evaluated, axis=1)
    if len(observer.course_entries):
        signals = np.vstack([signals, segment.effects[part].T[observer.course_entries]])
    entries = decimate(signals, kernel, step)[0]
    tau = decimate(np.ascontiguousarray(segment.tau[part].T), kernel, step)[0]
    spoilt = decimate(np.ascontiguousarray((~segment.usable[part]).T.astype(float)), np.ones_like(kernel), step)[0]
    W = np.zeros((last - first, *observer.shape))
    W[:, observer.rows, observer.cols] = entries.T
    centre = part.start + (taps - 1) // 2
    t = segment.t[centre : centre + (last - first - 1) * step + 1 : step]
    return Rows(t, W, np.ascontiguousarray(tau.T), spoilt.T < 0.5, block, first == 0)


@dataclass(frozen=True)
class Stack:
    """The observation matrix of one or several logs as triangular factors.

    Attributes:
        names: base parameters, (p,).
        joints: joint names, (n,).
        factors: factor of [W tau] for each block of time and joint, (B, n, p + 1, p + 1).
        rows: number of rows in each, (B, n).
        logs: number of the log of each block, (B,).
        start: time of the first row of each block, (B,) [s].
        sources: the logs, for methods that look at single rows.
        observer: the columns.
    """

    names: tuple[str, ...]
    joints: tuple[str, ...]
    factors: Floats
    rows: NDArray[np.int64]
    logs: NDArray[np.int64]
    start: Floats
    sources: tuple[Source, ...] = field(default=(), repr=False, compare=False)
    observer: Observer | None = field(default=None, repr=False, compare=False)

    @property
    def blocks(self) -> int:
        """Number of blocks of time."""
        return len(self.factors)

    @property
    def samples(self) -> int:
        """Number of instants in the stack."""
        return int(self.rows.max(axis=1).sum()) if len(self.rows) else 0

    def joint_factors(self, chosen: NDArray[np.bool_] | None = None) -> tuple[Floats, NDArray[np.int64]]:
        """Return one factor a joint over the chosen blocks, (n, p + 1, p + 1), and its number of rows, (n,)."""
        mask = np.ones(self.blocks, dtype=bool) if chosen is None else chosen
        return np.array([merge(part) for part in self.factors[mask].swapaxes(0, 1)]), self.rows[mask].sum(axis=0)


def stack(
    sources: Sequence[Source],
    observer: Observer,
    names: tuple[str, ...],
    joints: tuple[str, ...],
    progress: Progress = SILENT,
) -> Stack:
    """Fold conditioned logs into triangular factors.

    Args:
        sources: conditioned logs.
        observer: evaluator of the base columns.
        names: names of the base parameters.
        joints: joint names.
        progress: told how far the work is.
    """
    n, size = len(joints), len(names) + 1
    factors: list[Floats] = []
    counts: list[NDArray[np.int64]] = []
    logs: list[int] = []
    start: list[float] = []
    active = [np.unique(observer.cols[observer.rows == j]) for j in range(n)]
    for number, source in enumerate(sources):
        first = len(factors)
        expected = sum(len(s) for s in source.segments)
        done = 0
        for rows in rows_of(source, observer):
            if rows.block + first == len(factors):
                factors.append(np.zeros((n, size, size)))
                counts.append(np.zeros(n, dtype=np.int64))
                logs.append(number)
                start.append(float(rows.t[0]))
            for j in range(n):
                counts[-1][j] += _fold(factors[-1][j], rows, j, active[j])
            done += len(rows.t) * source.chosen.second_step
            progress.advance(number + min(1.0, done / expected), len(sources), source.name)
    shape = (len(factors), n, size, size)
    return Stack(
        names, joints, np.array(factors).reshape(shape), np.array(counts, dtype=np.int64).reshape(shape[:2]),
        np.array(logs), np.array(start), tuple(sources), observer,
    )  # fmt: skip


def _fold(R: Floats, rows: Rows, joint: int, active: NDArray[np.intp]) -> int:
    """Add the rows of one joint to its factor in place; only the columns that this joint has are worked on."""
    good = rows.usable[:, joint]
    columns = np.append(active, rows.W.shape[2])
    small = accumulate(R[np.ix_(columns, columns)], rows.W[good][:, joint, active], rows.tau[good, joint])
    R[np.ix_(columns, columns)] = small
    return int(good.sum())
