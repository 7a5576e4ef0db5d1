"""What only an implausible arm would absorb: rows of a search explained by possible links.

A counterbalance vanishes in masses and centres of mass that no link has. The entropic prior of possible links
(``estimation/possible_arm.py``) says what such links cost. The prior's own masses may be wrong: the least gain over
several of them counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.arrays import Floats
from dynid.estimation.possible_arm import (
    PhysicalParameters,
    constraints_of,
    fit_physical,
    fit_pooled,
)
from dynid.estimation.possible_set import PhysicalConstraints
from dynid.gap.gap_rows import EffectColumns
from dynid.gap.regression import Regression
from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import CATALOGUE

#: Masses of the prior's links that a name has to outlive, times those that fit best jointly with it.
MASSES = (1.0, 3.0, 10.0, 30.0)
#: Gain that has to be left after the price of an effect's freedom, whatever the prior's masses: the prior is a guess,
#: and chance alone would be content with 12.
LEAST_GAIN = 25.0
COUNTERBALANCE = "counterbalance"
#: Visible share of its power up to which links imitate a counterbalance: what they cannot is found without asking.
IMITATED = 0.1
#: Directions of information below this share of the strongest are none.
NONE = 1e-10


@dataclass(frozen=True)
class ReducedRows:
    """Rows on the base parameters alone, what else is fitted being eliminated.

    Attributes:
        R: (k, p).
        r: (k,).
        rest: sum of squares that no base parameters change.
    """

    R: Floats
    r: Floats
    rest: float


def sized_links(
    regression: Regression, base: BaseModel, more: Sequence[EffectColumns] = ()
) -> tuple[PhysicalParameters, PhysicalConstraints]:
    """Return the best possible arm beside further effects, and the prior of links in the size that the rows prefer."""
    rows = reduced(regression, more)
    return fit_pooled(rows.R @ base.reduction.K, rows.r, constraints_of(base), sized=True)


def imitated_counterbalances(regression: Regression, base: BaseModel) -> dict[int, EffectColumns]:
    """Return the columns of the counterbalances that links imitate, by joint."""
    effect = CATALOGUE[COUNTERBALANCE]
    columns_of_joint: dict[int, EffectColumns] = {}
    for joints in effect.candidate_joints(base.robot.n):
        for shape in effect.grid(regression.rows.motion, joints):
            columns = regression.columns_of(effect, joints, shape)
            if _visible_share(regression, columns) <= IMITATED:
                columns_of_joint[joints[0]] = columns
    return columns_of_joint


def _visible_share(regression: Regression, columns: EffectColumns) -> float:
    """Return the largest share of their power that columns have beside all others; 0 where they have none."""
    gram = np.sum([C @ C.T for C in columns.values()], axis=0)
    size = np.sqrt(np.diag(gram))
    P = np.sum([C @ regression.columns(j) for j, C in columns.items()], axis=0)
    P = P @ regression.root
    if not np.all(size > 0):
        return 0.0
    return float(np.linalg.eigvalsh((gram - P @ P.T) / np.outer(size, size))[-1])


def reduced(regression: Regression, more: Sequence[EffectColumns] = ()) -> ReducedRows:
    """Return the rows of a search without its prior, reduced to the base parameters.

    Args:
        regression: the search.
        more: columns of further effects.
    """
    wide = replace(regression, prior=None, effects=(*regression.effects, *more))
    p = regression.base
    gram = wide.gram.sum(axis=0)
    order = [*range(p), len(gram) - 1]
    other = [k for k in range(len(gram)) if k not in order]
    gram_of_base = gram[np.ix_(order, order)]
    if other:
        side = gram[np.ix_(other, order)]
        gram_of_base = gram_of_base - side.T @ _inverse(gram[np.ix_(other, other)]) @ side
    # Why of the rows before: a direction that is eliminated has nothing but rounding left. What no row sees is zero,
    # not rounding: on a scale of its own, rounding would tell a number.
    length = np.sqrt(np.maximum(np.diag(gram)[:p], 0.0))
    size = np.where(length > 0.0, length, 1.0)
    values, V = np.linalg.eigh(gram_of_base[:p, :p] / np.outer(size, size))
    determined = values > NONE * values[-1]
    root = np.sqrt(values[determined])
    r = V[:, determined].T @ (gram_of_base[:p, p] / size) / root
    return ReducedRows(
        root[:, None] * V[:, determined].T * length, r, float(gram_of_base[p, p] - r @ r)
    )


def amplitudes_beside(
    regression: Regression, theta: Floats, covariance: Floats
) -> tuple[Floats, Floats]:
    """Return everything but the base parameters as it fits best beside given ones, and its covariance.

    Args:
        regression: the rows.
        theta: base parameters, (p,).
        covariance: of them, (p, p).
    """
    gram, p = regression.gram.sum(axis=0)[regression.base : -1], regression.base
    inverse = _inverse(gram[:, p:-1])
    slope = inverse @ gram[:, :p]
    return inverse @ gram[:, -1] - slope @ theta, inverse + slope @ covariance @ slope.T


def possible_fit(regression: Regression, base: BaseModel) -> tuple[Floats, Floats]:
    """Return the base parameters of the best possible arm jointly with effects, (p,), and the amplitudes of these."""
    K, fit = base.reduction.K, sized_links(regression, base)[0]
    theta = K @ fit.x
    return theta, amplitudes_beside(regression, theta, K @ fit.covariance @ K.T)[0]


def least_gain(
    regression: Regression,
    base: BaseModel,
    one: EffectColumns,
    masses: Sequence[float] = MASSES,
) -> float:
    """Return the least drop of twice the objective that an effect brings, over the masses of the prior's links.

    Args:
        regression: the search, with other effects.
        base: model and base parameters.
        one: columns of the effect.
        masses: factors of the masses.
    """
    pairs = [
        (x.R @ base.reduction.K, x.r, x.rest)
        for x in (reduced(regression), reduced(regression, [one]))
    ]
    (A, r, _), constraints = pairs[1], constraints_of(base)
    # Why the size of the links with the effect: without it, links of a hundred tons carry what it carries. The sizes
    # of friction stay as they are found there too: with others, the objective would be another.
    # And never lighter than the prior's: that links might be light makes heavier ones no less possible.
    fits = (fit_pooled(A, r, constraints, sized=sized)[1] for sized in (True, False))
    size = max(fits, key=lambda each: each.prior[each.bodies[:, 0]].sum())
    gains = []
    for mass in masses:
        prior = size.prior.copy()
        prior[size.bodies] *= mass
        held = replace(size, prior=prior)
        before, after = (2 * fit_physical(A, r, held).objective + rest for A, r, rest in pairs)
        gains.append(before - after)
    return float(np.nan_to_num(min(gains)))


def _inverse(matrix: Floats) -> Floats:
    """Return the inverse of a positive semi-definite matrix, zero along directions that it does not see."""
    length = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    size = np.where(length > 0.0, length, 1.0)
    inverse = np.linalg.pinv(matrix / np.outer(size, size), rcond=NONE, hermitian=True)
    return np.asarray(inverse / np.outer(size, size))
