"""Whitened rows of all joints, what explains them so far, and what is left.

Each joint has its own noise, so each has its own rows; the parameters are common. Evidence for a candidate is judged
after everything that the model could absorb has been projected out of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from dynid.gap.known_errors import KnownErrors
from dynid.gap.noise import NoiseModel, whitened
from dynid.gap.segments import SegmentRows, jackknife_blocks
from dynid.model.effects.catalogue import joined_motion
from dynid.model.effects.interface import ArmMotion, Floats

Ints = NDArray[np.int64]
#: Whitened columns of one effect by joint, {joint: (k, M_j)}.
EffectColumns = Mapping[int, Floats]

#: Share of a candidate's power, and of that of its own columns, below which the model absorbs it: these logs cannot
#: show it.
ABSORBED = 1e-5
#: The same of possible links: the data hold these a thousand times as tightly as their prior does, so what they take up
#: nearly wholly is still told from an implausible arm.
ABSORBED_BY_ARM = 1e-8
#: Rows up to which the columns of all candidates stay in memory: those of so many take a quarter of a gigabyte.
FEW_ROWS = 1 << 13
#: Directions of normalised columns below this share of the strongest are not excited: they are left at zero.
WEAK = 1e-9
#: The same where the prior of possible links tells apart what no row does: it knows a billionth of what rows would.
WEAK_WITH_ARM = 1e-13


@dataclass(frozen=True)
class WhitenedRows:
    """The whitened rows of one joint.

    Attributes:
        joint: its index.
        A: baseline columns, (M, p + c).
        y: torques, (M,).
        block: number of the jackknife block, rising, (M,).
        log: number of the log, (M,).
        index: which rows of the concatenated segments they are, (M,).
    """

    joint: int
    A: Floats
    y: Floats
    block: Ints
    log: Ints
    index: Ints

    @cached_property
    def gram(self) -> Floats:
        """Products of all columns and torques with each other, (p + c + 1, p + c + 1)."""
        # Why once: what is fitted with the baseline changes again and again, these rows do not.
        both = np.column_stack([self.A, self.y])
        return np.asarray(both.T @ both)


@dataclass(frozen=True)
class WhitenedFit:
    """The least-squares fit of the whitened rows.

    Attributes:
        theta: base parameters, coefficients of columns that are not judged, amplitudes of effects, (w,).
        root: R with R R^T the inverse of the normal matrix without directions that are not excited, (w, r): columns
            times R are an orthonormal basis of all of them.
        e: residuals of each joint, (M_j,).
    """

    theta: Floats
    root: Floats
    e: list[Floats]

    @property
    def inverse(self) -> Floats:
        """Inverse of the normal matrix, (w, w)."""
        return np.asarray(self.root @ self.root.T)


@dataclass(frozen=True)
class WhitenedRegression:
    """The rows of all joints with the baseline, the prior and the effects that explain them.

    Prior rows hold any combination of baseline columns. Columns of an effect may be zero in the rows of some logs: base
    columns that are, with the others as they are, are what has changed in the other logs.

    Attributes:
        segments: where the rows come from.
        noise: what they were whitened with.
        joints: rows of each joint.
        prior: further rows [columns, value] on the baseline, such as what an earlier identification knows,
            (r, p + c + 1); None for none.
        effects: columns of selected effects.
        bounded: number of columns at the end of the baseline that are known errors, each one standard deviation of what
            it stands for.
        link_prior: whether the prior rows say how implausible an arm is. What frees the links then shows on other
            joints than its own.
    """

    segments: Sequence[SegmentRows]
    noise: NoiseModel
    joints: tuple[WhitenedRows, ...]
    prior: Floats | None = None
    effects: tuple[EffectColumns, ...] = ()
    bounded: int = 0
    link_prior: bool = False

    @cached_property
    def motion(self) -> ArmMotion:
        """All motion in which candidates act, one segment after the other."""
        return joined_motion([s.motion for s in self.segments if s.is_new])

    @property
    def absorbed(self) -> float:
        """Share of a candidate's power below which the model absorbs it."""
        return ABSORBED_BY_ARM if self.link_prior else ABSORBED

    @property
    def size(self) -> int:
        """Number of baseline columns, p + c."""
        return int(self.joints[0].A.shape[1])

    @property
    def _errors(self) -> Ints:
        """Which columns are known errors, (bounded,)."""
        return np.arange(self.size - self.bounded, self.size)

    def with_effects(self, effects: Sequence[EffectColumns]) -> WhitenedRegression:
        """Return the regression with the columns of other effects."""
        return replace(self, effects=tuple(effects))

    def whiten(self, joint: int, parts: Sequence[Floats]) -> Floats:
        """Return filtered columns of one joint, one (..., M_s) per segment, as whitened rows, (..., M_j)."""
        ar, sigma = self.noise.ar[joint], self.noise.sigma[joint] * self.noise.count[joint] ** 0.5
        kept = [
            whitened(x, ar)[..., s.use[self.noise.order :, joint]]
            for x, s in zip(parts, self.segments, strict=True)
        ]
        rows: Floats = np.concatenate(kept, axis=-1) / sigma
        return rows

    @cached_property
    def fit(self) -> WhitenedFit:
        """Baseline and effects fitted to all rows and to the prior."""
        whole = self.gram.sum(axis=0)
        gram, right = whole[:-1, :-1], whole[:-1, -1]
        if self.prior is not None:
            p = self.size
            gram[:p, :p] += self.prior[:, :-1].T @ self.prior[:, :-1]
            right[:p] += self.prior[:, :-1].T @ self.prior[:, -1]
        gram[self._errors, self._errors] += 1.0
        length = np.sqrt(np.diag(gram))
        length = np.where(length > 0, length, 1.0)
        values, V = np.linalg.eigh(gram / np.outer(length, length))
        kept = values > (WEAK_WITH_ARM if self.link_prior else WEAK) * values[-1]
        root = V[:, kept] / np.sqrt(values[kept]) / length[:, None]
        theta = root @ (root.T @ right)
        residuals = [rows.y - self.combined(rows.joint, theta) for rows in self.joints]
        return WhitenedFit(theta, root, residuals)

    @cached_property
    def gram(self) -> Floats:
        """Products of all columns and torques with each other in the rows of each joint, (n, w + 1, w + 1)."""
        p, width = self.size, self._edges[-1]
        order = [*range(p), width]
        found = np.zeros((len(self.joints), width + 1, width + 1))
        for j, rows in enumerate(self.joints):
            found[j][np.ix_(order, order)] = rows.gram
            here, E = self._effects_in(j)
            if len(here):
                block = np.column_stack([E @ rows.A, E @ rows.y])
                found[j][np.ix_(here, order)] = block
                found[j][np.ix_(order, here)] = block.T
                found[j][np.ix_(here, here)] = E @ E.T
        return found

    @property
    def _edges(self) -> list[int]:
        """Where the columns of each effect begin, and where all end."""
        return list(accumulate((_count(one) for one in self.effects), initial=self.size))

    def _effects_in(self, joint: int) -> tuple[Ints, Floats]:
        """Return which columns are those of effects in the rows of one joint, (K,), and these, (K, M)."""
        edges = self._edges
        places = [
            np.arange(edges[k], edges[k + 1]) for k, one in enumerate(self.effects) if joint in one
        ]
        parts = [one[joint] for one in self.effects if joint in one]
        if not parts:
            return np.zeros(0, dtype=np.int64), np.zeros((0, len(self.joints[joint].y)))
        return np.concatenate(places), np.concatenate(parts)

    def combined(self, joint: int, weights: Floats) -> Floats:
        """Return combinations of all columns in the rows of one joint, (w, ...) -> (M, ...)."""
        here, E = self._effects_in(joint)
        found: Floats = self.joints[joint].A @ weights[: self.size]
        return found + E.T @ weights[here] if len(here) else found

    def basis(self, joint: int) -> Floats:
        """Return an orthonormal basis of all columns in the rows of one joint, (M, r)."""
        return self.combined(joint, self.fit.root)

    def products(self, columns: EffectColumns) -> Floats:
        """Return products of further columns with all columns, over all joints, (k, w)."""
        found = np.zeros((_count(columns), self._edges[-1]))
        for joint, C in columns.items():
            found[:, : self.size] += C @ self.joints[joint].A
        return self.with_products(found, columns)

    def with_products(self, found: Floats, columns: EffectColumns) -> Floats:
        """Add products of further columns with those of effects to their place among all, (k, w)."""
        for joint, C in columns.items():
            here, E = self._effects_in(joint)
            if len(here):
                found[:, here] += C @ E.T
        return found

    @property
    def amplitudes(self) -> Floats:
        """Amplitudes of the effects, one after the other."""
        return self.fit.theta[self.size :]

    @property
    def known_errors(self) -> KnownErrors:
        """What no effect has to explain, as it was fitted: of known errors those at reversals."""
        n = len(self.joints)
        turns = self.fit.theta[self._errors].reshape(n, -1)
        p = self.size - self.bounded
        own = np.column_stack([turns, np.zeros((n, 2 * n))])
        return KnownErrors(np.zeros(1 + 2 * n), own, self.fit.inverse[:p, :p])

    @property
    def squares(self) -> float:
        """Sum of squares of what is left, the prior's included."""
        total = sum(float(e @ e) for e in self.fit.e)
        if self.prior is not None:
            rest = self.prior[:, -1] - self.prior[:, :-1] @ self.fit.theta[: self.size]
            total += float(rest @ rest)
        return total + float(np.sum(self.fit.theta[self._errors] ** 2))

    def prior_products(self, P: Floats) -> Floats:
        """Return what bounds of known errors and the prior of links tell of candidates, whose columns are zero there.

        Args:
            P: products of the candidates' columns with the basis of all columns, (k, r).

        Returns:
            Gram matrix of the projected columns in the prior rows, and products with what is left of these, (k, k + 1).
        """
        # Why not what an earlier identification knows: it is overconfident; tests of what has changed go by the logs.
        C, rest = -self.fit.root[self._errors] @ P.T, -self.fit.theta[self._errors]
        if self.prior is not None and self.link_prior:
            p = self.size
            C = np.concatenate([C, -self.prior[:, :-1] @ (self.fit.root[:p] @ P.T)])
            rest = np.append(rest, self.prior[:, -1] - self.prior[:, :-1] @ self.fit.theta[:p])
        return np.asarray(C.T @ np.column_stack([C, rest]))

    def reduced_chi_square(self) -> Floats:
        """Return the mean square of each joint's whitened residual, freedom taken off, (n,); 1 at the noise floor."""
        chi = np.ones(len(self.joints))
        root = self.fit.root
        for j, (e, gram) in enumerate(zip(self.fit.e, self.gram, strict=True)):
            freedom = len(e) - float(np.sum((gram[:-1, :-1] @ root) * root))
            if len(e) > 50 and freedom > 20:
                chi[j] = self.noise.count[j] * float(e @ e) / freedom
        return chi


