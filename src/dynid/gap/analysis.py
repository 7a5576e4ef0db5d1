"""One analysis from conditioned logs to a verdict: where, what, how sure, and how far the gap shrinks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.arrays import Floats
from dynid.estimation.least_squares import solvable
from dynid.estimation.payload import IdentifiedPayload
from dynid.gap.candidates import SelectionOptions
from dynid.gap.change import still_changed
from dynid.gap.counterbalance import COUNTERBALANCE, counterbalances
from dynid.gap.delays import EffectSearch, search_effects
from dynid.gap.forward_simulation import simulate_held_out
from dynid.gap.held_out import (
    HeldOutImprovement,
    fitted_with,
    held_out,
    held_out_improvement,
    rms_of,
)
from dynid.gap.localisation import JointGap, localise_residual
from dynid.gap.problem import GapProblem, KeptModel, judged_by_possible, make_problem
from dynid.gap.selected_effects import SelectedEffect, with_columns
from dynid.gap.verdict import GapVerdict, judge, refusal
from dynid.model.base_model import BaseModel
from dynid.model.parameters import BODY_PARAMETERS
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
        joints: the disagreement of each joint before.
        improvement: the held-out torque gap before and after what is named.
        simulation: position error of the forward simulation before and after it, (n,) each [rad or m]; None where it
            cannot be run.
        verdict: the verdict.
    """

    logs: tuple[ConditionedLog, ...]
    problem: GapProblem
    search: EffectSearch
    joints: tuple[JointGap, ...]
    improvement: HeldOutImprovement
    simulation: tuple[Floats, Floats] | None
    verdict: GapVerdict

    @property
    def invisible(self) -> dict[str, list[int]]:
        """Effects and joints that these logs cannot show."""
        joints: dict[str, list[int]] = {}
        for (name, where), share in self.search.visibility.items():
            if share < HIDDEN:
                joints.setdefault(name, []).extend(where[:1])
        return joints


@solvable()
def analyse_gap(
    logs: Sequence[ConditionedLog],
    base: BaseModel,
    kept: KeptModel | None,
    options: SelectionOptions,
    *,
    simulate: bool = True,
    earlier: Sequence[ConditionedLog] = (),
    possible: bool = False,
) -> GapAnalysis:
    """Search conditioned logs for what a model lacks, and prove it on the rows that are held out.

    Args:
        logs: conditioned logs, all with the same filter.
        base: model and base parameters.
        kept: the model that is kept, to find what has changed; None to find what no re-identification can absorb.
        options: what is searched.
        simulate: whether the forward simulation is run too.
        earlier: conditioned logs that a kept model was identified from, where they are at hand.
        possible: whether the physically possible set is in force, and judges what is named.
    """
    logs = on_one_clock(logs)
    earlier = on_one_clock(earlier) if earlier else ()
    problem = make_problem(logs, base, kept, earlier)
    search = search_effects(logs, base, kept, options, first=problem, earlier=earlier)
    if possible and kept is None:
        search = replace(search, problem=judged_by_possible(search.problem))
    return _proved(tuple(logs), problem, search, options, simulate=simulate)


@solvable()
def with_counterbalances(
    analysis: GapAnalysis,
    options: SelectionOptions,
    joints: Sequence[int],
    *,
    simulate: bool = True,
) -> GapAnalysis:
    """Return an analysis of what no numbers absorb with what only implausible links would absorb too.

    Args:
        analysis: the analysis.
        options: what is searched.
        joints: on which a counterbalance may be.
        simulate: whether the forward simulation is run too.
    """
    if options.effects and COUNTERBALANCE not in options.effects:
        return analysis
    search = analysis.search
    selected = counterbalances(search.problem, search.selected, joints)
    search = replace(search, problem=judged_by_possible(search.problem), selected=selected)
    return _proved(analysis.logs, analysis.problem, search, options, simulate=simulate)


