"""``dynid export RUN --format F``: the identified model for simulators and controllers, loaded back and compared."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import PATH, dynid_command, options_from
from dynid.cli.prompt import write_once
from dynid.cli.session import Session
from dynid.workflows.options import FORMATS, ExportOptions


@dynid_command(
    "export",
    examples=(
        "dynid export out/kuka_lwr4plus --format urdf",
        "dynid export out/kuka_lwr4plus --format urdf --urdf lwr.urdf       your own file, new inertial blocks",
        "dynid export out/kuka_lwr4plus --format c --format python",
        "dynid export out/kuka_lwr4plus --format mjcf --draws 100       arms for randomisation",
    ),
)
@click.argument("run", type=PATH)
@click.option(
    "--format",
    type=click.Choice([*FORMATS, "all"]),
    multiple=True,
    required=True,
    help="Format to write; may be given several times.",
)
@options_from(ExportOptions)
def command(session: Session, run: Path, format: tuple[str, ...], options: ExportOptions) -> Answer:
    """Write the identified model as URDF, MJCF, YAML, C, Python or MATLAB."""
    stored = dynid.loading.load_run(run)
    made = workflows.export.export(
        stored,
        session.out or stored.path.parent,
        options,
        formats=[name for name in FORMATS if name in format or "all" in format],
        seed=session.seed,
        write=partial(write_once, session),
    )
    return made.answer()
