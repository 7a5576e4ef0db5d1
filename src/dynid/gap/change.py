"""Old and new logs of other motion together: what may always have been missing, and which joints have changed.

The posterior of earlier logs is no judge of a change: on another motion a real arm differs from it by several of its
standard errors although nothing has changed, because what the model lacks was fitted along. So old and new logs are
fitted together, with the columns of the residual model in both alike, and what is looked for acts in the new ones.

Whether anything has changed at all is asked joint by joint: one set of parameters for both against one for each
(Chow). Another motion asks for more of a model that lacks something, and each set does better on the rows that it was
fitted to. So a joint has changed only when one set for both costs more than one set for two halves of the same logs
that are as unlike as they can be, and when it also misses parts of either logs by more that were left out.

Source: Chow 1960, "Tests of equality between sets of coefficients in two linear regressions", for the statistic; Stone
1974, "Cross-validatory choice and assessment of statistical predictions", for parts that are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynid.arrays import Floats, Ints, Mask
from dynid.estimation import tuning
from dynid.estimation.residual_model import GROUPS, shapes_of
from dynid.gap.gap_rows import GapRows
from dynid.gap.known_errors import reversal_columns
from dynid.gap.problem import GapProblem, unwhitened_fit
from dynid.gap.selected_effects import SelectedEffect, torque_in_rows, with_columns, with_selected
from dynid.model.effects.friction import sign_of

#: A joint has changed when its common fit is this much worse, beyond 1, than that of unlike halves of the same logs, or
#: the new logs leave this much more, beyond 1, than one half leaves over the other: between two motions all joints are
#: elsewhere at once.
BEYOND_HALVES = 1.5
#: Smallest growth of a joint's residual that counts, whatever halves say: the squares of what is visible at a fifth of
#: the noise.
LEAST_GROWTH = 0.02
#: The same for what parameters of the new logs alone leave of them, over what those of the old ones leave: a change
#: that no parameters absorb shows nowhere else. Faster motion leaves more too, so rows of like speed are compared.
LEAST_MORE = 0.2
#: Rows of like speed that have an rms at least.
FEW = 10
#: Parts that were left out have to be missed by so much more with the other logs than without them. Where nothing has
#: changed these are rows more; what the model lacks costs a few per cent.
LEAST_HARM = 0.1
#: Parts of the old, and of the new logs, that are left out in turn.
PARTS = 8
#: Least rms speed that shapes of friction scale with [rad/s or m/s].
SLOWEST = 1e-3
#: Ridge on normalised columns, which holds what the rows leave open near zero.
OPEN = 1e-6


@dataclass(frozen=True)
class ChangeTest:
    """Which joints have changed.

    Attributes:
        growth: rms of the residual with one set of parameters for old and new logs, over that with one for each, (n,).
        unlike: the largest such growth between halves of the old, or of the new logs: in time, where the joint was, and
            how fast it was, (n,).
        harm: rms by which left-out parts of the old, or of the new logs are missed, with the other logs and the rest
            of their own over that without, the larger one, (n,).
        more: rms that the parameters of the new logs leave of them, over that of the old logs, the least of slow and of
            fast rows, (n,).
        uneven: the largest such ratio between halves in time, and of where the joint was, with one set for both, (n,).
    """

    growth: Floats
    unlike: Floats
    harm: Floats
    more: Floats
    uneven: Floats

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints that have changed."""
        grown = self.growth > 1.0 + np.maximum(BEYOND_HALVES * (self.unlike - 1.0), LEAST_GROWTH)
        louder = self.more > 1.0 + np.maximum(BEYOND_HALVES * (self.uneven - 1.0), LEAST_MORE)
        return tuple(np.flatnonzero((grown & (self.harm > 1.0 + LEAST_HARM)) | louder).tolist())


def still_changed(problem: GapProblem, selected: Sequence[SelectedEffect]) -> ChangeTest:
    """Return on which joints old and new logs do not agree although effects are taken out of the new ones.

    Args:
        problem: a search for changes, old logs among its rows.
        selected: what is taken out.
    """
    selected, rows = with_columns(selected), problem.rows
    fit = with_selected(problem.regression(), selected)
    torques = torque_in_rows(fit.rows, selected, fit.amplitudes)
    rows = replace(rows, tau=rows.tau - sum(torques))
    left = unwhitened_fit(rows.only(~rows.is_new))[1]
    old = [part for part in rows.parts if not rows.is_new[part.start]]
    power = [np.mean(left[part][rows.use[part].all(axis=1)] ** 2, axis=0) for part in old]
    level = np.sqrt(np.maximum(np.mean(power, axis=0), 1e-30))
    return change_test(*with_always_missing(rows, problem.theta, level))


