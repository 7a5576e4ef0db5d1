"""``dynid gap PARAMETERS LOG...``: where model and measurement disagree, and which effect is missing."""

from __future__ import annotations

import re
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.dataclass_options import options_from
from dynid.cli.dataclass_options import options_of as made_from
from dynid.cli.gapanswer import answer_of, show
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import Answer, ask
from dynid.errors import ExitStatus, WrongUsage
from dynid.options import share
from dynid.workflows.logs import LogOptions

if TYPE_CHECKING:
    from dynid.estimation.conditioned_log import ConditionedLog
    from dynid.estimation.result import Identification
    from dynid.gap.analysis import GapAnalysis
    from dynid.gap.refit import FittedEffect
    from dynid.gap.stepwise_selection import SelectionOptions
    from dynid.model.base_model import BaseModel
    from dynid.robot import Robot

#: Cut-off of the search [Hz]: below, what happens at reversals is gone; above, noise of the positions comes in.
CUTOFF = 10.0
#: What the options are when a command of ours runs the search.
DEFAULTS: dict[str, Any] = {
    "mode": "refit",
    "effects": "all",
    "joints": None,
    "false_alarm": "1%",
    "max_effects": 3,
    "apply_": None,
    "no_apply": False,
    "new_name": None,
    "plot": True,
}


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
@options_from(LogOptions)
def command(common: Common, parameters: Path | None, logs: tuple[Path, ...], **options: Any) -> ExitStatus:  # noqa: ANN401
    """Find what the model lacks, name it with evidence, add it, and show that the gap shrinks."""
    if options["self_test"]:
        from dynid.cli.selftest import run_self_test

        return run_self_test(common)
    if parameters is None or not logs:
        raise WrongUsage("gap needs PARAMETERS and at least one LOG", fix="dynid gap out/arm/parameters.npz log.bag")
    if options["apply_"] and options["no_apply"]:
        raise WrongUsage("--apply and --no-apply exclude each other")
    answer = run_gap(common, parameters, logs, **options)
    common.terminal.emit_json(answer)
    for path in answer["wrote"]:
        common.terminal.wrote(path)
    return ExitStatus.DONE


def run_gap(common: Common, parameters: Path, logs: tuple[Path, ...], **given: Any) -> dict[str, Any]:  # noqa: ANN401
    """Read, search, report, add what was named, and return the JSON answer.

    Args:
        common: the common options.
        parameters: the result that is asked about.
        logs: recordings.
        given: options, as on the command line.
    """
    from dynid.estimation import result
    from dynid.gap.analysis import analyse_gap
    from dynid.gap.problem import kept_model
    from dynid.reports.gap_record import save
    from dynid.workflows.validate import base_model_of

    options = DEFAULTS | given
    stored = result.load(parameters)
    wanted = options_of(stored.robot, options)
    with common.terminal.progress() as progress:
        base = base_model_of(stored, stored.path.parent, progress)
    sources = conditioned(common, base, logs, options, stored)
    kept = kept_model(stored) if options["mode"] == "frozen" else None
    earlier = earlier_logs(common, base, stored, logs, options) if kept else []
    with common.terminal.progress() as progress:
        progress.stage("search", "")
        seen = analyse_gap(sources, base, kept, wanted, progress, earlier=earlier)
    wrote = write_pictures(common, parameters.parent / "gap", base.robot, seen) if options["plot"] else []
    show(common, base.robot, seen)
    chosen = chosen_effects(seen, options["apply_"], base.robot)
    if chosen and agreed(common, chosen, options):
        wrote += add(common, base, sources, seen, chosen, stored, logs, options)
    stored_gap = parameters.parent / "gap.npz"
    answer = answer_of(base.robot, seen, options["mode"], [*wrote, stored_gap])
    save(stored_gap, answer, logs, seen.joints, seen.improvement)
    return answer


def options_of(robot: Robot, options: dict[str, Any]) -> SelectionOptions:
    """Return what is searched, every name checked."""
    from dynid.files.yamlfile import closest
    from dynid.gap.stepwise_selection import SelectionOptions
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
    return SelectionOptions(effects, joints, share(options["false_alarm"], "--false-alarm"), options["max_effects"])


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
    common: Common, base: BaseModel, logs: tuple[Path, ...], options: dict[str, Any], stored: Identification
) -> list[ConditionedLog]:
    """Read the logs under one filter that keeps what happens at reversals."""
    from dynid.workflows.logs import condition_logs, load_log

    how = made_from(LogOptions, options)
    if how.cutoff is None:
        how = replace(how, cutoff=max(CUTOFF, stored.cutoff))
    if how.delay is None:
        # Why not in a refit: there a delay is one of the effects that are looked for.
        how = replace(how, delay=stored.delay if options["mode"] == "frozen" else 0.0)
    with common.terminal.progress() as progress:
        progress.stage("read")
        read = [load_log(path, base.robot, how, identify=False) for path in logs]
        return condition_logs(read, base.model, how, progress)


