"""``dynid gap PARAMETERS LOG...``: where model and measurement disagree, and which effect is missing."""

from __future__ import annotations

import re
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.loop3 import percent, read_sources, reading_of, reading_options
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import Answer, ask
from dynid.errors import ExitStatus, WrongUsage

if TYPE_CHECKING:
    from dynid.gap.final import Fitted
    from dynid.gap.investigate import Investigation
    from dynid.gap.search import Options
    from dynid.identify.result import StoredResult
    from dynid.identify.stack import Source
    from dynid.model.store import BaseModel
    from dynid.robot import Robot

#: Cut-off of the search [Hz]: below, what happens at reversals is gone; above, noise of the positions comes in.
CUTOFF = 10.0


@dynid_command(
    "gap",
    examples=(
        "dynid gap out/arm/parameters.npz a.bag a_again.bag b.bag b_again.bag c.bag",
        "dynid gap out/arm/parameters.npz new.bag --mode frozen        what has changed since it was identified?",
        "dynid gap out/arm/parameters.npz a.bag b.bag --apply best",
        "dynid gap --self-test                                         hide effects in simulated logs and look",
    ),
)
@click.argument("parameters", required=False, type=click.Path(path_type=Path))
@click.argument("logs", nargs=-1, type=click.Path(path_type=Path), metavar="LOG...")
@click.option("--mode", type=click.Choice(["refit", "frozen"]), default="refit", show_default=True,
              help="refit: what can no identification absorb? frozen: what has changed since?")  # fmt: skip
@click.option(
    "--effects", metavar="all|LIST", default="all", show_default=True, help="Effects that are tried, by identifier."
)
@click.option("--joints", metavar="LIST", help="Joints that are searched, by name or number.")
@click.option(
    "--false-alarm", metavar="SHARE", default="1%", show_default=True, help="Chance of a name where nothing is missing."
)
@click.option(
    "--max-effects", type=click.IntRange(min=1), default=3, show_default=True, help="Most effects that are added."
)
@click.option(
    "--apply", "apply_", is_flag=False, flag_value="best", metavar="NAME[@JOINTS]|best", help="Add it without asking."
)
@click.option("--no-apply", is_flag=True, help="Only report.")
@click.option(
    "--new-name", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="The copy of the robot file."
)
@click.option("--plot/--no-plot", default=True, show_default=True, help="Draw the pictures.")
@click.option("--self-test", is_flag=True, help="Hide effects, and none, in simulated logs and print what is named.")
@reading_options
def command(common: Common, parameters: Path | None, logs: tuple[Path, ...], **options: Any) -> ExitStatus:  # noqa: ANN401
    """Find what the model lacks, name it with evidence, add it, and show that the gap shrinks."""
    if options["self_test"]:
        from dynid.cli.selftest import run_self_test

        return run_self_test(common)
    if parameters is None or not logs:
        raise WrongUsage("gap needs PARAMETERS and at least one LOG", fix="dynid gap out/arm/parameters.npz log.bag")
    if options["apply_"] and options["no_apply"]:
        raise WrongUsage("--apply and --no-apply exclude each other")
    return investigate_logs(common, parameters, logs, options)


def investigate_logs(common: Common, parameters: Path, logs: tuple[Path, ...], options: dict[str, Any]) -> ExitStatus:
    """Read, search, report, and add what was named."""
    import numpy as np

    from dynid.cli.validate import base_model_of
    from dynid.gap.investigate import investigate
    from dynid.gap.setting import Known
    from dynid.identify import result
    from dynid.report.gap_record import save

    stored = result.load(parameters)
    wanted = options_of(stored.robot, options)
    base = base_model_of(common, stored)
    sources = conditioned(common, base, logs, options, stored)
    found = stored.identification
    left = np.array([joint.rms for joint in found.joints])
    known = Known(found.plain, found.covariance, left) if options["mode"] == "frozen" else None
    earlier = earlier_logs(common, base, stored, options) if known else []
    with common.terminal.progress() as progress:
        progress.stage("search", "")
        seen = investigate(sources, base, known, wanted, progress, earlier=earlier)
    wrote = write_pictures(common, parameters.parent / "gap", base.robot, seen) if options["plot"] else []
    show(common, base.robot, seen)
    chosen = chosen_effects(seen, options["apply_"], base.robot)
    if chosen and agreed(common, chosen, options):
        wrote += add(common, base, sources, seen, chosen, stored, logs, options)
    stored_gap = parameters.parent / "gap.npz"
    answer = answer_of(base.robot, seen, options["mode"], [*wrote, stored_gap])
    save(stored_gap, answer, logs, seen.where, seen.proof)
    common.terminal.emit_json(answer)
    for path in answer["wrote"]:
        common.terminal.wrote(path)
    return ExitStatus.DONE


