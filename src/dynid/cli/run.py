"""``dynid run batch.yaml``: many robots and logs from one list, side by side; one that fails stops no other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from dynid.cli.arguments import options_from, options_of
from dynid.cli.options import Common, dynid_command
from dynid.errors import ExitStatus, WrongUsage
from dynid.workflows.run import RunOptions


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
    from dynid.files.artifact import write_text
    from dynid.reports.tables import JunitCase
    from dynid.reports.tables import junit as junit_xml
    from dynid.workflows.run import run

    if json_lines and common.json:
        raise WrongUsage(
            "--json-lines and --json are two forms of the same answer", fix="give one of them"
        )

    def line(event: str, facts: dict[str, Any]) -> None:
        if json_lines:
            common.terminal.emit_json_line({"schema": "dynid/run-event/1", "event": event, **facts})

    ended: list[dict[str, Any]] = []
    words = ["--seed", str(common.seed), *["--force"] * common.force]
    with common.terminal.progress() as progress:

        def told(count: int, job: dict[str, Any]) -> None:
            ended.append(job)
            how = "reused" if job["reused"] else f"{job['seconds']:.1f} s"
            progress.stage(f"{len(ended)}/{count}", f"{job['name']}: {job['outcome']} ({how})")
            line("job", {key: job[key] for key in job if key != "answers"})

        options = options_of(RunOptions, values)
        jobs = run(batch, options, common.out or Path("out"), words, told)
    if junit is not None:
        cases = [
            JunitCase(
                job["name"],
                Path(job["robot"]).stem,
                job["message"],
                job["seconds"],
                job["outcome"] == "failed",
            )
            for job in jobs
        ]
        write_text(junit, junit_xml("dynid run", cases))
        common.terminal.wrote(junit)
    outcomes = [job["outcome"] for job in jobs]
    counts = {key: outcomes.count(key.replace("_", " a ")) for key in ("passed", "beyond_limit")}
    facts = {**counts, "failed": outcomes.count("failed"), "wrote": [junit] if junit else []}
    line("end", facts)
    if not json_lines:
        show(common, jobs, facts)
    common.terminal.emit_json({"schema": "dynid/run/1", "jobs": jobs, **facts})
    failed = [ExitStatus(job["status"]) for job in jobs if job["outcome"] == "failed"]
    return failed[0] if failed else ExitStatus(max(job["status"] for job in jobs))


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
