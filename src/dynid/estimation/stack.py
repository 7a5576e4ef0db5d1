"""The observation matrix of logs as triangular factors, without ever storing it whole (Paper Eq. 23).

Rows are made block by block and folded into one small triangular factor per joint and block of time. Everything linear
(ordinary and weighted least squares, hold-out) needs only those; methods that look at single rows walk over them again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.least_squares import Fit, merge, weighted
from dynid.estimation.observation_rows import ObservationRows, RowWalk, fold, rows_of
from dynid.estimation.velocity_reversal import ReversalEffects, reversal_effects
from dynid.longarrays import Growing, release
from dynid.model.base_model import BaseModel
from dynid.model.regressor import Observer
from dynid.progress import SILENT, Progress
from dynid.signals.conditioned_log import ConditionedLog

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

#: Rows are kept, so that covariance and prediction need not evaluate them again, up to this size; in a file where they
#: are many, of which memory holds a block [bytes].
KEPT_BYTES = 1 << 31


@dataclass(frozen=True)
class Earlier:
    """What an earlier result keeps of its logs.

    Attributes:
        factors: one factor per joint, (n, p + 1, p + 1).
        noise: standard deviation of each joint then, (n,) [N m].
        covariance: covariance of its estimate, allowing for coloured residuals, (p, p).
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
        observer: evaluator of the base columns.
        factors: factor of [W tau] for each block of time and joint, (B, n, p + 1, p + 1).
        counts: number of rows in each, (B, n).
        log_of_block: number of the log of each block, (B,); -1 for an earlier result.
        block: number of each block within its log, (B,).
        logs: the conditioned logs, for methods that look at single rows.
        kept: the single rows of each log, when they are few enough to be kept.
        earlier: the result that was updated, None otherwise; its rows are the first block.
    """

    names: tuple[str, ...]
    joints: tuple[str, ...]
    observer: Observer = field(repr=False, compare=False)
    factors: Floats
    counts: Ints
    log_of_block: Ints
    block: Ints
    logs: tuple[ConditionedLog, ...] = field(repr=False, compare=False)
    kept: tuple[tuple[ObservationRows, ...], ...] | None = field(default=None, repr=False, compare=False)
    earlier: Earlier | None = field(default=None, repr=False, compare=False)

    def __iter__(self) -> Iterator[ObservationRows]:
        """Walk over the single rows in order of time; may be done many times."""
        for number in range(len(self.logs)):
            yield from self.rows_of_log(number)

    def rows_of_log(self, number: int) -> Iterator[ObservationRows]:
        """Yield the single rows of one log again; long logs are evaluated anew rather than stored."""
        chosen = set(self.block[self.log_of_block == number].tolist())
        every = rows_of(self.logs[number], self.observer) if self.kept is None else self.kept[number]
        return _walk(rows for rows in every if rows.block in chosen)

    @property
    def blocks(self) -> int:
        """Number of blocks of time."""
        return len(self.factors)

    @property
    def samples(self) -> int:
        """Number of instants in the stack."""
        return int(self.counts.max(axis=1).sum()) if len(self.counts) else 0

    @property
    def commanded(self) -> bool:
        """Whether every log says what was commanded."""
        return all(segment.command is not None for log in self.logs for segment in log.segments)

    @cached_property
    def whole(self) -> tuple[Floats, Ints]:
        """One factor per joint over all blocks, (n, p + 1, p + 1) [N m or N], and its number of rows, (n,)."""
        return np.array([merge(part) for part in self.factors.swapaxes(0, 1)]), self.counts.sum(axis=0)

    @cached_property
    def first_fit(self) -> Fit:
        """Weighted least squares of all rows as they are, from which what is asked of residuals begins."""
        return weighted(*self.whole)

    @cached_property
    def reversals(self) -> ReversalEffects | None:
        """What velocity reversals leave in the rows; None where that is not known, or an earlier result has no rows."""
        return None if self.earlier is not None else reversal_effects(self, *self.whole)

    def select(self, blocks: Mask) -> Stack:
        """Return some blocks of time, (B,), as a stack of their own."""
        if blocks.all():
            return self
        return replace(
            self,
            factors=self.factors[blocks],
            counts=self.counts[blocks],
            log_of_block=self.log_of_block[blocks],
            block=self.block[blocks],
        )

    def with_logs(self, logs: Sequence[ConditionedLog]) -> Stack:
        """Return the stack with another commanded motion in its logs; its factors do not depend on that."""
        if self.kept is None:
            return replace(self, logs=tuple(logs))
        kept = KeptRows(len(logs))
        for number, log in enumerate(logs):
            for rows in rows_of(log, self.observer):
                kept.append(number, rows)
        return replace(self, logs=tuple(logs), kept=kept.whole())


class KeptRows:
    """Rows that are kept, log by log; their numbers go into a file where they are many.

    Args:
        logs: number of logs.
    """

    def __init__(self, logs: int) -> None:
        self._rows: list[list[ObservationRows]] = [[] for _ in range(logs)]
        self._numbers = Growing(0)

    def append(self, number: int, rows: ObservationRows) -> None:
        """Keep rows of a log."""
        for numbers in (rows.entries, rows.command, rows.tau):
            if numbers is not None:
                self._numbers.append(numbers.ravel())
        # Why not slices: they would keep all the numbers in memory.
        nothing, none = np.zeros((len(rows.entries), 0)), np.zeros((0, rows.tau.shape[1]))
        command = None if rows.command is None else nothing
        self._rows[number].append(replace(rows, entries=nothing, command=command, tau=none))

    def whole(self) -> tuple[tuple[ObservationRows, ...], ...]:
        """Return all rows."""
        numbers, start = self._numbers.whole(), 0
        found: list[list[ObservationRows]] = []
        for log in self._rows:
            found.append([])
            for rows in log:
                shape, parts = (len(rows.joints), len(rows.t)), []
                shapes = [shape, *([] if rows.command is None else [shape]), (len(rows.t), rows.tau.shape[1])]
                for each in shapes:
                    size = each[0] * each[1]
                    parts.append(numbers[start : start + size].reshape(each))
                    start += size
                command = None if rows.command is None else parts[1]
                found[-1].append(replace(rows, entries=parts[0], command=command, tau=parts[-1]))
        return tuple(map(tuple, found))


def kept_rows(log: ConditionedLog, observer: Observer) -> RowWalk:
    """Return the rows of one log, evaluated once and walked over as often as wanted."""
    kept = KeptRows(1)
    for rows in rows_of(log, observer):
        kept.append(0, rows)
    (found,) = kept.whole()
    return RowWalk(lambda: _walk(found))


def _walk(kept: Iterable[ObservationRows]) -> Iterator[ObservationRows]:
    """Yield kept rows, and give back the memory of each block after it."""
    for rows in kept:
        yield rows.fresh()
        release()


def stack_base(logs: Sequence[ConditionedLog], base: BaseModel, progress: Progress = SILENT) -> Stack:
    """Fold conditioned logs into triangular factors of a model's base columns.

    Args:
        logs: conditioned logs, all under the same filter.
        base: model and base parameters.
        progress: told how far the work is.
    """
    reduction = base.reduction
    observer = base.model.observer(reduction.base)
    progress.stage("stack")
    found = stack(logs, observer, reduction.base_names, base.robot.joint_names, progress)
    rows = f"{found.samples} samples x {len(found.joints)} joints"
    progress.stage("stacked", f"{rows} -> W {int(found.counts.sum())} x {len(found.names)}")
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
    counts: list[Ints] = []
    places: list[tuple[int, int]] = []
    expected_rows = sum(len(s) // log.filter.second_step for log in logs for s in log.segments)
    keep = 8 * expected_rows * len(observer.rows) <= KEPT_BYTES
    kept = KeptRows(len(logs))
    for number, log in enumerate(logs):
        expected = sum(len(s) for s in log.segments)
        done = 0
        for rows in rows_of(log, observer):
            if keep:
                kept.append(number, rows)
            if (number, rows.block) not in places[-1:]:
                factors.append(np.zeros((n, size, size)))
                counts.append(np.zeros(n, dtype=np.int64))
                places.append((number, rows.block))
            for j in range(n):
                counts[-1][j] += fold(factors[-1][j], rows, j)
            done += len(rows.t) * log.filter.second_step
            progress.advance(number + min(1.0, done / expected), len(logs), log.name)
    shape = (len(factors), n, size, size)
    log_of_block, block = np.array(places, dtype=np.int64).reshape(-1, 2).T
    return Stack(
        names=names,
        joints=joints,
        observer=observer,
        factors=np.array(factors).reshape(shape),
        counts=np.array(counts, dtype=np.int64).reshape(shape[:2]),
        log_of_block=log_of_block,
        block=block,
        logs=tuple(logs),
        kept=kept.whole() if keep else None,
    )
