"""Whether links that an arm could have do better with a counterbalance, joint by joint, before anything is searched.

Where the axis of a joint is the first that gravity turns, a counterbalance and links are columns of the same shape: no
error of torques tells them apart, however large it is. What links cost that carry it in its stead does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dynid.estimation.possible_arm import fit_sized
from dynid.gap.possible_arm import (
    COUNTERBALANCE,
    LEAST_GAIN,
    MASSES,
    PossibleArm,
    imitated_counterbalances,
    least_gain,
    possible_arm,
    reduced,
)
from dynid.gap.problem import GapProblem, with_misfit_of_numbers
from dynid.gap.selected_effects import SelectedEffect, with_selected
from dynid.gap.significance import Key, whitened_columns
from dynid.gap.stepwise_selection import EQUAL
from dynid.gap.verdict import judge
from dynid.gap.whitened_regression import EffectColumns, WhitenedRegression
from dynid.model.effects.interface import Floats

if TYPE_CHECKING:
    from dynid.gap.analysis import GapAnalysis

#: What is left of a counterbalance, when links have taken up the most of it, is taken for one of these.
LOOKALIKES = ("torque_offset", "spring", "end_stop")
#: Share of what one of these brings possible links, from which a counterbalance is as good: a cylinder on a crank
#: is no pure wave, and a curve with one number more comes a few percent nearer.
AS_GOOD = 0.95


@dataclass(frozen=True)
class Suspicion:
    """A joint whose links are less implausible jointly with a counterbalance.

    Attributes:
        joint: its index.
        gain: drop of twice the objective after the price of its freedom, links as heavy as fit best jointly with it.
        least: the same, the least over heavier links too.
        link: number of the link whose mass it changes most.
        masses: of that link without and with the counterbalance [kg].
        instead: the effect that was named on this joint and brings as much, or little more; None for none.
        beaten: whether that one is clearly worse.
    """

    joint: int
    gain: float
    least: float
    link: int
    masses: tuple[float, float]
    instead: Key | None = None
    beaten: bool = False

    @property
    def sure(self) -> bool:
        """Whether no heavier links would do as well."""
        return self.least >= LEAST_GAIN


def suspicions(problem: GapProblem, selected: Sequence[SelectedEffect]) -> list[Suspicion]:
    """Return the joints that are likely to have a counterbalance.

    Args:
        problem: a search of what no numbers absorb.
        selected: effects that it found.
    """
    bare = with_misfit_of_numbers(problem).regression()
    found = _suspected(with_selected(bare, selected), problem)
    for one in selected:
        # Why without it: jointly with what carries the weight in its stead, no links are implausible.
        if one.name in LOOKALIKES and one.joints[0] not in {other.joint for other in found}:
            found += _instead(bare, problem, one, [other for other in selected if other is not one])
    return found


def _suspected(regression: WhitenedRegression, problem: GapProblem) -> list[Suspicion]:
    """Return the joints that are likely to have a counterbalance jointly with the effects of a regression."""
    arm, found = possible_arm(regression, problem.base), []
    for joint, one in imitated_counterbalances(regression, problem.base).items():
        price = _price(regression, one)
        gain = least_gain(regression, arm, one, MASSES[:1]) - price
        if gain >= LEAST_GAIN:
            least = least_gain(regression, arm, one) - price
            found.append(Suspicion(joint, gain, least, *_carrier(regression, arm, one)))
    return found


def _instead(
    bare: WhitenedRegression, problem: GapProblem, one: SelectedEffect, others: Sequence[SelectedEffect]
) -> list[Suspicion]:
    """Return the joint of an effect where a counterbalance is sure without it, and brings possible links as much.

    Args:
        bare: the rows, without effects.
        problem: what was searched.
        one: an effect that looks like what is left of a counterbalance.
        others: the other effects.
    """
    regression = with_selected(bare, others)
    found = [each for each in _suspected(regression, problem) if each.joint == one.joints[0] and each.sure]
    if not found:
        return []
    made = whitened_columns(regression, one.effect, one.joints, [one.shape])
    columns = {j: C[0] for j, C in made.items()}
    own = least_gain(regression, possible_arm(regression, problem.base), columns, MASSES[:1])
    own -= _price(regression, columns)
    return [
        replace(each, instead=one.key, beaten=each.gain > own + EQUAL) for each in found if each.gain >= AS_GOOD * own
    ]


def _price(regression: WhitenedRegression, one: EffectColumns) -> float:
    """Return what the freedom of an effect costs (BIC)."""
    return len(next(iter(one.values()))) * float(np.log(max(1, sum(len(e) for e in regression.fit.e))))


def with_rivals(analysis: GapAnalysis, rivals: Mapping[int, Key]) -> GapAnalysis:
    """Return an analysis whose counterbalances are told with what fits as well in their stead.

    Args:
        analysis: what was found.
        rivals: effect and joint that fits as well as the counterbalance of a joint.
    """
    effects = tuple(
        replace(one, rivals=(*one.rivals, rivals[one.joints[0]]))
        if one.name == COUNTERBALANCE and one.joints[0] in rivals
        else one
        for one in analysis.effects
    )
    names = analysis.problem.base.robot.joint_names
    verdict = judge(analysis.search, effects, analysis.verdict.closest, names)
    return replace(analysis, effects=effects, verdict=verdict)


def _carrier(regression: WhitenedRegression, arm: PossibleArm, one: EffectColumns) -> tuple[int, tuple[float, float]]:
    """Return the number of the link whose mass a counterbalance changes most, and its mass without and with it."""
    without, with_it = (_masses(regression, arm, more) for more in ((), (one,)))
    k = int(np.argmax(np.abs(without - with_it)))
    parameters, bodies = arm.constraints.parameters, arm.constraints.bodies
    return parameters[bodies[k, 0]].number, (float(without[k]), float(with_it[k]))


def _masses(regression: WhitenedRegression, arm: PossibleArm, more: Sequence[EffectColumns]) -> Floats:
    """Return the masses of the best possible links jointly with further columns, (L,) [kg]."""
    rows = reduced(regression, more)
    x = fit_sized(rows.R @ arm.K, rows.r, arm.given)[0].x
    return np.asarray(x[arm.constraints.bodies[:, 0]])
