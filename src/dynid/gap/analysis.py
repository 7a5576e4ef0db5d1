"""One analysis from conditioned logs to a verdict: where, what, how sure, and how far the gap shrinks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dynid.errors import PackageMissing
from dynid.gap.forward_simulation import simulate_held_out
from dynid.gap.localisation import JointGap, localise_residual
from dynid.gap.problem import GapProblem, KeptModel, make_problem
from dynid.gap.refit import HeldOutImprovement, held_out_improvement, refit, with_columns
from dynid.gap.search import EffectSearch, search_effects, without
from dynid.gap.selected_effects import SelectedEffect
from dynid.gap.stepwise_selection import SelectionOptions
from dynid.gap.verdict import NOT_SMALLER, GapVerdict, judge, refusal
from dynid.gap.whitened_regression import WhitenedRegression
from dynid.model.base_model import BaseModel
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
        search: the search.
        effects: selected effects with numbers, named or not.
        joints: the disagreement of each joint before.
        improvement: the held-out torque gap before and after.
        simulation: position error of the forward simulation before and after, (n,) each [rad or m]; None where it
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


def analyse_gap(
    logs: Sequence[ConditionedLog],
    base: BaseModel,
    kept: KeptModel | None,
    options: SelectionOptions,
    progress: Progress = SILENT,
    *,
    simulate: bool = True,
    earlier: Sequence[ConditionedLog] = (),
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
    """
    logs = on_one_clock(logs)
    earlier = on_one_clock(earlier) if earlier else ()
    problem = make_problem(logs, base, kept, earlier)
    search = search_effects(logs, base, kept, options, progress, first=problem, earlier=earlier)
    search, effects, withdrawn, improvement, regression = proved(problem, search)
    verdict = judge(search, effects, improvement, base.robot.joint_names, withdrawn)
    joints = localise_residual(replace(problem, noise=search.problem.noise).regression())
    simulation = simulation_errors(problem, search, effects, regression) if simulate else None
    invisible: dict[str, list[int]] = {}
    for (name, where), share in search.visibility.items():
        if share < HIDDEN:
            invisible.setdefault(name, []).extend(where[:1])
    logs = tuple(logs)
    return GapAnalysis(
        logs, problem, search, tuple(effects), tuple(joints), improvement, simulation, verdict, invisible
    )


def proved(
    problem: GapProblem, search: EffectSearch
) -> tuple[EffectSearch, list[SelectedEffect], list[SelectedEffect], HeldOutImprovement, WhitenedRegression]:
    """Fit what was found and prove it on held-out rows, without what does not shrink the gap there.

    What fails is withdrawn and the rest proved again: a wrong effect spoils the prediction that others are judged by.

    Returns:
        Search, effects with numbers and withdrawn ones, the held-out gap, and the refitted regression.
    """
    withdrawn: list[SelectedEffect] = []
    while True:
        effects, regression = refit(search)
        improvement = held_out_improvement(problem, search, effects)
        failing = [one for one in effects if refusal(search, effects, one, improvement) == NOT_SMALLER]
        if not failing or len(effects) == 1:
            return search, effects, withdrawn, improvement, regression
        worst = min(failing, key=lambda one: one.score)
        withdrawn.append(worst)
        search = without(search, worst)


def simulation_errors(
    problem: GapProblem, search: EffectSearch, effects: Sequence[SelectedEffect], regression: WhitenedRegression
) -> tuple[Floats, Floats] | None:
    """Return the position error of the simulated held-out motion before and after, (n,) each; None if it cannot be run.

    Args:
        problem: what was searched, before anything was found.
        search: the search.
        effects: what it found.
        regression: refitted with these effects.
    """
    try:
        before = simulate_held_out(problem, problem.regression(nuisance=False), [])
        after = simulate_held_out(search.problem, regression, with_columns(effects)) if effects else before
    except PackageMissing:
        return None
    return None if before is None or after is None else (before.rms, after.rms)


def on_one_clock(logs: Sequence[ConditionedLog]) -> list[ConditionedLog]:
    """Let time run through several logs when their stamps do: what warms up or drifts does not start anew with each."""
    begin = [s.segments[0].t[0] - s.segments[0].elapsed[0] for s in logs]
    ends = [s.segments[-1].t[-1] for s in logs]
    if any(later < end for later, end in zip(begin[1:], ends[:-1], strict=True)):
        return list(logs)
    return [replace(s, segments=[replace(x, elapsed=x.t - begin[0]) for x in s.segments]) for s in logs]