def with_always_missing(rows: GapRows, theta: Floats, level: Floats) -> tuple[GapRows, Floats]:
    """Return rows with further base columns: what may have been missing before and is missing now, of each joint.

    They are those of the residual model (``estimation/residual_model.py``), and act in old and new logs alike, so that
    what follows place, speed and load in both is no change.

    Args:
        rows: rows, old and new ones.
        theta: base parameters, (p,).
        level: rms of what parameters alone leave of the old logs, (n,) [N m or N].

    Returns:
        The rows, with p + 14 n base columns, and rows [columns, value] that say how large each column may be: as large
        as an identification lets it be.
    """
    (n, p), k = rows.W.shape[1:], len(GROUPS)
    speed = np.maximum(np.sqrt(np.mean(rows.qd**2, axis=0)), SLOWEST)
    shapes = []
    for x in rows.motions:
        sign = np.stack([sign_of(x, j) for j in range(n)], axis=1)
        shapes.append(shapes_of(x.q, x.qd, sign, speed).reshape(len(x), -1).T)
    D = rows.filtered(shapes).T.reshape(len(rows), n, k)
    D[:, :, -1] *= np.abs(rows.W @ theta)
    power = np.sum(np.where(rows.use[:, :, None], D, 0.0) ** 2, axis=0)
    power /= np.maximum(rows.use.sum(axis=0), 1)[:, None]
    D /= np.where(power > 0.0, np.sqrt(power), 1.0)
    own = (D[:, :, None] * np.eye(n)[:, :, None]).reshape(len(rows), n, n * k)
    prior = np.zeros((n * k, p + n * k + 1))
    size = level[:, None] * np.sqrt(tuning.RESIDUAL_LARGEST)[GROUPS]
    prior[:, p:-1] = np.diag(1.0 / size.ravel())
    return replace(rows, W=np.concatenate([rows.W, own], axis=2)), prior


def change_test(rows: GapRows, held_by: Floats) -> ChangeTest:
    """Compare one set of parameters for old and new logs with one for each.

    Args:
        rows: old and new ones.
        held_by: rows [columns, value] that hold base parameters, (k, p + 1).
    """
    old, new = (_Era.of(rows, rows.train & era) for era in (~rows.is_new, rows.is_new))
    p, width = rows.W.shape[2], old.width
    base = np.append(np.arange(p), width - 1)
    known = np.zeros((width, width))
    known[np.ix_(base, base)] = held_by.T @ held_by
    errors = np.arange(p, width - 1)
    known[errors, errors] = 1.0
    parts, n = [old.whole, new.whole], rows.W.shape[1]
    count = rows.use[rows.train].sum(axis=0)
    sigma = _left(parts, [_solved(part, np.ones(n), known) for part in parts])
    sigma /= np.sqrt(np.maximum(count, 1))
    halves = [_halves(era, sigma, known) for era in (old, new)]
    unlike, uneven = (np.max(x, axis=0) for x in zip(*halves, strict=True))
    harm = [_harm(*pair, sigma, known) for pair in ((old, new.whole), (new, old.whole))]
    left, now = (era.residuals(_solved(era.whole, sigma, known)) for era in (old, new))
    more = np.array([_louder(a, b) for a, b in zip(now, left, strict=True)])
    return ChangeTest(_growth(parts, sigma, known), unlike, np.max(harm, axis=0), more, uneven)


@dataclass(frozen=True)
class _Era:
    """The searched rows of the old, or of the new logs, one part after the other; M rows in all.

    Attributes:
        columns: numbers of the columns that each joint has, the torque last, n of (c + 1,).
        rows: those columns in the rows that count of each joint, n of (m, c + 1).
        at: which rows these are, n of (m,).
        first: whether a row is in the first half of its part, (M,).
        q: positions, (M, n) [rad or m].
        speed: sizes of the velocities, (M, n) [rad/s or m/s].
        width: number of columns of all joints, with the torque.
    """

    columns: list[Ints]
    rows: list[Floats]
    at: list[Ints]
    first: Mask
    q: Floats
    speed: Floats
    width: int

    @classmethod
    def of(cls, rows: GapRows, chosen: Mask) -> _Era:
        """Return the chosen rows, (M,)."""
        (n, p), use, W = rows.W.shape[1:], rows.use[chosen], rows.W[chosen]
        columns, rows_of_joint = [], []
        for j in range(n):
            used = np.flatnonzero(np.any(W[:, j] != 0.0, axis=0))
            extra = reversal_columns(rows, j)[:, chosen].T
            own, k = np.arange(extra.shape[1]), extra.shape[1]
            columns.append(np.array([*used, *(p + j * k + own), p + n * k]))
            every = np.column_stack([W[:, j][:, used], extra, rows.tau[chosen, j]])
            rows_of_joint.append(every[use[:, j]])
        part = rows.part[chosen]
        begin, end = (np.searchsorted(part, part, side) for side in ("left", "right"))
        first = np.arange(len(part)) - begin < (end - begin) // 2
        at, speed = [np.flatnonzero(x) for x in use.T], np.abs(rows.qd[chosen])
        return cls(columns, rows_of_joint, at, first, rows.q[chosen], speed, p + n * k + 1)

    @cached_property
    def whole(self) -> Floats:
        """Products of [columns, torque] of each joint over all rows, (n, w + 1, w + 1)."""
        return self.part(np.ones(len(self.first), dtype=bool))

    def part(self, chosen: Mask) -> Floats:
        """Return the products over some of the rows."""
        gram = np.zeros((len(self.rows), self.width, self.width))
        for own, columns, rows, at in zip(gram, self.columns, self.rows, self.at, strict=True):
            A = rows[chosen[at]]
            own[np.ix_(columns, columns)] = A.T @ A
        return gram

    def residuals(self, theta: Floats) -> list[Floats]:
        """Return what [-theta, 1], (w,), leaves of the rows of each joint, and their speeds, n of (2, m)."""
        each = zip(self.columns, self.rows, self.at, self.speed.T, strict=True)
        return [np.stack([rows @ theta[columns], speed[at]]) for columns, rows, at, speed in each]


