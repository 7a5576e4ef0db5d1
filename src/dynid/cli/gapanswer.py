"""What ``dynid gap`` says: the JSON answer, and the tables for a person."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.cli.options import Common

if TYPE_CHECKING:
    from dynid.gap.investigate import Investigation
    from dynid.gap.refit import Fitted
    from dynid.robot import Robot


def answer_of(robot: Robot, seen: Investigation, mode: str, wrote: list[Path]) -> dict[str, Any]:
    """Return the JSON answer."""
    from dynid.gap.verdict import unrepeatable
    from dynid.model.effects.catalogue import CATALOGUE

    verdict, proof = seen.verdict, seen.proof
    simulation = seen.simulation
    return {
        "schema": "dynid/gap/1",
        "robot": robot.name,
        "mode": mode,
        "verdict": verdict.word,
        "where": [
            {"joint": robot.joint_names[g.joint], "share": g.share, "region": g.text, "chi": g.chi} for g in seen.where
        ],
        "named": [named_answer(robot, one, seen) for one in verdict.named],
        "alternatives": [list(group) for group in verdict.alternatives],
        "closest": [{**named_answer(robot, one, seen), "why_not": why} for one, why in verdict.closest],
        "gap": {
            "joints": list(robot.joint_names),
            "heldout_before_nm": proof.before,
            "heldout_after_nm": proof.after,
            "noise_floor_nm": proof.floor,
            "ratio_interval": proof.ratio,
            "simulation_before": None if simulation is None else simulation[0],
            "simulation_after": None if simulation is None else simulation[1],
            "heldout": seen.first.held_text,
            "noise_from": noise_text(seen),
        },
        "not_repeatable": [robot.joint_names[j] for j in unrepeatable(seen.found)],
        "cannot_judge": {
            name: [robot.joint_names[j] for j in joints] for name, joints in seen.unseen.items() if name in CATALOGUE
        },
        "advice": verdict.advice,
        "wrote": wrote,
    }


def noise_text(seen: Investigation) -> str:
    """Return where the noise floor comes from."""
    setting = seen.found.setting
    if setting.noise.repeats:
        return f"{setting.noise.repeats:.0f} s of repeats"
    if setting.matched:
        return "what differs and no effect explains"
    return "high frequencies: a lower bound, no motion is repeated"


def joints_text(robot: Robot, one: Fitted) -> list[str]:
    """Return the joints of an effect; all for one of the whole arm."""
    return [robot.joint_names[j] for j in one.pick.place or range(robot.n)]


def named_answer(robot: Robot, one: Fitted, seen: Investigation) -> dict[str, Any]:
    """Return one effect for the JSON answer."""
    j = one.pick.proof.joint
    return {
        "effect": one.pick.effect.name,
        "joints": joints_text(robot, one),
        "parameters": {
            name: {"value": value, "unit": one.units.get(name, ""), "std_error": one.errors.get(name)}
            for name, value in one.values.items()
        },
        "p_value": one.pick.proof.p_value,
        "heldout_rms_before_nm": seen.proof.before[j],
        "heldout_rms_after_nm": seen.proof.after[j],
    }


def show(common: Common, robot: Robot, seen: Investigation) -> None:
    """Print where, what and how far."""
    from dynid.gap.localisation import ABOVE
    from dynid.gap.verdict import labels, place_text

    terminal, verdict = common.terminal, seen.verdict
    noise = seen.found.setting.noise
    floor = f"from {noise_text(seen)}"
    if seen.found.setting.matched:
        floor += "; these logs drive the motion of the earlier ones, and are compared with them row by row"
    elif noise.kept:
        kept = ", ".join(robot.joint_names[j] for j in noise.kept)
        floor += f"; what the kept model left unexplained is more on {kept}"
    terminal.stage("noise", f"{floor}; held out: {seen.first.held_text}")
    loud = sorted((g for g in seen.where if g.share > 0.1 and g.chi > ABOVE), key=lambda g: -g.share)
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
            f"{one.pick.effect.title} on {place_text(one.pick.place, robot.joint_names)}: {one.pick.effect.signature}",
        )
        terminal.fact("", ", ".join(number_text(one, name) for name in one.values))
    groups = [" or ".join(labels(one.pick, robot.joint_names)) for one in verdict.named if one.pick.equals]
    words = {
        "named": "named",
        "nothing_missing": "nothing is missing",
        "unexplained": "something is missing that no effect of the catalogue explains",
        "ambiguous": f"fit equally well: {'; '.join(groups)}",
    }
    terminal.fact("verdict", words[verdict.word])
    shrink_table(common, robot, seen)
    if seen.simulation is None:
        terminal.stage("simulated", "no: too little is held out, or some link is too light to follow torques alone")
    if seen.unseen:
        hidden = ", ".join(
            f"{name} ({','.join(str(j + 1) for j in joints) or 'arm'})" for name, joints in seen.unseen.items()
        )
        terminal.detail("cannot say", f"these logs cannot show: {hidden}")
    terminal.fact("advice", verdict.advice)


def number_text(one: Fitted, name: str) -> str:
    """Return one parameter with its error and unit."""
    error = f" +- {one.errors[name]:.2g}" if name in one.errors else ""
    return f"{name} = {one.values[name]:.4g}{error} {one.units.get(name, '')}".strip()


def effect_row(robot: Robot, one: Fitted, seen: Investigation, said: str) -> list[str]:
    """Return one line of the table of candidates."""
    from dynid.gap.verdict import place_text

    j = one.pick.proof.joint
    before, after = seen.proof.before[j], seen.proof.after[j]
    change = (
        f"{before:.3g} -> {after:.3g} {robot.joints[j].torque_unit}  {100 * (after / before - 1):+.0f} %"
        if before
        else "-"
    )
    chance = one.pick.proof.p_value
    return [
        one.pick.effect.name,
        place_text(one.pick.place, robot.joint_names),
        change,
        "<0.1 %" if chance < 1e-3 else f"{100 * chance:.1f} %",
        said,
    ]


def shrink_table(common: Common, robot: Robot, seen: Investigation) -> None:
    """Print the gap joint by joint."""
    proof, simulation = seen.proof, seen.simulation
    rows = []
    for j, joint in enumerate(robot.joints):
        unit = joint.torque_unit
        row = [
            joint.name,
            f"{proof.before[j]:.3g} {unit}",
            f"{proof.after[j]:.3g} {unit}",
            f"{proof.floor[j]:.3g} {unit}",
        ]
        if simulation is not None:
            row += [f"{1e3 * simulation[0][j]:.2f}", f"{1e3 * simulation[1][j]:.2f}"]
        rows.append(row)
    heads = ["joint", "held out before", "after", "noise"]
    common.terminal.table(heads + (["simulated before [mrad]", "after"] if simulation is not None else []), rows)
