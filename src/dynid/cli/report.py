"""``dynid report RUN``: report.html from a results folder, in one file that needs no network."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

import dynid
from dynid import workflows
from dynid.cli.judged import show_next
from dynid.cli.options import Common, dynid_command

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
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--open/--no-open", "show", default=False, help="Open it in the browser.")
def command(common: Common, run: Path, show: bool) -> None:
    """Make the report of a result again."""
    made, wrote = write_report(common, run)
    first, *rest = made.verdict
    common.terminal.answer(first, style="bold", indent=2)
    for sentence in rest:
        common.terminal.sentence(sentence)
    show_next(common, made.judgement)
    common.terminal.emit_json({**made.facts(), "wrote": wrote})
    if show:
        click.launch(str(wrote[0].resolve()))


def renewed(common: Common, run: Path, base: BaseModel) -> list[Path]:
    """Make the report beside a result again where there is one, and return what was written.

    Why: a command that writes beside a result makes the page there say less than is known, or something else.

    Args:
        common: the common options.
        run: the result.
        base: its base model.
    """
    if not (run.parent / "report.html").is_file():
        return []
    return write_report(replace(common, out=run.parent), run, base)[1]


def write_report(
    common: Common, run: Path, base: BaseModel | None = None
) -> tuple[Report, list[Path]]:
    """Write report.html and summary.md of a result, beside it or where --out says.

    Args:
        common: the common options.
        run: the result, or its folder.
        base: its base model, where it is there already.
    """
    stored = dynid.loading.load_run(run)
    if base is not None:
        stored = replace(stored, rigid=base.model.rigid)
    with common.terminal.progress() as progress:
        made = workflows.report.report(stored, progress=progress)
    wrote = made.save(common.out or stored.path.parent)
    common.terminal.wrote(*wrote)
    return made, wrote
