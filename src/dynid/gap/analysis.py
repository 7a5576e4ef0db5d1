"""One analysis from conditioned logs to a verdict: where, what, how sure, and how far the gap shrinks; its record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dynid.arrays import Floats
from dynid.estimation.evidence import fingerprint
from dynid.estimation.least_squares import solvable
from dynid.estimation.payload import IdentifiedPayload
from dynid.estimation.result import Identification
from dynid.gap.candidates import SelectionOptions
from dynid.gap.change import still_changed
from dynid.gap.counterbalance import Suspicion, counterbalances
from dynid.gap.delays import EffectSearch, search_effects, searches
from dynid.gap.held_out import clue, held_out, held_out_effects, held_out_improvement
from dynid.gap.localisation import localise_residual
from dynid.gap.problem import judged_by_possible
from dynid.gap.selected_effects import SelectedEffect
from dynid.gap.verdict import (
    LIKELY,
    SEEN,
    advice_of,
    explained_share,
    joints_text,
    joints_with_more,
    refusal,
    unrepeatable,
    verdict_of,
)
from dynid.judgement.gap import GapEffect, GapRecord, HeldOutImprovement, JointGap
from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import CATALOGUE, DELAY
from dynid.model.parameters import BODY_PARAMETERS
from dynid.robot import Robot
from dynid.signals.conditioned_log import ConditionedLog
from dynid.units import joint_unit

#: Cut-off of the search [Hz]: below, what happens at reversals is gone; above, noise of the positions comes in.
CUTOFF = 10.0
#: Visible share below which these logs cannot show an effect, so that its absence means nothing.
HIDDEN = 0.01


@dataclass(frozen=True)
class GapAnalysis:
    """What a search found, and what proves it.

    Attributes:
        search: the search, with what is named alone.
        joints: the disagreement of each joint before.
        improvement: the held-out torque gap before and after what is named.
        verdict: ``named``, ``nothing_missing``, ``nothing_changed``, ``unexplained`` or ``ambiguous``.
        closest: effects that explain part of the gap, with the reason why they are no name.
        remainder: joints with more left than noise.
        advice: what to do next.
    """

    search: EffectSearch
    joints: tuple[JointGap, ...]
    improvement: HeldOutImprovement
    verdict: str
    closest: tuple[tuple[SelectedEffect, str], ...]
    remainder: tuple[int, ...]
    advice: str

    @property
    def named(self) -> tuple[SelectedEffect, ...]:
        """Effects that are named."""
        return tuple(self.search.selected)

    @property
    def left(self) -> float:
        """Power of the held-out errors with what is named over that of the noise, summed over joints."""
        return np.sum((self.improvement.after / self.improvement.floor) ** 2)

    @property
    def invisible(self) -> dict[str, list[int]]:
        """Effects and joints that these logs cannot show."""
        joints: dict[str, list[int]] = {}
        for (name, where), share in self.search.visibility.items():
            if share < HIDDEN:
                joints.setdefault(name, []).extend(where)
        return joints


@solvable()
def analyse_gap(
    logs: Sequence[ConditionedLog],
    base: BaseModel,
    kept: Identification | None,
    options: SelectionOptions,
    *,
    earlier: Sequence[ConditionedLog] = (),
    possible: bool = False,
) -> GapAnalysis:
    """Search conditioned logs for what a model lacks, and prove it on the rows that are held out.

    Args:
        logs: conditioned logs, all with the same filter.
        base: model and base parameters.
        kept: the model that is kept, to find what has changed; None to find what no re-identification can absorb.
        options: what is searched.
        earlier: conditioned logs that a kept model was identified from, where they are at hand.
        possible: whether the physically possible set is in force, and judges what is named.
    """
    before = on_one_clock(earlier) if earlier else ()
    refused: Sequence[tuple[SelectedEffect, str]] = ()
    logs = on_one_clock(logs)
    at = searches(logs, base, kept, before)
    while True:
        search = search_effects(logs, at, options)
        if possible and kept is None:
            search = replace(search, problem=judged_by_possible(search.problem))
        analysis = _proved(search, refused)
        # A refused effect may have kept others from being searched, and no second best stands in for it on its joint.
        refused = [x for x in analysis.closest if not x[1].startswith(LIKELY)]
        named = {(), *(one.joints[:1] for one in analysis.named)}
        barred = {x.joints[:1] for x, _ in refused} - named | {x.key for x, _ in refused}
        if len(search.selected) < options.most or barred == options.barred:
            return analysis
        options = replace(options, barred=barred)


@solvable()
def with_counterbalances(analysis: GapAnalysis, suspected: Sequence[Suspicion]) -> GapAnalysis:
    """Return an analysis of what no numbers absorb with what only implausible links would absorb too.

    Args:
        analysis: the analysis.
        suspected: where a counterbalance may be.
    """
    search = analysis.search
    selected = counterbalances(search.problem, search.selected, suspected)
    return _proved(replace(search, problem=judged_by_possible(search.problem), selected=selected))


def _proved(search: EffectSearch, before: Sequence[tuple[SelectedEffect, str]] = ()) -> GapAnalysis:
    """Return the analysis of a search: what is refused goes, the least likely first, and the rest is proved again.

    Args:
        search: the search.
        before: what was refused before it.
    """
    problem, first, effects = search.problem, search.first, list(search.selected)
    refused = list(before)
    # Why not of the same motion: what always was cancels there.
    on_another_motion = problem.rows.compared and not problem.same_motion
    changed: Sequence[int] = range(problem.base.robot.n)
    if on_another_motion and effects:
        changed = still_changed(first, []).joints
    # Why the same noise: it weighs the joints, and another weight is another fit.
    in_time = replace(first, noise=problem.noise, in_force=problem.in_force)

    def left_by(some: Sequence[SelectedEffect]) -> Floats:
        late = any(one.name == DELAY for one in some)
        return held_out(problem if late else in_time, some)

    def power(left: Floats) -> float:
        return float(np.nansum((left / problem.noise.floor) ** 2))

    while True:
        after, failing = left_by(effects), []
        for one in effects:
            without = left_by([other for other in effects if other is not one])
            fall = (power(without) - power(after)) / max(power(without - after), SEEN)
            if why := refusal(search, one, changed, fall):
                failing.append((one, why))
        if not failing:
            break
        refused.append(min(failing, key=lambda pair: pair[0].log_odds))
        effects.remove(refused[-1][0])
    search = search.without({one.key for one, _ in refused})
    remainder = joints_with_more(search)
    if problem.rows.compared:
        remainder = still_changed(problem, effects).joints
    verdict = verdict_of(search, remainder)
    known = search.state.rows.known_power(search.state.evidence)
    return GapAnalysis(
        search=search,
        joints=tuple(localise_residual(replace(first, noise=problem.noise).regression())),
        improvement=held_out_improvement(in_time, left_by([]), after, known),
        verdict=verdict,
        closest=tuple(refused),
        remainder=remainder,
        advice=advice_of(verdict, search, refused, remainder),
    )


def on_one_clock(logs: Sequence[ConditionedLog]) -> list[ConditionedLog]:
    """Let time run through several logs when their stamps do: what warms up or drifts does not start anew with each."""
    spans = sorted(
        (s.segments[0].t[0] - s.segments[0].elapsed[0], s.segments[-1].t[-1]) for s in logs
    )
    if any(later < end for (_, end), (later, _) in pairwise(spans)):
        return list(logs)
    return [
        replace(s, segments=[replace(x, elapsed=x.t - spans[0][0]) for x in s.segments])
        for s in logs
    ]


# ---------------------------------------------------------------- a load
# The search fits a load with errors that it takes to be noise. What the arm's residual model may explain, what its
# friction may have changed by, and gains that are wrong in both logs alike are not noise, and they are larger.
#: Parameters of a load that are told at least: its mass and its first moments.
LEAST_FORM = 4


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
    shape = {"form": float(form)}
    sign = np.copysign(1.0, load.values["m"])
    told = (sign * payload.body.parameters(), np.sqrt(np.diagonal(payload.covariance)))
    values, errors = (dict(zip(BODY_PARAMETERS[:form], x.tolist(), strict=False)) for x in told)
    new = replace(
        load,
        shape=load.shape | shape,
        values=values | shape,
        std_errors=load.std_errors | errors,
    )
    selected = [new if one is load else one for one in analysis.named]
    return replace(analysis, search=replace(analysis.search, selected=selected))


# ---------------------------------------------------------------- as plain values
def new_name(robot: Robot, effects: Sequence[GapEffect]) -> str:
    """Return the name of the copy, such as ``arm+stribeck2``."""
    index = {name: str(k + 1) for k, name in enumerate(robot.joint_names)}
    parts = [
        s.effect + ("_".join(index[j] for j in s.joints) if len(s.joints) < robot.n else "")
        for s in effects
    ]
    return "+".join([robot.slug, *parts])


def record_of(
    analysis: GapAnalysis, result: Identification, question: str, asked: str
) -> GapRecord:
    """Return what an analysis found as plain values.

    Args:
        analysis: the analysis.
        result: what was searched.
        question: ``"numbers"``, ``"arm"`` or ``"changed"``.
        asked: which questions were asked and why, in words.
    """
    search, robot, names = analysis.search, result.robot, result.robot.joint_names
    problem, disturbed = search.problem, unrepeatable(search)
    noise_from = "the high frequencies of the residual, a lower bound because no motion is repeated"
    if problem.noise.repeats:
        noise_from = f"{problem.noise.repeats:.0f} s of repeats"
    left = dict.fromkeys((*analysis.remainder, *disturbed))
    return GapRecord(
        robot=robot.name,
        question=question,
        verdict=analysis.verdict,
        named=tuple(effect_of(one, analysis, result) for one in analysis.named),
        closest=tuple(effect_of(one, analysis, result, why) for one, why in analysis.closest),
        advice=analysis.advice,
        joint_names=names,
        torque_units=tuple(joint.torque_unit for joint in robot.joints),
        joints=analysis.joints,
        improvement=analysis.improvement,
        heldout=search.first.held_text,
        noise_from=noise_from,
        not_repeatable=tuple(names[j] for j in disturbed),
        cannot_judge={name: tuple(joints) for name, joints in analysis.invisible.items()},
        logs=tuple(log.path for log in search.logs),
        made_from=str(result.path) if result.path.name else "",
        # Why not of a change: what is left of it is no property of the arm.
        clues=() if problem.since else tuple(clue(search, j) for j in left),
        asked=asked,
        curves=tuple(held_out_effects(problem, analysis.named)),
        of=fingerprint(result),
        repeats=problem.noise.repeats,
        more=tuple(names[j] for j in analysis.remainder),
        events=() if analysis.verdict.startswith("nothing") else search.events,
    )


def effect_of(
    one: SelectedEffect, analysis: GapAnalysis, result: Identification, why_not: str = ""
) -> GapEffect:
    """Return an effect as plain values, ``why_not`` being the reason why it is not named."""
    names, j, before = result.robot.joint_names, one.joint, analysis.improvement.before
    joint, late = result.robot.joints[j], one.name == DELAY
    sizes = []
    for name, value in one.values.items():
        error = one.std_errors.get(name, 0.0)
        unit = joint_unit(one.units.get(name, ""), revolute=joint.revolute)
        sizes.append((name, value, error if np.isfinite(error) else None, unit))
    # Why none: it is against other names and what has none, and something else speaks against this one.
    other_reason = why_not and not why_not.startswith(LIKELY)
    return GapEffect(
        effect=one.name,
        title=one.effect.title,
        indices=one.joints,
        joints=tuple(names[k] for k in one.joints or range(len(names))),
        where=joints_text(one.joints, names),
        sizes=tuple(sizes),
        p_value=one.p_value,
        joint=names[j],
        rms_before=float(before[j]),
        rms_after=None if why_not else float(analysis.improvement.after[j]),
        unit=joint.torque_unit,
        why_not=why_not,
        rivals=tuple(
            f"{CATALOGUE[name].title} on {joints_text(joints, names)}"
            for name, joints in one.rivals
        ),
        rival_keys=one.rivals,
        share=None if why_not or late else explained_share(analysis.search, one),
        probability=None if other_reason else one.probability,
        # Whether most of a delay is known to the model.
        corrected=bool(
            late
            and not why_not
            and abs(one.values["delay"] - result.delay) < 0.5 * abs(one.values["delay"])
        ),
    )
