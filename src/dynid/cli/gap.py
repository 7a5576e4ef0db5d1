"""``dynid gap PARAMETERS LOG...``: where model and measurement disagree, and which effect is missing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

import dynid
from dynid import workflows
from dynid.answer import Answer, Part
from dynid.cli.options import Output, dynid_command
from dynid.cli.prompt import ask, may_write
from dynid.cli.session import Session
from dynid.errors import DynidError, WrongUsage
from dynid.judgement.rules import Step
from dynid.options import option
from dynid.progress import stage
from dynid.runs import RunFolder
from dynid.sim.tuning import DRIVEN_S
from dynid.text import shell
from dynid.workflows.options import GapOptions

if TYPE_CHECKING:
    from dynid.estimation.result import Identification
    from dynid.judgement.gap import GapEffect
    from dynid.workflows.gap import Gap


@dynid_command("gap")
@click.option(
    "--apply",
    is_flag=False,
    flag_value="best",
    metavar="NAME[@JOINTS]|best",
    help="Add the named effects (best), or one candidate, without asking.",
)
def command(
    session: Session,
    *,
    parameters: Identification,
    logs: tuple[Path, ...],
    options: GapOptions,
    apply: str | None,
    no_apply: bool = option(False, "Only report: add nothing and do not ask."),
    new_name: Output | None = option(None, "Path of the copy of the robot file with the effects."),
    plot: bool = option(True, "Draw the pictures."),
) -> Answer:
    """Find which effect the model lacks, add it, and show how much smaller the error becomes.

    Examples:
      dynid gap out/arm a.bag a_again.bag b.bag b_again.bag c.bag
      dynid gap out/arm new.bag --ask changed        what has changed since it was identified?
      dynid gap out/arm a.bag b.bag --apply best     add the named effects
    """
    if apply and no_apply:
        raise WrongUsage("--apply and --no-apply exclude each other", fix="leave one of them out")
    run = RunFolder.of(parameters.path)
    stage("read")
    gap = dynid.find_gap(parameters, logs, options)
    stage("draw")
    run.remove_search()
    # Why first: what a simulator does afterwards takes no answer away.
    wrote = [gap.save(run.search), *(gap.write_figures(run.path / "gap") if plot else [])]
    answer, chosen = gap.answer(), gap.chosen(apply or "best")
    session.show(replace(answer, next=()))
    effect = " and ".join(one.effect for one in chosen)
    given = bool(apply) if apply or no_apply else None
    done = Answer({"simulator": None}, next=answer.next)
    if chosen and ask(session, "P7", given=given, effect=effect) == "yes":
        done = added(session, gap, chosen, new_name, run, plot=plot)
    wrote += [*done.wrote, *workflows.report.renewed(parameters.path)]
    return replace(done, facts={**answer.facts, **done.facts}, wrote=wrote)


def added(
    session: Session,
    gap: Gap,
    chosen: tuple[GapEffect, ...],
    new_name: Path | None,
    run: RunFolder,
    *,
    plot: bool,
) -> Answer:
    """Identify the arm with effects, and drive the exported files without and with them in a simulator."""
    assert gap.searched is not None
    usual = workflows.gap.robot_file_beside(gap.searched.robot, chosen)
    copy = new_name or (session.out / usual.name if session.out else usual)
    may_write(session, copy, other="another name with --new-name")
    after = gap.apply(chosen, robot_file=copy)
    folder, simulated = session.out or Path("out") / copy.stem, None
    *others, path = workflows.identify.save_result(folder, after)
    wrote, parts = [copy, path, *others, *dynid.report(path).save(folder)], list[Part]()
    try:
        # Why not any log: one that was held out proves more.
        log = (*gap.unseen_logs, *reversed(gap.recordings))[0]
        driven = dynid.compare_in_simulator((gap.searched, after), log, seconds=DRIVEN_S)
    except (DynidError, ValueError) as error:
        # Why both: MuJoCo has no error of its own for a model that it refuses.
        parts.append(("simulator", f"not driven: {error}"))
    else:
        parts += [driven.sentence(), driven.table()]
        simulated = driven.facts()
        wrote.append(driven.save(run.simulated))
        if plot:
            picture = run.path / "gap/simulator.png"
            wrote.append(workflows.simulate.save_figure(driven, picture))
    unseen = [str(log.source) for log in gap.unseen_logs if log.source]
    why = "LOG is one that was not used here."
    if unseen:
        why = "This log was held out: the errors are those of the table."
    words = "validate", path, *(unseen[:1] or ["LOG"]), "--cutoff", f"{gap.signals.cutoff:g}"
    step = Step(why, shell("dynid", *words))
    return Answer({"simulator": simulated}, parts=parts, wrote=wrote, next=[step])
