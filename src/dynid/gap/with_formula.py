"""Parts of a joint's gap whose rest a short formula describes.

With an unmodelled rest an effect's own evidence says little: something else may take its place, and its size takes up
part of the rest. Where a formula describes the rest, names and sizes are judged with it: each effect with the best
formula for what it leaves, against every other effect with its own, and against the best formula alone.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.gap.formula_rows import FactorRows
from dynid.gap.formulas import (
    fitted_formula,
    held_out_ratio,
    screened_rows,
    short_formula,
)
from dynid.gap.localisation import NEGLIGIBLE
from dynid.gap.partial import CUTOFFS, MOVED, SURE, change_of_size, same_columns
from dynid.gap.refit import SURE_Z, refit
from dynid.gap.search import EffectSearch
from dynid.gap.selected_effects import SelectedEffect, with_selected
from dynid.gap.significance import (
    CandidateScore,
    EffectCandidate,
    Key,
    SignificanceTest,
    candidates_at,
    score_candidate,
    significance_test,
)
from dynid.gap.stepwise_selection import EQUAL, SMALLEST, SelectionOptions, refined, wanted_effects
from dynid.gap.stepwise_selection import SURE as SURE_LEAD
from dynid.gap.verdict import REDUNDANT, SAME, SHARES, undetermined
from dynid.gap.whitened_regression import EffectColumns, WhitenedRegression
from dynid.model.effects.formula import Formula, formula_text
from dynid.model.effects.interface import Floats
from dynid.model.effects.position import Spring

#: Effects that are tried jointly with a formula: the leading ones of the bare rows, and in place of each of its terms.
LEADING, IN_PLACE = 5, 2
#: Products that may become terms with an effect, the leading ones of the bare rows and with all that are tried.
SCREENED = 400
#: Power left on a joint, over that of its noise, from which on parts of it are looked for.
LOUD = 1.0


@dataclass(frozen=True)
class Explanation:
    """An effect with the formula for what it leaves of a joint, or the formula alone.

    Attributes:
        one: the effect; None for none.
        own: how sure it is jointly with the formula; None for none.
        terms: those of the formula.
        formula: visible size of the formula jointly with the effect, over the noise.
        gains: what both explain in each block of time, (B,).
        score: what both explain, less what their freedom costs.
        left: what both leave of the joint above its noise, reduced chi-square less 1.
        columns: of both in the rows of the joint, the effect's first, (k, M).
    """

    one: SelectedEffect | None
    own: SignificanceTest | None
    terms: list[str]
    formula: float
    gains: Floats
    score: float
    left: float
    columns: Floats

    @property
    def z(self) -> float:
        """Standard errors between the effect's size and zero jointly with the formula."""
        if self.own is None:
            return 0.0
        beta, covariance = self.own.amplitudes, self.own.covariance
        size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        return float(np.max(np.abs(beta) / size))

    @property
    def takes_part(self) -> bool:
        """Whether the effect explains something jointly with the formula."""
        return self.own is not None and self.own.visible_rms >= SMALLEST and self.z >= SURE_Z


def parts_with_formulas(search: EffectSearch, options: SelectionOptions, joints: Sequence[int]) -> list[SelectedEffect]:
    """Return effects that explain a part of a joint's gap beyond doubt with a formula for the rest, one for a joint.

    Their numbers are those with the formula, and what is named on the joint already comes with such numbers too.
    Formulas of louder joints stay in place, because the parameters carry what is not described to other joints.

    Args:
        search: a search; what it has selected explains part of the rows already.
        options: which effects are tried.
        joints: 0-based, the loudest first.
    """
    found: list[SelectedEffect] = []
    described = search
    for joint in joints:
        if len({one.key for one in (*search.selected, *found)}) >= options.most:
            break
        regression = with_selected(search.problem.regression(), described.selected)
        if float(regression.reduced_chi_square()[joint]) - 1 < LOUD:
            continue
        all_found = explanations(described, options, regression, joint)
        best = _clearly_best(described, regression, all_found, joint)
        proved = best is not None and _proved(described, *best, joint)
        explained = best[0] if best is not None and proved else all_found[0]
        found += _sizes_with_formula(described, explained, joint, float(regression.reduced_chi_square()[joint]) - 1)
        if best is not None and proved:
            found.append(best[1])
        described = replace(described, selected=_with_formula(described, explained, joint))
    return found


def same_motion(one: SelectedEffect, better_formula: str) -> bool:
    """Return whether the formula with an effect goes with the same factors of motion as one that does better than it.

    That one is the effect with a factor of place then, and effect and rest are halves of one law. With other factors,
    as of a friction that follows the load next to one that follows load and speed, the two are different laws.

    Args:
        one: an effect that is fitted jointly with the formula.
        better_formula: the formula that explains more than the effect alone; "" for none.
    """

    def motions(text: str) -> set[frozenset[str]]:
        terms = [term.split() for term in re.split(r" \+ (?=[a-h] )", text)]
        return {frozenset(part for part in term if "qd" in part) for term in terms}

    return bool(better_formula) and not motions(one.fitted_with).isdisjoint(motions(better_formula))


