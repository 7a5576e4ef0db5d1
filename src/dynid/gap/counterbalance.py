"""Whether links that an arm could have do better with a counterbalance, joint by joint, before anything is searched.

Where the axis of a joint is the first that gravity turns, a counterbalance and links are columns of the same shape: no
error of torques tells them apart, however large it is. What links cost that carry it in its stead does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit
from scipy.stats import chi2

from dynid.arrays import Floats
from dynid.estimation.possible_arm import (
    PhysicalParameters,
    constraints_of,
    fit_physical,
    fit_pooled,
)
from dynid.estimation.possible_set import PhysicalConstraints
from dynid.gap import tuning
from dynid.gap.gap_rows import EffectColumns
from dynid.gap.problem import GapProblem, judged_by_possible
from dynid.gap.regression import Regression
from dynid.gap.selected_effects import Key, SelectedEffect, with_selected
from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.parameters import link_cylinders

#: What is left of a counterbalance, when links have taken up the most of it, is taken for one of these.
LOOKALIKES = ("torque_offset", "spring", "end_stop")
#: Share of what one of these brings possible links, from which a counterbalance is as good: a cylinder on a crank
#: is no pure wave, and a curve with one number more comes a few percent nearer.
AS_GOOD = 0.95
#: Gain by which one is better beyond doubt: a chance of one in four hundred.
EQUAL = 12.0


@dataclass(frozen=True)
class Suspicion:
    """A joint whose links are less implausible jointly with a counterbalance.

    Attributes:
        joint: its index.
        gains: drop of twice the objective after the price of its freedom, for ``MASSES`` of the prior's links over
            those that fit best jointly with it.
        link: number of the link that it changes most.
        masses: of that link without and with the counterbalance [kg].
        weight: of the whole arm without it, over the square of its reach [kg/m^2].
        moved: how far that link's centre of mass lies elsewhere without it [m].
        length: of that link [m].
        offsets: torque offsets of the joint without and with it, and its Coulomb friction [N m].
        sizes: its amplitudes, and their standard errors, (2, 2) [N m].
        chance: of such a gain where there is no counterbalance.
        instead: the effect that was named on this joint and brings as much, or little more; None for none.
        beaten: whether that one is clearly worse.
    """

    joint: int
    gains: tuple[float, ...]
    link: int
    masses: tuple[float, float]
    weight: float
    moved: float
    length: float
    offsets: tuple[float, float, float]
    sizes: Floats
    chance: float
    instead: Key | None = None
    beaten: bool = False

    @property
    def gain(self) -> float:
        """What it brings to links as heavy as fit best jointly with it."""
        return self.gains[0]

    @property
    def sure(self) -> bool:
        """Whether no heavier links would do as well."""
        return min(self.gains) >= LEAST_GAIN

    @property
    def searched(self) -> bool:
        """Whether it is worth a search with possible links."""
        return self.gain >= LEAST_GAIN

    @property
    def probability(self) -> float:
        """That it is there, whatever the links weigh, (0, 1)."""
        likely = expit(np.array(self.gains) / 2 - tuning.COUNTERBALANCE_RARE)
        chance = np.exp(-0.5 * (np.log(MASSES) / tuning.MASS_SPREAD) ** 2)
        return float(likely @ chance / chance.sum())

    @property
    def instead_of(self) -> str:
        """What the arm would have in its stead; nothing where that is what it has with it."""
        (without, with_it), (offset, usual, _) = self.masses, self.offsets
        if self.moved > self.length:
            return f"a link {self.link} whose centre of mass lies {self.moved:.2g} m from where it lies with it"
        if self._odd_offset:
            return f"a torque offset of {offset:.3g} N m instead of {usual:.2g} N m"
        if without > tuning.ODD_TIMES * with_it:
            return f"a link {self.link} of {without:.3g} kg instead of {with_it:.3g} kg"
        return ""

    @property
    def odd(self) -> bool:
        """Whether no arm is like that, whatever its links weigh."""
        return self.moved > self.length or self._odd_offset or self.weight > tuning.HEAVIEST

    @property
    def _odd_offset(self) -> bool:
        offset, usual, friction = self.offsets
        return abs(offset) > tuning.ODD_TIMES * max(abs(usual), friction)


def suspicions(problem: GapProblem, selected: Sequence[SelectedEffect]) -> list[Suspicion]:
    """Return the joints that are likely to have a counterbalance: sure ones, or to be told with what does as well.

    Args:
        problem: a search of what no numbers absorb.
        selected: effects that it found.
    """
    bare = _beside_links(problem)
    suspected = _suspected(with_selected(bare, selected), problem)
    for one in selected:
        # Why without it: jointly with what carries the weight in its stead, no links are implausible.
        if one.name in LOOKALIKES and one.joints[0] not in {other.joint for other in suspected}:
            suspected += _instead(
                bare, problem, one, [other for other in selected if other is not one]
            )
    return suspected


def _beside_links(problem: GapProblem) -> Regression:
    """Return rows whose noise is at least what parameters without any bounds leave: that says nothing about links."""
    by_possible = judged_by_possible(problem)
    return replace(problem, noise=by_possible.in_force or problem.noise).regression()


def counterbalances(
    problem: GapProblem, selected: Sequence[SelectedEffect], joints: Sequence[int]
) -> list[SelectedEffect]:
    """Return the effects of a search with the counterbalances that links could only imitate implausibly.

    Args:
        problem: a search of what no numbers absorb.
        selected: effects that it found.
        joints: on which a counterbalance may be.
    """
    every = {one.joint: one for one in suspicions(problem, selected) if one.joint in joints}
    effects = [x for x in selected if x.name not in LOOKALIKES or x.joints[0] not in every]
    effect, bare = CATALOGUE[COUNTERBALANCE], _beside_links(problem)
    for _ in joints:
        likely = _suspected(with_selected(bare, effects), problem)
        left = [each for each in likely if each.sure and each.joint in joints]
        if not left:
            break
        best = max(left, key=lambda each: min(each.gains))
        known = every.get(best.joint, best)
        columns = bare.columns_of(effect, (best.joint,), {})
        torques = {j: best.sizes[0] @ C for j, C in columns.items()}
        rms = {j: float(np.sqrt(np.mean(x**2))) for j, x in torques.items() if len(x)}
        names = list(effect.amplitudes({}))
        effects.append(
            SelectedEffect(
                effect=effect,
                joints=(best.joint,),
                shape={},
                joint=max(rms, key=lambda j: rms[j]),
                visible=max(rms.values()),
                log_odds=min(best.gains) / 2 - tuning.COUNTERBALANCE_RARE,
                p_value=best.chance,
                rivals=(known.instead,) if known.instead and not known.beaten else (),
                values=dict(zip(names, best.sizes[0].tolist(), strict=True)),
                std_errors=dict(zip(names, best.sizes[1].tolist(), strict=True)),
                probability=best.probability,
            )
        )
    return effects


def _suspected(regression: Regression, problem: GapProblem) -> list[Suspicion]:
    """Return the joints that are likely to have a counterbalance jointly with the effects of a regression."""
    base, suspected = problem.base, []
    for joint, one in imitated_counterbalances(regression, base).items():
        price = _price(regression, one)
        gain = least_gain(regression, base, one, MASSES[:1]) - price
        if gain / 2 > tuning.COUNTERBALANCE_RARE:
            more = [least_gain(regression, base, one, [mass]) - price for mass in MASSES[1:]]
            suspicion = _described(regression, base, joint, one, (gain, *more))
            if suspicion.searched or suspicion.instead_of:
                suspected.append(suspicion)
    return suspected


def _instead(
    bare: Regression,
    problem: GapProblem,
    one: SelectedEffect,
    others: Sequence[SelectedEffect],
) -> list[Suspicion]:
    """Return the joint of an effect where a counterbalance is sure without it, and brings possible links as much.

    Args:
        bare: the rows, without effects.
        problem: what was searched.
        one: an effect that looks like what is left of a counterbalance.
        others: the other effects.
    """
    regression = with_selected(bare, others)
    likely = _suspected(regression, problem)
    sure = [each for each in likely if each.joint == one.joints[0] and each.sure]
    if not sure:
        return []
    columns = regression.columns_of(one.effect, one.joints, one.shape)
    own = least_gain(regression, problem.base, columns, MASSES[:1])
    own -= _price(regression, columns)
    return [
        replace(each, instead=one.key, beaten=each.gain > own + EQUAL)
        for each in sure
        if each.gain >= AS_GOOD * own
    ]


def _price(regression: Regression, one: EffectColumns) -> float:
    """Return what the freedom of an effect costs (BIC)."""
    rows = max(1, sum(len(y) for y in regression.y))
    return len(next(iter(one.values()))) * float(np.log(rows))


def _described(
    regression: Regression,
    base: BaseModel,
    joint: int,
    one: EffectColumns,
    gains: tuple[float, ...],
) -> Suspicion:
    """Return a suspicion with the link that a counterbalance changes most, and its own size.

    Args:
        regression: the rows, without it.
        base: model and base parameters.
        joint: whose axis it is.
        one: its columns.
        gains: drop of twice the objective after its price, for several masses of the links.
    """
    without, with_it = (sized_links(regression, base, more)[0] for more in ((), (one,)))
    links, robot = constraints_of(base), base.robot
    bodies = links.bodies
    mass, other = without.x[bodies[:, 0]], with_it.x[bodies[:, 0]]
    k = int(np.argmax(np.abs(mass - other)))
    centres = [fit.x[bodies[k, 1:4]] / fit.x[bodies[k, 0]] for fit in (without, with_it)]
    named = [dict(zip(fit.names, fit.x.tolist(), strict=True)) for fit in (without, with_it)]
    offset, usual = (each.get(f"fo{joint + 1}", 0.0) for each in named)
    number = links.parameters[bodies[k, 0]].number
    ends = link_cylinders(robot)[number - 1]
    K, freedom = base.reduction.K, len(next(iter(one.values())))
    amplitudes, covariance = amplitudes_beside(
        regression.with_effects([*regression.effects, one]),
        K @ with_it.x,
        K @ with_it.covariance @ K.T,
    )
    return Suspicion(
        joint=joint,
        gains=gains,
        link=number,
        masses=(float(mass[k]), float(other[k])),
        weight=float(mass.sum() / sum(np.hypot(each.a, each.d) for each in robot.joints) ** 2),
        moved=float(np.linalg.norm(centres[0] - centres[1])),
        length=float(np.linalg.norm(ends[1] - ends[0])),
        offsets=(offset, usual, named[1].get(f"fc{joint + 1}", 0.0)),
        sizes=np.array([amplitudes, np.sqrt(np.diagonal(covariance))])[:, -freedom:],
        chance=float(chi2.sf(gains[0] + _price(regression, one), freedom)),
    )


# ---------------------------------------------------------------- links that an arm could have
# A counterbalance vanishes in masses and centres of mass that no link has. The entropic prior of possible links
# (``estimation/possible_arm.py``) says what such links cost.
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