def few(segments: Sequence[SegmentRows]) -> bool:
    """Return whether all that is made of rows may stay in memory."""
    return sum(len(s) for s in segments) <= FEW_ROWS


def _count(one: EffectColumns) -> int:
    return len(next(iter(one.values())))


def whitened_regression(
    segments: Sequence[SegmentRows],
    noise: NoiseModel,
    nuisance: Sequence[Sequence[Floats]],
    prior: Floats | None,
) -> WhitenedRegression:
    """Whiten the rows of all joints.

    Args:
        segments: rows; only those that count are used.
        noise: the noise of each joint.
        nuisance: for each segment and joint, known errors, each one standard deviation, (c / n, M).
        prior: further rows [columns, value] on the base parameters, (r, p + 1); None for none.
    """
    n, p = segments[0].W.shape[1:]
    empty = WhitenedRegression(segments, noise, ())
    edges = np.cumsum([0, *(len(s) for s in segments)])
    count = len(nuisance[0][0])
    blocks = jackknife_blocks(segments)
    joints = []
    for j in range(n):
        base = empty.whiten(j, [s.W[:, j].T for s in segments])
        extra = empty.whiten(j, [columns[j] for columns in nuisance])
        A = np.zeros((base.shape[1], p + n * count))
        A[:, :p] = base.T
        A[:, p + j * count : p + (j + 1) * count] = extra.T
        y = empty.whiten(j, [s.tau[:, j] for s in segments])
        chosen = [np.flatnonzero(s.use[noise.order :, j]) + noise.order for s in segments]
        block = [one[rows] for one, rows in zip(blocks, chosen, strict=True)]
        log = [np.full(len(rows), s.number) for s, rows in zip(segments, chosen, strict=True)]
        index = [rows + start for rows, start in zip(chosen, edges[:-1], strict=True)]
        joints.append(
            WhitenedRows(
                j, A, y, *(np.concatenate(x).astype(np.int64) for x in (block, log, index))
            )
        )
    wide = None
    if prior is not None:
        wide = np.zeros((len(prior), p + n * count + 1))
        wide[:, :p], wide[:, -1] = prior[:, :-1], prior[:, -1]
    return replace(empty, joints=tuple(joints), prior=wide, bounded=n * count)


def torque_residuals(
    regression: WhitenedRegression,
    segments: Sequence[SegmentRows],
    nuisance: Sequence[Sequence[Floats]],
) -> list[Floats]:
    """Return what the baseline of a regression leaves of all rows, whether they were fitted or not, one (M, n) each.

    Args:
        regression: the fitted regression.
        segments: all rows.
        nuisance: for each segment and joint, columns that are not judged, (c / n, M).
    """
    n, p = segments[0].W.shape[1:]
    theta = regression.fit.theta[:p]
    gamma = regression.fit.theta[p : regression.size].reshape(n, -1)
    return [
        s.tau - s.W @ theta - np.stack([x @ c for x, c in zip(gamma, columns, strict=True)], axis=1)
        for s, columns in zip(segments, nuisance, strict=True)
    ]