def _sizes_with_formula(search: EffectSearch, found: Explanation, joint: int, excess: float) -> list[SelectedEffect]:
    """Return what is named on a joint already with its numbers with the formula, where that describes the rest."""
    named = [one.key for one in search.selected if one.test.joint == joint and one.name != Formula.name]
    if not found.terms or not named or not _describes(found, excess):
        return []
    fitted = _numbers(search, found, joint)
    return [one for one in fitted if one.key in named and not undetermined(one)]


def _numbers(search: EffectSearch, found: Explanation, joint: int) -> list[SelectedEffect]:
    """Return all effects with their numbers jointly with a formula, and errors that know of what it leaves.

    What is left of the rest moves a size by as much of what the whole rest moves it by as its root mean square is.
    """
    whole = _with_formula(search, found, joint)
    plain = [one for one in whole if one.name != Formula.name]
    left = float(with_selected(search.problem.regression(), plain).reduced_chi_square()[joint]) - 1
    share = np.sqrt(min(max(found.left, NEGLIGIBLE) / max(left, NEGLIGIBLE), 1.0))
    whole_fit, alone = (refit(replace(search, selected=some, delay_test=None))[0] for some in (whole, plain))
    before = {one.key: one.values for one in alone}
    return [
        replace(
            one,
            fitted_with=formula_text(found.terms) if found.terms else "",
            std_errors={
                name: float(np.hypot(error, share * (one.values[name] - before[one.key].get(name, one.values[name]))))
                for name, error in one.std_errors.items()
            },
        )
        for one in whole_fit
        if one.name != Formula.name
    ]


def _describes(found: Explanation, excess: float) -> bool:
    """Return whether an explanation leaves hardly anything of a joint's excess."""
    return found.left < NEGLIGIBLE or 1 - found.left / excess >= SHARES[1]


def _clearly_best(
    search: EffectSearch, regression: WhitenedRegression, found: Sequence[Explanation], joint: int
) -> tuple[Explanation, SelectedEffect] | None:
    """Return the explanation whose effect no other goes without, and that effect with its numbers with the formula.

    A name whose size or shape the rows leave open is none, and stands in the way of no other.
    """
    excess = float(regression.reduced_chi_square()[joint]) - 1
    possible = [
        x
        for x in sorted(found, key=lambda x: -x.score)
        if x.one is not None and x.own is not None and x.takes_part and x.own.chow_p_value >= SAME
        if x.z >= SURE and x.own.visible_rms >= REDUNDANT * x.formula
        if _describes(x, excess) and not _slow_part(x)
    ]
    open_ones: list[Explanation] = []
    for best in possible:
        fitted = _numbers(search, best, joint)[-1]
        if undetermined(fitted):
            open_ones.append(best)
            continue
        others = [x for x in found if not any(x is one for one in (best, *open_ones))]
        others = [x for x in others if not _holds(regression, joint, x, best)]
        if all(_clearly(best, other) for other in others):
            return best, fitted
    return None


def _slow_part(found: Explanation) -> bool:
    """Return whether an effect may be the slow part of what its formula is not all of: both follow places alone.

    A torque over several positions has a slope and a bend along each of them, as it has a mean. A formula is not all of
    it where it leaves something, or is a series of several terms.
    """
    if found.one is None or found.one.effect.family != Spring.family:
        return False
    places = [term for term in found.terms if "qd" not in term and "t" not in term.split()]
    return len(places) > 1 or (bool(places) and found.left >= NEGLIGIBLE)


def _holds(regression: WhitenedRegression, joint: int, other: Explanation, best: Explanation) -> bool:
    """Return whether an explanation has the effect of another in it, by whatever name."""
    assert best.own is not None
    own = best.columns[: len(best.own.amplitudes)]
    return len(other.columns) > 0 and bool(np.all(same_columns(regression, joint, own, {joint: other.columns})))


def _clearly(one: Explanation, other: Explanation) -> bool:
    """Return whether one explanation is better than another beyond doubt."""
    spread = float(np.std(one.gains - other.gains) * np.sqrt(len(one.gains)))
    return one.score - other.score > max(EQUAL, SURE_LEAD * spread)


def _proved(search: EffectSearch, best: Explanation, fitted: SelectedEffect, joint: int) -> bool:
    """Return whether the size of an effect jointly with a formula holds, and unseen rows speak for both."""
    if fitted.z < SURE:
        return False
    problem, whole = search.problem, _with_formula(search, best, joint)
    formula_alone = whole[:-1]
    if any(held_out_ratio(problem, without, whole, joint)[1] >= 1 for without in (formula_alone, search.selected)):
        return False
    return max(change_of_size(problem, whole, share) for share in CUTOFFS) <= MOVED


