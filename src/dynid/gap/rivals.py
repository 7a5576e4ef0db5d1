"""Names that fit the searched rows equally well, judged once more on all rows, those of the proof included.

Which of two equals it is has nothing to do with whether there is something at all: that is proved on held-out rows. So
these may help to choose, and a recording that was planned to tell two names apart does so wherever it is held out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynid.gap.problem import GapProblem
from dynid.gap.selected_effects import SelectedEffect, with_selected
from dynid.gap.significance import (
    candidates_at,
    score_candidate,
    significance_test,
    whitened_columns,
)
from dynid.gap.stepwise_selection import clearly_better, contains, refined, told_apart
from dynid.gap.whitened_regression import WhitenedRegression
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.effects.interface import Effect, Joints


def settled_rivals(problem: GapProblem, selected: Sequence[SelectedEffect]) -> list[SelectedEffect]:
    """Return selected effects without the rivals that all rows speak against, and a rival where they speak for it."""
    found = list(selected)
    for k, one in enumerate(selected):
        if one.rivals:
            rest = [other for other in found if other is not one]
            found[k] = _settled(problem, one, rest)
    return found


def _settled(
    problem: GapProblem, one: SelectedEffect, rest: Sequence[SelectedEffect]
) -> SelectedEffect:
    """Return one effect, or the rival that is clearly better, with those that are still as good."""
    whole = replace(problem, train=[np.ones(len(s), dtype=bool) for s in problem.segments])
    regression = with_selected(whole.regression(), rest)
    fits = {key: _best_fit(regression, CATALOGUE[key[0]], key[1]) for key in one.rivals}
    fits = {one.key: _best_fit(regression, one.effect, one.joints)} | fits
    own, best = fits[one.key], max(fits.values(), key=lambda fit: fit.score)
    chosen = best if clearly_better(best, own) else own
    alike = [key for key, fit in fits.items() if key != chosen.key and not told_apart(chosen, fit)]
    rivals = tuple(key for key in alike if not contains(fits[key], chosen))
    if chosen is own:
        return replace(one, rivals=rivals)
    train = with_selected(problem.regression(), rest)
    columns = whitened_columns(train, chosen.effect, chosen.joints, [chosen.shape])
    test = significance_test(train, {j: C[0] for j, C in columns.items()})
    return replace(chosen, test=test, rivals=rivals)


def _best_fit(regression: WhitenedRegression, effect: Effect, joints: Joints) -> SelectedEffect:
    """Return an effect at its best shape."""
    made = candidates_at(regression, effect, joints)
    fits = [
        refined(regression, score_candidate(regression, candidate), candidate)[0]
        for candidate in made
    ]
    return max(fits, key=lambda fit: fit.score)
