"""Whether an arm has changed between two sets of logs: one set of parameters for both against one for each (Chow).

The posterior of earlier logs is no judge of that: on another motion a real arm differs from it by several of its
standard errors although nothing has changed, because what the model lacks was fitted along. So the statistic of old
against new logs is compared with the same statistic between halves of the old logs, and of the new ones, where nothing
can have changed: what one part of a motion leaves of another.

Source: Chow 1960, "Tests of equality between sets of coefficients in two linear regressions", for the statistic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.gap.segments import Mask, SegmentRows
from dynid.model.effects.interface import Floats

#: A joint has changed when its common fit is this much worse, beyond 1, than halves of logs are by themselves. Another
#: motion asks for more of the model than the other half of the same one.
BEYOND_HALVES = 1.5
#: Smallest growth of a joint's residual that counts, whatever halves say: the squares of what is visible at a fifth of
#: the noise.
LEAST_GROWTH = 0.02
#: The same for what parameters of the new logs alone leave of them, over what those of the old ones leave: a change
#: that no parameters absorb shows nowhere else, but faster motion leaves more too.
LEAST_MORE = 0.2
#: Directions of normalised columns below this share of the strongest are left at zero.
WEAK = 1e-6


@dataclass(frozen=True)
class ChangeTest:
    """Which joints have changed.

    Attributes:
        growth: rms of the residual with one set of parameters for old and new logs, over that with one for each, (n,).
        halves: the largest such growth between halves of the old, and of the new logs, (n,).
        more: rms that the parameters of the new logs leave of them, over that of the old logs, (n,).
        left: rms that the parameters of the old logs leave of them, (n,) [N m or N].
    """

    growth: Floats
    halves: Floats
    more: Floats
    left: Floats

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints that have changed."""
        usual = BEYOND_HALVES * (self.halves - 1.0)
        grown = self.growth > 1.0 + np.maximum(usual, LEAST_GROWTH)
        return tuple(np.flatnonzero(grown | (self.more > 1.0 + np.maximum(usual, LEAST_MORE))).tolist())


@dataclass(frozen=True)
class Part:
    """Rows of some time, as normal equations of each joint; w baseline columns.

    Attributes:
        gram: of [columns, torque], (n, w + 1, w + 1).
        count: number of rows, (n,).
    """

    gram: Floats
    count: Floats

    def __add__(self, other: Part) -> Part:
        """Return both."""
        return Part(self.gram + other.gram, self.count + other.count)


def change_test(
    segments: Sequence[SegmentRows], train: Sequence[Mask], nuisance: Sequence[Sequence[Floats]]
) -> ChangeTest:
    """Compare one set of parameters for old and new logs with one for each.

    Args:
        segments: rows, old and new ones.
        train: rows that are searched, one mask (M,) per segment.
        nuisance: for each segment and joint, columns that are not judged, (c / n, M).
    """
    halves = [_halves(s, rows, columns) for s, rows, columns in zip(segments, train, nuisance, strict=True)]
    eras = [
        [_sum([half[k] for half, s in zip(halves, segments, strict=True) if s.fresh is fresh]) for k in (0, 1)]
        for fresh in (False, True)
    ]
    old, new = (first + second for first, second in eras)
    sigma = _rms([old, new], _separate([old, new], np.ones(len(old.count))))
    null = np.max([_growth(parts, sigma) for parts in eras], axis=0)
    left, now = (_rms([part], [_solved(part, sigma)]) for part in (old, new))
    return ChangeTest(_growth([old, new], sigma), null, now / np.maximum(left, 1e-300), left)


def _halves(segment: SegmentRows, train: Mask, nuisance: Sequence[Floats]) -> tuple[Part, Part]:
    """Return the first and the second half of a segment's searched rows."""
    rows = np.flatnonzero(train)
    middle = rows[len(rows) // 2] if len(rows) else 0
    first = np.arange(len(train)) < middle
    return _part(segment, train & first, nuisance), _part(segment, train & ~first, nuisance)


def _part(segment: SegmentRows, chosen: Mask, nuisance: Sequence[Floats]) -> Part:
    n, p = segment.W.shape[1:]
    own = len(nuisance[0])
    gram, count = np.zeros((n, p + n * own + 1, p + n * own + 1)), np.zeros(n)
    for j in range(n):
        use = chosen & segment.use[:, j]
        columns = [*range(p), *range(p + j * own, p + (j + 1) * own), p + n * own]
        A = np.column_stack([segment.W[use, j], nuisance[j][:, use].T, segment.tau[use, j]])
        gram[j][np.ix_(columns, columns)] = A.T @ A
        count[j] = use.sum()
    return Part(gram, count)


def _sum(parts: Sequence[Part]) -> Part:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


def _growth(parts: Sequence[Part], sigma: Floats) -> Floats:
    """Return rms of one set of parameters for all parts over that of one for each, (n,)."""
    common = _solved(_sum(parts), sigma)
    together = _rms(parts, [common] * len(parts))
    return together / np.maximum(_rms(parts, _separate(parts, sigma)), 1e-300)


def _separate(parts: Sequence[Part], sigma: Floats) -> list[Floats]:
    return [_solved(part, sigma) for part in parts]


def _solved(part: Part, sigma: Floats) -> Floats:
    """Return [-theta, 1] of the weighted least-squares fit, (w + 1,)."""
    whole = np.einsum("j,jab->ab", 1.0 / sigma**2, part.gram)
    gram, right = whole[:-1, :-1], whole[:-1, -1]
    size = np.sqrt(np.diag(gram))
    size = np.where(size > 0, size, 1.0)
    values, V = np.linalg.eigh(gram / np.outer(size, size))
    kept = values > WEAK * values[-1]
    theta = V[:, kept] @ ((V[:, kept].T @ (right / size)) / values[kept]) / size
    return np.append(-theta, 1.0)


def _rms(parts: Sequence[Part], theta: Sequence[Floats]) -> Floats:
    """Return the rms residual of each joint over all parts, each with its parameters, (n,)."""
    powers = [np.einsum("a,jab,b->j", x, part.gram, x) for part, x in zip(parts, theta, strict=True)]
    count = np.sum([part.count for part in parts], axis=0)
    return np.asarray(np.sqrt(np.maximum(np.sum(powers, axis=0), 1e-30) / np.maximum(count, 1)))
