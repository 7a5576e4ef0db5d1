"""What ``dynid gap`` says: the JSON answer, and the tables for a person."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.cli.options import Common

if TYPE_CHECKING:
    from dynid.gap.analysis import GapAnalysis
    from dynid.gap.refit import FittedEffect
    from dynid.robot import Robot


def answer_of(robot: Robot, seen: GapAnalysis, mode: str, wrote: list[Path]) -> dict[str, Any]:
    """Return the JSON answer."""
    from dynid.gap.verdict import unrepeatable
    from dynid.model.effects.catalogue import CATALOGUE

    verdict, held_out = seen.verdict, seen.improvement
    simulation = seen.simulation
    return {
        "schema": "dynid/gap/1",
        "robot": robot.name,
        "mode": mode,
        "verdict": verdict.word,
        "where": [
            {"joint": robot.joint_names[g.joint], "share": g.share, "region": g.text, "chi": g.chi} for g in seen.joints
        ],
        "named": [named_answer(robot, one, seen) for one in verdict.named],
        "alternatives": [list(group) for group in verdict.alternatives],
        "closest": [{**named_answer(robot, one, seen), "why_not": why} for one, why in verdict.closest],
        "gap": {
            "joints": list(robot.joint_names),
            "heldout_before_nm": held_out.before,
            "heldout_after_nm": held_out.after,
            "noise_floor_nm": held_out.floor,
            "ratio_interval": held_out.ratio,
            "simulation_before": None if simulation is None else simulation[0],
            "simulation_after": None if simulation is None else simulation[1],
            "heldout": seen.problem.held_text,
            "noise_from": noise_text(seen),
        },
        "not_repeatable": [robot.joint_names[j] for j in unrepeatable(seen.search)],
        "cannot_judge": {
            name: [robot.joint_names[j] for j in joints] for name, joints in seen.invisible.items() if name in CATALOGUE
        },
        "advice": verdict.advice,
        "wrote": wrote,
    }


def noise_text(seen: GapAnalysis) -> str:
    """Return where the noise floor comes from."""
    problem = seen.search.problem
    if problem.noise.repeats:
        return f"{problem.noise.repeats:.0f} s of repeats"
    if problem.matched:
        return "what differs and no effect explains"
    return "high frequencies: a lower bound, no motion is repeated"


def joint_names(robot: Robot, one: FittedEffect) -> list[str]:
    """Return the joints of an effect; all for one of the whole arm."""
    return [robot.joint_names[j] for j in one.joints or range(robot.n)]


def named_answer(robot: Robot, one: FittedEffect, seen: GapAnalysis) -> dict[str, Any]:
    """Return one effect for the JSON answer."""
    j = one.selected.test.joint
    return {
        "effect": one.name,
        "joints": joint_names(robot, one),
        "parameters": {
            name: {"value": value, "unit": one.units.get(name, ""), "std_error": one.errors.get(name)}
            for name, value in one.values.items()
        },
        "p_value": one.selected.test.p_value,
        "heldout_rms_before_nm": seen.improvement.before[j],
        "heldout_rms_after_nm": seen.improvement.after[j],
    }


def show(common: Common, robot: Robot, seen: GapAnalysis) -> None:
    """Print where, what and how far."""
    from dynid.gap.localisation import NEGLIGIBLE
    from dynid.gap.verdict import joints_text, labels

    terminal, verdict = common.terminal, seen.verdict
    noise = seen.search.problem.noise
    floor = f"from {noise_text(seen)}"
    if seen.search.problem.matched:
        floor += "; these logs drive the motion of the earlier ones, and are compared with them row by row"
    elif noise.misfit:
        kept = ", ".join(robot.joint_names[j] for j in noise.misfit)
        floor += f"; what the kept model left unexplained is more on {kept}"
    terminal.stage("noise", f"{floor}; held out: {seen.problem.held_text}")
    loud = sorted((g for g in seen.joints if g.share > 0.1 and g.chi > 1 + NEGLIGIBLE), key=lambda g: -g.share)
    text = "; ".join(f"{robot.joint_names[g.joint]} ({100 * g.share:.0f} % of the disagreement) {g.text}" for g in loud)
    terminal.fact("where", text or "nowhere above the noise")
    if verdict.named or verdict.closest:
        rows = [
            effect_row(robot, one, seen, why) for one, why in [*((f, "named") for f in verdict.named), *verdict.closest]
        ]
        terminal.table(["candidate", "joints", "held-out error", "chance", "said"], rows, numbers=False)
    for one in verdict.named:
        terminal.fact(
            "named",
            f"{one.effect.title} on {joints_text(one.joints, robot.joint_names)}: {one.effect.signature}",
        )
        terminal.fact("", ", ".join(number_text(one, name) for name in one.values))
    groups = [" or ".join(labels(one.selected, robot.joint_names)) for one in verdict.named if one.selected.rivals]
    words = {
        "named": "named",
        "nothing_missing": "nothing is missing",
        "unexplained": "something is missing that no effect of the catalogue explains",
        "ambiguous": f"fit equally well: {'; '.join(groups)}",
    }
    terminal.fact("verdict", words[verdict.word])
    improvement_table(common, robot, seen)
    if seen.simulation is None:
        terminal.stage("simulated", "no: too little is held out, or some link is too light to follow torques alone")
    if seen.invisible:
        hidden = ", ".join(
            f"{name} ({','.join(str(j + 1) for j in joints) or 'arm'})" for name, joints in seen.invisible.items()
        )
        terminal.detail("cannot say", f"these logs cannot show: {hidden}")
    terminal.fact("advice", verdict.advice)


def number_text(one: FittedEffect, name: str) -> str:
    """Return one parameter with its error and unit."""
    error = f" +- {one.errors[name]:.2g}" if name in one.errors else ""
    return f"{name} = {one.values[name]:.4g}{error} {one.units.get(name, '')}".strip()


def effect_row(robot: Robot, one: FittedEffect, seen: GapAnalysis, said: str) -> list[str]:
    """Return one line of the table of candidates."""
    from dynid.gap.verdict import joints_text

    j = one.selected.test.joint
    before, after = seen.improvement.before[j], seen.improvement.after[j]
    change = (
        f"{before:.3g} -> {after:.3g} {robot.joints[j].torque_unit}  {100 * (after / before - 1):+.0f} %"
        if before
        else "-"
    )
    chance = one.selected.test.p_value
    return [
        one.name,
        joints_text(one.joints, robot.joint_names),
        change,
        "<0.1 %" if chance < 1e-3 else f"{100 * chance:.1f} %",
        said,
    ]


def improvement_table(common: Common, robot: Robot, seen: GapAnalysis) -> None:
    """Print the gap joint by joint."""
    held_out, simulation = seen.improvement, seen.simulation
    rows = []
    for j, joint in enumerate(robot.joints):
        unit = joint.torque_unit
        row = [
            joint.name,
            f"{held_out.before[j]:.3g} {unit}",
            f"{held_out.after[j]:.3g} {unit}",
            f"{held_out.floor[j]:.3g} {unit}",
        ]
        if simulation is not None:
            row += [f"{1e3 * simulation[0][j]:.2f}", f"{1e3 * simulation[1][j]:.2f}"]
        rows.append(row)
    heads = ["joint", "held out before", "after", "noise"]
    common.terminal.table(heads + (["simulated before [mrad]", "after"] if simulation is not None else []), rows)
