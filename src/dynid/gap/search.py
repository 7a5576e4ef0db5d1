"""The search: delays are taken out of the logs, and the noise is measured jointly with what was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.gap.change import change_test
from dynid.gap.evidence import Rest
from dynid.gap.known_errors import KnownErrors
from dynid.gap.late_torques import late_torques
from dynid.gap.localisation import chi_square_between_reversals
from dynid.gap.noise import measure_noise, motions_of
from dynid.gap.problem import (
    GapProblem,
    KeptModel,
    held_near_possible,
    judged_by_possible,
    make_problem,
    nuisance_columns,
    problem_of_arm,
    with_noise,
)
from dynid.gap.rivals import settled_rivals
from dynid.gap.selected_effects import SelectedEffect, torque_in_rows, with_selected
from dynid.gap.selection import EvidenceSelection
from dynid.gap.significance import (
    Key,
    SignificanceTest,
    significance_test,
    whitened_columns,
)
from dynid.gap.stepwise_selection import SelectionOptions, StepwiseSelection
from dynid.gap.strays import Stray, find_strays
from dynid.gap.whitened_regression import WhitenedRegression, torque_residuals
from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.effects.interface import Floats
from dynid.options import LONGEST_DELAY
from dynid.progress import SILENT, Progress
from dynid.signals.conditioned_log import ConditionedLog, segment_without_delay

#: Most selections: three for a delay, because each shift makes the next one exact to second order, one after what is
#: left of it, one with the noise of the first selection, and one more.
MOST_SELECTIONS = 6
#: When the noise measured with what was found differs by more than this from what it was before, the search starts
#: anew: its first rows were whitened with part of the effect.
SAME_NOISE = 0.7
#: The same where old and new logs leave more together than was taken for noise at first: nothing is named for that.
MORE_NOISE = 1.1


@dataclass(frozen=True)
class EffectSearch:
    """A finished search.

    Attributes:
        problem: what was searched, delays taken out.
        selected: selected effects.
        delay: how late the torques were found to be [s].
        delay_test: how sure that is; None without a delay.
        before: reduced chi-square of each joint without the effects, (n,).
        after: and with them, (n,).
        between_reversals: the same between reversals, where that is less: below 1 cm/s the velocity is not known well
            enough to say whether friction turns as the model says, (n,).
        visibility: largest visible share of each candidate.
        errors: what recorder, filter and reversals do.
        rest: what is missing without a name; None where names were not chosen by evidence.
        strays: short disturbances that do not repeat.
    """

    problem: GapProblem
    selected: list[SelectedEffect]
    delay: float
    delay_test: SignificanceTest | None
    before: Floats
    after: Floats
    between_reversals: Floats
    visibility: dict[Key, float]
    errors: KnownErrors
    rest: Rest | None = None
    strays: tuple[Stray, ...] = ()


def search_effects(
    logs: Sequence[ConditionedLog],
    base: BaseModel,
    kept: KeptModel | None,
    options: SelectionOptions,
    progress: Progress = SILENT,
    *,
    first: GapProblem | None = None,
    earlier: Sequence[ConditionedLog] = (),
) -> EffectSearch:
    """Search logs for what the model lacks.

    Args:
        logs: conditioned logs, all with the same filter.
        base: model and base parameters.
        kept: the model that is kept, to find what has changed; None to find what no re-identification can absorb.
        options: what is searched.
        progress: told how far the work is.
        first: the problem of these logs, when it is there already.
        earlier: conditioned logs that a kept model was identified from.
    """
    delay, delay_test, settled = 0.0, None, False
    first = problem = first or make_problem(logs, base, kept, earlier)
    # Why not otherwise: a model that is fitted to late torques alone bends to them, and another delay does as well.
    guess = late_torques(problem) if problem.since else None
    for _ in range(MOST_SELECTIONS):
        more = abs(delay) < LONGEST_DELAY
        stepwise: StepwiseSelection | EvidenceSelection
        if by_evidence(problem):
            stepwise = EvidenceSelection(problem, options, progress, delay=more, late=guess)
        else:
            stepwise = StepwiseSelection(problem, options, progress, delay=more, late=guess)
        late, guess = stepwise.run(), None
        if late is None and delay_test is not None and not settled and not problem.since:
            # Why although it is no effect any more: the rest is small compared with the noise, not with its own error.
            late, settled = rest_of_delay(stepwise.regression), True
        if late is not None:
            delay += float(late.amplitudes[0])
            delay_test = delay_test or late
            shifted = [
                replace(s, segments=[segment_without_delay(x, delay) for x in s.segments])
                for s in logs
            ]
            problem = (
                problem_of_arm(shifted, base)
                if first.arm
                else make_problem(shifted, base, kept, earlier)
            )
            continue
        floor = problem.noise.floor
        problem = with_noise_of_fit(stepwise.problem, stepwise.regression, stepwise.selected)
        change = problem.noise.floor / floor
        most = MORE_NOISE if problem.pooled else 1 / SAME_NOISE
        if np.all((change > SAME_NOISE) & (change < most)) or (
            problem.pooled and not stepwise.selected
        ):
            break
    bare = problem.regression(stepwise.regression.fit.theta[: base.reduction.rank])
    chi_before = (first.regression() if delay else bare).reduced_chi_square()
    selected, rest = stepwise.selected, None
    strays: tuple[Stray, ...] = ()
    if isinstance(stepwise, EvidenceSelection):
        rest, errors = (
            stepwise.evidence.rest(),
            stepwise.evidence.known_errors(stepwise.rows.regression.size),
        )
        strays = tuple(
            find_strays(
                stepwise.evidence, stepwise.rows, stepwise.added, problem.noise.unrepeatable
            )
        )
    else:
        selected = settled_rivals(problem, selected)
        errors = with_selected(bare, selected).known_errors
    after, between = chi_squares(with_selected(bare, selected))
    return EffectSearch(
        problem,
        selected,
        delay,
        delay_test,
        chi_before,
        after,
        between,
        stepwise.visibility,
        errors,
        rest,
        strays,
    )


def by_evidence(problem: GapProblem) -> bool:
    """Return whether names are chosen by evidence.

    Why not of one motion alone: there, every function of the state repeats with the phase of the motion, and what has
    no name explains all that an effect does.
    """
    motions = set(motions_of(len(problem.segments), problem.repeats))
    return problem.arm is None and not problem.since and len(motions) > 1


def rest_of_delay(regression: WhitenedRegression) -> SignificanceTest:
    """Return how late torques still are jointly with what was selected, and how sure that is."""
    columns = whitened_columns(regression, CATALOGUE["torque_delay"], (), [{}])
    return significance_test(regression, {j: C[0] for j, C in columns.items()})


def chi_squares(regression: WhitenedRegression) -> tuple[Floats, Floats]:
    """Return the reduced chi-square of each joint, and the one between reversals where that is less, (n,) each."""
    chi = regression.reduced_chi_square()
    return chi, np.minimum(chi, chi_square_between_reversals(regression))


def without(first: GapProblem, search: EffectSearch, dropped: SelectedEffect) -> EffectSearch:
    """Return a search without one of its effects.

    Args:
        first: what was searched, before any delay was taken out.
        search: the search.
        dropped: the effect.
    """
    selected = [one for one in search.selected if one.key != dropped.key]
    if dropped.name == "torque_delay":
        search = replace(
            search,
            problem=replace(first, noise=search.problem.noise, in_force=search.problem.in_force),
            delay=0.0,
            delay_test=None,
        )
    bare = search.problem.regression()
    problem = held_near_possible(search.problem, with_selected(bare, selected))
    after, between = chi_squares(with_selected(problem.regression(), selected))
    return replace(
        search, problem=problem, selected=selected, after=after, between_reversals=between
    )


def with_noise_of_fit(
    problem: GapProblem, regression: WhitenedRegression, selected: Sequence[SelectedEffect]
) -> GapProblem:
    """Return the problem with the noise measured again, after what was found is taken out of the residual.

    Why: a large effect does not repeat exactly when the motion does not, and would pass for noise. And rows that are
    compared with earlier ones have no other measure of it; the first guess, which lets all parameters go, is too small.
    """
    if problem.arm is not None or (
        not problem.pooled and not problem.matched and not (problem.noise.repeats and selected)
    ):
        return problem
    residuals = residuals_of_fit(problem, regression, selected)
    noise = measure_noise(problem.segments, residuals, problem.repeats, problem.train)
    # Why its parameters: candidates that scale with the model are those of the arm jointly with what was found.
    theta = regression.fit.theta[: problem.base.reduction.rank]
    return with_noise(replace(problem, theta=theta), noise, residuals)


def still_changed(search: EffectSearch, selected: Sequence[SelectedEffect]) -> tuple[int, ...]:
    """Return joints on which old and new logs do not agree although effects are taken out of the new ones.

    Args:
        search: a search for changes, old logs among its rows.
        selected: what is taken out.
    """
    problem = search.problem
    assert problem.pooled, "old logs are not among the rows"
    selected, segments = [one for one in selected if one.name != "torque_delay"], problem.segments
    if selected:
        regression = with_selected(problem.regression(), selected)
        torques = [
            torque_in_rows(s, selected, regression.amplitudes).T for s in regression.segments
        ]
        segments = [
            replace(s, rows=replace(s.rows, tau=s.tau - x))
            for s, x in zip(segments, torques, strict=True)
        ]
    nuisance = [nuisance_columns(s) for s in segments]
    return change_test(segments, problem.train, nuisance, problem.held_by).joints


def residuals_of_fit(
    problem: GapProblem, regression: WhitenedRegression, selected: Sequence[SelectedEffect]
) -> list[Floats]:
    """Return what the model and the effects of a regression leave of all rows, one (M, n) per segment [N m or N]."""
    residuals = torque_residuals(
        regression, problem.segments, [nuisance_columns(s) for s in problem.segments]
    )
    for k, s in enumerate(regression.segments):
        residuals[k] -= torque_in_rows(s, selected, regression.amplitudes).T
    return residuals


def judged_search(search: EffectSearch) -> EffectSearch:
    """Return a search whose held-out rows are judged by the best possible arm."""
    problem = search.problem
    regression = with_selected(problem.regression(), search.selected)
    residuals = residuals_of_fit(problem, regression, search.selected)
    return replace(search, problem=judged_by_possible(problem, residuals))
