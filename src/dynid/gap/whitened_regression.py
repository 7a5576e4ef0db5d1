"""Whitened rows of all joints in time, and the least-squares fit of base parameters and effects to them.

Each joint has its own noise, so each has its own rows; the parameters are common.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.gap.noise import NoiseModel, whitened
from dynid.gap.segments import SegmentRows
from dynid.model.effects.catalogue import joined_motion
from dynid.model.effects.interface import ArmMotion, Effect, Floats, Joints, Shape

Ints = NDArray[np.int64]
#: Columns of one effect by joint, {joint: (k, M_j)}.
EffectColumns = Mapping[int, Floats]

#: Rows up to which all that is made of them stays in memory.
FEW_ROWS = 1 << 13
#: Directions of normalised columns below this share of the strongest are not excited: they are left at zero.
WEAK = 1e-9
#: The same where a prior tells apart what no row does: it knows a billionth of what rows would.
WEAK_WITH_PRIOR = 1e-13


@dataclass(frozen=True)
class WhitenedRows:
    """The whitened rows of one joint.

    Attributes:
        A: baseline columns, (M, p + c).
        y: torques, (M,).
        index: which rows of the concatenated segments they are, (M,).
    """

    A: Floats
    y: Floats
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
        theta: base parameters, known errors, amplitudes of effects, (w,).
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

    Attributes:
        segments: where the rows come from.
        noise: what they were whitened with.
        joints: rows of each joint.
        prior: further rows [columns, value] on the base parameters, (r, p + 1); None for none.
        effects: columns of selected effects.
    """

    segments: Sequence[SegmentRows]
    noise: NoiseModel
    joints: tuple[WhitenedRows, ...]
    prior: Floats | None = None
    effects: tuple[EffectColumns, ...] = ()

    @cached_property
    def motion(self) -> ArmMotion:
        """All motion in which candidates act, one segment after the other."""
        return joined_motion([s.motion for s in self.segments if s.is_new])

    @property
    def base(self) -> int:
        """Number of base parameters, p."""
        return int(self.segments[0].W.shape[2])

    @property
    def size(self) -> int:
        """Number of baseline columns, p + c."""
        return int(self.joints[0].A.shape[1])

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

    def columns(self, joint: int) -> Floats:
        """Return all columns in the rows of one joint, those of effects elsewhere as zeros, (M, w)."""
        rows = self.joints[joint]
        parts = [
            one[joint].T if joint in one else np.zeros((len(rows.y), len(next(iter(one.values())))))
            for one in self.effects
        ]
        return np.concatenate([rows.A, *parts], axis=1)

    @cached_property
    def gram(self) -> Floats:
        """Products of all columns and torques with each other in the rows of each joint, (n, w + 1, w + 1)."""
        if not self.effects:
            return np.array([rows.gram for rows in self.joints])
        both = (np.column_stack([self.columns(j), rows.y]) for j, rows in enumerate(self.joints))
        return np.array([X.T @ X for X in both])

    @cached_property
    def fit(self) -> WhitenedFit:
        """Baseline and effects fitted to all rows and to the prior; known errors are of one standard deviation."""
        whole = self.gram.sum(axis=0)
        gram, right = whole[:-1, :-1], whole[:-1, -1]
        p = self.base
        if self.prior is not None:
            gram[:p, :p] += self.prior[:, :-1].T @ self.prior[:, :-1]
            right[:p] += self.prior[:, :-1].T @ self.prior[:, -1]
        errors = np.arange(p, self.size)
        gram[errors, errors] += 1.0
        length = np.sqrt(np.diag(gram))
        length = np.where(length > 0, length, 1.0)
        values, V = np.linalg.eigh(gram / np.outer(length, length))
        kept = values > (WEAK if self.prior is None else WEAK_WITH_PRIOR) * values[-1]
        root = V[:, kept] / np.sqrt(values[kept]) / length[:, None]
        theta = root @ (root.T @ right)
        residuals = [rows.y - self.columns(j) @ theta for j, rows in enumerate(self.joints)]
        return WhitenedFit(theta, root, residuals)

    @property
    def amplitudes(self) -> Floats:
        """Amplitudes of the effects, one after the other."""
        return self.fit.theta[self.size :]

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


