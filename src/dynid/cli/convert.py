"""``dynid convert LOG -o FILE``: a recording as .npz or .csv."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

import dynid
from dynid import workflows
from dynid.cli.arguments import options_from, options_of
from dynid.cli.options import Common, dynid_command
from dynid.errors import ExitStatus, OutputExists, WrongUsage
from dynid.text import shell
from dynid.workflows.options import ConvertOptions


@dynid_command(
    "convert",
    examples=(
        "dynid convert recording/ -o run.csv                a folder of rosbag2 as a table",
        "dynid convert lab.csv --robot my_arm.yaml -o run.npz",
    ),
)
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "--to",
    "target",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="File to write: .npz or .csv; -o FILE is the same.",
)
@click.option(
    "--robot", metavar="ROBOT", help="The arm of the log, whose file names topic and columns."
)
@options_from(ConvertOptions)
def command(
    common: Common,
    log: Path,
    target: Path | None,
    robot: str | None,
    **values: Any,  # noqa: ANN401
) -> ExitStatus:
    """Write a recording as .npz or .csv; every number stays as it was recorded."""
    target = target or common.out
    if target is None:
        raise WrongUsage(
            "no file to write is given",
            fix=shell("dynid", "convert", log, "-o", f"{log.stem}.npz"),
        )
    if target.exists() and not common.force:
        raise OutputExists(f"{target} exists", fix="--force, or another --to")
    done = workflows.convert.convert(
        log, target, dynid.load_robot(robot) if robot else None, options_of(ConvertOptions, values)
    )
    common.terminal.findings(done.findings)
    common.terminal.fact(
        "log", f"{len(done.log)} samples, {done.log.duration:.1f} s, {done.log.n} joints"
    )
    common.terminal.wrote(done.path)
    common.terminal.emit_json(done.facts())
    return ExitStatus.DONE