def earlier_logs(
    common: Common, base: BaseModel, stored: Identification, logs: tuple[Path, ...], options: dict[str, Any]
) -> list[ConditionedLog]:
    """Return the logs that a kept model was identified from, where they are still what they were.

    Why: what the model left unexplained in them it leaves unexplained in new ones, and that is no change. A new log
    that is one of them cannot be compared with itself.
    """
    from dynid.files.artifact import sha256

    new = {sha256(path) for path in logs}
    before = [(Path(name), sha) for name, sha in zip(stored.header.get("logs", []), stored.log_sha256, strict=False)]
    there = tuple(path for path, sha in before if sha not in new and path.is_file() and sha256(path) == sha)
    if not all(path.is_file() for path, _ in before):
        text = "not all at hand: what the model lacked then may be taken for a change"
        common.terminal.stage("earlier", f"logs that it was identified from {text}")
    if new & {sha for _, sha in before}:
        common.terminal.stage(
            "earlier", "the model was identified from a log given here: nothing has changed in that one"
        )
    return conditioned(common, base, there, options, stored) if there else []


# ---------------------------------------------------------------- adding
def chosen_effects(seen: GapAnalysis, apply_: str | None, robot: Robot) -> list[FittedEffect]:
    """Return the effects to add: those named, or the one that --apply asks for."""
    if apply_ in (None, "best"):
        return list(seen.verdict.named)
    name, _, where = str(apply_).partition("@")
    joints = joints_of(robot, where, "--apply")
    found = [f for f in seen.effects if f.name == name and (not joints or f.joints[:1] in [(j,) for j in joints])]
    if not found:
        there = ", ".join(f"{f.name}@{','.join(str(j + 1) for j in f.joints[:1])}" for f in seen.effects) or "nothing"
        raise WrongUsage(f"--apply {apply_}: this was not found", why=f"found: {there}")
    return found


def agreed(common: Common, chosen: list[FittedEffect], options: dict[str, Any]) -> bool:
    """Return whether the effects are to be added."""
    given = False if options["no_apply"] else True if options["apply_"] else None
    names = " and ".join(f.name for f in chosen)
    return ask(common, "P7", given=given, effect=names) is Answer.YES


def add(
    common: Common,
    base: BaseModel,
    sources: list[ConditionedLog],
    seen: GapAnalysis,
    chosen: list[FittedEffect],
    stored: Identification,
    logs: tuple[Path, ...],
    options: dict[str, Any],
) -> list[Path]:
    """Write the copy of the robot file and the arm identified again with the effects."""
    from dynid.files.artifact import sha256
    from dynid.gap.analysis import on_one_clock
    from dynid.gap.apply import identify_again, new_name, specs_of, write_robot

    robot = base.robot
    specs = specs_of(chosen, robot)
    name = new_name(robot, specs)
    copy = options["new_name"] or beside(robot) / f"{name}.yaml"
    if copy.exists() and not common.force:
        ask_to_overwrite(common, copy)
    write_robot(robot, specs, copy)
    _, found = identify_again(on_one_clock(sources), seen.problem, base, specs)
    folder = common.out or Path("out") / copy.stem
    inputs = {f"log {k + 1}": sha256(log) for k, log in enumerate(logs)}
    header = {
        "robot": found.robot.name,
        "key": found.robot.model_key,
        "logs": [str(log) for log in logs],
        "log_findings": [],
        "inputs": inputs,
        "effects": [asdict(s) for s in specs],
        "made_from": str(stored.path),
    }
    again = replace(found.robot, path=copy)
    replace(found, robot=again, log_sha256=tuple(inputs.values()), header=header).save(folder / "parameters.npz")
    common.terminal.next(f"dynid validate {folder / 'parameters.npz'} LOG      (a log that was not used here)")
    return [copy, folder / "parameters.npz"]


def beside(robot: Robot) -> Path:
    """Return the folder of a robot file of one's own; ./robots or the current one for a robot that comes with dynid."""
    import os

    from dynid.files.robotfile import packaged

    shipped = packaged("robots").resolve()
    if robot.path is None or shipped in robot.path.resolve().parents or not os.access(robot.path.parent, os.W_OK):
        return Path("robots") if Path("robots").is_dir() else Path()
    return robot.path.parent


def ask_to_overwrite(common: Common, path: Path) -> None:
    """Ask before a robot file is overwritten."""
    from dynid.cli.prompt import can_ask
    from dynid.errors import Declined, OutputExists

    if not common.yes and not can_ask(common):
        raise OutputExists(f"{path} exists", fix="use --force, or another name with --new-name")
    if ask(common, "P6", path=path) is not Answer.YES:
        raise Declined(f"{path} is left as it was", fix="use --force, or another name with --new-name")


def write_pictures(common: Common, folder: Path, robot: Robot, seen: GapAnalysis) -> list[Path]:
    """Draw where the gap is and how far it shrank."""
    from dynid.reports.gap_figures import improvement_figure, where_figure, write

    units = [joint.torque_unit for joint in robot.joints]
    with common.terminal.progress() as progress:
        progress.stage("draw", "")
        first = write(where_figure(seen.joints, robot.joint_names, robot.name), folder / "where.png")
        title = f"{robot.name}: the gap on unseen data ({seen.problem.held_text})"
        return [
            first,
            write(improvement_figure(seen.improvement, robot.joint_names, units, title), folder / "shrink.png"),
        ]
