"""Names that explain a part of a joint's gap and leave the rest unexplained.

A drive that repeats well shows small effects beyond doubt while its other errors are larger. But with errors that
nobody knows, many effects stand in for something else and are significant; so such a name needs more than its own
evidence. Stand-ins have rivals that explain half as much or more, change their size with the cut-off, and are beaten by
a short formula.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.gap.formulas import screened_rows, short_formula
from dynid.gap.problem import GapProblem
from dynid.gap.search import EffectSearch
from dynid.gap.segments import SegmentRows, cut, segments_of, with_reference
from dynid.gap.selected_effects import SelectedEffect, with_selected
from dynid.gap.significance import candidates_at, score_candidate, significance_test, whitened_columns
from dynid.gap.stepwise_selection import SelectionOptions, contains, wanted_effects
from dynid.gap.whitened_regression import EffectColumns, WhitenedRegression, whitened_regression
from dynid.model.effects.interface import Floats
from dynid.model.regressor import model_torques

#: Standard errors from zero, and visible size over the noise, that a partial name has at least. The limits of this file
#: were tried on the published friction of one slide and on stand-ins for things that are in no catalogue.
SURE, VISIBLE = 5.0, 1.0
#: Largest score of another effect in its place, over its own: right names had .25, stand-ins .5 to 1.05.
RIVAL = 0.6
#: Cut-offs at which its size must hold, over that of the search, and the largest change: right names moved by 3 %,
#: stand-ins by 23 to 165 %.
CUTOFFS, MOVED = (0.5, 2.0), 0.2
#: Largest gain of the best short formula over its own: .2 to 1.04 for right names, 1.36 to 8.9 for stand-ins.
FORMULA = 1.2
#: Share of its gain that a right name keeps with a formula that explains more: that is the rest, and it is itself.
KEPT_WITH_FORMULA = 0.7
#: Share of a term's power within that of an effect from which on the two are one.
IDENTICAL = 0.99


def why_no_part(search: EffectSearch, effects: Sequence[SelectedEffect], one: SelectedEffect) -> str:
    """Return why an effect is not even named as a part of its joint's gap, or nothing.

    Args:
        search: the search.
        effects: all that it found, with numbers.
        one: the effect.
    """
    problem = search.problem
    if problem.since or problem.arm is not None or one.name == "torque_delay":
        return "only a whole change is named, not a part of one"
    if one.z < SURE:
        return f"its size is only {one.z:.1f} standard errors from zero; a partial effect needs {SURE:g}"
    if one.test.visible_rms < VISIBLE:
        return f"its torque is only {one.test.visible_rms:.2g} times the noise; a partial effect needs {VISIBLE:g}"
    rest = [other for other in effects if other is not one and other.name != "torque_delay"]
    regression = with_selected(problem.regression(), rest)
    name, share = best_rival(regression, problem, one)
    if share > RIVAL:
        return f"{name} in its place explains {100 * share:.0f} % as much; the limit is {100 * RIVAL:.0f} %"
    moved = [change_of_size(problem, [*rest, one], share) for share in CUTOFFS]
    if max(moved) > MOVED:
        return f"its size changes by {100 * max(moved):.0f} % with the cut-off; the limit is {100 * MOVED:.0f} %"
    columns = whitened_columns(regression, one.effect, one.joints, [one.shape])
    gains = best_formula_gains(regression, one.test.joint, {j: C[0] for j, C in columns.items()})
    more, kept = (gain / max(one.test.gain, 1e-12) for gain in gains)
    if more > FORMULA and kept < KEPT_WITH_FORMULA:
        return (
            f"a short formula explains {more:.1f} times as much (limit {FORMULA:g}); fitted with it, the effect keeps "
            f"{100 * kept:.0f} % of its evidence (limit {100 * KEPT_WITH_FORMULA:.0f} %)"
        )
    return ""


def best_rival(regression: WhitenedRegression, problem: GapProblem, one: SelectedEffect) -> tuple[str, float]:
    """Return the effect that explains most in place of another on its joint, and its score over that one's."""
    n, j = problem.base.robot.n, one.test.joint
    scores: dict[str, float] = {}
    for effect, joints in wanted_effects(problem, SelectionOptions()):
        if effect.name == "torque_delay" or j not in effect.rows(joints, n):
            continue
        other = replace(one, effect=effect, joints=joints)
        if other.key != one.key and contains(other, one):
            continue
        label = "own" if other.key == one.key else effect.name
        for candidate in candidates_at(regression, effect, joints):
            score = score_candidate(regression, candidate).score
            scores[label] = max(score, scores.get(label, 0.0))
    own = max(scores.pop("own", 0.0), one.score, 1e-12)
    name = max(scores, key=lambda name: scores[name], default="")
    return name, scores.get(name, 0.0) / own


