"""Base parameters: which columns stand alone, which vanish, which only count together (Paper Eq. 13).

Found by singular values here and without thresholds in ``model/exact.py``; both must agree. The regressor is evaluated
at random states of the arm, never on a measured motion: what the structure of the arm allows is one question, what a
log excites is another. Columns are normalised first; without that slow motions hide the gap.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.errors import ReductionsDisagree
from dynid.model import tuning
from dynid.model.base_model import Reduction
from dynid.model.regressor import Model
from dynid.robot import Robot

if TYPE_CHECKING:
    from dynid.model.exact import ExactReduction

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

#: Parameters named in the message before it is cut.
_SHOWN = 8


def random_states(robot: Robot, count: int, seed: int) -> tuple[Floats, Floats, Floats]:
    """Return random positions, velocities and accelerations, each (count, n)."""
    rng = np.random.default_rng(seed)
    reach = np.array([np.pi if joint.revolute else 1.0 for joint in robot.joints])
    q = rng.uniform(-reach, reach, (count, robot.n))
    qd, qdd = rng.normal(0.0, tuning.RANDOM_STATE_SPREAD, (2, count, robot.n))
    return q, qd, qdd


def reduce(
    model: Model, *, samples: int = 200, seed: int = 0, tolerance: float = tuning.DEPENDENT_COLUMN
) -> Reduction:
    """Find the base parameters of a model by singular values on random states, and those of added effects.

    Args and source: as ``reduce_plain``.
    """
    return with_added(reduce_plain(model, samples=samples, seed=seed, tolerance=tolerance), model)


def reduce_plain(
    model: Model, *, samples: int = 200, seed: int = 0, tolerance: float = tuning.DEPENDENT_COLUMN
) -> Reduction:
    """Find the base parameters of a model by singular values on random states, without those of added effects.

    Args:
        model: the model.
        samples: number of random states.
        seed: seed of the random states.
        tolerance: relative size below which a normalised column counts as dependent.

    Source: Paper Eq. 13 and its functions X_i, X_ni, X_1, X_2.
    """
    size = model.plain_size
    samples = max(samples, -(-2 * size // model.robot.n))
    W = model.regressor(*random_states(model.robot, samples, seed)).reshape(-1, size)
    norms = np.linalg.norm(W, axis=0)
    present = norms > tuning.ROUNDING_SHARE * norms.max()
    scale = np.where(present, norms, 1.0)
    W = np.where(present, W / scale, 0.0)
    values, Vt = np.linalg.svd(W, full_matrices=False)[1:]
    rank = int(np.sum(values > tolerance * values[0]))
    gap = float(values[rank - 1] / values[rank]) if rank < size and values[rank] > 0 else np.inf
    base, K = _regroup(W, present, tolerance)
    K = K * scale / scale[base][:, None]
    K[np.abs(K) < tuning.ROUNDING_SHARE * np.abs(K).max(axis=1, keepdims=True)] = 0.0
    mixed = np.abs(Vt[rank:]).max(axis=0, initial=0.0) > 1e-8
    names = model.parameter_names
    pick = [(names[k], bool(present[k]), bool(mixed[k])) for k in range(size)]
    return Reduction(
        names=names[:size],
        base=base,
        K=K,
        alone=tuple(name for name, there, mix in pick if there and not mix),
        none=tuple(name for name, there, _ in pick if not there),
        combined=tuple(name for name, there, mix in pick if there and mix),
        singular_values=values,
        gap=gap,
        method="svd",
    )


def with_added(plain: Reduction, model: Model) -> Reduction:
    """Return the base parameters of a model with those of added effects, each of which stands alone.

    Why not found like the others: they depend on the order of the samples, which random states do not have.
    """
    size, total = model.plain_size, model.size
    if total == size:
        return plain
    K = np.zeros((plain.rank + total - size, total))
    K[: plain.rank, :size] = plain.K
    K[plain.rank :, size:] = np.eye(total - size)
    names = model.parameter_names
    added = np.arange(size, total, dtype=np.intp)
    formulas = plain.formulas + names[size:] if plain.formulas else ()
    return replace(
        plain,
        names=names,
        base=np.append(plain.base, added),
        K=K,
        alone=plain.alone + names[size:],
        formulas=formulas,
    )


def _regroup(W: Floats, present: NDArray[np.bool_], tolerance: float) -> tuple[Ints, Floats]:
    """Return the leftmost independent columns and how the others are made of them, for normalised columns.

    Gram-Schmidt from left to right, twice each: the second pass removes what rounding left of the first.
    """
    R: Floats = np.asarray(np.linalg.qr(W, mode="r"))
    Q = np.empty((R.shape[0], 0))
    base: list[int] = []
    for k in np.flatnonzero(present):
        rest = R[:, k] - Q @ (Q.T @ R[:, k])
        rest -= Q @ (Q.T @ rest)
        size = np.linalg.norm(rest)
        if size > tolerance:
            base.append(int(k))
            Q = np.column_stack([Q, rest / size])
    chosen = np.array(base, dtype=np.intp)
    K: Floats = np.asarray(np.linalg.lstsq(R[:, chosen], R, rcond=None)[0], dtype=np.float64)
    K[:, chosen] = np.eye(len(chosen))
    K[:, ~present] = 0.0
    return chosen, K


# ---------------------------------------------------------------- two methods, one answer
def base_parameters(
    model: Model, *, samples: int = 200, seed: int = 0, tolerance: float = tuning.DEPENDENT_COLUMN
) -> Reduction:
    """Find the base parameters of a model by both methods, and those of added effects.

    Args:
        model: the model.
        samples: random states for the singular values.
        seed: their seed.
        tolerance: relative size below which a normalised column counts as dependent.

    Raises:
        ReductionsDisagree: when the two methods differ.
    """
    from dynid.model.exact import (
        reduce_exactly,
    )  # here and below: a model that is at hand needs no derivation

    svd = reduce_plain(model, samples=samples, seed=seed, tolerance=tolerance)
    return with_added(confirmed(reduce_exactly(model), svd), model)


def confirmed(exact: ExactReduction, svd: Reduction) -> Reduction:
    """Return the exact base parameters with the singular values, after checking that both methods agree.

    Args:
        exact: base parameters without thresholds.
        svd: base parameters by singular values, of the same model.

    Returns:
        Representatives, K and classes of the exact method; singular values and gap of the other.

    Raises:
        ReductionsDisagree: when rank, representatives or classes differ.
    """
    from dynid.model.exact import relation_text

    require_agreement(exact, svd)
    return Reduction(
        names=exact.names,
        base=exact.base,
        K=exact.K,
        alone=exact.alone,
        none=exact.none,
        combined=exact.combined,
        singular_values=svd.singular_values,
        gap=svd.gap,
        method="exact",
        formulas=tuple(relation_text(relation) for relation in exact.relations),
    )


def require_agreement(exact: ExactReduction, svd: Reduction) -> None:
    """Raise ReductionsDisagree when the two methods differ in rank, classes or representatives."""
    differing = [
        f"{name} ({_class_in(exact, name)} / {svd.class_of(name)})"
        for name in exact.names
        if _class_in(exact, name) != svd.class_of(name)
    ]
    if not differing:
        differing = [exact.names[k] for k in np.setxor1d(exact.base, svd.base)]
    if exact.rank == svd.rank and not differing:
        return
    more = f" and {len(differing) - _SHOWN} more" if len(differing) > _SHOWN else ""
    raise ReductionsDisagree(
        f"the exact method finds {exact.rank} base parameters, singular values {svd.rank}; "
        "classes (exact / singular values) differ for "
        f"{', '.join(differing[:_SHOWN]) or 'no single parameter'}{more}; {_nearby(exact, svd)}"
    )


def _class_in(exact: ExactReduction, name: str) -> str:
    return "alone" if name in exact.alone else "none" if name in exact.none else "combined"


def _nearby(exact: ExactReduction, svd: Reduction) -> str:
    """Return the singular values round the two ranks, relative to the largest."""
    values = svd.singular_values / svd.singular_values[0]
    first, last = sorted((exact.rank, svd.rank))
    shown = ", ".join(
        f"{k + 1}: {values[k]:.1e}" for k in range(max(first - 2, 0), min(last + 2, len(values)))
    )
    return f"singular values relative to the largest are {shown}"
