"""``dynid report RUN``: report.html from a results folder, in one file that needs no network."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from dynid.cli.options import Common, dynid_command

if TYPE_CHECKING:
    from dynid.reports.evidence import Evidence


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
    from dynid.reports.sections.verdict import lights, sentences
    from dynid.workflows.results import parameters_of

    parameters = parameters_of(run)
    evidence, wrote = write_report(common, parameters)
    for sentence in sentences(evidence):
        common.terminal.answer(sentence)
    common.terminal.emit_json(
        {
            "schema": "dynid/report/1",
            "robot": evidence.robot.name,
            "verdict": sentences(evidence),
            "lights": {light.name: light.state for light in lights(evidence)},
            "wrote": wrote,
        }
    )
    if show:
        click.launch(str(wrote[0].resolve()))


def write_report(common: Common, parameters: Path) -> tuple[Evidence, list[Path]]:
    """Write report.html and summary.md of a result, beside it or where --out says."""
    from dynid.files.artifact import write_text
    from dynid.reports.evidence import gather
    from dynid.reports.page import page, summary

    with common.terminal.progress() as progress:
        progress.stage("report", "")
        evidence = gather(parameters)
        texts = {"report.html": page(evidence), "summary.md": summary(evidence)}
    folder = common.out or parameters.parent
    for name, text in texts.items():
        write_text(folder / name, text)
        common.terminal.wrote(folder / name)
    return evidence, [folder / name for name in texts]