def best_formula_gains(regression: WhitenedRegression, joint: int, one: EffectColumns) -> tuple[float, float]:
    """Return how much the best short formula explains of a joint, told or not, and how much an effect does with it.

    Args:
        regression: the rows, with what explains part of them already.
        joint: 0-based.
        one: columns of the effect.
    """
    rows = screened_rows(regression, joint)
    terms, _ = short_formula(regression, rows)
    if not terms:
        return 0.0, 0.0
    found = rows.made(regression, terms)
    # Why without those: a formula with the effect as one of its terms speaks for it.
    others = found[~same_columns(regression, joint, found, one)]
    extended = regression.with_effects([*regression.effects, {joint: others}]) if len(others) else regression
    return significance_test(regression, {joint: found}).gain, significance_test(extended, one).gain


def same_columns(regression: WhitenedRegression, joint: int, columns: Floats, one: EffectColumns) -> NDArray[np.bool_]:
    """Return which columns, (k, M), are those of an effect, jointly with the baseline, (k,)."""
    if joint not in one:
        return np.zeros(len(columns), dtype=bool)
    Q = regression.basis(joint)
    C, E = (x - (x @ Q) @ Q.T for x in (columns, one[joint]))
    U = np.linalg.svd(E, full_matrices=False)[2]
    return np.asarray(np.sum((C @ U.T) ** 2, axis=1) > IDENTICAL * np.sum(C**2, axis=1))


def change_of_size(problem: GapProblem, selected: Sequence[SelectedEffect], share: float) -> float:
    """Return by what share the amplitudes of the last effect change with another cut-off.

    Args:
        problem: the search.
        selected: the effects.
        share: the cut-off over that of the search.
    """
    bare = problem.regression(nuisance=False)
    sigma = np.array([max(float(np.sqrt(np.mean(e**2))), 1e-12) if len(e) else 1.0 for e in bare.fit.e])
    noise = replace(problem.noise, ar=np.zeros((len(sigma), 0)), sigma=sigma * problem.noise.sigma, count=sigma * 0 + 1)
    nothing = [[np.zeros((0, len(s)))] * s.motion.n for s in problem.segments]
    reference = model_torques(problem.base.model, problem.base.reduction, problem.theta)
    here = whitened_regression(cut(with_reference(problem.segments, reference), problem.train), noise, nothing, None)
    other = with_cutoff(problem, share)
    nothing = [[np.zeros((0, len(s)))] * s.motion.n for s in other]
    there = whitened_regression(other, noise, nothing, None)
    size, moved = (_last_amplitudes(rows, selected) for rows in (here, there))
    return float(np.linalg.norm(moved - size) / max(float(np.linalg.norm(size)), 1e-300))


def with_cutoff(problem: GapProblem, share: float) -> list[SegmentRows]:
    """Return the searched rows under another cut-off, in shares of that of the search."""
    reference = model_torques(problem.base.model, problem.base.reduction, problem.theta)
    found = []
    for s, train in zip(problem.segments, problem.train, strict=True):
        kept = s.log.filter
        step = kept.second_step if share < 1 else max(1, int(kept.second_step / share))
        filtered = replace(s.log, filter=replace(kept, cutoff=share * kept.cutoff, second_step=step))
        for rows in segments_of([filtered], problem.base, reference) if train.any() else ():
            first, last = s.t[train][[0, -1]]
            inside = (rows.t >= first) & (rows.t <= last)
            found.append(replace(rows, number=s.number, use=rows.use & inside[:, None]))
    return found


def _last_amplitudes(regression: WhitenedRegression, selected: Sequence[SelectedEffect]) -> Floats:
    count = len(selected[-1].effect.amplitudes(selected[-1].shape))
    return with_selected(regression, selected).amplitudes[-count:]
