"""Rows of the observation matrix in time order: what a filtered log says about the parameters (Paper Eq. 23).

    tau = W theta + noise

They are evaluated from conditioned logs block by block and filtered like the torques. Estimators that need residual
series walk over them; everything else needs only the triangular factors of ``dynid.estimation.stack``.

Rows at velocity reversals are not fitted. A joint that reverses creeps and sticks for some milliseconds, at
velocities below the encoder's noise. The Coulomb column is wrong there, each time in the same way, and biases
friction and inertia.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.least_squares import accumulate
from dynid.model.regressor import Observer
from dynid.signals.conditioned_log import ConditionedLog, Segment
from dynid.signals.filters import decimate

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class ObservationRows:
    """Rows of one interval of time: M instants, n joints, p columns. Pass them as a list, or anything walked anew.

    Attributes:
        entries: of W that are not zero by structure, (E, M).
        joints: joint of each entry, (E,).
        columns: column of each entry, (E,).
        size: number of columns p.
        tau: torques after the parallel filter, (M, n) [N m or N].
        command: the entries on the commanded motion, which knows no measurement noise, (E, M); None where nobody asked.
        usable: rows that count, (M, n); None for all.
        follows: whether its first row follows the last row of the rows before it without a gap.
        t: time, (M,) [s].
        block: number of the block of time within its log.
        cutoff: cut-off frequency of the parallel filter [Hz].
    """

    entries: NDArray[Any]
    joints: NDArray[np.intp]
    columns: NDArray[np.intp]
    size: int
    tau: Floats
    command: NDArray[Any] | None = None
    usable: Mask | None = None
    follows: bool = False
    t: Floats = field(default_factory=lambda: np.zeros(0))
    block: int = 0
    cutoff: float = 0.0

    @cached_property
    def W(self) -> Floats:
        """Base regressor after the parallel filter, (M, n, p) [N m or N per unit of each parameter]."""
        return self._dense(self.entries)

    @cached_property
    def Z(self) -> Floats | None:
        """Instruments, (M, n, p): the regressor on the commanded motion, in its units; None without them."""
        return None if self.command is None else self._dense(self.command)

    @cached_property
    def _whole(self) -> bool:
        """Whether the entries are those of a whole matrix in its order."""
        n = self.tau.shape[1]
        return len(self.joints) == n * self.size and np.array_equal(
            self.joints * self.size + self.columns, np.arange(n * self.size)
        )

    @cached_property
    def instruments(self) -> ObservationRows:
        """The rows on the commanded motion, of rows that were made with it."""
        assert self.command is not None, "only rows that were made with commands have instruments"
        return replace(self, entries=self.command, command=None)

    def _dense(self, entries: NDArray[Any]) -> Floats:
        M, n = self.tau.shape
        if self._whole:
            return np.asarray(entries.T.reshape(M, n, self.size), dtype=float)
        full = np.zeros((M, n, self.size))
        full[:, self.joints, self.columns] = entries.T
        return full

    @property
    def mask(self) -> Mask:
        """Rows that count, (M, n)."""
        return np.ones(self.tau.shape, dtype=bool) if self.usable is None else self.usable

    def of_joint(self, joint: int) -> tuple[NDArray[np.intp], NDArray[Any]]:
        """Return the columns that a joint's rows have at all, (k,), rising, and their entries, (k, M)."""
        if self._whole:
            return np.arange(self.size), self.entries[joint * self.size : (joint + 1) * self.size]
        own, columns = _of_joint(joint, self.joints.tobytes(), self.columns.tobytes())
        return columns, self.entries[own]

    def torque(self, theta: Floats) -> Floats:
        """Return W theta, (M, n) [N m or N], without making W.

        Args:
            theta: parameters, (p,), or of each joint its own, (n, p).
        """
        n = self.tau.shape[1]
        spread = np.zeros((n, len(self.joints)))
        spread[self.joints, np.arange(len(self.joints))] = np.broadcast_to(theta, (n, self.size))[
            self.joints, self.columns
        ]
        return np.asarray((spread @ self.entries).T)

    def residual(self, theta: Floats) -> Floats:
        """Return tau - W theta, (M, n) [N m or N]; zero where rows do not count."""
        return np.where(self.mask, self.tau - self.torque(theta), 0.0)

    def part(self, start: int, end: int, *, follows: bool, block: int) -> ObservationRows:
        """Return some of the rows, copied so that they keep nothing else alive; all of them as they are."""
        if end - start == len(self.tau):
            return replace(self, follows=follows, block=block)
        return replace(
            self,
            entries=self.entries[:, start:end].copy(),
            command=None if self.command is None else self.command[:, start:end].copy(),
            tau=self.tau[start:end].copy(),
            usable=self.mask[start:end].copy(),
            t=self.t[start:end].copy(),
            follows=follows,
            block=block,
        )

    def with_arrays(self, W: Floats, tau: Floats, Z: Floats | None = None) -> ObservationRows:
        """Return rows of the same instants made of other arrays.

        Args:
            W: regressor, (M, n, p) [N m or N per unit of each parameter]; p may differ.
            tau: torques, (M, n) [N m or N].
            Z: instruments, (M, n, p), or None.
        """
        return dense_rows(
            W,
            tau,
            Z,
            usable=self.usable,
            follows=self.follows,
            t=self.t,
            block=self.block,
            cutoff=self.cutoff,
        )


