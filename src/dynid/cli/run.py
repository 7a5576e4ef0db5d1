"""``dynid run batch.yaml``: many robots and logs from one list, in parallel; one that fails stops no other."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import click

from dynid.cli.batch import Done, Runner
from dynid.cli.options import Common, dynid_command
from dynid.errors import ExitStatus, WrongUsage
from dynid.files.batchfile import Job, read_batch


@dynid_command(
    "run",
    examples=(
        "dynid run batch.yaml                         all jobs of the list, done ones are not done again",
        "dynid run batch.yaml --junit results.xml     for continuous integration",
    ),
)
@click.argument("batch", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--jobs", type=click.IntRange(min=1), metavar="N", help="Jobs at a time (default: the machine's cores).")
@click.option("--only", metavar="NAME", multiple=True, help="Run only this job; may be given several times.")
@click.option(
    "--junit", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE", help="Write a JUnit XML report."
)
def command(common: Common, batch: Path, jobs: int | None, only: tuple[str, ...], junit: Path | None) -> ExitStatus:
    """Identify, validate and compare many recordings from one YAML list."""
    wanted = chosen(read_batch(batch), only)
    refuse_unknown_options(wanted)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    workers = min(jobs or cores, len(wanted))
    runner = Runner(common.out or Path("out"), seed=common.seed, force=common.force, threads=max(1, cores // workers))
    done = run_all(common, runner, wanted, workers)
    wrote = write_junit(common, junit, done)
    show(common, done)
    failed, limits = [d for d in done if d.failed], [d for d in done if d.status == ExitStatus.LIMIT_NOT_MET]
    common.terminal.answer()
    fine = len(done) - len(failed) - len(limits)
    common.terminal.fact("verdict", f"{fine} of {len(done)} passed, {len(limits)} beyond a limit, {len(failed)} failed")
    common.terminal.emit_json(
        {
            "schema": "dynid/run/1",
            "jobs": [described(each) for each in done],
            "passed": fine,
            "beyond_limit": len(limits),
            "failed": len(failed),
            "wrote": wrote,
        }
    )
    if failed:
        return ExitStatus(failed[0].status) if failed[0].status in set(ExitStatus) else ExitStatus.INTERNAL
    return ExitStatus.LIMIT_NOT_MET if limits else ExitStatus.DONE


def chosen(jobs: tuple[Job, ...], only: tuple[str, ...]) -> tuple[Job, ...]:
    """Return the jobs with the given names, all without one."""
    from dynid.files.yamlfile import closest

    names = [job.name for job in jobs]
    for name in only:
        if name not in names:
            raise WrongUsage(f"no job '{name}'{closest(name, names)}", fix=f"one of {', '.join(names)}")
    return tuple(job for job in jobs if job.name in only or not only)


def refuse_unknown_options(jobs: tuple[Job, ...]) -> None:
    """Refuse options that ``dynid identify`` does not have before anything runs."""
    from dynid.cli.identify import command as identify
    from dynid.cli.options import COMMON_NAMES, known_keys
    from dynid.files.yamlfile import closest

    known = sorted(set(known_keys(identify)) - set(COMMON_NAMES) - {"fail_if"})
    for job in jobs:
        for key in job.options:
            if key.replace("-", "_") not in known:
                what = f"job '{job.name}': identify has no option '{key}'{closest(key, known)}"
                raise WrongUsage(what, fix=f"one of {', '.join(known)}")


def run_all(common: Common, runner: Runner, jobs: tuple[Job, ...], workers: int) -> list[Done]:
    """Run the jobs side by side and return what came out in the order of the list."""
    found: dict[str, Done] = {}
    with ThreadPoolExecutor(workers) as pool:
        waiting = [pool.submit(runner.run, job) for job in jobs]
        try:
            for future in as_completed(waiting):
                done = future.result()
                found[done.job.name] = done
                how = "reused" if done.reused else f"{done.seconds:.1f} s"
                common.terminal.stage(f"{len(found)}/{len(jobs)}", f"{done.job.name}: {outcome(done)} ({how})")
        except BaseException:
            runner.stop()
            raise
    return [found[job.name] for job in jobs]


def outcome(done: Done) -> str:
    """Return in a word how a job ended."""
    return "failed" if done.failed else "beyond a limit" if done.status else "passed"


def error_of(done: Done, command: str) -> float | None:
    """Return the largest relative error that a command of a job answered [%]."""
    values = [answer["relative_error_percent"] for answer in done.answers.get(command, [])]
    return max(values) if values else None


def show(common: Common, done: list[Done]) -> None:
    """Print one row a job."""

    def percent(value: float | None) -> str:
        return "-" if value is None else f"{value:.2f} %"

    rows = [
        [d.job.name, outcome(d), percent(error_of(d, "identify")), percent(error_of(d, "validate")), d.message or "-"]
        for d in done
    ]
    common.terminal.table(["job", "outcome", "unexplained", "unseen log", "what"], rows, numbers=False)


def described(done: Done) -> dict[str, Any]:
    """Return a job for JSON."""
    return {
        "name": done.job.name,
        "robot": done.job.robot,
        "logs": list(done.job.logs),
        "folder": str(done.folder),
        "status": done.status,
        "outcome": outcome(done),
        "message": done.message,
        "seconds": done.seconds,
        "reused": done.reused,
        "relative_error_percent": error_of(done, "identify"),
        "unseen_relative_error_percent": error_of(done, "validate"),
        "answers": done.answers,
    }


def write_junit(common: Common, path: Path | None, done: list[Done]) -> list[Path]:
    """Write the report for continuous integration."""
    if path is None:
        return []
    from dynid.files.artifact import write_text
    from dynid.reports.tables import JunitCase, junit

    cases = [
        JunitCase(
            d.job.name, Path(d.job.robot).stem, (d.message or outcome(d)) if d.status else "", d.seconds, d.failed
        )
        for d in done
    ]
    write_text(path, junit("dynid run", cases))
    common.terminal.wrote(path)
    return [path]
