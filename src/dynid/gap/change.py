"""Old and new logs of other motion together: what may always have been missing, and which joints have changed.

The posterior of earlier logs is no judge of a change: on another motion a real arm differs from it by several of its
standard errors although nothing has changed, because what the model lacks was fitted along. So old and new logs are
fitted together, with the columns of the residual model in both alike, and what is looked for acts in the new ones.

Whether anything has changed at all is asked joint by joint: one set of parameters for both against one for each
(Chow), compared with the same between halves of the old logs, and of the new ones, where nothing can have changed.

Source: Chow 1960, "Tests of equality between sets of coefficients in two linear regressions", for the statistic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.estimation.error_columns import GROUPS, shapes_of
from dynid.estimation.model_error import LARGEST
from dynid.gap.segments import Mask, SegmentRows
from dynid.model.effects.interface import Floats, sign_of

#: A joint has changed when its common fit is this much worse, beyond 1, than halves of logs are by themselves. Another
#: motion asks for more of the model than the other half of the same one.
BEYOND_HALVES = 1.5
#: Smallest growth of a joint's residual that counts, whatever halves say: the squares of what is visible at a fifth of
#: the noise.
LEAST_GROWTH = 0.02
#: The same for what parameters of the new logs alone leave of them, over what those of the old ones leave: a change
#: that no parameters absorb shows nowhere else, but faster motion leaves more too.
LEAST_MORE = 0.2
#: Least rms speed that shapes of friction scale with [rad/s or m/s].
SLOWEST = 1e-3
#: Directions of normalised columns below this share of the strongest are left at zero.
WEAK = 1e-6


@dataclass(frozen=True)
class ChangeTest:
    """Which joints have changed.

    Attributes:
        growth: rms of the residual with one set of parameters for old and new logs, over that with one for each, (n,).
        halves: the largest such growth between halves of the old, and of the new logs, (n,).
        more: rms that the parameters of the new logs leave of them, over that of the old logs, (n,).
    """

    growth: Floats
    halves: Floats
    more: Floats

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


def with_always_missing(
    segments: Sequence[SegmentRows], theta: Floats, level: Floats
) -> tuple[list[SegmentRows], Floats]:
    """Return rows with further base columns: what may have been missing before and is missing now, of each joint.

    They are those of the residual model (``estimation/error_columns.py``), and act in old and new logs alike, so that
    what follows place, speed and load in both is no change.

    Args:
        segments: rows, old and new ones.
        theta: base parameters, (p,).
        level: rms of what parameters alone leave of the old logs, (n,) [N m or N].

    Returns:
        The rows, with p + 14 n base columns, and rows [columns, value] that say how large each column may be: as large
        as an identification lets it be.
    """
    n, p = segments[0].W.shape[1:]
    k = len(GROUPS)
    speed = np.maximum(np.sqrt(np.mean(np.concatenate([s.qd for s in segments]) ** 2, axis=0)), SLOWEST)
    shapes = []
    for s in segments:
        sign = np.stack([sign_of(s.motion, j) for j in range(n)], axis=1)
        flat = shapes_of(s.motion.q, s.motion.qd, sign, speed).reshape(len(s.motion), -1)
        D = s.filtered(np.ascontiguousarray(flat.T)).T.reshape(len(s), n, k)
        D[:, :, -1] *= np.abs(s.W @ theta)
        shapes.append(D)
    use = np.concatenate([s.use for s in segments])[:, :, None]
    power = np.sum(np.where(use, np.concatenate(shapes), 0.0) ** 2, axis=0) / np.maximum(use.sum(axis=0), 1)
    scale = np.where(power > 0.0, np.sqrt(power), 1.0)
    joints, columns = np.divmod(np.arange(n * k), k)
    found = []
    for s, D in zip(segments, shapes, strict=True):
        rows = replace(
            s.rows,
            entries=np.concatenate([s.rows.entries, (D / scale).reshape(len(s), -1).T]),
            joints=np.concatenate([s.rows.joints, joints]),
            columns=np.concatenate([s.rows.columns, p + k * joints + columns]),
            size=p + n * k,
            command=None,
        )
        found.append(replace(s, rows=rows))
    prior = np.zeros((n * k, p + n * k + 1))
    prior[:, p:-1] = np.diag(1.0 / (level[:, None] * np.sqrt(LARGEST)[GROUPS]).ravel())
    return found, prior


def change_test(
    segments: Sequence[SegmentRows],
    train: Sequence[Mask],
    nuisance: Sequence[Sequence[Floats]],
    held_by: Floats | None = None,
) -> ChangeTest:
    """Compare one set of parameters for old and new logs with one for each.

    Args:
        segments: rows, old and new ones.
        train: rows that are searched, one mask (M,) per segment.
        nuisance: for each segment and joint, columns that are not judged, (c / n, M).
        held_by: rows [columns, value] that hold base parameters, (k, p + 1); None for none.
    """
    width = segments[0].W.shape[2]
    prior = np.zeros((0, width + 1)) if held_by is None else held_by
    wide = np.zeros((len(prior), width + sum(map(len, nuisance[0])) + 1))
    wide[:, :width], wide[:, -1] = prior[:, :-1], prior[:, -1]
    known = wide.T @ wide
    halves = [_halves(s, rows, columns) for s, rows, columns in zip(segments, train, nuisance, strict=True)]
    eras = [
        [_sum([half[k] for half, s in zip(halves, segments, strict=True) if s.fresh is fresh]) for k in (0, 1)]
        for fresh in (False, True)
    ]
    old, new = (first + second for first, second in eras)
    sigma = _rms([old, new], _separate([old, new], np.ones(len(old.count)), known))
    null = np.max([_growth(parts, sigma, known) for parts in eras], axis=0)
    left, now = (_rms([part], [_solved(part, sigma, known)]) for part in (old, new))
    return ChangeTest(_growth([old, new], sigma, known), null, now / np.maximum(left, 1e-300))


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


def _growth(parts: Sequence[Part], sigma: Floats, known: Floats) -> Floats:
    """Return rms of one set of parameters for all parts over that of one for each, (n,)."""
    common = _solved(_sum(parts), sigma, known)
    together = _rms(parts, [common] * len(parts))
    return together / np.maximum(_rms(parts, _separate(parts, sigma, known)), 1e-300)


def _separate(parts: Sequence[Part], sigma: Floats, known: Floats) -> list[Floats]:
    return [_solved(part, sigma, known) for part in parts]


def _solved(part: Part, sigma: Floats, known: Floats) -> Floats:
    """Return [-theta, 1] of the weighted least-squares fit beside what is known of theta, (w + 1,)."""
    whole = np.einsum("j,jab->ab", 1.0 / sigma**2, part.gram) + known
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
