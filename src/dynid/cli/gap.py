"""``dynid gap PARAMETERS LOG...``: where model and measurement disagree, and which effect is missing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.cli.options import FILE, PATH, Answered, dynid_command, options_from
from dynid.cli.prompt import Answer, ask, may_write
from dynid.cli.report import renewed
from dynid.cli.session import Session
from dynid.errors import DynidError, WrongUsage
from dynid.judgement.rules import Step
from dynid.progress import stage
from dynid.runs import RunFolder
from dynid.table import Table, cell_text
from dynid.text import shell
from dynid.workflows.options import GapOptions

if TYPE_CHECKING:
    from dynid.gap.record import GapEffect
    from dynid.workflows.gap import Gap


@dynid_command(
    "gap",
    examples=(
        "dynid gap out/arm a.bag a_again.bag b.bag b_again.bag c.bag",
        "dynid gap out/arm new.bag --ask changed        what has changed since it was identified?",
        "dynid gap out/arm a.bag b.bag --apply best     add the named effects",
    ),
)
@click.argument("parameters", type=PATH)
@click.argument("logs", nargs=-1, required=True, type=PATH, metavar="LOG...")
@options_from(GapOptions)
@click.option(
    "--apply",
    is_flag=False,
    flag_value="best",
    metavar="NAME[@JOINTS]|best",
    help="Add the named effects (best), or one candidate, without asking.",
)
@click.option("--no-apply", is_flag=True, help="Only report: add nothing and do not ask.")
@click.option(
    "--new-name",
    type=FILE,
    metavar="FILE",
    help="Path of the copy of the robot file with the effects.",
)
@click.option("--plot/--no-plot", default=True, show_default=True, help="Draw the pictures.")
def command(
    session: Session,
    parameters: Path,
    logs: tuple[Path, ...],
    options: GapOptions,
    apply: str | None,
    no_apply: bool,
    new_name: Path | None,
    plot: bool,
) -> Answered:
    """Find which effect the model lacks, add it, and show how much smaller the error becomes."""
    if apply and no_apply:
        what = "--apply and --no-apply cannot be used together"
        raise WrongUsage(what, fix="leave one of them out")
    stored = dynid.loading.load_run(parameters)
    workflows.gap.selection_options(stored.robot, options)
    run, search = RunFolder.of(stored.path), workflows.gap
    base = workflows.model.base_model_of(stored, run.path)
    stage("read")
    read = [dynid.loading.load_log(path, base.robot, options, identify=False) for path in logs]
    asks = options.question in ("auto", "changed")
    earlier = search.earlier_logs(stored, read, options) if asks else []
    gap = search.find_gap(stored, read, options, earlier=earlier, base=base)
    stage("draw")
    run.remove_search()
    # Why first: what a simulator does afterwards takes no answer away.
    pictures = run.path / "gap"
    wrote = [gap.save(run.search), *(gap.write_figures(pictures) if plot else [])]
    show(session, gap)
    chosen, simulator, steps = gap.chosen(apply or "best"), None, gap.judgement.steps
    effect = " and ".join(one.effect for one in chosen)
    given = bool(apply) if apply or no_apply else None
    if chosen and ask(session, "P7", given=given, effect=effect) is Answer.YES:
        added, simulator = add(session, gap, chosen, new_name, run, plot=plot)
        wrote += added
        steps = (proof(gap, added[1]),)
    session.wrote(*wrote)
    wrote += renewed(session, stored.path, base)
    session.steps(*steps)
    return {**gap.facts(), "simulator": simulator, "wrote": wrote}


def add(
    session: Session,
    gap: Gap,
    chosen: tuple[GapEffect, ...],
    new_name: Path | None,
    run: RunFolder,
    *,
    plot: bool,
) -> tuple[list[Path], dict[str, Any] | None]:
    """Identify the arm with effects, and drive the exported files without and with them in a simulator.

    Returns:
        The copy of the robot file, the result, further files, and what the simulator gave.
    """
    assert gap.analysis is not None
    usual = workflows.gap.robot_file_beside(gap.analysis.problem.base.robot, chosen)
    copy = new_name or (session.out / usual.name if session.out else usual)
    may_write(session, copy, other="another name with --new-name")
    after = gap.apply(chosen, robot_file=copy)
    folder_after = session.out or Path("out") / copy.stem
    *others, path = workflows.identify.save_result(folder_after, after)
    wrote = [copy, path, *others, *workflows.report.report(path).save(folder_after)]
    work = workflows.simulator_gap
    try:
        driven = work.gap_in_simulator(gap, after)
    except (DynidError, ValueError) as error:
        # Why both: MuJoCo has no error of its own for a model that it refuses.
        session.fact("simulator", f"not driven: {error}")
        return wrote, None
    session.sentences(driven.sentence())
    session.table(in_one_cell(driven.table()))
    wrote.append(driven.save(run.simulated))
    if plot:
        wrote.append(work.save_figure(driven, run.path / "gap/simulator.png"))
    return wrote, driven.facts()


def proof(gap: Gap, path: Path) -> Step:
    """Return how the model with effects is tried on a log that was not used."""
    unseen = [str(log.source) for log in gap.unseen_logs if log.source]
    if not unseen:
        command = f"{shell('dynid', 'validate', path)} LOG"
        return Step("LOG is one that was not used here.", command)
    command = shell("dynid", "validate", path, unseen[0], "--cutoff", f"{gap.signals.cutoff:g}")
    return Step("This log was held out: the errors are those of the table.", command)


# ---------------------------------------------------------------- printing
#: What changes in the tables of joints: heading, and the column of its unit.
CHANGES = {
    "rms": ("held-out error", "unit"),
    "simulated": ("error of simulated motion", "in"),
    "position": ("position error", "in"),
    "torque": ("torque error", "unit"),
}


def in_one_cell(rows: Table) -> list[dict[str, str]]:
    """Return what was before and is after in one cell, for which a terminal of 80 columns has room."""
    compact = []
    for row in rows:
        cells = {"joint": row["joint"]}
        for what, (head, unit) in CHANGES.items():
            if f"{what} before" in row:
                before, after = (cell_text(row[f"{what} {when}"]) for when in ("before", "after"))
                change = before if before == after else f"{before} -> {after}"
                cells[head] = f"{change} {row[unit]}"
        compact.append(cells | {"noise": row["noise"]} if "noise" in row else cells)
    return compact


def show(session: Session, gap: Gap) -> None:
    """Print the answer, why, and the gap joint by joint; with -v what was asked, tried and left."""
    session.judgement(gap.judgement)
    session.table(in_one_cell(gap.joint_table()))
    session.stage("noise", f"{gap.noise_text}; held out: {gap.heldout}")
    if not session.verbose:
        return
    session.answer()
    session.sentences(*filter(None, gap.summary().splitlines()))
    for clue in gap.clues:
        session.fact("rest", clue)
    if not len(gap.simulation):
        why = (
            "too little motion is held out, or a link is too light to be simulated from its torques"
        )
        session.fact("simulated", f"no: {why}")
    hidden = [
        f"{name} ({','.join(str(j + 1) for j in joints) or 'arm'})"
        for name, joints in gap.cannot_judge.items()
    ]
    if hidden:
        session.fact("not shown", f"these logs cannot show: {', '.join(hidden)}")
    session.table(gap.table())
