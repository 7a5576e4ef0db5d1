"""``dynid fleet RESULT...``: which arms of a fleet have changed, and which differ from others of their model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from dynid.cli.arguments import options_from, options_of
from dynid.cli.options import Common, dynid_command
from dynid.errors import ExitStatus
from dynid.workflows.fleet import FleetOptions

#: Rows that are shown without -v.
SHOWN = 20


@dynid_command(
    "fleet",
    examples=(
        "dynid fleet out/*/*                         folders ARM/DAY or DAY/ARM, such as out/2026-03-01/arm12",
        "dynid fleet runs.csv                        a list with the columns result, arm, time",
        "dynid fleet out/*/* --fail-if-changed       for a job of every night",
    ),
)
@click.argument(
    "results", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RESULT..."
)
@options_from(FleetOptions)
def command(common: Common, results: tuple[Path, ...], **values: Any) -> ExitStatus:  # noqa: ANN401
    """Find which arms have changed over time, and which differ from others of their model."""
    from dynid.workflows.fleet import fleet

    options = options_of(FleetOptions, values)
    with common.terminal.progress() as progress:
        found = fleet(results, options, progress=progress)
    for path, why in found.unread:
        common.terminal.say(f"left out   {path}: {why}")
    wrote = found.save(common.out or Path("out") / "fleet")
    common.terminal.wrote(*wrote)
    for title, table in (
        ("changed", found.changes()),
        ("unlike other arms of the model", found.outliers()),
    ):
        if len(table):
            most = len(table) if common.verbose else SHOWN
            common.terminal.answer(title)
            common.terminal.show(table[:most])
            if len(table) > most:
                common.terminal.answer(
                    f"and {len(table) - most} more; all with -v, in fleet.csv or with --json"
                )
            common.terminal.answer()
    common.terminal.fact("verdict", found.verdict())
    common.terminal.emit_json({**found.facts(), "wrote": wrote})
    return (
        ExitStatus.LIMIT_NOT_MET if options.fail_if_changed and found.changed else ExitStatus.DONE
    )
