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
from scipy import sparse
from scipy.fft import dct, next_fast_len

from dynid.arrays import Floats, Ints
from dynid.estimation.noise_floor import RepeatPair
from dynid.gap.gap_rows import GapRows
from dynid.gap.noise import NoiseModel

#: Upper end of the lowest band [Hz]; each further one ends an octave higher, the last one at the cut-off.
LOWEST_HZ, OCTAVES = 0.1, 7


def instants(rows: GapRows, repeats: Sequence[RepeatPair]) -> tuple[list[int], Ints]:
    """Return how many instants each motion has, and at which of all instants each row is, (M,).

    Args:
        rows: the rows.
        repeats: parts of the same motion.
    """
    motion, phase = np.arange(len(rows.parts)), rows.at.copy()
    period: dict[int, int] = {}
    for pair in repeats:
        lag = round(pair.lag)
        one, other = rows.parts[pair.first], rows.parts[pair.second]
        if pair.first == pair.second:
            period[pair.first] = lag
        elif motion[pair.second] == pair.second:
            motion[pair.second] = motion[pair.first]
            phase[other] += phase[one.start] - lag
    lengths: list[int] = []
    place = phase
    for m in np.unique(motion):
        own = motion[rows.part] == m
        x = phase[own] % period[m] if m in period else phase[own]
        place[own] = x - x.min() + sum(lengths)
        # Why longer: a transform of a prime number of instants takes five times as long.
        lengths.append(next_fast_len(int(np.ptp(x)) + 1, real=True))
    return lengths, place


@dataclass(frozen=True)
class Bands:
    """How rows become rows by frequency; F of them in B bands, for each joint.

    Attributes:
        rows: the rows.
        noise: what they are whitened with.
        lengths: how many instants each motion has.
        place: at which of all instants each row is, (M,).
    """

    rows: GapRows
    noise: NoiseModel
    lengths: list[int]
    place: Ints

    @property
    def cutoff(self) -> float:
        """Highest frequency that is looked at [Hz]."""
        return self.rows.logs[0].filter.cutoff

    @cached_property
    def times(self) -> list[Ints]:
        """The rows of the first, second, ... time that instants are driven."""
        order = np.argsort(self.place, kind="stable")
        place, time = self.place[order], np.zeros(len(order), dtype=np.int64)
        time[order] = np.arange(len(order)) - np.searchsorted(place, place)
        return [np.flatnonzero(time == k) for k in range(int(time.max()) + 1)]

    @cached_property
    def _order(self) -> tuple[Ints, Ints]:
        """Which frequencies are looked at, band by band, and which band each belongs to, (F,) each."""
        f = np.concatenate([np.arange(m) * self.rows.rate / 2 / m for m in self.lengths])
        edges = LOWEST_HZ * 2.0 ** np.arange(OCTAVES)
        band = np.searchsorted(edges[edges < self.cutoff], f, side="right")
        band[f > self.cutoff] = -1
        more = [np.where(band < 0, -1, band + 1 + band.max())] * (len(self.times) - 1)
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
        use = self.noise.counting(self.rows, joint)
        seen = abs(self.turned[joint]).sum(axis=1) > 0
        share = np.concatenate([np.full(len(x), x.mean()) for x in self._split(seen)])
        share = share[self._order[0]]
        new = 1.0 if always else (use & self.rows.is_new).sum() / max(use.sum(), 1)
        return np.array([new * share[part].sum() for part in self.slices])

    def _split(self, x: Floats) -> list[Floats]:
        """Return rows of means and differences, one array for each motion."""
        return np.split(x, np.cumsum(self.lengths * len(self.times))[:-1])

    @cached_property
    def turned(self) -> list[sparse.csr_array]:
        """What whitens the rows of each joint and turns them into means and differences, (times of instants, M)."""
        M, noise = len(self.rows), self.noise
        turned = []
        for j, ar in enumerate(noise.ar):
            use = noise.counting(self.rows, j).astype(float)
            mean = sparse.csr_array((sum(self.lengths), M))
            count, parts = np.zeros(sum(self.lengths)), []
            for time in self.times:
                one = sparse.csr_array((use[time], (self.place[time], time)), mean.shape)
                here = one.sum(axis=1)
                total = np.maximum(count + here, 1.0)
                off = one - mean.multiply(here[:, None])
                parts.append(off.multiply(np.sqrt(count / total)[:, None]))
                mean = mean + off.multiply((1.0 / total)[:, None])
                count += here
            parts[0] = mean.multiply(np.sqrt(count)[:, None])
            # Why the cut-off: whitened rows have hardly any noise above it.
            share = np.sqrt(2.0 * self.cutoff / self.rows.rate / noise.count[j])
            white = sparse.diags_array([1.0, *-ar], offsets=-np.arange(len(ar) + 1), shape=(M, M))
            turned.append(share / noise.sigma[j] * sparse.vstack(parts) @ white)
        return turned

    def transformed(self, joint: int, x: Floats) -> Floats:
        """Return filtered columns of one joint, (..., M), as whitened rows by frequency, (..., F)."""
        flat = self.turned[joint] @ x.reshape(-1, x.shape[-1]).T
        motions = [dct(part, norm="ortho", axis=0) for part in self._split(flat)]
        return np.concatenate(motions)[self._order[0]].T.reshape(*x.shape[:-1], -1)

    def unrepeated(self, joint: int, x: Floats) -> Floats:
        """Return rows of a joint, (M,), less their mean over all times that each instant is driven; once, as they are.

        Why larger: so that noise which does not repeat is as large as it was.
        """
        use = self.noise.counting(self.rows, joint)
        count = np.bincount(self.place, use)
        mean = np.bincount(self.place, x * use) / np.maximum(count, 1.0)
        again = np.where(count > 1.0, mean, 0.0)[self.place]
        scale = np.sqrt(np.where(count > 1.0, count / np.maximum(count - 1.0, 1.0), 1.0))
        return (x - again) * scale[self.place]

    def products(self, one: Floats, other: Floats) -> Floats:
        """Return products of columns by frequency, (..., k, F) and (..., m, F), band by band, (B, ..., k, m)."""
        return np.array([one[..., x] @ np.swapaxes(other[..., x], -1, -2) for x in self.slices])
