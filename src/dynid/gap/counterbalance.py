"""Whether links that an arm could have do better beside a counterbalance, joint by joint, before anything is searched.

Where the axis of a joint is the first that gravity turns, a counterbalance and links are columns of the same shape: no
error of torques tells them apart, however large it is. What links cost that carry it in its stead does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.estimation.physical_parameters import fit_sized
from dynid.gap.possible_arm import (
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
from dynid.gap.whitened_regression import EffectColumns, WhitenedRegression
from dynid.model.effects.interface import Floats


@dataclass(frozen=True)
class Suspicion:
    """A joint whose links are less odd beside a counterbalance.

    Attributes:
        joint: its index.
        gain: drop of twice the objective after the price of its freedom, links as heavy as fit best beside it.
        least: the same, the least over heavier links too.
        link: number of the link whose mass it changes most.
        masses: of that link without and with the counterbalance [kg].
    """

    joint: int
    gain: float
    least: float
    link: int
    masses: tuple[float, float]

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
    regression = with_selected(with_misfit_of_numbers(problem).regression(), selected)
    arm = possible_arm(regression, problem.base)
    found = []
    for joint, one in imitated_counterbalances(regression, problem.base).items():
        price = len(one[joint]) * float(np.log(sum(len(e) for e in regression.fit.e)))
        gain = least_gain(regression, arm, one, MASSES[:1]) - price
        if gain >= LEAST_GAIN:
            least = least_gain(regression, arm, one) - price
            found.append(Suspicion(joint, gain, least, *_carrier(regression, arm, one)))
    return found


def _carrier(regression: WhitenedRegression, arm: PossibleArm, one: EffectColumns) -> tuple[int, tuple[float, float]]:
    """Return the number of the link whose mass a counterbalance changes most, and its mass without and with it."""
    without, beside = (_masses(regression, arm, more) for more in ((), (one,)))
    k = int(np.argmax(np.abs(without - beside)))
    parameters, bodies = arm.constraints.parameters, arm.constraints.bodies
    return parameters[bodies[k, 0]].number, (float(without[k]), float(beside[k]))


def _masses(regression: WhitenedRegression, arm: PossibleArm, more: Sequence[EffectColumns]) -> Floats:
    """Return the masses of the best possible links beside further columns, (L,) [kg]."""
    rows = reduced(regression, more)
    x = fit_sized(rows.R @ arm.K, rows.r, arm.given)[0].x
    return np.asarray(x[arm.constraints.bodies[:, 0]])
