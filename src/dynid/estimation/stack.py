"""Stack the base regressor over logs without ever storing it whole (Paper Eq. 23).

Rows are made block by block, filtered like the torques, and folded into one small triangular factor for each joint and
each block of time. Everything linear (ordinary and weighted least squares, hold-out, block bootstrap) needs only those;
methods that look at single rows walk over them again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.conditioned_log import ConditionedLog
from dynid.estimation.least_squares import accumulate, merge
from dynid.estimation.observation_rows import Rows
from dynid.model.regressor import Observer
from dynid.model.store import BaseModel
from dynid.progress import SILENT, Progress
from dynid.signals.conditioning import Segment
from dynid.signals.filters import decimate

Floats = NDArray[np.float64]

#: Length of a block of time [s]: longer than the correlation of the residuals, short enough for a fine hold-out.
BLOCK_SECONDS = 1.0
#: At most this many blocks a log, so that the factors of an hour stay small.
MOST_BLOCKS = 64
#: Samples evaluated at once.
_EVALUATED = 4096
#: Rows are kept, so that covariance and prediction need not evaluate them again, up to this size; beyond it in single
#: precision, and beyond twice of it not at all [bytes].
KEPT_BYTES = 64 << 20


@dataclass(frozen=True)
class Packed:
    """Filtered rows of one stretch of time, only the entries that are not zero by structure.

    Attributes:
        entries: of the base regressor, (E, M).
        command: the same on the commanded motion, None where the log has none.
        tau: torques, (M, n).
        usable: rows that count, (M, n).
        follows: whether the rows before it end where it begins.
        t: time, (M,) [s].
        block: number of the block of time.
        reversal_times: when each joint reverses in the stretch [s]; empty where the segment has no Coulomb signs.
        cutoff: of the parallel filter [Hz].
    """

    entries: NDArray[Any]
    command: NDArray[Any] | None
    tau: Floats
    usable: NDArray[np.bool_]
    follows: bool
    t: Floats
    block: int
    reversal_times: tuple[Floats, ...]
    cutoff: float

    def rows(self, observer: Observer) -> Rows:
        """Return the rows with their zeros."""
        Z = None if self.command is None else _dense(self.command, observer)
        W, times = _dense(self.entries, observer), (self.t, self.block, self.reversal_times, self.cutoff)
        return Rows(W, self.tau, Z, self.usable, self.follows, *times)

    def part(self, start: int, end: int, *, follows: bool, block: int) -> Packed:
        """Return some of the rows, copied so that they keep nothing else alive."""
        command = None if self.command is None else self.command[:, start:end].copy()
        entries, tau = self.entries[:, start:end].copy(), self.tau[start:end]
        times = (self.t[start:end], block, self.reversal_times, self.cutoff)
        return Packed(entries, command, tau, self.usable[start:end], follows, *times)

    def single(self) -> Packed:
        """Return the rows in single precision: enough to look at residuals once more, half the memory."""
        command = None if self.command is None else self.command.astype(np.float32)
        return replace(self, entries=self.entries.astype(np.float32), command=command)


def _dense(entries: NDArray[Any], observer: Observer) -> Floats:
    W = np.zeros((entries.shape[1], *observer.shape))
    W[:, observer.rows, observer.cols] = entries.T
    return W


def rows_of(log: ConditionedLog, observer: Observer) -> Iterator[Rows]:
    """Yield the filtered rows of one log, block of time by block of time.

    Args:
        log: the conditioned log.
        observer: the columns to evaluate.
    """
    for packed in _packed(log, observer):
        yield packed.rows(observer)


def _packed(log: ConditionedLog, observer: Observer) -> Iterator[Packed]:
    chosen = log.filter
    kernel, step = chosen.second_kernel, chosen.second_step
    taps = kernel.shape[1]
    outputs = [max(0, (len(s) - taps) // step + 1) for s in log.segments]
    per_block = max(1, round(chosen.kept_rate * BLOCK_SECONDS), -(-sum(outputs) // MOST_BLOCKS))
    together = max(1, _EVALUATED // step)
    block = 0
    for segment, count in zip(log.segments, outputs, strict=True):
        blocks = max(1, round(count / per_block)) if count else 0
        reversals = reversal_times(segment, chosen.position_cutoff) if taps > 1 else ()
        edges = np.linspace(0, count, blocks + 1).astype(int)
        for first in range(0, count, together):
            last = min(first + together, count)
            packed = replace(
                _evaluated(segment, observer, kernel, step, first, last), reversal_times=reversals, cutoff=chosen.cutoff
            )
            inside = edges[(edges > first) & (edges < last)]
            cuts = np.concatenate([[first], inside, [last]])
            for start, end in pairwise(cuts.tolist()):
                number = block + int(np.searchsorted(edges, start, side="right")) - 1
                yield packed.part(start - first, end - first, follows=start > 0, block=number)
        block += blocks


def _evaluated(segment: Segment, observer: Observer, kernel: Floats, step: int, first: int, last: int) -> Packed:
    part = slice(first * step, (last - 1) * step + kernel.shape[1])
    tau = decimate(np.ascontiguousarray(segment.tau[part].T), kernel, step)[0]
    usable = np.ones((last - first, observer.shape[0]), dtype=bool)
    if not segment.usable[part].all():
        invalid = (~segment.usable[part]).T.astype(float)
        usable = decimate(np.ascontiguousarray(invalid), np.ones_like(kernel), step)[0].T < 0.5
    command, effects = segment.command, segment.effects[part]
    motion = (segment.q[part], segment.qd[part], segment.qdd[part])
    commanded = None if command is None else tuple(x[part] for x in command)
    signs = (segment.coulomb_sign[part], segment.command_coulomb_sign[part])
    return Packed(
        entries=_entries(motion, signs[0], effects, observer, kernel, step),
        command=None if commanded is None else _entries(commanded, signs[1], effects, observer, kernel, step),
        tau=np.ascontiguousarray(tau.T),
        usable=usable,
        follows=first > 0,
        t=segment.t[part.start + (kernel.shape[1] - 1) // 2 :: step][: last - first].copy(),
        block=0,
        reversal_times=(),
        cutoff=0.0,
    )


def reversal_times(segment: Segment, cutoff: float) -> tuple[Floats, ...]:
    """Return when each joint turns back [s]; what turns several times within a period of the cut-off turns once."""
    found = []
    for sign in segment.coulomb_sign.T:
        k = np.flatnonzero(np.signbit(sign[1:]) != np.signbit(sign[:-1]))
        share = sign[k] / (sign[k] - sign[k + 1])
        times = segment.t[k] + share * (segment.t[k + 1] - segment.t[k])
        groups = np.split(times, np.flatnonzero(np.diff(times) > 1.0 / cutoff) + 1)
        found.append(np.array([float(np.mean(group)) for group in groups if len(group)]))
    return tuple(found)


def _entries(
    motion: tuple[Floats, ...], sign: Floats, effects: Floats, observer: Observer, kernel: Floats, step: int
) -> Floats:
    """Return the base regressor's entries after the parallel filter, (E, M).

    Added effects come with the segment, and so do Coulomb signs where it has them: filtered as the torques were.
    """
    q, qd, qdd = motion
    blocks = observer.blocks(q, qd, qdd, sign if sign.size else None)
    entries = np.concatenate([e.copy() for _, e in blocks], axis=1)
    if len(observer.added_entries):
        entries = np.vstack([entries, effects.T[observer.added_entries]])
    kept: Floats = decimate(entries, kernel, step)[0]
    return kept


def with_logs(stacked: Stack, logs: Sequence[ConditionedLog]) -> Stack:
    """Return the stack with another commanded motion in its logs; its factors do not depend on that."""
    observer = stacked.observer
    kept = stacked.kept
    if kept is not None and observer is not None:
        kept = tuple(tuple(_packed(log, observer)) for log in logs)
    return replace(stacked, logs=tuple(logs), kept=kept)


@dataclass(frozen=True)
class Earlier:
    """What an earlier result keeps of its logs.

    Attributes:
        factors: one factor a joint, (n, p + 1, p + 1).
        noise: standard deviation of each joint then, (n,).
        covariance: honest covariance of its estimate, (p, p).
    """

    factors: Floats
    noise: Floats
    covariance: Floats


@dataclass(frozen=True)
class Stack:
    """The observation matrix of one or several logs as triangular factors.

    Attributes:
        names: base parameters, (p,).
        joints: joint names, (n,).
        factors: factor of [W tau] for each block of time and joint, (B, n, p + 1, p + 1).
        rows: number of rows in each, (B, n).
        log_of_block: number of the log of each block, (B,); -1 for an earlier result.
        start: time of the first row of each block, (B,) [s].
        logs: the conditioned logs, for methods that look at single rows.
        observer: the columns.
        kept: the single rows, when they are few enough to be kept.
        earlier: the result that was updated, None otherwise; its rows are block 0, of log -1.
    """

    names: tuple[str, ...]
    joints: tuple[str, ...]
    factors: Floats
    rows: NDArray[np.int64]
    log_of_block: NDArray[np.int64]
    start: Floats
    logs: tuple[ConditionedLog, ...] = field(default=(), repr=False, compare=False)
    observer: Observer | None = field(default=None, repr=False, compare=False)
    kept: tuple[tuple[Packed, ...], ...] | None = field(default=None, repr=False, compare=False)
    earlier: Earlier | None = field(default=None, repr=False, compare=False)

    def rows_of_log(self, number: int) -> Iterator[Rows]:
        """Yield the single rows of one log again; long logs are evaluated anew rather than stored."""
        if self.observer is None:
            return
        packed = _packed(self.logs[number], self.observer) if self.kept is None else self.kept[number]
        for rows in packed:
            yield rows.rows(self.observer)

    def rows_of_blocks(self, blocks: NDArray[np.bool_]) -> Iterator[Rows]:
        """Yield the single rows of some blocks of time, (B,), in order of time."""
        for number in range(len(self.logs)):
            first = int(np.searchsorted(self.log_of_block, number))
            for rows in self.rows_of_log(number):
                if blocks[first + rows.block]:
                    yield rows

    def __iter__(self) -> Iterator[Rows]:
        """Walk over the rows of all logs in order of time; may be done many times."""
        for number in range(len(self.logs)):
            yield from self.rows_of_log(number)

    @property
    def blocks(self) -> int:
        """Number of blocks of time."""
        return len(self.factors)

    @property
    def samples(self) -> int:
        """Number of instants in the stack."""
        return int(self.rows.max(axis=1).sum()) if len(self.rows) else 0

    @cached_property
    def whole(self) -> tuple[Floats, NDArray[np.int64]]:
        """One factor a joint over all blocks, (n, p + 1, p + 1), and its number of rows, (n,)."""
        return self.joint_factors(np.ones(self.blocks, dtype=bool))

    def joint_factors(self, mask: NDArray[np.bool_]) -> tuple[Floats, NDArray[np.int64]]:
        """Return one factor a joint over the chosen blocks, (n, p + 1, p + 1), and its number of rows, (n,)."""
        return np.array([merge(part) for part in self.factors[mask].swapaxes(0, 1)]), self.rows[mask].sum(axis=0)


def stack_base(logs: Sequence[ConditionedLog], base: BaseModel, progress: Progress = SILENT) -> Stack:
    """Fold conditioned logs into triangular factors of a model's base columns."""
    reduction = base.reduction
    observer = base.model.observer(reduction.base)
    progress.stage("stack")
    found = stack(logs, observer, reduction.base_names, base.robot.joint_names, progress)
    rows = f"{found.samples} samples x {len(found.joints)} joints"
    progress.stage("stacked", f"{rows} -> W {int(found.rows.sum())} x {len(found.names)}")
    return found


