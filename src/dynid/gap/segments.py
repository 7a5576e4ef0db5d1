"""Observation rows of conditioned logs, segment by segment, beside the motion that candidate columns are made from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.conditioned_log import ConditionedLog, arm_motion, with_effects
from dynid.estimation.observation_rows import rows_of
from dynid.model.base_model import BaseModel
from dynid.model.effects.interface import ArmMotion, Floats, ReferenceTorques
from dynid.signals.filters import decimate

Mask = NDArray[np.bool_]

#: Below this speed for longer than ``DWELL_SECONDS`` a joint rests; its friction is then undetermined, and the rows
#: are left out with ``DWELL_SECONDS`` around them [rad/s, s].
REST_SPEED, DWELL_SECONDS = 0.012, 0.25
#: Blocks of time that errors are taken from by leaving one out (jackknife): longer than the memory of whitened
#: residuals [s], and so many of them if the rows last long enough.
SHORTEST_BLOCK, LONGEST_BLOCK, BLOCKS = 0.25, 1.0, 40


@dataclass(frozen=True)
class SegmentRows:
    """The observation rows of one segment of a log, beside the motion that candidate columns are made from.

    Attributes:
        source: the conditioned log, this segment alone.
        motion: its motion, at the rate that columns are evaluated at.
        log: number of the log.
        t: time of the rows, since the log began, (M,) [s].
        W: base regressor, (M, n, p).
        tau: measured torques, (M, n).
        q: positions, (M, n).
        qd: velocities, (M, n).
        use: rows that count: not clipped, not at rest, (M, n).
    """

    source: ConditionedLog
    motion: ArmMotion
    log: int
    t: Floats
    W: Floats
    tau: Floats
    q: Floats
    qd: Floats
    use: Mask

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.t)

    @property
    def rate(self) -> float:
        """Rate of the rows [Hz]."""
        return self.source.filter.kept_rate

    def filtered(self, signals: Floats) -> Floats:
        """Return signals of the motion under the parallel filter, (C, N) -> (C, M)."""
        kernel, step = self.source.filter.second_kernel, self.source.filter.second_step
        kept: Floats = decimate(np.ascontiguousarray(signals), kernel, step)[0]
        return kept


def segments_of(sources: Sequence[ConditionedLog], base: BaseModel, reference: ReferenceTorques) -> list[SegmentRows]:
    """Return the rows of conditioned logs, segment by segment.

    Args:
        sources: conditioned logs.
        base: model and base parameters.
        reference: the current model, which effects scale with.
    """
    observer = base.model.observer(base.reduction.base)
    found = []
    for number, source in enumerate(with_effects(s, base.model, reference) for s in sources):
        for segment in source.segments:
            alone = replace(source, segments=[segment])
            rows = list(rows_of(alone, observer))
            if not rows:
                continue
            motion = arm_motion(segment, source.filter, base.model, reference)
            W, tau = np.concatenate([r.W for r in rows]), np.concatenate([r.tau for r in rows])
            t = np.concatenate([r.t for r in rows]) - segment.t[0] + segment.elapsed[0]
            empty = SegmentRows(alone, motion, number, t, W, tau, tau, tau, np.concatenate([r.mask for r in rows]))
            q, qd = empty.filtered(motion.q.T).T, empty.filtered(motion.qd.T).T
            found.append(replace(empty, q=q, qd=qd, use=empty.use & moving(qd, empty.rate)))
    return found


def jackknife_blocks(segments: Sequence[SegmentRows]) -> list[NDArray[np.int64]]:
    """Return the number of the block of time of each row, one (M,) per segment; blocks of different segments differ."""
    seconds = sum(float(s.use.any(axis=1).sum()) / s.rate for s in segments)
    length = min(LONGEST_BLOCK, max(SHORTEST_BLOCK, seconds / BLOCKS))
    return [1_000_000 * k + np.arange(len(s)) // max(1, round(length * s.rate)) for k, s in enumerate(segments)]


def with_reference(segments: Sequence[SegmentRows], reference: ReferenceTorques) -> list[SegmentRows]:
    """Return the segments with another current model."""
    return [replace(s, motion=replace(s.motion, reference=reference)) for s in segments]


def moving(qd: Floats, rate: float) -> Mask:
    """Return which rows are not part of a rest, (M, n)."""
    width = max(1, round(DWELL_SECONDS * rate))
    mask = np.ones(qd.shape, dtype=bool)
    for j in range(qd.shape[1]):
        slow = np.concatenate([[False], np.abs(qd[:, j]) < REST_SPEED, [False]])
        edges = np.flatnonzero(np.diff(slow.astype(int)))
        for start, end in zip(edges[::2], edges[1::2], strict=True):
            if end - start > width:
                mask[max(0, start - width) : end + width, j] = False
    return mask


def cut(segments: Sequence[SegmentRows], chosen: Sequence[Mask]) -> list[SegmentRows]:
    """Return the segments with only the chosen rows counting."""
    return [replace(s, use=s.use & rows[:, None]) for s, rows in zip(segments, chosen, strict=True)]
