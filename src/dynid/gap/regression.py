"""Whitened rows of all joints in time, and the least-squares fit of base parameters and effects to them.

Each joint has its own noise, so each has its own rows; the parameters are common.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynid.arrays import Floats
from dynid.gap.gap_rows import EffectColumns, GapRows, on_joint
from dynid.gap.noise import NoiseModel
from dynid.model.effects.interface import Effect
from dynid.model.effects.motion import Joints, Shape

#: Directions of normalised columns below this share of the strongest are not excited: they are left at zero.
WEAK = 1e-9
#: The same where a prior tells apart what no row does: it knows a billionth of what rows would.
WEAK_WITH_PRIOR = 1e-13


@dataclass(frozen=True)
class Regression:
    """The whitened rows of all joints with the baseline, the prior and the effects that explain them.

    Attributes:
        rows: where they come from.
        noise: what they were whitened with.
        baseline: columns of base parameters and known errors of each joint, n of (M_j, p + c).
        y: torques of each joint, n of (M_j,).
        prior: further rows [columns, value] on the base parameters, (r, p + 1); None for none.
        effects: whitened columns of effects, {joint: (k, M_j)} each.
    """

    rows: GapRows
    noise: NoiseModel
    baseline: list[Floats]
    y: list[Floats]
    prior: Floats | None = None
    effects: tuple[EffectColumns, ...] = ()

    @property
    def base(self) -> int:
        """Number of base parameters, p."""
        return int(self.rows.W.shape[2])

    def columns_of(self, effect: Effect, joints: Joints, shape: Shape) -> EffectColumns:
        """Return whitened columns of an effect, {joint: (k, M_j)}."""
        columns = self.rows.columns(effect, joints, [shape])
        return {j: self.noise.whiten(self.rows, j, C[0]) for j, C in columns.items()}

    def columns(self, joint: int) -> Floats:
        """Return all columns in the rows of one joint, those of effects elsewhere as zeros, (M_j, w)."""
        parts = [on_joint(one, joint, len(self.y[joint])).T for one in self.effects]
        return np.concatenate([self.baseline[joint], *parts], axis=1)

    @cached_property
    def gram(self) -> Floats:
        """Products of all columns and torques with each other in the rows of each joint, (n, w + 1, w + 1)."""
        both = (np.column_stack([self.columns(j), y]) for j, y in enumerate(self.y))
        return np.array([X.T @ X for X in both])

    @property
    def information(self) -> Floats:
        """The normal matrix, (w, w); known errors are of one standard deviation."""
        gram, p = self.gram.sum(axis=0)[:-1, :-1], self.base
        if self.prior is not None:
            gram[:p, :p] += self.prior[:, :-1].T @ self.prior[:, :-1]
        errors = np.arange(p, self.baseline[0].shape[1])
        gram[errors, errors] += 1.0
        return np.asarray(gram)

    @cached_property
    def root(self) -> Floats:
        """R with R R^T the inverse of the normal matrix without directions that are not excited, (w, r)."""
        gram = self.information
        length = np.sqrt(np.diag(gram))
        length = np.where(length > 0, length, 1.0)
        values, V = np.linalg.eigh(gram / np.outer(length, length))
        kept = values > (WEAK if self.prior is None else WEAK_WITH_PRIOR) * values[-1]
        return V[:, kept] / np.sqrt(values[kept]) / length[:, None]

    def solved(self, right: Floats) -> Floats:
        """Return the fit to products of all columns with torques, (w, ...), and to the prior."""
        if self.prior is not None:
            more = self.prior[:, :-1].T @ self.prior[:, -1]
            right[: self.base] += more.reshape(-1, *[1] * (right.ndim - 1))
        return self.root @ (self.root.T @ right)

    @cached_property
    def theta(self) -> Floats:
        """Base parameters, known errors, amplitudes of effects, (w,)."""
        return self.solved(self.gram.sum(axis=0)[:-1, -1])

    @property
    def amplitudes(self) -> Floats:
        """Amplitudes of the effects, one after the other."""
        return self.theta[self.baseline[0].shape[1] :]

    @cached_property
    def e(self) -> list[Floats]:
        """Residuals of each joint, n of (M_j,)."""
        return [y - self.columns(j) @ self.theta for j, y in enumerate(self.y)]

    def with_effects(self, effects: Sequence[EffectColumns]) -> Regression:
        """Return the regression with the columns of other effects."""
        return replace(self, effects=tuple(effects))


def whitened_regression(
    rows: GapRows, noise: NoiseModel, prior: Floats | None = None, *, nuisance: bool = True
) -> Regression:
    """Whiten the rows of all joints.

    Args:
        rows: only those that count are used.
        noise: the noise of each joint.
        prior: further rows [columns, value] on the base parameters, (r, p + 1).
        nuisance: whether shapes of reversals are fitted as known errors.
    """
    n, p = rows.W.shape[1:]
    baseline, y = [], []
    for j in range(n):
        W = noise.whiten(rows, j, np.ascontiguousarray(rows.W[:, j].T)).T
        if nuisance:
            own = noise.whiten(rows, j, rows.turns[j])
            W = np.concatenate([W, np.zeros((len(W), n * len(own)))], axis=1)
            W[:, p + j * len(own) :][:, : len(own)] = own.T
        baseline.append(W)
        y.append(noise.whiten(rows, j, rows.tau[:, j]))
    return Regression(rows, noise, baseline, y, prior)
