"""One analysis from conditioned logs to a verdict: where, what, how sure, and how far the gap shrinks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.errors import PackageMissing
from dynid.estimation.least_squares import solvable
from dynid.gap import refusals
from dynid.gap.forward_simulation import simulate_held_out
from dynid.gap.localisation import JointGap, localise_residual
from dynid.gap.problem import (
    GapProblem,
    KeptModel,
    make_problem,
    problem_of_arm,
    without_always_missing,
)
from dynid.gap.refit import (
    GROWN,
    GROWN_ARM,
    HeldOutImprovement,
    fitted_with,
    held_out_improvement,
    lead_over_always,
    refit,
    unsure_of_reversals,
    with_columns,
    with_delay,
)
from dynid.gap.search import EffectSearch, judged_search, search_effects, without
from dynid.gap.segments import segments_of
from dynid.gap.selected_effects import SelectedEffect, with_selected
from dynid.gap.stepwise_selection import EQUAL, SURE, SelectionOptions
from dynid.gap.verdict import (
    NOT_SMALLER,
    GapVerdict,
    judge,
    refusal,
)
from dynid.gap.whitened_regression import WhitenedRegression
from dynid.model.base_model import BaseModel, model_torques
from dynid.model.effects.interface import Floats
from dynid.progress import SILENT, Progress
from dynid.signals.conditioned_log import ConditionedLog

#: Cut-off of the search [Hz]: below, what happens at reversals is gone; above, noise of the positions comes in.
CUTOFF = 10.0
#: Visible share below which these logs cannot show an effect, so that its absence means nothing.
HIDDEN = 0.01


@dataclass(frozen=True)
class GapAnalysis:
    """What a search found, and what proves it.

    Attributes:
        logs: the conditioned logs, on one clock.
        problem: what was searched, before anything was found.
        search: the search, with what is named alone.
        effects: what is named, with numbers.
        joints: the disagreement of each joint before.
        improvement: the held-out torque gap before and after what is named.
        simulation: position error of the forward simulation before and after it, (n,) each [rad or m]; None where it
            cannot be run.
        verdict: the verdict.
        invisible: effects and joints that these logs cannot show.
    """

    logs: tuple[ConditionedLog, ...]
    problem: GapProblem
    search: EffectSearch
    effects: tuple[SelectedEffect, ...]
    joints: tuple[JointGap, ...]
    improvement: HeldOutImprovement
    simulation: tuple[Floats, Floats] | None
    verdict: GapVerdict
    invisible: dict[str, list[int]]


@solvable()
def analyse_gap(
    logs: Sequence[ConditionedLog],
    base: BaseModel,
    kept: KeptModel | None,
    options: SelectionOptions,
    progress: Progress = SILENT,
    *,
    simulate: bool = True,
    earlier: Sequence[ConditionedLog] = (),
    arm: bool = False,
    possible: bool = False,
) -> GapAnalysis:
    """Search conditioned logs for what a model lacks, and prove it on the rows that are held out.

    Args:
        logs: conditioned logs, all with the same filter.
        base: model and base parameters.
        kept: the model that is kept, to find what has changed; None to find what no re-identification can absorb.
        options: what is searched.
        progress: told how far the work is.
        simulate: whether the forward simulation is run too.
        earlier: conditioned logs that a kept model was identified from, where they are at hand.
        arm: whether to find what only an implausible arm would absorb too.
        possible: whether the physically possible set is in force, and judges what is named.
    """
    logs = on_one_clock(logs)
    earlier = on_one_clock(earlier) if earlier else ()
    problem = problem_of_arm(logs, base) if arm else make_problem(logs, base, kept, earlier)
    search = search_effects(logs, base, kept, options, progress, first=problem, earlier=earlier)
    if possible and kept is None and not arm:
        search = replace(search, problem=judged_search(replace(search, selected=[])).problem)
    found = proved(problem, search, simulate=simulate)
    verdict = judge(found.search, found.effects, found.refused, base.robot.joint_names)
    joints = localise_residual(replace(problem, noise=search.problem.noise).regression())
    invisible: dict[str, list[int]] = {}
    for (name, where), share in search.visibility.items():
        if share < HIDDEN:
            invisible.setdefault(name, []).extend(where[:1])
    logs = tuple(logs)
    return GapAnalysis(
        logs,
        problem,
        found.search,
        tuple(found.effects),
        tuple(joints),
        found.improvement,
        found.simulation,
        verdict,
        invisible,
    )


@dataclass(frozen=True)
class Proof:
    """What is left of a search when everything that is refused has gone.

    Attributes:
        search: the search with what passed alone.
        effects: what passed, with numbers.
        refused: what did not, with the reason.
        improvement: the held-out gap before and after, with what passed alone.
        regression: refitted with it.
        simulation: the replay before and after; None where it was not asked for or cannot be run.
    """

    search: EffectSearch
    effects: list[SelectedEffect]
    refused: list[tuple[SelectedEffect, str]]
    improvement: HeldOutImprovement
    regression: WhitenedRegression
    simulation: tuple[Floats, Floats] | None


def proved(
    problem: GapProblem,
    search: EffectSearch,
    *,
    simulate: bool = False,
) -> Proof:
    """Fit what was found and prove it on held-out rows, alone: whatever is shown is what passed.

    What fails there is withdrawn first and the rest proved again, because a wrong effect spoils the prediction that
    others are judged by; then all others that are refused go, and what is left has to pass without them. Last, nothing
    may make the held-out torque of any joint worse.

    Args:
        problem: what was searched, before anything was found.
        search: the search.
        simulate: whether the forward simulation is asked too.
    """
    if search.rest is not None:
        return proved_by_evidence(problem, search, simulate=simulate)
    refused: list[tuple[SelectedEffect, str]] = []
    while True:
        effects, regression = refit(search)
        improvement = held_out_improvement(problem, search, effects)
        said = [(one, refusal(search, effects, one, improvement)) for one in effects]
        failing = [(one, why) for one, why in said if why.startswith(NOT_SMALLER)]
        if failing:
            failing = [min(failing, key=lambda pair: pair[0].score)]
        failing = (
            failing or [(one, why) for one, why in said if why] or not_new(effects, regression)
        )
        failing = failing or spoiling(problem, search, effects, improvement)
        if not failing:
            simulation = replays(problem, search, effects, regression) if simulate else None
            # Why only now: what is named is decided by what the rows tell; what it measures depends on more than that.
            sized = unsure_of_reversals(search, effects)
            return Proof(search, sized, refused, improvement, regression, simulation)
        refused += failing
        for one, _ in failing:
            search = without(problem, search, one)


def proved_by_evidence(
    problem: GapProblem, search: EffectSearch, *, simulate: bool = False
) -> Proof:
    """Fit what the evidence named, and refuse what the one table of refusals says; the least likely goes first.

    Args:
        problem: what was searched, before anything was found.
        search: the search.
        simulate: whether the forward simulation is asked too.
    """
    refused: list[tuple[SelectedEffect, str]] = []
    while True:
        effects = with_delay(search, search.selected)
        regression = with_selected(search.problem.regression(nuisance=False), search.selected)
        improvement = held_out_improvement(problem, search, effects)
        whole = noise_units(improvement)
        failing = []
        for one in effects:
            rest = [other for other in effects if other is not one]
            less = (
                held_out_improvement(problem, without(problem, search, one), rest)
                if len(rest)
                else None
            )
            bare = noise_units(improvement, after=False) if less is None else noise_units(less)
            if why := refusals.refusal(
                refusals.Case(search, effects, one, improvement, (whole, bare))
            ):
                failing.append((one, why))
        if not failing:
            simulation = replays(problem, search, effects, regression) if simulate else None
            return Proof(search, effects, refused, improvement, regression, simulation)
        worst = min(failing, key=lambda pair: pair[0].score)
        refused.append(worst)
        search = without(problem, search, worst[0])


def noise_units(improvement: HeldOutImprovement, *, after: bool = True) -> float:
    """Return the held-out error of all joints together, in units of their noise."""
    left = improvement.after if after else improvement.before
    return float(np.sqrt(np.mean((left / improvement.floor) ** 2)))


def not_new(
    effects: Sequence[SelectedEffect], regression: WhitenedRegression
) -> list[tuple[SelectedEffect, str]]:
    """Return effects that explain old and new logs as well when they were always there, with the reason."""
    if all(s.is_new for s in regression.segments):
        return []
    found = []
    columns = with_columns(effects)
    for k, one in enumerate(columns):
        lead, spread = lead_over_always(regression, columns, k)
        if lead < max(EQUAL, SURE * spread):
            found.append(
                (
                    one,
                    "it explains old and new logs equally well as an effect that was always there",
                )
            )
    return found


def spoiling(
    problem: GapProblem,
    search: EffectSearch,
    effects: Sequence[SelectedEffect],
    improvement: HeldOutImprovement,
) -> list[tuple[SelectedEffect, str]]:
    """Return the effect without which least is spoiled, with the reason, when a joint's held-out error has grown."""
    # Why more where none of them acts: a joint's error moves with the parameters that it shares.
    own = {j for one in effects for j in one.effect.rows(one.joints, len(improvement.before))}
    strict = (
        range(len(improvement.before)) if problem.since else own if problem.arm is None else set()
    )
    near = [GROWN if j in strict else GROWN_ARM for j in range(len(improvement.before))]
    worse = improvement.worse(np.array(near))
    if not worse or not effects:
        return []

    def spoiled(one: SelectedEffect) -> float:
        rest = [other for other in effects if other is not one]
        found = held_out_improvement(problem, without(problem, search, one), rest)
        return float(np.max((found.after / np.maximum(found.before, 1e-12))[worse]))

    culprit = min(effects, key=lambda one: (spoiled(one), one.score))
    j = max(worse, key=lambda j: improvement.after[j] / improvement.before[j])
    joint = problem.base.robot.joints[j]
    change = f"{improvement.before[j]:.3g} -> {improvement.after[j]:.3g} {joint.torque_unit}"
    limit = f"limit +{100 * (near[j] - 1):.0f} %"
    return [(culprit, f"it increases the error of {joint.name} on unseen data ({change}, {limit})")]


