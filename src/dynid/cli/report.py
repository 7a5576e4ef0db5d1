"""``dynid report RUN``: report.html from a results folder, in one file that needs no network."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

import dynid
from dynid import workflows
from dynid.cli.options import PATH, Answered, dynid_command
from dynid.cli.session import Session
from dynid.runs import RunFolder

if TYPE_CHECKING:
    from dynid.model.base_model import BaseModel
    from dynid.workflows.report import Report


@dynid_command(
    "report",
    examples=(
        "dynid report out/kuka_lwr4plus               writes report.html and summary.md there",
        "dynid report out/kuka_lwr4plus --open        and shows it in the browser",
    ),
)
@click.argument("run", type=PATH)
@click.option("--open/--no-open", default=False, help="Open it in the browser.")
def command(session: Session, run: Path, open: bool) -> Answered:
    """Make the report of a result again."""
    made, wrote = write_report(session, run, session.out)
    first, *rest = made.verdict
    session.headline(first)
    session.sentences(*rest)
    session.steps(*made.judgement.steps)
    if open:
        click.launch(str(wrote[0].resolve()))
    return {**made.facts(), "wrote": wrote}


def renewed(session: Session, run: Path, base: BaseModel) -> list[Path]:
    """Make the report beside a result again where there is one, and return what was written.

    Why: a command that writes beside a result makes the page there say less than is known, or something else.
    """
    there = RunFolder.of(run)
    return write_report(session, run, there.path, base)[1] if there.report.is_file() else []


def write_report(
    session: Session, run: Path, folder: Path | None, base: BaseModel | None = None
) -> tuple[Report, list[Path]]:
    """Write report.html and summary.md of a result, beside it where there is no other folder."""
    stored = dynid.loading.load_run(run)
    if base is not None:
        stored = replace(stored, rigid=base.model.rigid)
    made = workflows.report.report(stored)
    wrote = made.save(folder or stored.path.parent)
    session.wrote(*wrote)
    return made, wrote
