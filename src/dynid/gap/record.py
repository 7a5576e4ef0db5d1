"""What an analysis found as plain values, with the names and units of its arm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.estimation.evidence import fingerprint
from dynid.estimation.result import Identification
from dynid.gap.analysis import GapAnalysis
from dynid.gap.held_out import clue, held_out_effects
from dynid.gap.selected_effects import SelectedEffect
from dynid.gap.verdict import LIKELY, explained_share, joints_text, unrepeatable
from dynid.judgement.gap import GapEffect, GapRecord
from dynid.model.effects.catalogue import CATALOGUE, DELAY
from dynid.robot import Robot
from dynid.units import joint_unit


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
