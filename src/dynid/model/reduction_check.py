"""Two methods, one answer: the singular values' base parameters checked against the exact ones."""

from __future__ import annotations

import numpy as np

from dynid.errors import ReductionsDisagree
from dynid.model.exact import ExactReduction, reduce_exactly
from dynid.model.reduce import DEPENDENT, Reduction, reduce_plain, with_added
from dynid.model.regressor import Model
from dynid.model.relation_text import group_text

#: Parameters named in the message before it is cut.
_SHOWN = 8


def base_parameters(model: Model, *, samples: int = 200, seed: int = 0, tolerance: float = DEPENDENT) -> Reduction:
    """Find the base parameters of a model by both methods, and those of added effects.

    Args:
        model: the model.
        samples: random states for the singular values.
        seed: their seed.
        tolerance: relative size below which a normalised column counts as dependent.

    Raises:
        ReductionsDisagree: when the two methods differ.
    """
    svd = reduce_plain(model, samples=samples, seed=seed, tolerance=tolerance)
    return with_added(certified(reduce_exactly(model), svd), model)


def certified(exact: ExactReduction, svd: Reduction) -> Reduction:
    """Return the exact base parameters with the singular values beside them, after checking that both methods agree.

    Args:
        exact: base parameters without thresholds.
        svd: base parameters by singular values, of the same model.

    Returns:
        Representatives, K and classes of the exact method; singular values and gap of the other.

    Raises:
        ReductionsDisagree: when rank, representatives or classes differ.
    """
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
        formulas=tuple(group_text(group) for group in exact.groups),
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
    shown = ", ".join(f"{k + 1}: {values[k]:.1e}" for k in range(max(first - 2, 0), min(last + 2, len(values))))
    return f"singular values relative to the largest are {shown}"