def options_of(robot: Robot, options: dict[str, Any]) -> Options:
    """Return what is searched, every name checked."""
    from dynid.files.yamlfile import closest
    from dynid.gap.search import Options
    from dynid.model.effects.catalogue import CATALOGUE

    effects: tuple[str, ...] = ()
    if options["effects"] != "all":
        effects = tuple(word.strip() for word in options["effects"].split(",") if word.strip())
    for word in effects:
        if word not in CATALOGUE:
            raise WrongUsage(
                f"--effects: no effect '{word}'{closest(word, CATALOGUE)}", fix=f"some of {','.join(CATALOGUE)}"
            )
    joints = joints_of(robot, options["joints"], "--joints")
    return Options(effects, joints, percent(options["false_alarm"], "--false-alarm"), options["max_effects"])


def joints_of(robot: Robot, text: str | None, option: str) -> tuple[int, ...]:
    """Return joints given by name, by number, or as a range such as ``2-4``."""
    from dynid.files.yamlfile import closest

    found: list[int] = []
    for word in (w.strip() for w in (text or "").split(",")):
        span = re.fullmatch(r"(\d+)(?:-(\d+))?", word)
        if not word:
            continue
        if word in robot.joint_names:
            found.append(robot.joint_names.index(word))
        elif span and 1 <= int(span[1]) <= int(span[2] or span[1]) <= robot.n:
            found += range(int(span[1]) - 1, int(span[2] or span[1]))
        else:
            raise WrongUsage(
                f"{option}: no joint '{word}'{closest(word, robot.joint_names)}", fix=f"1 to {robot.n}, or a name"
            )
    return tuple(dict.fromkeys(found))


def conditioned(
    common: Common, base: BaseModel, logs: tuple[Path, ...], options: dict[str, Any], stored: StoredResult
) -> list[Source]:
    """Read the logs under one filter that keeps what happens at reversals."""
    if options["cutoff"] == "auto":
        options = {**options, "cutoff": repr(max(CUTOFF, stored.cutoff))}
    if options["delay"] == "auto":
        # Why not in a refit: there a delay is one of the effects that are looked for.
        options = {**options, "delay": repr(stored.delay) if options["mode"] == "frozen" else "off"}
    return read_sources(common, base, logs, reading_of(options, identify=False))[0]


def earlier_logs(common: Common, base: BaseModel, stored: StoredResult, options: dict[str, Any]) -> list[Source]:
    """Return the logs that a kept model was identified from, where they are still what they were.

    Why: what the model left unexplained in them it leaves unexplained in new ones, and that is no change.
    """
    from dynid.files.artifact import sha256

    paths = [Path(name) for name in stored.header.get("logs", [])]
    there = tuple(
        path for path, sha in zip(paths, stored.log_sha256, strict=False) if path.is_file() and sha256(path) == sha
    )
    if len(there) < len(paths):
        text = "not all at hand: what the model lacked then may be taken for a change"
        common.terminal.stage("earlier", f"logs that it was identified from {text}")
    return conditioned(common, base, there, options, stored) if there else []


# ---------------------------------------------------------------- the answer
def answer_of(robot: Robot, seen: Investigation, mode: str, wrote: list[Path]) -> dict[str, Any]:
    """Return the JSON answer."""
    from dynid.gap.verdict import unrepeatable
    from dynid.model.effects.catalogue import CATALOGUE

    verdict, proof, noise = seen.verdict, seen.proof, seen.found.setting.noise
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
            "noise_from": "repeats" if noise.repeats else "high frequencies (a lower bound)",
        },
        "not_repeatable": [robot.joint_names[j] for j in unrepeatable(seen.found)],
        "cannot_judge": {
            name: [robot.joint_names[j] for j in joints] for name, joints in seen.unseen.items() if name in CATALOGUE
        },
        "advice": verdict.advice,
        "wrote": wrote,
    }


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
    terminal, verdict = common.terminal, seen.verdict
    noise = seen.found.setting.noise
    floor = (
        f"from {noise.repeats:.0f} s of repeats"
        if noise.repeats
        else "from high frequencies: a lower bound, no motion is repeated"
    )
    if noise.kept:
        kept = ", ".join(robot.joint_names[j] for j in noise.kept)
        floor += f"; what the kept model left unexplained is more on {kept}"
    terminal.stage("noise", f"{floor}; held out: {seen.first.held_text}")
    loud = sorted((g for g in seen.where if g.share > 0.1), key=lambda g: -g.share)
    text = "; ".join(f"{robot.joint_names[g.joint]} ({100 * g.share:.0f} % of the disagreement) {g.text}" for g in loud)
    terminal.fact("where", text or "nowhere above the noise")
    if seen.fitted:
        rows = [
            effect_row(robot, one, seen, why) for one, why in [*((f, "named") for f in verdict.named), *verdict.closest]
        ]
        terminal.table(["candidate", "joints", "held-out error", "chance", "said"], rows, numbers=False)
    for one in verdict.named:
        terminal.fact("named", f"{one.pick.effect.title} on {place_text(robot, one)}: {one.pick.effect.signature}")
        terminal.fact("", ", ".join(number_text(one, name) for name in one.values))
    words = {
        "named": "named",
        "nothing_missing": "nothing is missing",
        "unexplained": "something is missing that no effect of the catalogue explains",
        "ambiguous": f"fit equally well: {'; '.join(' or '.join(group) for group in verdict.alternatives)}",
    }
    terminal.fact("verdict", words[verdict.word])
    shrink_table(common, robot, seen)
    if seen.simulation is None:
        terminal.stage(
            "simulated", "no: the identified mass matrix is not positive definite, or too little is held out"
        )
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