@lru_cache(maxsize=256)
def _of_joint(
    joint: int, joints: bytes, columns: bytes
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return which entries are those of a joint, by rising column, and their columns."""
    every = np.frombuffer(columns, np.intp)
    own = np.flatnonzero(np.frombuffer(joints, np.intp) == joint)
    own = own[np.argsort(every[own], kind="stable")]
    return own, every[own]


def dense_rows(W: Floats, tau: Floats, Z: Floats | None = None, **facts: Any) -> ObservationRows:  # noqa: ANN401
    """Return rows made of whole arrays.

    Args:
        W: regressor, (M, n, p) [N m or N per unit of each parameter].
        tau: torques, (M, n) [N m or N].
        Z: instruments, (M, n, p), or None.
        facts: further attributes of ``ObservationRows``.
    """
    M, n, p = W.shape
    joints, columns = np.divmod(np.arange(n * p), p)
    entries, command = (
        None if x is None else np.asarray(x, dtype=float).reshape(M, n * p).T for x in (W, Z)
    )
    assert entries is not None
    return ObservationRows(entries, joints, columns, p, tau, command, **facts)


# ---------------------------------------------------------------- evaluation
def rows_of(
    log: ConditionedLog, observer: Observer, *, commanded: bool = False, whole: bool = True
) -> Iterator[ObservationRows]:
    """Yield the filtered rows of one log, block of time by block of time.

    Args:
        log: the conditioned log.
        observer: the columns to evaluate.
        commanded: evaluate them on the commanded motion as well.
        whole: count rows at velocity reversals, too.
    """
    chosen = log.filter
    kernel, step = chosen.second_kernel, chosen.second_step
    taps = kernel.shape[1]
    outputs = [max(0, (len(s) - taps) // step + 1) for s in log.segments]
    per_block = max(
        1, round(chosen.kept_rate * tuning.BLOCK_SECONDS), -(-sum(outputs) // tuning.MOST_BLOCKS)
    )
    together = max(1, tuning.ROWS_EVALUATED // step)
    block = 0
    for segment, count in zip(log.segments, outputs, strict=True):
        blocks = max(1, round(count / per_block)) if count else 0
        reversals = () if whole else reversal_times(segment, chosen.position_cutoff)
        edges = np.linspace(0, count, blocks + 1).astype(int).tolist()
        command = _command(segment) if commanded and count else None
        for first, last in pairwise(_stops(edges, together)):
            rows = replace(
                _evaluated(segment, observer, kernel, step, first, last, command),
                cutoff=chosen.cutoff,
            )
            if reversals:
                far = [_far(rows.t, times, chosen.cutoff) for times in reversals]
                rows = replace(rows, usable=rows.mask & np.array(far).T)
            cuts = [first, *(edge for edge in edges if first < edge < last), last]
            for start, end in pairwise(cuts):
                number = block + bisect_right(edges, start) - 1
                yield rows.part(start - first, end - first, follows=start > 0, block=number)
        block += blocks


def _stops(edges: Sequence[int], together: int) -> list[int]:
    """Return where evaluation stops: after several short blocks of time, or within a long one, at even parts of it.

    Args:
        edges: where blocks begin and end.
        together: rows that are evaluated at once.
    """
    found = [edges[0]]
    for start, end in pairwise(edges):
        if len(found) > 1 and end - found[-2] <= together:
            found[-1] = end
        elif end > start:
            parts = -(-(end - start) // together)
            found += [start + (end - start) * k // parts for k in range(1, parts + 1)]
    return found


def _command(segment: Segment) -> tuple[Floats, ...]:
    """Return commanded positions, velocities and accelerations of a segment, (N, n) each."""
    qd = np.gradient(segment.command_q, segment.t, axis=0)
    return segment.command_q, qd, np.gradient(qd, segment.t, axis=0)


def _evaluated(
    segment: Segment,
    observer: Observer,
    kernel: Floats,
    step: int,
    first: int,
    last: int,
    command: tuple[Floats, ...] | None,
) -> ObservationRows:
    part = slice(first * step, (last - 1) * step + kernel.shape[1])
    tau = decimate(np.ascontiguousarray(segment.tau[part].T), kernel, step)[0]
    usable = np.ones((last - first, observer.shape[0]), dtype=bool)
    if not segment.usable[part].all():
        invalid = (~segment.usable[part]).T.astype(float)
        usable = decimate(np.ascontiguousarray(invalid), np.ones_like(kernel), step)[0].T < 0.5
    effects, sign = segment.effects[part], segment.coulomb_sign[part]
    motion = (segment.q[part], segment.qd[part], segment.qdd[part])
    return ObservationRows(
        entries=_entries(motion, sign if sign.size else None, effects, observer, kernel, step),
        joints=observer.rows,
        columns=observer.cols,
        size=observer.shape[1],
        tau=np.ascontiguousarray(tau.T),
        command=None
        if command is None
        else _entries(tuple(x[part] for x in command), None, effects, observer, kernel, step),
        usable=usable,
        t=segment.t[part.start + (kernel.shape[1] - 1) // 2 :: step][: last - first].copy(),
    )


def _entries(
    motion: tuple[Floats, ...],
    sign: Floats | None,
    effects: Floats,
    observer: Observer,
    kernel: Floats,
    step: int,
) -> Floats:
    """Return the base regressor's entries after the parallel filter, (E, M).

    Added effects come with the segment, and so do Coulomb signs where it has them: filtered as the torques were.
    """
    q, qd, qdd = motion
    entries = observer.entries(q, qd, qdd, sign)
    if len(observer.added_entries):
        entries = np.vstack([entries, effects.T[observer.added_entries]])
    kept: Floats = decimate(entries, kernel, step)[0]
    return kept


def _far(t: Floats, times: Floats, cutoff: float) -> Mask:
    """Return which rows are far from all reversals of a joint, (M,)."""
    ends = np.concatenate([[-np.inf], times, [np.inf]])
    after = np.searchsorted(times, t)
    nearest = np.minimum(t - ends[after], ends[after + 1] - t)
    return np.asarray(nearest >= tuning.REVERSAL / cutoff)


def reversal_times(segment: Segment, cutoff: float) -> tuple[Floats, ...]:
    """Return when each joint reverses, n arrays (k,) [s]; several within a period of the cut-off count as one.

    Args:
        segment: conditioned motion with Coulomb signs.
        cutoff: cut-off frequency of the position filter [Hz].
    """
    found = []
    for joint in range(segment.coulomb_sign.shape[1]):
        sign, t = segment.coulomb_sign[:, joint], segment.t
        k = np.flatnonzero(np.signbit(sign[1:]) != np.signbit(sign[:-1]))
        times = t[k] + sign[k] / (sign[k] - sign[k + 1]) * (t[k + 1] - t[k])
        first = np.flatnonzero(np.diff(times, prepend=-np.inf) > 1.0 / cutoff)
        found.append(
            np.add.reduceat(times, first) / np.diff(first, append=len(times))
            if len(times)
            else times
        )
    return tuple(found)


# ---------------------------------------------------------------- walks over rows
def runs(segments: Iterable[ObservationRows]) -> Iterator[list[ObservationRows]]:
    """Yield rows that follow each other together."""
    run: list[ObservationRows] = []
    for segment in segments:
        if run and not segment.follows:
            yield run
            run = []
        run.append(segment)
    if run:
        yield run


def joined(run: Sequence[ObservationRows]) -> ObservationRows:
    """Return rows that follow each other as one."""
    first = run[0]
    commands = [each.command for each in run if each.command is not None]
    return replace(
        first,
        entries=np.concatenate([each.entries for each in run], axis=1),
        command=np.concatenate(commands, axis=1) if commands else None,
        tau=np.concatenate([each.tau for each in run]),
        usable=np.concatenate([each.mask for each in run]),
        t=np.concatenate([each.t for each in run]),
    )


def joint_factors(segments: Iterable[ObservationRows]) -> tuple[Floats, Ints]:
    """Return the triangular factor of each joint's rows, (n, p + 1, p + 1) [N m or N], and their number, (n,)."""
    factors, rows = np.zeros((0, 0, 0)), np.zeros(0, dtype=np.int64)
    for segment in segments:
        n = segment.tau.shape[1]
        if not len(factors):
            factors, rows = (
                np.zeros((n, segment.size + 1, segment.size + 1)),
                np.zeros(n, dtype=np.int64),
            )
        for j in range(n):
            fold(factors[j], segment, j)
        rows = rows + segment.mask.sum(axis=0)
    return factors, rows


def fold(R: Floats, rows: ObservationRows, joint: int, weight: Floats | None = None) -> int:
    """Add the rows of one joint to its factor in place, and return how many they are.

    Only the columns that this joint has are worked on: the links before it do not load it.

    Args:
        R: triangular factor of the rows so far, (p + 1, p + 1) [N m or N].
        rows: further rows.
        joint: number of the joint.
        weight: factor on each row, (M,); None for ones.
    """
    good, (active, entries) = rows.mask[:, joint], rows.of_joint(joint)
    place = np.ix_(*2 * [np.append(active, rows.size)])
    tau = rows.tau[:, joint]
    if weight is not None:
        entries, tau = entries * weight, tau * weight
    if not good.all():
        entries, tau = entries[:, good], tau[good]
    R[place] = accumulate(R[place], entries.T, tau)
    return int(good.sum())


def robust_noise(segments: Iterable[ObservationRows], theta: Floats) -> Floats:
    """Return the standard deviation that the middle of each joint's residuals suggests, (n,) [N m or N]."""
    both = [(np.abs(each.residual(theta)), each.mask) for each in segments]
    size, mask = (np.concatenate(part) for part in zip(*both, strict=True))
    spread = [
        1.4826 * float(np.median(x[good])) if good.any() else 0.0
        for x, good in zip(size.T, mask.T, strict=True)
    ]
    return np.maximum(spread, 1e-12 * max(float(size.max(initial=0.0)), 1e-18))