def filtered_columns(
    segments: Sequence[SegmentRows],
    effect: Effect,
    joints: Joints,
    shapes: Sequence[Shape],
    *,
    always: bool = False,
) -> dict[int, list[Floats]]:
    """Return filtered columns of an effect for several shapes, {joint: one (G, k, M) per segment}.

    Args:
        segments: rows.
        effect: the effect.
        joints: where it sits.
        shapes: those that are tried, all with the same number of columns.
        always: whether it acts in earlier logs too.
    """
    rows = list(effect.rows(joints, segments[0].motion.n))
    found: dict[int, list[Floats]] = {joint: [] for joint in rows}
    for s in segments:
        if (always or s.is_new) and s.use[:, rows].any():
            raw = effect.tried(s.motion, joints, shapes)
            # Why shape by shape: a filter takes five times the memory of what it is given.
            kept = np.array(
                [s.filtered(x.reshape(-1, len(s.motion))).reshape(*x.shape[:2], -1) for x in raw]
            )
        else:
            kept = np.zeros((len(shapes), len(effect.amplitudes(shapes[0])), len(rows), len(s)))
        for r, joint in enumerate(rows):
            found[joint].append(kept[:, :, r])
    return found


def whitened_columns(
    regression: WhitenedRegression, effect: Effect, joints: Joints, shape: Shape
) -> dict[int, Floats]:
    """Return whitened columns of an effect, {joint: (k, M_j)}."""
    parts = filtered_columns(regression.segments, effect, joints, [shape])
    return {j: regression.whiten(j, [x[0] for x in part]) for j, part in parts.items()}


def whitened_regression(
    segments: Sequence[SegmentRows],
    noise: NoiseModel,
    errors: Sequence[Sequence[Floats]],
    prior: Floats | None,
) -> WhitenedRegression:
    """Whiten the rows of all joints.

    Args:
        segments: rows; only those that count are used.
        noise: the noise of each joint.
        errors: for each segment and joint, known errors, each one standard deviation, (c / n, M).
        prior: further rows [columns, value] on the base parameters, (r, p + 1); None for none.
    """
    n, p = segments[0].W.shape[1:]
    empty = WhitenedRegression(segments, noise, (), prior)
    edges = np.cumsum([0, *(len(s) for s in segments)])
    count = len(errors[0][0])
    joints = []
    for j in range(n):
        base = empty.whiten(j, [s.W[:, j].T for s in segments])
        A = np.zeros((base.shape[1], p + n * count))
        A[:, :p] = base.T
        own = slice(p + j * count, p + (j + 1) * count)
        A[:, own] = empty.whiten(j, [columns[j] for columns in errors]).T
        y = empty.whiten(j, [s.tau[:, j] for s in segments])
        index = [
            np.flatnonzero(s.use[noise.order :, j]) + noise.order + start
            for s, start in zip(segments, edges[:-1], strict=True)
        ]
        joints.append(WhitenedRows(A, y, np.concatenate(index).astype(np.int64)))
    return replace(empty, joints=tuple(joints))


def torque_residuals(
    regression: WhitenedRegression,
    segments: Sequence[SegmentRows],
    errors: Sequence[Sequence[Floats]],
) -> list[Floats]:
    """Return what the baseline of a regression leaves of all rows, whether they were fitted or not, one (M, n) each.

    Args:
        regression: the fitted regression.
        segments: all rows.
        errors: for each segment and joint, known errors, (c / n, M).
    """
    n, p = segments[0].W.shape[1:]
    theta = regression.fit.theta[:p]
    gamma = regression.fit.theta[p : regression.size].reshape(n, -1)
    return [
        s.tau - s.W @ theta - np.stack([x @ c for x, c in zip(gamma, columns, strict=True)], axis=1)
        for s, columns in zip(segments, errors, strict=True)
    ]
