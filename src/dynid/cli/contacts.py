"""``dynid contacts PARAMETERS LOG``: when and where something touched the arm."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.arguments import options_from, options_of
from dynid.cli.options import Common, dynid_command
from dynid.text import shell
from dynid.workflows.contacts import ContactOptions

if TYPE_CHECKING:
    from dynid.workflows.contacts import FoundContacts


@dynid_command(
    "contacts",
    examples=(
        "dynid contacts out/kuka_lwr4plus day3.bag",
        "dynid contacts out/kuka_lwr4plus day3.bag --false-alarms 10/h     a lower threshold",
        "dynid contacts out/kuka_lwr4plus day3.bag --json | jq .contacts",
    ),
)
@click.argument("parameters", type=click.Path(path_type=Path))
@click.argument("log", type=click.Path(path_type=Path))
@options_from(ContactOptions)
@click.option(
    "--plot/--no-plot", default=True, show_default=True, help="Draw the torque from outside."
)
def command(common: Common, parameters: Path, log: Path, plot: bool, **values: Any) -> None:  # noqa: ANN401
    """Find contacts on a log, with a threshold for a stated rate of false alarms."""
    from dynid.workflows.contacts import contacts
    from dynid.workflows.results import load_run

    stored = load_run(parameters)
    with common.terminal.progress() as progress:
        found = contacts(stored, log, options_of(ContactOptions, values), progress=progress)
    common.terminal.answer(found.sentence(), style="bold", indent=2)
    if found.external.contacts:
        common.terminal.show(found.table())
    picture = (common.out or stored.path.parent) / "contacts" / f"{Path(found.log).stem}.png"
    wrote = draw(common, found, picture) if plot else []
    common.terminal.wrote(*wrote)
    common.terminal.emit_json({**found.facts(), "wrote": wrote})
    if found.external.changed:
        common.terminal.next(shell("dynid", "gap", parameters, log), "Ask what has changed.")


def draw(common: Common, found: FoundContacts, picture: Path) -> list[Path]:
    """Write the picture, unless it is there already; ask before another one is overwritten."""
    from dynid.cli.prompt import may_write
    from dynid.npz import written_whole
    from dynid.scratch import scratch_folder
    from dynid.workflows.contacts import save_figure

    with scratch_folder() as folder:
        content = save_figure(found, Path(folder) / "contacts.png").read_bytes()
    if picture.is_file() and picture.read_bytes() == content and not common.force:
        common.terminal.stage("reused", f"{picture}       (the same bytes)")
        return []
    may_write(common, picture, {})
    with written_whole(picture) as stream:
        stream.write(content)
    return [picture]