def _louder(one: Floats, other: Floats) -> float:
    """Return the rms of residuals with their speeds, (2, m), over that of others, the least of slow and fast ones."""
    middle = np.median(np.append(one[1], other[1])) if one.size + other.size else 0.0
    ratios = []
    for fast in (False, True):
        a, b = (x[0, (x[1] >= middle) == fast] for x in (one, other))
        if min(len(a), len(b)) >= FEW:
            ratios.append(np.sqrt(np.mean(a**2) / max(np.mean(b**2), 1e-300)))
    return float(min(ratios, default=0.0))


def _halves(era: _Era, sigma: Floats, known: Floats) -> tuple[Floats, Floats]:
    """Return the largest growth, and the largest ratio of residuals, between halves of some logs, (n,) each.

    A joint is judged by halves in time, and by halves of its own positions and speeds.
    """
    n = len(sigma)

    def grown(first: Mask) -> Floats:
        one = era.part(first)
        return _growth([one, era.whole - one], sigma, known)

    growth, ratio = grown(era.first), np.zeros(n)
    left = era.residuals(_solved(era.whole, sigma, known))
    for j in range(n):
        near, slow = (np.argsort(np.argsort(x[:, j])) < len(x) // 2 for x in (era.q, era.speed))
        growth[j] = max(growth[j], grown(near)[j], grown(slow)[j])
        halves = [
            (left[j][:, first[era.at[j]]], left[j][:, ~first[era.at[j]]])
            for first in (era.first, near)
        ]
        ratio[j] = max(_louder(*pair) for a, b in halves for pair in ((a, b), (b, a)))
    return growth, ratio


def _harm(era: _Era, other: Floats, sigma: Floats, known: Floats) -> Floats:
    """Return the rms by which left-out parts of some logs are missed with other logs over that without them, (n,)."""
    number = np.arange(len(era.first)) * PARTS // max(len(era.first), 1)
    parts = [era.part(number == k) for k in range(PARTS)]
    rest = [era.whole - part for part in parts]
    with_other, without = (
        _left(parts, [_solved(one, sigma, known) for one in fitted])
        for fitted in ([one + other for one in rest], rest)
    )
    return with_other / without


def _growth(parts: Sequence[Floats], sigma: Floats, known: Floats) -> Floats:
    """Return rms of one set of parameters for all parts over that of one for each, (n,)."""
    together = _left(parts, [_solved(np.sum(parts, axis=0), sigma, known)] * len(parts))
    return together / _left(parts, [_solved(part, sigma, known) for part in parts])


def _solved(part: Floats, sigma: Floats, known: Floats) -> Floats:
    """Return [-theta, 1] of the weighted least-squares fit jointly with what is known of theta, (w + 1,)."""
    information = np.tensordot(sigma**-2.0, part, 1) + known
    gram, right = information[:-1, :-1], information[:-1, -1]
    size = np.sqrt(np.maximum(np.diag(gram), 0.0))
    size = np.where(size > 0, size, 1.0)
    theta = (
        np.linalg.solve(gram / np.outer(size, size) + OPEN * np.eye(len(size)), right / size) / size
    )
    return np.append(-theta, 1.0)


def _left(parts: Sequence[Floats], theta: Sequence[Floats]) -> Floats:
    """Return the root of the sum of squares that each joint leaves of all parts, each with its parameters, (n,)."""
    powers = [x @ part @ x for part, x in zip(parts, theta, strict=True)]
    return np.asarray(np.sqrt(np.maximum(np.sum(powers, axis=0), 1e-30)))
