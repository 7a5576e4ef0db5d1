"""``dynid report RUN``: report.html from a results folder, in one file that needs no network."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import PATH, dynid_command
from dynid.cli.session import Session


@dynid_command(
    "report",
    examples=(
        "dynid report out/kuka_lwr4plus               writes report.html and summary.md there",
        "dynid report out/kuka_lwr4plus --open        and shows it in the browser",
    ),
)
@click.argument("run", type=PATH)
@click.option("--open/--no-open", default=False, help="Open it in the browser.")
def command(session: Session, run: Path, open: bool) -> Answer:
    """Make the report of a result again."""
    stored = dynid.loading.load_run(run)
    made = workflows.report.report(stored)
    wrote = made.save(session.out or stored.path.parent)
    if open:
        click.launch(str(wrote[0].resolve()))
    return replace(made.answer(), wrote=wrote)
