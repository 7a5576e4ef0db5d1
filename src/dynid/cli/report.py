"""``dynid report RUN``: report.html from a results folder, in one file that needs no network."""

from __future__ import annotations

from pathlib import Path

import click

from dynid.cli.options import Common, dynid_command


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
    from dynid.cli.export import parameters_of
    from dynid.files.artifact import write_text
    from dynid.report.evidence import gather
    from dynid.report.page import page, summary
    from dynid.report.sections.verdict import lights, sentences

    parameters = parameters_of(run)
    with common.terminal.progress() as progress:
        progress.stage("report", "")
        evidence = gather(parameters)
        texts = {"report.html": page(evidence), "summary.md": summary(evidence)}
    folder = common.out or parameters.parent
    for name, text in texts.items():
        write_text(folder / name, text)
        common.terminal.wrote(folder / name)
    for sentence in sentences(evidence):
        common.terminal.answer(sentence)
    common.terminal.emit_json(
        {
            "schema": "dynid/report/1",
            "robot": evidence.robot.name,
            "verdict": sentences(evidence),
            "lights": {light.name: light.state for light in lights(evidence)},
            "wrote": [folder / name for name in texts],
        }
    )
    if show:
        click.launch(str((folder / "report.html").resolve()))
