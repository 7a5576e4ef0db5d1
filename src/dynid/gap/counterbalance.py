"""Whether links that an arm could have do better with a counterbalance, joint by joint, before anything is searched.

Where the axis of a joint is the first that gravity turns, a counterbalance and links are columns of the same shape: no
error of torques tells them apart, however large it is. What links cost that carry it in its stead does: the entropic
prior of possible links (``estimation/possible_arm.py``) says how much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import chdtrc, expit

from dynid.arrays import Floats
from dynid.estimation.factor import Conditional, Factor, triangle
from dynid.estimation.possible_arm import (
    PhysicalParameters,
    constraints_of,
    fit_physical,
    fit_pooled,
)
from dynid.estimation.possible_set import PhysicalConstraints
from dynid.gap import tuning
from dynid.gap.candidates import visible
from dynid.gap.gap_rows import EffectColumns
from dynid.gap.problem import GapProblem, possible_noise
from dynid.gap.regression import Regression
from dynid.gap.selected_effects import Key, SelectedEffect, with_selected
from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.parameters import link_cylinders

COUNTERBALANCE = "counterbalance"
#: What is left of a counterbalance, when links have taken up the most of it, is taken for one of these.
LOOKALIKES = ("torque_offset", "spring", "end_stop")
#: Share of what one of these brings possible links, from which a counterbalance is as good: a cylinder on a crank
#: is no pure wave, and a curve with one number more comes a few percent nearer.
AS_GOOD = 0.95
#: Gain by which one is better beyond doubt: a chance of one in four hundred.
EQUAL = 12.0
#: Masses of the prior's links that a name has to outlive, times those that fit best jointly with it.
MASSES = (1.0, 3.0, 10.0, 30.0)
#: Gain that has to be left after the price of an effect's freedom, whatever the prior's masses: the prior is a guess,
#: and chance alone would be content with 12.
LEAST_GAIN = 25.0
#: Visible share of its power up to which links imitate a counterbalance: what they cannot is found without asking.
IMITATED = 0.1
#: Prior size of what an effect's column explains, in units of the noise of all rows together: any.
ANY = 1e6


@dataclass(frozen=True)
class Links:
    """The links that an arm could have, beside everything else that explains some rows.

    Attributes:
        base: model and base parameters.
        rows: [parameters, right side] of the links, all else being eliminated, (p, c + 1).
        rest: sum of squares that no links change.
        others: known errors and amplitudes of effects for given base parameters.
        count: number of rows of all joints.
    """

    base: BaseModel
    rows: Floats
    rest: float
    others: Conditional
    count: int

    @classmethod
    def beside(
        cls, regression: Regression, base: BaseModel, more: Sequence[EffectColumns] = ()
    ) -> Links:
        """Return the links beside the effects of a search and further ones, without what it knows of parameters."""
        p, effects = regression.base, len(regression.known) - 1
        X = np.concatenate(regression.with_effects(more).X)
        sd = np.ones(X.shape[1] - p)
        norm = np.linalg.norm(X[:, effects:], axis=0)
        sd[effects - p :] = ANY / np.where(norm > 0.0, norm, 1.0)
        blocks = {"others": X[:, p:], "base": X[:, :p]}
        left, others = (
            Factor(blocks, np.concatenate(regression.y)).prior("others", sd).without("others")
        )
        R = triangle(left.rows)
        rows = np.column_stack([R[:p, :p] @ base.reduction.K, R[:p, p]])
        rest = float(R[p, p] ** 2)
        return cls(base=base, rows=rows, rest=rest, others=others.conditional, count=len(X))

    def fitted(self, *, sized: bool = True) -> tuple[PhysicalParameters, PhysicalConstraints]:
        """Return the best possible arm, and the prior of links in the size that the rows prefer, or as it is."""
        constraints = constraints_of(self.base)
        return fit_pooled(self.rows[:, :-1], self.rows[:, -1], constraints, sized=sized)

    @cached_property
    def best(self) -> PhysicalParameters:
        """The best possible arm."""
        return self.fitted()[0]

    def objective(self, prior: PhysicalConstraints) -> float:
        """Return twice the objective of the best arm under a prior."""
        least = fit_physical(self.rows[:, :-1], self.rows[:, -1], prior)[1]
        return 2 * least + self.rest

    def freedom(self, without: Links) -> tuple[int, float]:
        """Return how many numbers these have more than others, and what they cost (BIC)."""
        more = len(self.others.mean) - len(without.others.mean)
        return more, more * float(np.log(max(self.count, 1)))

    def fit(self) -> tuple[Floats, Floats, Floats]:
        """Return the base parameters of the best arm, (p,), all others beside them, and their standard errors."""
        K, (root, slope) = self.base.reduction.K, (self.others.root, self.others.slope)
        theta, along = K @ self.best.x, slope @ K
        covariance = root @ root.T + along @ self.best.covariance @ along.T
        return theta, self.others.mean + slope @ theta, np.sqrt(np.diagonal(covariance))


@dataclass(frozen=True)
class Suspicion:
    """A joint whose links are less implausible jointly with a counterbalance.

    Attributes:
        joint: its index.
        gains: drop of twice the objective after the price of its freedom, for ``MASSES`` of the prior's links over
            those that fit best jointly with it.
        link: number of the link that it changes most.
        instead_of: what the arm would have in its stead, in words; nothing where that is what it has with it.
        odd: whether no arm is like that, whatever its links weigh.
        sizes: its amplitudes, and their standard errors, (2, 2) [N m].
        chance: of such a gain where there is no counterbalance.
        rivals: the effect that was named on this joint, where it brings as much.
    """

    joint: int
    gains: tuple[float, ...]
    link: int
    instead_of: str
    odd: bool
    sizes: Floats
    chance: float
    rivals: tuple[Key, ...] = ()

    @property
    def sure(self) -> bool:
        """Whether no heavier links would do as well."""
        return min(self.gains) >= LEAST_GAIN

    @property
    def searched(self) -> bool:
        """Whether it is worth a search with possible links: what it brings to links that fit best jointly with it."""
        return self.gains[0] >= LEAST_GAIN

    @property
    def probability(self) -> float:
        """That it is there, whatever the links weigh, (0, 1)."""
        likely = expit(np.array(self.gains) / 2 - tuning.COUNTERBALANCE_RARE)
        chance = np.exp(-0.5 * (np.log(MASSES) / tuning.MASS_SPREAD) ** 2)
        return float(likely @ chance / chance.sum())

    def selected(self, visible: float) -> SelectedEffect:
        """Return it as an effect that was found, with its visible size."""
        effect = CATALOGUE[COUNTERBALANCE]
        values, errors = (dict(zip(effect.units, x, strict=True)) for x in self.sizes.tolist())
        return SelectedEffect(
            effect=effect,
            joints=(self.joint,),
            shape={},
            joint=self.joint,
            visible=visible,
            log_odds=min(self.gains) / 2 - tuning.COUNTERBALANCE_RARE,
            p_value=self.chance,
            values=values,
            std_errors=errors,
            probability=self.probability,
        )


def suspicions(problem: GapProblem, selected: Sequence[SelectedEffect]) -> list[Suspicion]:
    """Return the joints that are likely to have a counterbalance: sure ones, or to be told with what does as well.

    Args:
        problem: a search of what no numbers absorb.
        selected: effects that it found.
    """
    bare, base = _beside_links(problem), problem.base
    suspected = _suspected(with_selected(bare, selected), base)
    for one in selected:
        if one.name not in LOOKALIKES or one.joints[0] in suspected:
            continue
        # Why without it: jointly with what carries the weight in its stead, no links are implausible.
        regression = with_selected(bare, [other for other in selected if other is not one])
        each = _suspected(regression, base).get(one.joints[0])
        if each and each.sure:
            columns = regression.columns_of(one.effect, one.joints, one.shape)
            without, with_it = (Links.beside(regression, base, x) for x in ((), (columns,)))
            own = gains(without, with_it, MASSES[:1])[0]
            if each.gains[0] >= AS_GOOD * own:
                rivals = () if each.gains[0] > own + EQUAL else (one.key,)
                suspected[each.joint] = replace(each, rivals=rivals)
    return list(suspected.values())


def _beside_links(problem: GapProblem) -> Regression:
    """Return rows whose noise is at least what parameters without any bounds leave: that says nothing about links."""
    return replace(problem, noise=possible_noise(problem)).regression()


def counterbalances(
    problem: GapProblem, selected: Sequence[SelectedEffect], suspected: Sequence[Suspicion]
) -> list[SelectedEffect]:
    """Return the effects of a search with the counterbalances that links could only imitate implausibly.

    Args:
        problem: a search of what no numbers absorb.
        selected: effects that it found.
        suspected: where a counterbalance may be.
    """
    every = {one.joint: one for one in suspected}
    effects = [x for x in selected if x.name not in LOOKALIKES or x.joints[0] not in every]
    effect, bare = CATALOGUE[COUNTERBALANCE], _beside_links(problem)
    for _ in every:
        likely = _suspected(with_selected(bare, effects), problem.base).values()
        left = [each for each in likely if each.sure and each.joint in every]
        if not left:
            break
        best = max(left, key=lambda each: min(each.gains))
        column = best.sizes[0] @ bare.columns_of(effect, (best.joint,), {})[best.joint]
        one = best.selected(visible=float(np.sqrt(np.mean(column**2))))
        effects.append(replace(one, rivals=every[best.joint].rivals))
    return effects


def _suspected(regression: Regression, base: BaseModel) -> dict[int, Suspicion]:
    """Return the joints that are likely to have a counterbalance jointly with the effects of a regression."""
    without, suspected = Links.beside(regression, base), {}
    for joint, columns in imitated_counterbalances(regression, base).items():
        with_it = Links.beside(regression, base, [columns])
        gain = gains(without, with_it, MASSES[:1])
        if gain[0] / 2 > tuning.COUNTERBALANCE_RARE:
            gain += gains(without, with_it, MASSES[1:])
            one = _described(without, with_it, joint, gain)
            if one.searched or one.instead_of:
                suspected[joint] = one
    return suspected


def _described(without: Links, with_it: Links, joint: int, gain: tuple[float, ...]) -> Suspicion:
    """Return a suspicion with the link that a counterbalance changes most, and its own size."""
    base = with_it.base
    fits, constraints, arm = (without.best, with_it.best), constraints_of(base), base.robot
    # Without it and with it: each link's mass, and where its centre of mass lies.
    bodies = np.array([fit.x for fit in fits])[:, constraints.bodies]
    masses, centres = bodies[..., 0], bodies[..., 1:4] / bodies[..., :1]
    k = int(np.argmax(np.abs(masses[0] - masses[1])))
    (heavy, light), reach = masses[:, k].tolist(), sum(np.hypot(x.a, x.d) for x in arm.joints)
    number = constraints.parameters[constraints.bodies[k, 0]].number
    length = float(np.linalg.norm(np.diff(link_cylinders(arm)[number - 1], axis=0)))
    moved = float(np.linalg.norm(centres[0, k] - centres[1, k]))
    named = [dict(zip(fit.names, fit.x.tolist(), strict=True)) for fit in fits]
    offset, usual = (each.get(f"fo{joint + 1}", 0.0) for each in named)
    odd_offset = abs(offset) > tuning.ODD_TIMES * max(abs(usual), named[1].get(f"fc{joint + 1}", 0))
    instead_of = ""
    if moved > length:
        instead_of = (
            f"a link {number} whose centre of mass lies {moved:.2g} m from where it lies with it"
        )
    elif odd_offset:
        instead_of = f"a torque offset of {offset:.3g} N m instead of {usual:.2g} N m"
    elif heavy > tuning.ODD_TIMES * light:
        instead_of = f"a link {number} of {heavy:.3g} kg instead of {light:.3g} kg"
    freedom, price = with_it.freedom(without)
    return Suspicion(
        joint=joint,
        gains=gain,
        link=number,
        instead_of=instead_of,
        odd=bool(moved > length or odd_offset or masses[0].sum() > tuning.HEAVIEST * reach**2),
        sizes=np.array(with_it.fit()[1:])[:, -freedom:],
        chance=float(chdtrc(freedom, max(0.0, gain[0] + price))),
    )


def imitated_counterbalances(regression: Regression, base: BaseModel) -> dict[int, EffectColumns]:
    """Return the columns of the counterbalances that links imitate, by joint."""
    effect, imitated = CATALOGUE[COUNTERBALANCE], {}
    for (j,) in effect.candidate_joints(base.robot.n):
        columns = regression.columns_of(effect, (j,), {})
        own, sides = columns[j] @ columns[j].T, columns[j] @ regression.X[j]
        if visible(own, sides, regression.information[:-1, :-1]) <= IMITATED:
            imitated[j] = columns
    return imitated


def gains(without: Links, with_it: Links, masses: Sequence[float] = MASSES) -> tuple[float, ...]:
    """Return the drop of twice the objective that an effect brings after its price, for masses of the prior's links."""
    # Why the size of the links with the effect: without it, links of a hundred tons carry what it carries. The sizes
    # of friction stay as they are found there too: with others, the objective would be another.
    # And never lighter than the prior's: that links might be light makes heavier ones no less possible.
    priors = [with_it.fitted(sized=sized)[1] for sized in (True, False)]
    heavier = max(priors, key=lambda each: each.prior[each.bodies[:, 0]].sum())
    drops = []
    for mass in masses:
        prior = heavier.prior.copy()
        prior[heavier.bodies] *= mass
        held = replace(heavier, prior=prior)
        drop = float(np.nan_to_num(without.objective(held) - with_it.objective(held)))
        drops.append(drop - with_it.freedom(without)[1])
    return tuple(drops)
