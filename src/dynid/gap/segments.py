"""Observation rows of conditioned logs, segment by segment, with the motion that candidate columns are made from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.rows import Rows, parallel_filtered, rows_of
from dynid.model.base_model import BaseModel
from dynid.model.effects.interface import ArmMotion, Floats, ReferenceTorques
from dynid.signals.conditioned_log import ConditionedLog, arm_motion, with_effects

Mask = NDArray[np.bool_]

#: Below this speed for longer than ``DWELL_SECONDS`` a joint rests; its friction is then undetermined, and the rows
#: are left out with ``DWELL_SECONDS`` around them [rad/s, s].
REST_SPEED, DWELL_SECONDS = 0.012, 0.25
#: Blocks of time that errors are taken from by leaving one out (jackknife): longer than the memory of whitened
#: residuals [s], and so many of them if the rows last long enough.
SHORTEST_BLOCK, LONGEST_BLOCK, BLOCKS = 0.25, 1.0, 40


@dataclass(frozen=True)
class SegmentRows:
    """The observation rows of one segment of a log, with the motion that candidate columns are made from.

    Attributes:
        rows: of the base regressor, M instants.
        log: the conditioned log, this segment alone.
        number: of the log.
        motion: of the segment, at the rate that columns are evaluated at, N samples.
        q: positions of the rows, (M, n) [rad or m].
        qd: velocities of the rows, (M, n) [rad/s or m/s].
        use: rows that count: not clipped, not at rest, (M, n).
        is_new: whether effects act here; not in earlier logs, when what has changed since is looked for.
        coulomb: Coulomb friction of a first fit, which errors at reversals are shares of, (n,) [N m or N].
        reversal: speed within which nobody knows how friction turns, (n,) [rad/s or m/s].
    """

    rows: Rows
    log: ConditionedLog
    number: int
    motion: ArmMotion
    q: Floats
    qd: Floats
    use: Mask
    is_new: bool = True
    coulomb: Floats = field(default_factory=lambda: np.zeros(0))
    reversal: Floats = field(default_factory=lambda: np.zeros(0))

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.q)

    @property
    def W(self) -> Floats:
        """Base regressor, (M, n, p)."""
        return self.rows.W

    @property
    def tau(self) -> Floats:
        """Torques, (M, n) [N m or N]."""
        return self.rows.tau

    @property
    def t(self) -> Floats:
        """Time of the rows on the clock of the motion, (M,) [s]."""
        segment = self.log.segments[0]
        return np.asarray(self.rows.t - segment.t[0] + segment.elapsed[0])

    @property
    def rate(self) -> float:
        """Rate of the rows [Hz]."""
        return self.log.filter.kept_rate

    def filtered(self, signals: Floats) -> Floats:
        """Return signals of the motion under the parallel filter, (C, N) -> (C, M)."""
        return parallel_filtered(signals, self.log.filter)


def segments_of(
    logs: Sequence[ConditionedLog], base: BaseModel, reference: ReferenceTorques
) -> list[SegmentRows]:
    """Return the rows of conditioned logs, segment by segment.

    Args:
        logs: conditioned logs.
        base: model and base parameters.
        reference: the current model, which effects scale with.
    """
    observer = base.model.observer(base.reduction.base)
    found = []
    for number, log in enumerate(with_effects(each, base.model, reference) for each in logs):
        for segment in log.segments:
            alone = replace(log, segments=[segment])
            rows = rows_of(alone, observer)
            if len(rows.t):
                motion = arm_motion(segment, log.filter, base.model, reference)
                q, qd = (parallel_filtered(x.T, log.filter).T for x in (motion.q, motion.qd))
                use = rows.use & moving(qd, log.filter.kept_rate)
                found.append(SegmentRows(rows, alone, number, motion, q, qd, use))
    return found


def jackknife_blocks(
    segments: Sequence[SegmentRows], shortest: float = SHORTEST_BLOCK
) -> list[NDArray[np.int64]]:
    """Return the number of the block of time of each row, one (M,) per segment; blocks of different segments differ.

    Args:
        segments: rows.
        shortest: length that each has at least [s].
    """
    seconds = sum(float(s.use.any(axis=1).sum()) / s.rate for s in segments)
    length = min(LONGEST_BLOCK, max(shortest, seconds / BLOCKS))
    return [
        1_000_000 * k + np.arange(len(s)) // max(1, round(length * s.rate))
        for k, s in enumerate(segments)
    ]


def with_reference(
    segments: Sequence[SegmentRows], reference: ReferenceTorques
) -> list[SegmentRows]:
    """Return the segments with another current model."""
    return [replace(s, motion=replace(s.motion, reference=reference)) for s in segments]


def moving(qd: Floats, rate: float) -> Mask:
    """Return which rows are not part of a rest, (M, n)."""
    # Why not scipy.ndimage, which would do it in two calls: to import it takes as long as a tenth of a search.
    width = max(1, round(DWELL_SECONDS * rate))
    rests = _sums(np.abs(qd) < REST_SPEED, 0, width) > width
    return np.asarray(_sums(rests, -2 * width, width) == 0)


def _sums(x: Mask, first: int, last: int) -> NDArray[np.int64]:
    """Return how many of the rows from ``first`` to ``last`` around each row are set, (M, n); none beyond the ends."""
    total = np.concatenate([np.zeros((1, x.shape[1]), dtype=np.int64), np.cumsum(x, axis=0)])
    rows = np.arange(len(x))
    return np.asarray(
        total[np.clip(rows + last + 1, 0, len(x))] - total[np.clip(rows + first, 0, len(x))]
    )


def cut(segments: Sequence[SegmentRows], chosen: Sequence[Mask]) -> list[SegmentRows]:
    """Return the segments with only the chosen rows counting."""
    return [replace(s, use=s.use & rows[:, None]) for s, rows in zip(segments, chosen, strict=True)]