def _proved(
    logs: tuple[ConditionedLog, ...],
    first: GapProblem,
    search: EffectSearch,
    options: SelectionOptions,
    *,
    simulate: bool,
) -> GapAnalysis:
    """Return the analysis of a search: what is refused goes, the least likely first, and the rest is proved again.

    Args:
        logs: the conditioned logs.
        first: what was searched, before anything was found.
        search: the search.
        options: what was searched.
        simulate: whether the forward simulation is run too.
    """
    problem, effects = search.problem, list(search.selected)
    refused: list[tuple[SelectedEffect, str]] = []
    # Why not of the same motion: what always was cancels there.
    on_another_motion = problem.rows.compared and not problem.same_motion
    changed = still_changed(first, []).joints if on_another_motion and effects else None
    # Why the same noise: it weighs the joints, and another weight is another fit.
    in_time = replace(first, noise=problem.noise, in_force=problem.in_force)

    def left_by(some: Sequence[SelectedEffect]) -> Floats:
        late = any(one.name == "torque_delay" for one in some)
        return held_out(problem if late else in_time, some)

    def power(left: Floats) -> float:
        return float(np.sum((rms_of(left) / problem.noise.floor) ** 2))

    while True:
        after, failing = left_by(effects), []
        for one in effects:
            without = left_by([other for other in effects if other is not one])
            falls = (power(without) - power(after)) / max(one.visible**2, 1e-12)
            if why := refusal(search, one, options.sure, changed, falls):
                failing.append((one, why))
        if not failing:
            break
        refused.append(min(failing, key=lambda pair: pair[0].log_odds))
        effects.remove(refused[-1][0])
    improvement = held_out_improvement(in_time, left_by([]), after, search.errors)
    search = replace(search, selected=effects)
    return GapAnalysis(
        logs,
        first,
        search,
        tuple(localise_residual(replace(first, noise=problem.noise).regression())),
        improvement,
        _replays(first, search, effects) if simulate else None,
        judge(search, effects, refused, problem.base.robot.joint_names),
    )


def _replays(
    first: GapProblem, search: EffectSearch, effects: Sequence[SelectedEffect]
) -> tuple[Floats, Floats] | None:
    """Return the replay of the held-out motion before and after; None where it cannot be run."""
    problem, shown = search.problem, with_columns(effects)
    # Why of a change: fitted to old and new logs, an arm carries what was put on it in its own links.
    rows = first.rows.only(~first.rows.is_new) if first.rows.compared else first.rows
    kept = replace(first, rows=rows)
    before = simulate_held_out(first, kept.regression(nuisance=False), [])
    after = simulate_held_out(problem, fitted_with(problem, shown), shown) if effects else before
    return None if before is None or after is None else (before, after)


def on_one_clock(logs: Sequence[ConditionedLog]) -> list[ConditionedLog]:
    """Let time run through several logs when their stamps do: what warms up or drifts does not start anew with each."""
    begin = [s.segments[0].t[0] - s.segments[0].elapsed[0] for s in logs]
    ends = [s.segments[-1].t[-1] for s in logs]
    if any(later < end for later, end in zip(begin[1:], ends[:-1], strict=True)):
        return list(logs)
    return [
        replace(s, segments=[replace(x, elapsed=x.t - begin[0]) for x in s.segments]) for s in logs
    ]


# ---------------------------------------------------------------- a load
# The search fits a load with errors that it takes to be noise. What the arm's residual model may explain, what its
# friction may have changed by, and gains that are wrong in both logs alike are not noise, and they are larger.
#: Parameters of a load that are told at least: its mass and its first moments.
LEAST_FORM = 4


def named_load(analysis: GapAnalysis) -> SelectedEffect | None:
    """Return the load that is named, None where none is."""
    return next((one for one in analysis.verdict.named if one.name == "payload"), None)


def with_reestimated_payload(
    analysis: GapAnalysis, load: SelectedEffect, payload: IdentifiedPayload
) -> GapAnalysis:
    """Return an analysis whose load has other numbers.

    Args:
        analysis: the analysis.
        load: the load that it names.
        payload: the load as it was weighed; of one that was taken off, the same body that hung there before.
    """
    form = max(LEAST_FORM, round(load.values["form"]))
    sign = 1.0 if load.values["m"] >= 0.0 else -1.0
    values, errors = sign * payload.body.parameters(), np.sqrt(np.diagonal(payload.covariance))
    new = replace(
        load,
        shape=load.shape | {"form": float(form)},
        values=dict(zip(BODY_PARAMETERS[:form], values.tolist(), strict=False))
        | {"form": float(form)},
        std_errors=load.std_errors
        | dict(zip(BODY_PARAMETERS[:form], errors.tolist(), strict=False)),
    )

    verdict = replace(
        analysis.verdict,
        named=tuple(new if one is load else one for one in analysis.verdict.named),
    )
    return replace(analysis, verdict=verdict)
