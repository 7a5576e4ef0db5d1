"""Whitened rows of all joints in time, and the least-squares fit of base parameters and effects to them.

Each joint has its own noise, so each has its own rows; the parameters are common.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynid.arrays import Floats
from dynid.estimation.factor import of_unit_diagonal
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
    """The whitened rows of all joints with all columns that explain them, and what is known of these.

    Attributes:
        rows: where they come from.
        noise: what they were whitened with.
        X: columns of base parameters, known errors and effects in the rows of each joint, n of (M_j, w).
        y: torques of each joint, n of (M_j,).
        known: products of rows [columns, value] on base parameters and known errors, (k + 1, k + 1).
    """

    rows: GapRows
    noise: NoiseModel
    X: list[Floats]
    y: list[Floats]
    known: Floats

    @property
    def base(self) -> int:
        """Number of base parameters, p."""
        return int(self.rows.W.shape[2])

    def columns_of(self, effect: Effect, joints: Joints, shape: Shape) -> EffectColumns:
        """Return whitened columns of an effect, {joint: (k, M_j)}."""
        columns = self.rows.columns(effect, joints, [shape])
        return {j: self.noise.whiten(self.rows, j, C[0]) for j, C in columns.items()}

    def with_effects(self, effects: Sequence[EffectColumns]) -> Regression:
        """Return the regression with the columns of further effects, zeros on the joints where they do not act."""
        X = [
            np.column_stack([X, *(on_joint(one, j, len(X)).T for one in effects)])
            for j, X in enumerate(self.X)
        ]
        return replace(self, X=X)

    @cached_property
    def gram(self) -> Floats:
        """Products of all columns and torques with each other in the rows of each joint, (n, w + 1, w + 1)."""
        both = (np.column_stack(pair) for pair in zip(self.X, self.y, strict=True))
        return np.array([Z.T @ Z for Z in both])

    @cached_property
    def information(self) -> Floats:
        """The normal matrix and, in the last column, its right side, with what is known, (w + 1, w + 1)."""
        total, given = self.gram.sum(axis=0), np.r_[: len(self.known) - 1, -1]
        total[np.ix_(given, given)] += self.known
        return total

    @cached_property
    def root(self) -> Floats:
        """R with R R^T the inverse of the normal matrix without directions that are not excited, (w, r)."""
        scaled, unit = of_unit_diagonal(self.information[:-1, :-1])
        values, V = np.linalg.eigh(scaled)
        held = self.known[: self.base, : self.base].any()
        kept = values > (WEAK_WITH_PRIOR if held else WEAK) * values[-1]
        return V[:, kept] / np.sqrt(values[kept]) * unit[:, None]

    @cached_property
    def theta(self) -> Floats:
        """Base parameters, known errors, amplitudes of effects, (w,)."""
        return self.root @ (self.root.T @ self.information[:-1, -1])

    @property
    def amplitudes(self) -> Floats:
        """Amplitudes of the effects, one after the other."""
        return self.theta[len(self.known) - 1 :]

    @cached_property
    def e(self) -> list[Floats]:
        """Residuals of each joint, n of (M_j,)."""
        return [y - X @ self.theta for X, y in zip(self.X, self.y, strict=True)]


def whitened_regression(
    rows: GapRows, noise: NoiseModel, prior: Floats | float = 0.0, *, nuisance: bool = True
) -> Regression:
    """Whiten the rows of all joints.

    Args:
        rows: only those that count are used.
        noise: the noise of each joint.
        prior: products of further rows [columns, value] on the base parameters, (p + 1, p + 1); 0 for none.
        nuisance: whether shapes of reversals are fitted as known errors of one standard deviation each.
    """
    n, p = rows.W.shape[1:]
    turns = rows.turns if nuisance else rows.turns[:, :0]
    c, base = turns.shape[1], np.r_[:p, -1]
    known = np.diag([*np.zeros(p), *np.ones(n * c), 0.0])
    known[np.ix_(base, base)] += prior
    X, y = [], []
    for j in range(n):
        own = noise.whiten(rows, j, np.concatenate([rows.W[:, j].T, turns[j]]))
        X.append(np.zeros((own.shape[1], p + n * c)))
        X[j][:, np.r_[:p, p + j * c : p + j * c + c]] = own.T
        y.append(noise.whiten(rows, j, rows.tau[:, j]))
    return Regression(rows, noise, X, y, known)
