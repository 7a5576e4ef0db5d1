"""``dynid export RUN --format F``: the identified model for simulators and controllers, loaded back and compared."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.cli.arguments import options_from, options_of
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import write_once
from dynid.errors import ExitStatus
from dynid.workflows.options import SUFFIXES, ExportOptions

if TYPE_CHECKING:
    from dynid.workflows.export import ExportedModel


@dynid_command(
    "export",
    examples=(
        "dynid export out/kuka_lwr4plus --format urdf",
        "dynid export out/kuka_lwr4plus --format urdf --urdf lwr.urdf       your own file, new inertial blocks",
        "dynid export out/kuka_lwr4plus --format c --format python",
        "dynid export out/kuka_lwr4plus --format mjcf --draws 100       arms for randomisation",
    ),
)
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--format",
    "formats",
    type=click.Choice([*SUFFIXES, "all"]),
    multiple=True,
    required=True,
    help="Format to write; may be given several times.",
)
@options_from(ExportOptions)
def command(common: Common, run: Path, formats: tuple[str, ...], **values: Any) -> ExitStatus:  # noqa: ANN401
    """Write the identified model as URDF, MJCF, YAML, C, Python or MATLAB."""
    wanted = [name for name in SUFFIXES if name in formats or "all" in formats]
    stored = dynid.loading.load_run(run)
    with common.terminal.progress() as progress:
        made = workflows.export.export(
            stored,
            common.out or stored.path.parent,
            options_of(ExportOptions, values),
            formats=wanted,
            seed=common.seed,
            write=partial(write_once, common),
            progress=progress,
        )
    show(common, made)
    if made.drawn:
        common.terminal.wrote(made.drawn[-1].parent)
    common.terminal.emit_json(made.facts())
    return ExitStatus.DONE if made.agrees or made.findings else ExitStatus.LIMIT_NOT_MET


def show(common: Common, made: ExportedModel) -> None:
    """Print whether the files have the torques of the model, and what the formats leave out."""
    common.terminal.answer(made.sentence(), style="bold", indent=2)
    common.terminal.show(made.table(), numbers=False)
    for file in made.files:
        for phrase in file.elements:
            common.terminal.sentence(f"{file.format} has {phrase}")
        for phrase in file.leaves_out:
            if phrase.removeprefix("effect ") not in file.beside:
                common.terminal.sentence(f"{file.format} has no place for {phrase}")
        if file.beside:
            common.terminal.sentence(f"effects.py adds to {file.format}: {', '.join(file.beside)}")