def place_text(robot: Robot, one: Fitted) -> str:
    """Return where an effect sits, in words."""
    place = one.pick.place
    return "the whole arm" if not place else " from ".join(robot.joint_names[j] for j in place)


def effect_row(robot: Robot, one: Fitted, seen: Investigation, said: str) -> list[str]:
    """Return one line of the table of candidates."""
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
        place_text(robot, one),
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


# ---------------------------------------------------------------- adding
def chosen_effects(seen: Investigation, apply_: str | None, robot: Robot) -> list[Fitted]:
    """Return the effects to add: those named, or the one that --apply asks for."""
    if apply_ in (None, "best"):
        return list(seen.verdict.named)
    name, _, where = str(apply_).partition("@")
    joints = joints_of(robot, where, "--apply")
    found = [
        f
        for f in seen.fitted
        if f.pick.effect.name == name and (not joints or f.pick.place[:1] in [(j,) for j in joints])
    ]
    if not found:
        there = (
            ", ".join(f"{f.pick.effect.name}@{','.join(str(j + 1) for j in f.pick.place[:1])}" for f in seen.fitted)
            or "nothing"
        )
        raise WrongUsage(f"--apply {apply_}: this was not found", why=f"found: {there}")
    return found


def agreed(common: Common, chosen: list[Fitted], options: dict[str, Any]) -> bool:
    """Return whether the effects are to be added."""
    given = False if options["no_apply"] else True if options["apply_"] else None
    names = " and ".join(f.pick.effect.name for f in chosen)
    return ask(common, "P7", given=given, effect=names) is Answer.YES


def add(
    common: Common,
    base: BaseModel,
    sources: list[Source],
    seen: Investigation,
    chosen: list[Fitted],
    stored: StoredResult,
    logs: tuple[Path, ...],
    options: dict[str, Any],
) -> list[Path]:
    """Write the copy of the robot file and the arm identified again with the effects."""
    from dynid.files.artifact import sha256
    from dynid.gap.apply import identify_again, new_name, specs_of, write_robot
    from dynid.gap.investigate import on_one_clock
    from dynid.identify import result

    robot = base.robot
    specs = specs_of(chosen, robot)
    name = new_name(robot, specs)
    copy = (
        options["new_name"]
        or (robot.path.parent if robot.path and _writable(robot.path.parent) else Path()) / f"{name}.yaml"
    )
    if copy.exists() and not common.force:
        ask_to_overwrite(common, copy)
    write_robot(robot, specs, copy)
    again, found = identify_again(on_one_clock(sources), seen.first, base, specs)
    again = replace(again, model=replace(again.model, robot=replace(again.robot, path=copy)))
    folder = common.out or Path("out") / copy.stem
    inputs = {f"log {k + 1}": sha256(log) for k, log in enumerate(logs)}
    header = {
        "robot": again.robot.name,
        "key": again.robot.model_key,
        "log_sha256": list(inputs.values()),
        "logs": [str(log) for log in logs],
        "cutoff_hz": sources[0].chosen.cutoff,
        "log_findings": [],
        "inputs": inputs,
        "effects": [asdict(s) for s in specs],
        "made_from": str(stored.path),
    }
    result.save(folder / "parameters.npz", found, again, header)
    common.terminal.next(f"dynid validate {folder / 'parameters.npz'} LOG      (a log that was not used here)")
    return [copy, folder / "parameters.npz"]


def _writable(folder: Path) -> bool:
    import os

    return os.access(folder, os.W_OK)


def ask_to_overwrite(common: Common, path: Path) -> None:
    """Ask before a robot file is overwritten."""
    from dynid.cli.prompt import can_ask
    from dynid.errors import Declined, OutputExists

    if not common.yes and not can_ask(common):
        raise OutputExists(f"{path} exists", fix="use --force, or another name with --new-name")
    if ask(common, "P6", path=path) is not Answer.YES:
        raise Declined(f"{path} is left as it was", fix="use --force, or another name with --new-name")


def write_pictures(common: Common, folder: Path, robot: Robot, seen: Investigation) -> list[Path]:
    """Draw where the gap is and how far it shrank."""
    from dynid.report.gap_figures import shrink_figure, where_figure, write

    units = [joint.torque_unit for joint in robot.joints]
    with common.terminal.progress() as progress:
        progress.stage("draw", "")
        first = write(where_figure(seen.where, robot.joint_names, robot.name), folder / "where.png")
        title = f"{robot.name}: the gap on unseen data ({seen.first.held_text})"
        return [first, write(shrink_figure(seen.proof, robot.joint_names, units, title), folder / "shrink.png")]
