"""Base parameters: which columns stand alone, which vanish, which only count together (Paper Eq. 13).

Found by singular values. The regressor is evaluated at random states of the arm, never on a measured
motion: what the structure of the arm allows is one question, what a log excites is another. Columns
are normalised first; without that slow motions hide the gap.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.arrays import Floats, Ints, Mask
from dynid.model import tuning
from dynid.model.parameters import representative_rank
from dynid.model.regressor import Model
from dynid.robot import Robot


@dataclass(frozen=True)
class Reduction:
    """The base parameters of a model: theta = K gamma and tau = P[:, base] theta.

    Attributes:
        names: names of all c columns.
        base: indices of the p representatives: the first independent columns of ``representatives_first``.
        K: how the base parameters combine all parameters, (p, c); the identity at ``base``.
        alone: names of parameters identifiable alone (X_i).
        none: names of parameters that no motion shows (X_ni).
        combined: names of parameters identifiable only in linear combinations (X_1 and X_2).
        singular_values: of the stacked, normalised regressor, (c,).
        gap: smallest kept over largest dropped singular value; infinity when nothing was dropped.
        formulas: each base parameter in the symbols of the DH table, (p,); () where they were not asked for.
    """

    names: tuple[str, ...]
    base: Ints
    K: Floats
    alone: tuple[str, ...]
    none: tuple[str, ...]
    combined: tuple[str, ...]
    singular_values: Floats
    gap: float
    formulas: tuple[str, ...] = ()

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return len(self.base)

    @property
    def base_names(self) -> tuple[str, ...]:
        """Names of the base parameters; a combination is called after its representative with an R: ``Ixx2R``."""
        single = set(self.alone)
        return tuple(
            self.names[k] if self.names[k] in single else f"{self.names[k]}R" for k in self.base
        )

    def terms(self, row: int) -> dict[str, float]:
        """Return the parameters in one base parameter with their coefficients."""
        return {self.names[k]: float(self.K[row, k]) for k in np.flatnonzero(self.K[row])}

    def class_of(self, name: str) -> str:
        """Return the class of a parameter: alone, combined or none."""
        return "alone" if name in self.alone else "none" if name in self.none else "combined"


def random_states(robot: Robot, count: int, seed: int) -> tuple[Floats, Floats, Floats]:
    """Return random positions, velocities and accelerations, each (count, n)."""
    rng = np.random.default_rng(seed)
    reach = np.where(robot.turning, np.pi, 1.0)
    q = rng.uniform(-reach, reach, (count, robot.n))
    qd, qdd = rng.normal(0.0, tuning.RANDOM_STATE_SPREAD, (2, count, robot.n))
    return q, qd, qdd


def reduce(
    model: Model,
    *,
    samples: int = 200,
    seed: int = 0,
    tolerance: float | None = None,
    still: bool = False,
) -> Reduction:
    """Find the base parameters of a model without those of added effects.

    Args:
        model: the model.
        samples: number of random states.
        seed: seed of the random states.
        tolerance: relative size below which a normalised column counts as dependent; None for the usual one.
        still: whether the torques at rest are meant: the gravity parameters that vendors publish.

    Source: Paper Eq. 13 and its functions X_i, X_ni, X_1, X_2; regrouping by Gautier 1991.
    """
    size, tolerance = model.size_without_effects, tolerance or tuning.DEPENDENT_COLUMN
    q, qd, qdd = random_states(model.robot, max(samples, -(-2 * size // model.robot.n)), seed)
    W = model.regressor(q, qd * (not still), qdd * (not still)).reshape(-1, size)
    norms = np.linalg.norm(W, axis=0)
    present = norms > tuning.ROUNDING_SHARE * norms.max()
    scale = np.where(present, norms, 1.0)
    W = np.where(present, W / scale, 0.0)
    values, Vt = np.linalg.svd(W, full_matrices=False)[1:]
    rank = int(np.sum(values > tolerance * values[0]))
    gap = float(values[rank - 1] / values[rank]) if rank < size and values[rank] > 0 else np.inf
    # A column that is made of those before it leaves nothing on the diagonal of R.
    order = representatives_first(model)
    R = np.asarray(np.linalg.qr(W[:, order], mode="r"))
    base = np.sort(order[np.abs(np.diag(R)) > tolerance])
    R = R[:, np.argsort(order)]
    K = np.linalg.lstsq(R[:, base], R, rcond=None)[0] * present
    K[:, base] = np.eye(len(base))
    K[np.abs(K) < tuning.ROUNDING_SHARE * np.abs(K).max(axis=1, initial=0, keepdims=True)] = 0.0
    mixed = np.abs(Vt[rank:]).max(axis=0, initial=0.0) > 1e-8
    names = model.parameter_names[:size]

    def those(chosen: Mask) -> tuple[str, ...]:
        return tuple(names[k] for k in np.flatnonzero(chosen))

    return Reduction(
        names=names,
        base=base,
        K=K * scale / scale[base][:, None],
        alone=those(present & ~mixed),
        none=those(~present),
        combined=those(present & mixed),
        singular_values=values,
        gap=gap,
    )


def with_added(reduction: Reduction, model: Model) -> Reduction:
    """Return base parameters with those of the further added effects of a model, each of which stands alone.

    Why not found like the others: they depend on the order of the samples, which random states do not have.
    """
    size, total = len(reduction.names), model.size
    if total == size:
        return reduction
    K = np.zeros((reduction.rank + total - size, total))
    K[: reduction.rank, :size] = reduction.K
    K[reduction.rank :, size:] = np.eye(total - size)
    names = model.parameter_names
    return replace(
        reduction,
        names=names,
        base=np.append(reduction.base, np.arange(size, total, dtype=np.intp)),
        K=K,
        alone=reduction.alone + names[size:],
        formulas=reduction.formulas + names[size:] if reduction.formulas else (),
    )


def representatives_first(model: Model) -> Ints:
    """Return the columns without those of added effects in the order in which they represent sums."""
    robot = model.robot
    ranks = [
        representative_rank(robot.convention, robot.joints[one.number - 1], one.kind)
        for one in model.parameters[: model.size_without_effects]
    ]
    return np.array(sorted(range(len(ranks)), key=ranks.__getitem__))
