"""``dynid run batch.yaml``: many robots and logs from one list, side by side; one that fails stops no other."""

from __future__ import annotations

from collections import Counter
from itertools import count
from pathlib import Path
from typing import Any

import click

from dynid.answer import Answer
from dynid.cli.options import FILE, INPUT, dynid_command, options_from
from dynid.cli.session import Session
from dynid.disk import write_text
from dynid.errors import WrongUsage
from dynid.reports.tables import JunitCase
from dynid.reports.tables import junit as junit_xml
from dynid.table import Table
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
@click.argument("batch", type=INPUT)
@options_from(RunOptions)
@click.option("--junit", type=FILE, metavar="FILE", help="Write a JUnit XML report.")
@click.option(
    "--json-lines", is_flag=True, help="Print one line of JSON for each job, when it ends."
)
def command(
    session: Session, batch: Path, options: RunOptions, junit: Path | None, json_lines: bool
) -> Answer:
    """Identify, validate and compare many recordings from one YAML list."""
    if json_lines and session.json:
        raise WrongUsage("--json-lines and --json are two forms of one answer", fix="give one")
    number = count(1)

    def line(event: str, facts: dict[str, Any]) -> None:
        if json_lines:
            facts = {"schema": "dynid/run-event/1", "event": event, **facts}
            session.emit_json(facts, indent=None)

    def ended(jobs: int, job: dict[str, Any]) -> None:
        how = "reused" if job["reused"] else f"{job['seconds']:.1f} s"
        session.stage(f"{next(number)}/{jobs}", f"{job['name']}: {job['outcome']} ({how})")
        line("job", {key: job[key] for key in job if key != "answers"})

    words = ["--seed", str(session.seed), *["--force"] * session.force]
    jobs = run(batch, options, session.out or Path("out"), words, ended)
    if junit is not None:
        write_text(junit, junit_xml("dynid run", [*map(case_of, jobs)]))
    wrote = [] if junit is None else [junit]
    outcomes = Counter(job["outcome"] for job in jobs)
    facts = {
        "passed": outcomes["passed"],
        "beyond_limit": outcomes["beyond a limit"],
        "failed": outcomes["failed"],
    }
    line("end", {**facts, "wrote": wrote})
    failed = [job["status"] for job in jobs if job["outcome"] == "failed"]
    columns = {
        "job": "name",
        "outcome": "outcome",
        "error %": "relative_error_percent",
        "held out %": "unseen_relative_error_percent",
        "what": "message",
    }
    rows = [{head: job[key] or None for head, key in columns.items()} for job in jobs]
    counts = f"{facts['beyond_limit']} beyond a limit, {facts['failed']} failed"
    verdict = ("verdict", f"{facts['passed']} of {len(jobs)} passed, {counts}")
    return Answer(
        {"schema": "dynid/run/1", "jobs": jobs, **facts},
        parts=() if json_lines else (Table(rows), "", verdict),
        wrote=wrote,
        status=failed[0] if failed else max(job["status"] for job in jobs),
    )


def case_of(job: dict[str, Any]) -> JunitCase:
    """Return a job as a line of a test report."""
    robot, failed = Path(job["robot"]).stem, job["outcome"] == "failed"
    return JunitCase(job["name"], robot, job["message"], job["seconds"], failed)
