"""Rows by frequency: the mean of all times that a motion was driven, and how each time differs from those before.

Rows of one motion are turned by an orthonormal matrix for each instant: what repeats is in the mean alone, and what was
always there cancels in the differences. In a band of octaves, what follows no state is as good as white.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct
from scipy.sparse import csr_array

from dynid.gap.noise import RepeatPair, whitened
from dynid.gap.segments import Mask, SegmentRows
from dynid.gap.whitened_regression import WhitenedRegression
from dynid.model.effects.interface import Floats

#: Upper end of the lowest band [Hz]; each further one ends an octave higher, the last one at the cut-off.
LOWEST_HZ, OCTAVES = 0.1, 7


def phases(
    segments: Sequence[SegmentRows], repeats: Sequence[RepeatPair]
) -> tuple[list[int], list[NDArray[np.int64]]]:
    """Return which motion each segment drives, and where in it each row is, (M,) rows."""
    motion = list(range(len(segments)))
    phase = [np.arange(len(s)) for s in segments]
    period: dict[int, int] = {}
    for pair in repeats:
        lag = round(pair.lag)
        if pair.first == pair.second:
            period[pair.first] = lag
        elif motion[pair.second] == pair.second:
            motion[pair.second] = motion[pair.first]
            phase[pair.second] = phase[pair.second] - lag + phase[pair.first][0]
    return motion, [x % period[k] if (k := motion[i]) in period else x for i, x in enumerate(phase)]


@dataclass(frozen=True)
class Bands:
    """How rows of segments become rows by frequency; F of them in B bands, for each joint.

    Attributes:
        regression: whitened rows.
        motions: how many instants each motion has.
        place: at which of all instants each row is, the segments one after the other, (M,).
        cutoff: highest frequency that is looked at [Hz].
    """

    regression: WhitenedRegression
    motions: tuple[int, ...]
    place: NDArray[np.int64]
    cutoff: float

    @classmethod
    def of(cls, regression: WhitenedRegression, repeats: Sequence[RepeatPair]) -> Bands:
        """Return the bands of whitened rows.

        Args:
            regression: the rows.
            repeats: segments of the same motion.
        """
        motion, phase = phases(regression.segments, repeats)
        place, lengths, at = list(phase), [], 0
        for m in sorted(set(motion)):
            own = [i for i, k in enumerate(motion) if k == m]
            low = min(int(phase[i].min()) for i in own)
            lengths.append(max(int(phase[i].max()) for i in own) - low + 1)
            for i in own:
                place[i] = phase[i] - low + at
            at += lengths[-1]
        cutoff = regression.segments[0].log.filter.cutoff
        return cls(regression, tuple(lengths), np.concatenate(place), cutoff)

    @cached_property
    def _times(self) -> list[csr_array]:
        """Which instant each row of the first, second, ... time that it is driven belongs to, (M, instants) each."""
        seen = np.zeros(sum(self.motions), dtype=np.int64)
        time, edges = np.zeros(len(self.place), dtype=np.int64), self._edges
        # Why block by block of a period: within a segment a motion may be driven several times.
        for a, b in pairwise(edges):
            np.add.at(seen, self.place[a:b], 1)
            time[a:b] = seen[self.place[a:b]] - 1
        shape = len(self.place), len(seen)
        return [
            csr_array(((time == k).astype(float), (np.arange(len(time)), self.place)), shape)
            for k in range(int(seen.max()))
        ]

    @cached_property
    def _edges(self) -> list[int]:
        """Where stretches begin in which no instant comes twice, and where all end."""
        found, at = [0], 0
        for s in self.regression.segments:
            breaks = np.flatnonzero(np.diff(self.place[at : at + len(s)]) != 1) + 1
            found += [*(at + breaks).tolist(), at + len(s)]
            at += len(s)
        return found

    def _use(self, joint: int) -> Mask:
        """Return which rows count, (M,)."""
        order = self.regression.noise.order
        return np.concatenate(
            [(np.arange(len(s)) >= order) & s.use[:, joint] for s in self.regression.segments]
        )

    @cached_property
    def _counts(self) -> list[list[Floats]]:
        """How many rows of each time count at each instant, 0 or 1, by joint, (instants,) each."""
        n = len(self.regression.joints)
        return [[S.T @ self._use(j).astype(float) for S in self._times] for j in range(n)]

    @cached_property
    def _order(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Which frequencies are looked at, band by band, and which band each belongs to, (F,) each."""
        rate = self.regression.segments[0].rate
        f = np.concatenate([np.arange(m) * rate / 2 / m for m in self.motions])
        edges = LOWEST_HZ * 2.0 ** np.arange(OCTAVES)
        band = np.searchsorted(edges[edges < self.cutoff], f, side="right")
        band[f > self.cutoff] = -1
        more = [np.where(band < 0, -1, band + 1 + band.max())] * (len(self._times) - 1)
        band = np.concatenate([band, *more])
        order = np.argsort(band, kind="stable")
        order = order[band[order] >= 0]
        return order, band[order]

    @cached_property
    def slices(self) -> list[slice]:
        """Where the rows of each band are, B of them."""
        edges = np.flatnonzero(np.diff(self._order[1], prepend=-1, append=1 << 30))
        return [slice(a, b) for a, b in pairwise(edges.tolist())]

    def counts(self, joint: int, *, always: bool = True) -> Floats:
        """Return how many rows of each band count for a joint, (B,).

        Args:
            joint: 0-based.
            always: whether all rows do, or the share of the new logs alone.
        """
        times, ends = np.array(self._counts[joint]), np.cumsum(self.motions)[:-1]
        before = np.cumsum(times, axis=0) - times
        there = [times.sum(axis=0) > 0, *((times * before)[1:] > 0)]
        share = np.concatenate(
            [
                np.full(len(x), x.mean() if len(x) else 0.0)
                for each in there
                for x in np.split(each, ends)
            ]
        )[self._order[0]]
        use, new = self._use(joint), 1.0
        if not always:
            every = np.concatenate([np.full(len(s), s.is_new) for s in self.regression.segments])
            new = float((use & every).sum() / max(use.sum(), 1))
        return np.array([new * share[part].sum() for part in self.slices])

    def rows(self, joint: int, parts: Sequence[Floats]) -> Floats:
        """Return filtered columns of one joint, one (..., M_s) per segment, as whitened rows by frequency, (..., F)."""
        noise, edge = self.regression.noise, np.cumsum(self.motions)[:-1]
        white = [whitened(x, noise.ar[joint]) for x in parts]
        lead = parts[0].shape[:-1]
        flat = np.concatenate(
            [np.pad(x.reshape(-1, x.shape[-1]), ((0, 0), (noise.order, 0))) for x in white], axis=1
        )
        # Why the cut-off: whitened rows have hardly any noise above it.
        share = np.sqrt(2.0 * self.cutoff / self.regression.segments[0].rate / noise.count[joint])
        flat = flat * (self._use(joint) * share / noise.sigma[joint])
        turned, count = [], np.zeros(sum(self.motions))
        mean = np.zeros((len(flat), len(count)))
        for S, here in zip(self._times, self._counts[joint], strict=True):
            away = (S.T @ flat.T).T - mean * here
            whole = np.maximum(count + here, 1.0)
            turned.append(np.sqrt(count / whole) * away)
            mean, count = mean + away / whole, count + here
        turned[0] = np.sqrt(count) * mean
        found = [
            dct(x, norm="ortho", axis=-1) for each in turned for x in np.split(each, edge, axis=1)
        ]
        return np.concatenate(found, axis=1)[:, self._order[0]].reshape(*lead, -1)

    def unrepeated(self, joint: int, x: Floats) -> Floats:
        """Return rows of a joint, (M,), less their mean over all times that each instant is driven; once, as they are.

        Why larger: so that noise which does not repeat is as large as it was.
        """
        use = self._use(joint)
        count = np.sum(self._counts[joint], axis=0)
        mean = np.sum([S.T @ (x * use) for S in self._times], axis=0) / np.maximum(count, 1.0)
        again = np.where(count > 1.0, mean, 0.0)[self.place]
        scale = np.sqrt(np.where(count > 1.0, count / np.maximum(count - 1.0, 1.0), 1.0))
        return (x - again) * scale[self.place]

    def products(self, one: Floats, other: Floats) -> Floats:
        """Return products of columns by frequency, (..., k, F) and (..., m, F), band by band, (B, ..., k, m)."""
        return np.array([one[..., x] @ np.swapaxes(other[..., x], -1, -2) for x in self.slices])
