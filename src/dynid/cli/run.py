"""``dynid run batch.yaml``: many robots and logs from one list, side by side; one that fails stops no other."""

from __future__ import annotations

from collections import Counter
from itertools import count
from pathlib import Path
from typing import Any

import click

from dynid.cli.arguments import options_from, options_of
from dynid.cli.options import Common, dynid_command
from dynid.disk import write_text
from dynid.errors import ExitStatus, WrongUsage
from dynid.reports.tables import JunitCase
from dynid.reports.tables import junit as junit_xml
from dynid.workflows.run import RunOptions, run


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
    if json_lines and common.json:
        raise WrongUsage(
            "--json-lines and --json are two forms of the same answer", fix="give one of them"
        )

    def line(event: str, facts: dict[str, Any]) -> None:
        if json_lines:
            common.terminal.emit_json_line({"schema": "dynid/run-event/1", "event": event, **facts})

    number = count(1)
    words = ["--seed", str(common.seed), *["--force"] * common.force]
    with common.terminal.progress() as progress:

        def ended(jobs: int, job: dict[str, Any]) -> None:
            how = "reused" if job["reused"] else f"{job['seconds']:.1f} s"
            progress.stage(f"{next(number)}/{jobs}", f"{job['name']}: {job['outcome']} ({how})")
            line("job", {key: job[key] for key in job if key != "answers"})

        jobs = run(batch, options_of(RunOptions, values), common.out or Path("out"), words, ended)
    if junit is not None:
        write_text(junit, junit_xml("dynid run", list(map(case_of, jobs))))
        common.terminal.wrote(junit)
    outcomes = Counter(job["outcome"] for job in jobs)
    facts = {
        "passed": outcomes["passed"],
        "beyond_limit": outcomes["beyond a limit"],
        "failed": outcomes["failed"],
        "wrote": [junit] if junit else [],
    }
    line("end", facts)
    if not json_lines:
        show(common, jobs, facts)
    common.terminal.emit_json({"schema": "dynid/run/1", "jobs": jobs, **facts})
    failed = [ExitStatus(job["status"]) for job in jobs if job["outcome"] == "failed"]
    return failed[0] if failed else ExitStatus(max(job["status"] for job in jobs))


def case_of(job: dict[str, Any]) -> JunitCase:
    """Return a job as a line of a test report."""
    robot, failed = Path(job["robot"]).stem, job["outcome"] == "failed"
    return JunitCase(job["name"], robot, job["message"], job["seconds"], failed)


def show(common: Common, jobs: list[dict[str, Any]], facts: dict[str, Any]) -> None:
    """Print one row per job, and how many passed."""
    keys = ("relative_error_percent", "unseen_relative_error_percent")
    rows = [
        [
            job["name"],
            job["outcome"],
            *("-" if job[key] is None else f"{job[key]:.2f} %" for key in keys),
            job["message"] or "-",
        ]
        for job in jobs
    ]
    common.terminal.table(
        ["job", "outcome", "unexplained", "unseen log", "what"], rows, numbers=False
    )
    common.terminal.answer()
    counts = f"{facts['beyond_limit']} beyond a limit, {facts['failed']} failed"
    common.terminal.fact("verdict", f"{facts['passed']} of {len(jobs)} passed, {counts}")