def _with_formula(search: EffectSearch, found: Explanation, joint: int) -> list[SelectedEffect]:
    """Return what a search has selected, and what explains a joint jointly with it: the formula, then the effect."""
    own = [] if found.one is None else [found.one]
    if not found.terms:
        return [*search.selected, *own]
    text = formula_text(found.terms)
    return [*search.selected, fitted_formula(search.problem, [*search.selected, *own], text, joint), *own]


def explanations(
    search: EffectSearch, options: SelectionOptions, regression: WhitenedRegression, joint: int
) -> list[Explanation]:
    """Return the best formula alone, and each leading effect of a joint with the best formula for what it leaves.

    Args:
        search: the search.
        options: which effects are tried.
        regression: the rows, with what is selected.
        joint: 0-based.
    """
    rows = screened_rows(regression, joint)
    terms, _ = short_formula(regression, rows)
    candidates = _candidates(search, options, regression, joint)
    leading = _leading(regression, candidates, LEADING)
    columns = rows.made(regression, terms) if terms else np.zeros((0, 0))
    for k in range(len(terms)):
        rest = np.delete(columns, k, axis=0)
        extended = regression.with_effects([*regression.effects, {joint: rest}]) if len(rest) else regression
        leading = _leading(extended, candidates, IN_PLACE) | leading
    if terms:
        extended = regression.with_effects([*regression.effects, {joint: columns}])
        leading = _leading(extended, candidates, IN_PLACE) | leading
    every = regression.with_effects([*regression.effects, *(own for _, own in leading.values())])
    rows.kept = list(dict.fromkeys([*rows.kept[:SCREENED], *screened_rows(every, joint).kept[:SCREENED]]))
    found = [_explanation(regression, rows, joint, None, {}, terms)]
    for one, own in leading.values():
        extended = regression.with_effects([*regression.effects, own])
        chosen = short_formula(extended, rows)[0]
        each = _explanation(regression, rows, joint, one, own, chosen)
        # Why: what takes no part is no rival of what does; its formula may be one, which is often that by other words.
        found.append(each if each.takes_part else _explanation(regression, rows, joint, None, {}, chosen))
    return found


def _candidates(
    search: EffectSearch, options: SelectionOptions, regression: WhitenedRegression, joint: int
) -> list[EffectCandidate]:
    """Return all effects that act on a joint and are not selected yet, but for constants: an unknown rest has one."""
    n, taken = len(regression.joints), {one.key for one in search.selected}
    return [
        candidate
        for effect, joints in wanted_effects(search.problem, options)
        if effect.name not in ("torque_delay", "torque_offset") and joint in effect.rows(joints, n)
        if (effect.name, joints) not in taken
        for candidate in candidates_at(regression, effect, joints)
    ]


def _leading(
    regression: WhitenedRegression, candidates: Sequence[EffectCandidate], count: int
) -> dict[Key, tuple[SelectedEffect, EffectColumns]]:
    """Return the effects that explain most of the rows, at their best shapes, with their columns."""
    ranked = sorted(((score_candidate(regression, c), c) for c in candidates), key=lambda pair: -pair[0].score)
    best: dict[Key, tuple[CandidateScore, EffectCandidate]] = {}
    for score, candidate in ranked:
        if score.score > 0:
            best.setdefault(candidate.key, (score, candidate))
    return {key: refined(regression, *pair) for key, pair in list(best.items())[:count]}


def _explanation(
    regression: WhitenedRegression,
    rows: FactorRows,
    joint: int,
    one: SelectedEffect | None,
    own: EffectColumns,
    terms: list[str],
) -> Explanation:
    """Return what an effect and a formula explain together."""
    count = len(next(iter(own.values()))) if own else 0
    both = dict(own) or {joint: np.zeros((0, len(regression.fit.e[joint])))}
    formula, extended = 0.0, regression
    if terms:
        columns = rows.made(regression, terms)
        with_one = regression.with_effects([*regression.effects, own]) if own else regression
        formula = significance_test(with_one, {joint: columns}).visible_rms
        extended = regression.with_effects([*regression.effects, {joint: columns}])
        nothing = {j: np.zeros((len(columns), C.shape[1])) for j, C in both.items()}
        both = {j: np.vstack([C, columns if j == joint else nothing[j]]) for j, C in both.items()}
    if not len(both[joint]):
        left = float(regression.reduced_chi_square()[joint]) - 1
        return Explanation(None, None, terms, 0.0, np.zeros(1), 0.0, left, both[joint])
    gains = significance_test(regression, both).gains
    price = len(terms) * (np.log(len(regression.fit.e[joint])) + 2 * np.log(rows.columns))
    price += 0.0 if one is None else one.test.gain - one.score
    whole = extended.with_effects([*extended.effects, own]) if own else extended
    left = float(whole.reduced_chi_square()[joint]) - 1
    test = significance_test(extended, own) if count else None
    return Explanation(one, test, terms, formula, gains, float(gains.sum()) - float(price), left, both[joint])
