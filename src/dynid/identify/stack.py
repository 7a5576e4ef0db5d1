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
    """

    t: Floats
    W: Floats
    tau: Floats
    usable: NDArray[np.bool_]
    block: int


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
    entries = decimate(np.concatenate(evaluated, axis=1), kernel, step)[0]
    tau = decimate(np.ascontiguousarray(segment.tau[part].T), kernel, step)[0]
    spoilt = decimate(np.ascontiguousarray((~segment.usable[part]).T.astype(float)), np.ones_like(kernel), step)[0]
    W = np.zeros((last - first, *observer.shape))
    W[:, observer.rows, observer.cols] = entries.T
    centre = part.start + (taps - 1) // 2
    t = segment.t[centre : centre + (last - first - 1) * step + 1 : step]
    return Rows(t, W, np.ascontiguousarray(tau.T), spoilt.T < 0.5, block)


@dataclass(frozen=True)
class Factor:
    """Triangular factor of the rows of one joint in one block of time: [W tau] = Q R.

    Attributes:
        R: (p + 1, p + 1) upper triangular, or fewer rows; the last column belongs to the torque.
        count: number of rows in it.
    """

    R: Floats
    count: int


@dataclass(frozen=True)
class Stack:
    """The observation matrix of one or several logs as triangular factors.

    Attributes:
        names: base parameters, (p,).
        joints: joint names, (n,).
        factors: one a log, block of time and joint: ``factors[b][j]``.
        logs: number of the log of each block.
        start: time of the first row of each block [s].
        sources: the logs, for methods that need single rows.
        observer: the columns.
    """

    names: tuple[str, ...]
    joints: tuple[str, ...]
    factors: tuple[tuple[Factor, ...], ...]
    logs: tuple[int, ...]
    start: tuple[float, ...]
    sources: tuple[Source, ...] = field(default=(), repr=False, compare=False)
    observer: Observer | None = field(default=None, repr=False, compare=False)

    @property
    def samples(self) -> int:
        """Number of instants in the stack."""
        return sum(max(factor.count for factor in block) for block in self.factors)

    def joint_factor(self, joint: int, blocks: Sequence[int] | None = None) -> Factor:
        """Return the factor of one joint over some blocks (all when None)."""
        chosen = range(len(self.factors)) if blocks is None else blocks
        parts = [self.factors[b][joint] for b in chosen]
        stacked = np.concatenate([part.R for part in parts]) if parts else np.zeros((0, len(self.names) + 1))
        R = np.linalg.qr(stacked, mode="r") if len(stacked) > len(self.names) + 1 else stacked
        return Factor(R, sum(part.count for part in parts))


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
    factors: list[list[Factor]] = []
    logs: list[int] = []
    start: list[float] = []
    active = [np.unique(observer.cols[observer.rows == j]) for j in range(len(joints))]
    for number, source in enumerate(sources):
        offset = len(factors)
        expected = sum(len(s) for s in source.segments)
        done = 0
        for rows in rows_of(source, observer):
            if rows.block + offset == len(factors):
                factors.append([Factor(np.zeros((0, len(names) + 1)), 0) for _ in joints])
                logs.append(number)
                start.append(float(rows.t[0]))
            current = factors[-1]
            for j in range(len(joints)):
                current[j] = _folded(current[j], rows, j, active[j])
            done += len(rows.t) * source.chosen.second_step
            progress.advance(number + min(1.0, done / expected), len(sources), source.name)
    return Stack(names, joints, tuple(tuple(block) for block in factors), tuple(logs), tuple(start), tuple(sources), observer)


def _folded(factor: Factor, rows: Rows, joint: int, active: NDArray[np.intp]) -> Factor:
    """Add rows of one joint to its factor; only the columns that this joint has are worked on."""
    good = rows.usable[:, joint]
    columns = np.append(active, rows.W.shape[2])
    block = np.column_stack([rows.W[good][:, joint, active], rows.tau[good, joint]])
    small = np.linalg.qr(np.concatenate([factor.R[:, columns], block]), mode="r")
    R = np.zeros((len(small), rows.W.shape[2] + 1))
    R[:, columns] = small
    return Factor(R, factor.count + int(good.sum()))