def stack(
    logs: Sequence[ConditionedLog],
    observer: Observer,
    names: tuple[str, ...],
    joints: tuple[str, ...],
    progress: Progress = SILENT,
) -> Stack:
    """Fold conditioned logs into triangular factors.

    Args:
        logs: conditioned logs.
        observer: evaluator of the base columns.
        names: names of the base parameters.
        joints: joint names.
        progress: told how far the work is.
    """
    n, size = len(joints), len(names) + 1
    factors: list[Floats] = []
    counts: list[NDArray[np.int64]] = []
    log_of_block: list[int] = []
    start: list[float] = []
    expected_rows = sum(len(s) // log.filter.second_step for log in logs for s in log.segments)
    single = 8 * expected_rows * len(observer.rows) > KEPT_BYTES
    keep = 4 * expected_rows * len(observer.rows) <= 2 * KEPT_BYTES
    kept: list[list[Packed]] = [[] for _ in logs]
    active = [np.unique(observer.cols[observer.rows == j]) for j in range(n)]
    for number, log in enumerate(logs):
        first = len(factors)
        expected = sum(len(s) for s in log.segments)
        done = 0
        for packed in _packed(log, observer):
            if keep:
                kept[number].append(packed.single() if single else packed)
            rows = packed.rows(observer)
            if rows.block + first == len(factors):
                factors.append(np.zeros((n, size, size)))
                counts.append(np.zeros(n, dtype=np.int64))
                log_of_block.append(number)
                start.append(float(rows.t[0]))
            for j in range(n):
                counts[-1][j] += _fold(factors[-1][j], rows, j, active[j])
            done += len(rows.t) * log.filter.second_step
            progress.advance(number + min(1.0, done / expected), len(logs), log.name)
    shape = (len(factors), n, size, size)
    return Stack(
        names, joints, np.array(factors).reshape(shape), np.array(counts, dtype=np.int64).reshape(shape[:2]),
        np.array(log_of_block), np.array(start), tuple(logs), observer,
        tuple(tuple(part) for part in kept) if keep else None,
    )  # fmt: skip


def _fold(R: Floats, rows: Rows, joint: int, active: NDArray[np.intp]) -> int:
    """Add the rows of one joint to its factor in place; only the columns that this joint has are worked on."""
    good = rows.mask[:, joint]
    columns = np.append(active, rows.W.shape[2])
    small = accumulate(R[np.ix_(columns, columns)], rows.W[good][:, joint, active], rows.tau[good, joint])
    R[np.ix_(columns, columns)] = small
    return int(good.sum())
