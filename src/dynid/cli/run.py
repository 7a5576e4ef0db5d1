"""``dynid run batch.yaml``: many robots and logs from one list, side by side; one that fails stops no other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli import own
from dynid.cli.arguments import options_from, options_of
from dynid.cli.options import COMMON_NAMES, Common, dynid_command, known_keys
from dynid.errors import ExitStatus, WrongUsage
from dynid.workflows.run import RunOptions

if TYPE_CHECKING:
    from dynid.workflows.job import JobResult
    from dynid.workflows.run import BatchResult

#: Schema of the lines of ``--json-lines``: one ``"job"`` each, then one ``"end"``.
EVENT = "dynid/run-event/1"


@dynid_command(
    "run",
    examples=(
        "dynid run batch.yaml                         all jobs of the list, done ones are not done again",
        "dynid run batch.yaml --junit results.xml     for continuous integration",
        "dynid run batch.yaml --scheduler tcp://host:8786     on the workers of a Dask scheduler",
        "dynid run batch.yaml --json-lines | jq .name         follow the jobs as they end",
    ),
)
@click.argument("batch", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@options_from(RunOptions)
@click.option(
    "--junit",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write a JUnit XML report.",
)
@click.option(
    "--json-lines", is_flag=True, help="Print one line of JSON for each job, when it ends."
)
def command(
    common: Common,
    batch: Path,
    junit: Path | None,
    json_lines: bool,
    **values: Any,  # noqa: ANN401
) -> ExitStatus:
    """Identify, validate and compare many recordings from one YAML list."""
    from dynid.cli.identify import command as identify
    from dynid.cli.main import run as run_command
    from dynid.files.artifact import write_text
    from dynid.workflows.run import run

    if json_lines and common.json:
        raise WrongUsage(
            "--json-lines and --json are two forms of the same answer", fix="give one of them"
        )

    def told(each: JobResult) -> None:
        if json_lines:
            facts = {key: value for key, value in each.facts().items() if key != "answers"}
            common.terminal.emit_json_line({"schema": EVENT, "event": "job", **facts})

    # Why not what only the user may say: a list comes with the folder of logs.
    not_of_jobs = {"fail_if", *COMMON_NAMES, *own.OPTIONS}
    known = sorted(set(known_keys(identify)) - not_of_jobs)
    with common.terminal.progress() as progress:
        done = run(
            batch,
            run_command,
            options_of(RunOptions, values),
            out=common.out or Path("out"),
            seed=common.seed,
            force=common.force,
            known_options=known,
            progress=progress,
            told=told,
        )
    wrote = [junit] if junit is not None else []
    for path in wrote:
        write_text(path, done.junit())
        common.terminal.wrote(path)
    if json_lines:
        counts = {
            "passed": done.passed,
            "beyond_limit": len(done.beyond_limit),
            "failed": len(done.failed),
        }
        common.terminal.emit_json_line({"schema": EVENT, "event": "end", **counts, "wrote": wrote})
    else:
        show(common, done)
    common.terminal.emit_json({**done.facts(), "wrote": wrote})
    return done.status


def show(common: Common, done: BatchResult) -> None:
    """Print one row per job, and how many passed."""

    def percent(value: float | None) -> str:
        return "-" if value is None else f"{value:.2f} %"

    rows = [
        [
            each.job.name,
            each.outcome,
            percent(each.relative_error("identify")),
            percent(each.relative_error("validate")),
            each.message or "-",
        ]
        for each in done.jobs
    ]
    common.terminal.table(
        ["job", "outcome", "unexplained", "unseen log", "what"], rows, numbers=False
    )
    common.terminal.answer()
    counts = f"{len(done.beyond_limit)} beyond a limit, {len(done.failed)} failed"
    common.terminal.fact("verdict", f"{done.passed} of {len(done.jobs)} passed, {counts}")
