"""``dynid gap PARAMETERS LOG...``: where model and measurement disagree, and which effect is missing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.cli.arguments import options_from, options_of
from dynid.cli.judged import show_answer, show_next
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import Answer, ask, can_ask
from dynid.cli.report import renewed
from dynid.cli.simulate import show_comparison
from dynid.errors import Declined, DynidError, ExitStatus, OutputExists, WrongUsage
from dynid.text import shell
from dynid.workflows.gap_options import GapOptions

if TYPE_CHECKING:
    from dynid.estimation.result import Identification
    from dynid.gap.record import GapEffect
    from dynid.sim.comparison import SimulatorGap
    from dynid.workflows.gap_result import Gap


@dynid_command(
    "gap",
    examples=(
        "dynid gap out/arm a.bag a_again.bag b.bag b_again.bag c.bag",
        "dynid gap out/arm new.bag --ask changed        what has changed since it was identified?",
        "dynid gap out/arm a.bag b.bag --apply best     add the named effects",
    ),
)
@click.argument("parameters", type=click.Path(path_type=Path))
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="LOG...")
@options_from(GapOptions)
@click.option(
    "--apply",
    "apply_",
    is_flag=False,
    flag_value="best",
    metavar="NAME[@JOINTS]|best",
    help="Add the named effects (best), or one candidate, without asking.",
)
@click.option("--no-apply", is_flag=True, help="Only report: add nothing and do not ask.")
@click.option(
    "--new-name",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Path of the copy of the robot file with the effects.",
)
@click.option("--plot/--no-plot", default=True, show_default=True, help="Draw the pictures.")
def command(
    common: Common,
    parameters: Path,
    logs: tuple[Path, ...],
    **values: Any,  # noqa: ANN401
) -> ExitStatus:
    """Find which effect the model lacks, add it, and show how much smaller the error becomes."""
    if values["apply_"] and values["no_apply"]:
        raise WrongUsage(
            "--apply and --no-apply cannot be used together", fix="leave one of them out"
        )
    own = {key: values[key] for key in ("apply_", "no_apply", "new_name", "plot")}
    common.terminal.emit_json(
        run_gap(common, parameters, logs, options_of(GapOptions, values), **own)
    )
    return ExitStatus.DONE


def run_gap(
    common: Common,
    parameters: Path,
    logs: tuple[Path, ...],
    options: GapOptions | None = None,
    *,
    apply_: str | None = None,
    no_apply: bool = False,
    new_name: Path | None = None,
    plot: bool = True,
) -> dict[str, Any]:
    """Read, search, report, add what was named, and return the JSON answer.

    Args:
        common: the common options.
        parameters: the result that is asked about.
        logs: recordings.
        options: what is searched.
        apply_: effects that are added without asking; None asks.
        no_apply: add nothing.
        new_name: path of the copy of the robot file.
        plot: whether pictures are drawn.
    """
    options = options or GapOptions()
    stored = dynid.loading.load_run(parameters)
    workflows.gap_options.selection_options(stored.robot, options)
    with common.terminal.progress() as progress:
        base = workflows.results.base_model_of(stored, stored.path.parent, progress)
        progress.stage("read")
        read = [dynid.loading.load_log(path, base.robot, options, identify=False) for path in logs]
        search, asks = workflows.gap, options.question in ("auto", "changed")
        earlier = search.earlier_logs(stored, read, options, progress) if asks else []
        gap = search.find_gap(stored, read, options, earlier=earlier, base=base, progress=progress)
        progress.stage("draw")
        folder = stored.path.parent
        workflows.gap_result.remove_search(folder)
        # Why first: what a simulator does afterwards takes no answer away.
        wrote = [gap.save(folder / "gap.npz")]
        if plot:
            wrote += gap.write_figures(folder / "gap")
    show(common, gap)
    chosen, applied, driven = gap.chosen(apply_ or "best"), None, None
    given = False if no_apply else True if apply_ else None
    if (
        chosen
        and ask(common, "P7", given=given, effect=" and ".join(one.effect for one in chosen))
        is Answer.YES
    ):
        after, added = add(common, gap, chosen, new_name)
        driven, pictures = drive(common, gap, after, folder, plot=plot)
        wrote += [*added, *pictures]
        applied = added[-1]
    common.terminal.wrote(*wrote)
    wrote += renewed(common, stored.path, base)
    if applied is not None:
        show_check(common, gap, applied)
    else:
        show_next(common, gap.judgement)
    return {**gap.facts(), "simulator": driven and driven.facts(), "wrote": wrote}


def drive(
    common: Common, gap: Gap, after: Identification, folder: Path, *, plot: bool
) -> tuple[SimulatorGap | None, list[Path]]:
    """Drive the exported files without and with what was added in a simulator; return what came of it, and files."""
    try:
        with common.terminal.progress() as progress:
            found = workflows.simulator_gap.gap_in_simulator(gap, after, progress=progress)
    except (DynidError, ValueError) as error:
        # Why both: MuJoCo has no error of its own for a model that it refuses.
        common.terminal.fact("simulator", f"not driven: {error}")
        return None, []
    show_comparison(common, found)
    picture = (
        [workflows.simulator_gap.save_figure(found, folder / "gap/simulator.png")] if plot else []
    )
    return found, [found.save(folder / "simulator_gap.npz"), *picture]


def add(
    common: Common, gap: Gap, chosen: tuple[GapEffect, ...], new_name: Path | None
) -> tuple[Identification, list[Path]]:
    """Write the copy of the robot file and the arm identified again with the effects."""
    assert gap.analysis is not None
    beside = workflows.gap_result.robot_file_beside(gap.analysis.problem.base.robot, chosen)
    copy = new_name or (common.out / beside.name if common.out else beside)
    if copy.exists() and not common.force:
        ask_to_overwrite(common, copy)
    path = (common.out or Path("out") / copy.stem) / "parameters.npz"
    after = gap.apply(chosen, robot_file=copy)
    after.save(path)
    return after, [copy, path]


def show_check(common: Common, gap: Gap, path: Path) -> None:
    """Say how the model with the effects is tried on a log that was not used."""
    unseen = next((str(log.source) for log in gap.unseen_logs if log.source), "")
    if unseen:
        command = shell("dynid", "validate", path, unseen, "--cutoff", f"{gap.signals.cutoff:g}")
        common.terminal.next(command, "This log was held out: the errors are those of the table.")
    else:
        common.terminal.next(
            f"{shell('dynid', 'validate', path)} LOG", "LOG is one that was not used here."
        )


def ask_to_overwrite(common: Common, path: Path) -> None:
    """Ask before a robot file is overwritten."""
    if not common.yes and not can_ask(common):
        raise OutputExists(f"{path} exists", fix="use --force, or another name with --new-name")
    if ask(common, "P6", path=path) is not Answer.YES:
        raise Declined(
            f"{path} is left as it was", fix="use --force, or another name with --new-name"
        )


# ---------------------------------------------------------------- printing
def show(common: Common, gap: Gap) -> None:
    """Print the answer, why, and the table of joints; with -v what was asked, tried and left."""
    terminal = common.terminal
    show_answer(common, gap.judgement)
    improvement_table(common, gap)
    terminal.stage("noise", f"{gap.noise_text}; held out: {gap.heldout}")
    if common.verbose:
        show_search(common, gap)


def show_search(common: Common, gap: Gap) -> None:
    """Print what was asked, where the disagreement is, and what was tried."""
    from dynid.model.effects.catalogue import CATALOGUE

    terminal = common.terminal
    terminal.answer()
    terminal.fact("asked", gap.asked)
    terminal.fact("where", gap.where_text)
    terminal.fact("verdict", gap.verdict_text)
    for one in gap.named:
        terminal.fact(
            "named", f"{CATALOGUE[one.effect].title} on {one.where}: {', '.join(one.texts())}"
        )
    for clue in gap.clues:
        terminal.fact("rest", clue)
    if gap.advice:
        terminal.fact("advice", gap.advice)
    if not len(gap.simulation):
        terminal.fact(
            "simulated",
            "no: too little motion is held out, or a link is too light to be simulated from its torques",
        )
    if gap.named or gap.closest:
        rows = [effect_row(one) for one in (*gap.named, *gap.closest)]
        terminal.table(
            ["candidate", "joints", "held-out error", "chance", "result"], rows, numbers=False
        )
    for one in gap.named:
        terminal.fact("shape", f"{one.effect} on {one.where}: {CATALOGUE[one.effect].signature}")
    if gap.cannot_judge:
        hidden = ", ".join(
            f"{name} ({','.join(str(j + 1) for j in joints) or 'arm'})"
            for name, joints in gap.cannot_judge.items()
        )
        terminal.fact("not shown", f"these logs cannot show: {hidden}")


def effect_row(one: GapEffect) -> list[str]:
    """Return one line of the table of candidates."""
    before, after = one.rms_before, one.rms_after
    change = f"{before:.3g} {one.unit}"
    if before and after is not None:
        change = f"{before:.3g} -> {after:.3g} {one.unit}  {100 * (after / before - 1):+.0f} %"
    chance = "<0.1 %" if one.p_value < 1e-3 else f"{100 * one.p_value:.1f} %"
    return [one.effect, one.where, change, chance, one.message]


def improvement_table(common: Common, gap: Gap) -> None:
    """Print the gap joint by joint; where something is named, without and with it."""
    held_out, rows, both = gap.improvement, [], bool(gap.named)

    def change(before: float, after: float, form: str) -> str:
        return f"{before:{form}} -> {after:{form}}" if both else f"{before:{form}}"

    for j, (name, unit) in enumerate(zip(gap.joint_names, gap.torque_units, strict=True)):
        row = [
            name,
            f"{change(held_out.before[j], held_out.after[j], '.3g')} {unit}",
            f"{held_out.floor[j]:.3g}",
        ]
        if len(gap.simulation):
            before, after = 1e3 * gap.simulation[:, j]
            row.append(f"{change(before, after, '.1f')} {'mm' if unit == 'N' else 'mrad'}")
        rows.append(row)
    heads = ["joint", "error on unseen rows", "noise"]
    common.terminal.table(
        [*heads, "error of simulated motion"] if len(gap.simulation) else heads, rows
    )