def replays(
    problem: GapProblem,
    search: EffectSearch,
    effects: Sequence[SelectedEffect],
    regression: WhitenedRegression,
) -> tuple[Floats, Floats] | None:
    """Return the replay of the held-out motion before and after; None where it cannot be run.

    Args:
        problem: what was searched, before anything was found.
        search: the search.
        effects: what it found.
        regression: refitted with these effects.
    """
    # Why of a change: fitted to old and new logs, an arm carries what was put on it in its own links.
    old = [k for k, s in enumerate(problem.segments) if not problem.pooled or not s.is_new]
    if problem.pooled:
        # Why: the columns of what has always been missing take part of what they leave out, and no replay has them.
        problem = without_always_missing(problem)
        search = replace(search, problem=without_always_missing(search.problem))
        regression = fitted_with(search.problem, with_columns(effects))
    kept = replace(
        problem, segments=[problem.segments[k] for k in old], train=[problem.train[k] for k in old]
    )
    try:
        before = simulate_held_out(problem, kept.regression(nuisance=False), [])
        after = (
            simulate_held_out(search.problem, regression, with_columns(effects))
            if effects
            else before
        )
    except PackageMissing:
        return None
    return None if before is None or after is None else (before, after)


def relative_error(logs: Sequence[ConditionedLog], base: BaseModel, theta: Floats) -> float:
    """Return what base parameters, (p,), leave of the torques of logs [%]."""
    squares = np.zeros(2)
    for s in segments_of(logs, base, model_torques(base.model, base.reduction, theta)):
        left = s.tau - s.W @ theta
        squares += [np.sum(np.where(s.use, x, 0.0) ** 2) for x in (left, s.tau)]
    return float(100.0 * np.sqrt(squares[0] / max(squares[1], 1e-300)))


def on_one_clock(logs: Sequence[ConditionedLog]) -> list[ConditionedLog]:
    """Let time run through several logs when their stamps do: what warms up or drifts does not start anew with each."""
    begin = [s.segments[0].t[0] - s.segments[0].elapsed[0] for s in logs]
    ends = [s.segments[-1].t[-1] for s in logs]
    if any(later < end for later, end in zip(begin[1:], ends[:-1], strict=True)):
        return list(logs)
    return [
        replace(s, segments=[replace(x, elapsed=x.t - begin[0]) for x in s.segments]) for s in logs
    ]
