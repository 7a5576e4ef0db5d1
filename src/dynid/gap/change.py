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

import numpy as np

from dynid.arrays import Floats, Mask
from dynid.estimation import tuning
from dynid.estimation.factor import of_unit_diagonal
from dynid.estimation.residual_model import GROUPS, shapes_in
from dynid.gap.gap_rows import GapRows
from dynid.gap.noise import NoiseModel
from dynid.gap.problem import GapProblem, searched_rms, unwhitened_fit
from dynid.gap.regression import whitened_regression
from dynid.gap.selected_effects import SelectedEffect, torque_in_rows, with_selected

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
    rows = problem.rows
    fit = with_selected(problem.regression(), selected)
    torques = torque_in_rows(fit.rows, selected, fit.amplitudes)
    return change_test(*with_always_missing(problem, replace(rows, tau=rows.tau - sum(torques))))


def with_always_missing(problem: GapProblem, rows: GapRows) -> tuple[GapRows, Floats]:
    """Return rows with further base columns: what may have been missing before and is missing now, of each joint.

    They are those of the residual model (``estimation/residual_model.py``), and act in old and new logs alike, so that
    what follows place, speed and load in both is no change.

    Args:
        problem: the search.
        rows: its rows, old and new ones, less what is taken out.

    Returns:
        The rows, with p + 14 n base columns, and rows [columns, value] that say how large each column may be: as large
        as an identification lets it be.
    """
    (n, p), k, base = rows.W.shape[1:], len(GROUPS), problem.base
    old = rows.only(~rows.is_new)
    level = searched_rms(old, unwhitened_fit(old)[1])
    speed = np.maximum(np.sqrt(np.mean(rows.qd**2, axis=0)), SLOWEST)
    observer = base.observer
    D = np.concatenate([shapes_in(log, observer, speed) for log in rows.logs])
    D[:, :, -1] *= np.abs(rows.W @ problem.theta)
    rms = np.sqrt(np.mean(D**2, axis=0, where=rows.use[:, :, None]))
    D /= np.where(rms > 0.0, rms, 1.0)
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
    parts, n = _Parts(rows.only(rows.train), held_by), rows.tau.shape[1]
    eras = [rows.train & ~rows.is_new, rows.train & rows.is_new]
    whole = [parts.products(era) for era in eras]
    parts.sigma = parts.left(whole, [parts.fitted(one) for one in whole]) / parts.counts**0.5
    left = parts.residuals(*(parts.fitted(one) for one in whole))
    time = rows.at / np.bincount(rows.part)[rows.part]
    unlike, uneven, harm = np.ones(n), np.zeros(n), np.zeros(n)
    for era, both, other in zip(eras, whole, whole[::-1], strict=True):
        for j in range(n):
            speed = np.abs(rows.qd[:, j])
            for key in (time, rows.q[:, j], speed):
                first = era & (key < np.median(key[era]))
                one, second = parts.products(first), era & ~first
                unlike[j] = max(unlike[j], parts.growth([one, both - one])[j])
                if key is not speed:
                    for pair in ((first, second), (second, first)):
                        uneven[j] = max(uneven[j], _louder(left[:, j], speed, *pair))
        number = (np.cumsum(era) - 1) * PARTS // era.sum()
        out = [parts.products(era & (number == k)) for k in range(PARTS)]
        with_other, without = (
            parts.left(out, [parts.fitted(both - one + more) for one in out])
            for more in (other, 0.0)
        )
        harm = np.maximum(harm, with_other / without)
    more = np.array(
        [_louder(*pair, *eras[::-1]) for pair in zip(left.T, np.abs(rows.qd.T), strict=True)]
    )
    return ChangeTest(parts.growth(whole), unlike, harm, more, uneven)


class _Parts:
    """Fits to parts of rows, by the products of their columns and torques."""

    def __init__(self, rows: GapRows, held_by: Floats) -> None:
        """Keep the columns of each joint that are no zeros, the torque last."""
        noise = NoiseModel.white(np.ones(rows.tau.shape[1]))
        fit = whitened_regression(rows, noise, held_by.T @ held_by)
        every = [np.column_stack(pair) for pair in zip(fit.X, fit.y, strict=True)]
        self.rows, self.known, self.used = (
            rows,
            fit.known,
            [np.flatnonzero(X.any(axis=0)) for X in every],
        )
        self.columns = [X[:, used] for X, used in zip(every, self.used, strict=True)]
        self.at = [np.flatnonzero(use) for use in rows.use.T]
        self.counts = np.maximum(rows.use.sum(axis=0), 1)
        self.sigma = np.ones(len(every))

    def products(self, chosen: Mask) -> Floats:
        """Return the products of [columns, torque] of each joint over some rows, (n, w + 1, w + 1)."""
        products = np.zeros((len(self.at), *self.known.shape))
        for own, X, used, at in zip(products, self.columns, self.used, self.at, strict=True):
            some = X[chosen[at]]
            own[np.ix_(used, used)] = some.T @ some
        return products

    def fitted(self, products: Floats) -> Floats:
        """Return [-theta, 1] of the weighted least-squares fit jointly with what is known, (w + 1,)."""
        information = np.tensordot(self.sigma**-2.0, products, 1) + self.known
        scaled, unit = of_unit_diagonal(information)
        theta = np.linalg.solve(scaled[:-1, :-1] + OPEN * np.eye(len(unit) - 1), scaled[:-1, -1])
        return np.append(-theta * unit[:-1] / unit[-1], 1.0)

    def left(self, parts: Sequence[Floats], theta: Sequence[Floats]) -> Floats:
        """Return the root of the sum of squares that each joint leaves of parts, each with its fit, (n,)."""
        powers = [x @ part @ x for part, x in zip(parts, theta, strict=True)]
        return np.sqrt(np.maximum(np.sum(powers, axis=0), 1e-30))

    def growth(self, parts: Sequence[Floats]) -> Floats:
        """Return the rms of one fit to all parts over that of one for each, (n,)."""
        together = self.left(parts, [self.fitted(np.sum(parts, axis=0))] * len(parts))
        return together / self.left(parts, [self.fitted(part) for part in parts])

    def residuals(self, old: Floats, new: Floats) -> Floats:
        """Return what the fit of its own leaves of old and of new rows, (M, n); no number where rows do not count."""
        left = np.full(self.rows.tau.shape, np.nan)
        for j, (X, used, at) in enumerate(zip(self.columns, self.used, self.at, strict=True)):
            left[at, j] = np.where(self.rows.is_new[at], X @ new[used], X @ old[used])
        return left


def _louder(left: Floats, speed: Floats, one: Mask, other: Mask) -> float:
    """Return the rms of residuals in some rows over that in others, all (M,), the least of slow and fast ones."""
    known = np.isfinite(left)
    both = (one | other) & known
    middle, ratios = np.median(speed[both]) if both.any() else 0.0, []
    for alike in (speed >= middle, speed < middle):
        a, b = (left[mask & alike & known] for mask in (one, other))
        if min(len(a), len(b)) >= FEW:
            ratios.append(float(np.sqrt(np.mean(a**2) / np.maximum(np.mean(b**2), 1e-300))))
    return min(ratios, default=0.0)
