"""Many robots and logs from one list, side by side; a job that fails stops no other.

A job is ``dynid identify``, then ``validate`` and ``compare``, done by a worker (``dynid.workflows.cluster``).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.errors import ExitStatus, WrongUsage
from dynid.files.batchfile import Job, folder_name, read_batch
from dynid.options import Options, bytes_or_none, option
from dynid.progress import SILENT, Progress
from dynid.scratch import sweep
from dynid.table import Table
from dynid.workflows.cluster import mapped, opened
from dynid.workflows.job import Command, JobResult, Surroundings, do_job, not_done

if TYPE_CHECKING:
    from distributed import Client


@dataclass(frozen=True)
class RunOptions(Options):
    """Which jobs of a batch file run, and where."""

    jobs: int | None = option(
        None, "How many jobs run at a time (default: one per core).", metavar="N", kind="count"
    )
    scheduler: str | None = option(
        None,
        "Run the jobs on the workers of this Dask scheduler, such as tcp://host:8786, instead of on this machine.",
        metavar="ADDRESS",
    )
    memory: int | None = option(
        None,
        "Memory that one job may take, such as 4GB; a job that takes more is ended and fails "
        "(default: an equal share of the machine's).",
        metavar="SIZE",
        read=bytes_or_none,
    )
    dashboard: bool = option(
        False, "Show the jobs in a browser, on http://127.0.0.1:8787; needs the package bokeh."
    )
    only: tuple[str, ...] = option(
        (),
        "Run only the job of this name; may be given several times.",
        metavar="NAME",
        repeatable=True,
    )


@dataclass(frozen=True, repr=False)
class BatchResult:
    """What came out of all jobs, in the order of the list."""

    jobs: tuple[JobResult, ...]

    @property
    def failed(self) -> list[JobResult]:
        """Jobs of which a command could not do its job."""
        return [done for done in self.jobs if done.failed]

    @property
    def beyond_limit(self) -> list[JobResult]:
        """Jobs that did not meet a limit."""
        return [done for done in self.jobs if done.status == ExitStatus.LIMIT_NOT_MET]

    @property
    def passed(self) -> int:
        """Number of jobs that met all limits."""
        return len(self.jobs) - len(self.failed) - len(self.beyond_limit)

    @property
    def status(self) -> ExitStatus:
        """Exit status of the batch: that of the first job that failed."""
        if self.failed:
            first = self.failed[0].status
            return ExitStatus(first) if first in set(ExitStatus) else ExitStatus.INTERNAL
        return ExitStatus.LIMIT_NOT_MET if self.beyond_limit else ExitStatus.DONE

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid run`` says."""
        return {
            "schema": "dynid/run/1",
            "jobs": [done.facts() for done in self.jobs],
            "passed": self.passed,
            "beyond_limit": len(self.beyond_limit),
            "failed": len(self.failed),
        }

    def table(self) -> Table:
        """Return one row per job: outcome, relative torque errors [%], and what went wrong."""
        rows = [
            {
                "job": done.job.name,
                "outcome": done.outcome,
                "unexplained %": done.relative_error("identify"),
                "unseen log %": done.relative_error("validate"),
                "what": done.message,
            }
            for done in self.jobs
        ]
        return Table(rows)

    def __repr__(self) -> str:
        """Return the table as text."""
        return repr(self.table())

    def junit(self) -> str:
        """Return a JUnit XML report for continuous integration."""
        from dynid.reports.tables import JunitCase, junit

        return junit(
            "dynid run",
            [
                JunitCase(
                    done.job.name,
                    Path(done.job.robot).stem,
                    (done.message or done.outcome) if done.status else "",
                    done.seconds,
                    done.failed,
                )
                for done in self.jobs
            ],
        )


def run(
    batch: Path,
    command: Command,
    options: RunOptions = RunOptions(),
    *,
    out: Path = Path("out"),
    seed: int = 0,
    force: bool = False,
    known_options: Sequence[str] | None = None,
    progress: Progress = SILENT,
    told: Callable[[JobResult], None] = lambda done: None,
) -> BatchResult:
    """Identify, validate and compare many recordings from one YAML list.

    Args:
        batch: the batch file.
        command: what runs a command line of dynid; a function of a module, so that workers find it.
        options: which jobs, and where they run.
        out: folder that holds the jobs' folders.
        seed: seed of every random choice.
        force: run also what was done before from the same inputs.
        known_options: options of ``dynid identify`` that a job may set; None lets that command refuse others.
        progress: reports where the jobs run, and as each ends.
        told: called with each job as it ends.

    Raises:
        WrongRobotFile: the batch file is wrong.
        WrongUsage: a job or one of its options does not exist; nothing has run then.
        SchedulerSilent: nothing answers where a scheduler should.
    """
    wanted = chosen(read_batch(batch), options.only)
    if known_options is not None:
        refuse_unknown_options(wanted, known_options)
    folders = [out / folder_name(job) for job in wanted]
    around = Surroundings(command, seed, force)
    found: dict[int, JobResult] = {}
    workers = min(options.jobs or cores(), sum(len(job.logs) for job in wanted))
    with opened(
        workers,
        scheduler=options.scheduler,
        memory=options.memory,
        dashboard=options.dashboard,
        progress=progress,
    ) as client:
        try:
            for k, each in _jobs_done(client, workers, wanted, folders, around, progress):
                found[k] = each
                how = "reused" if each.reused else f"{each.seconds:.1f} s"
                progress.stage(
                    f"{len(found)}/{len(wanted)}", f"{each.job.name}: {each.outcome} ({how})"
                )
                told(each)
        finally:
            for k, folder in enumerate(folders):
                if k not in found:
                    sweep(folder)
    return BatchResult(tuple(found[k] for k in range(len(wanted))))


def _jobs_done(
    client: Client | None,
    workers: int,
    jobs: Sequence[Job],
    folders: Sequence[Path],
    around: Surroundings,
    progress: Progress,
) -> Iterator[tuple[int, JobResult]]:
    """Yield jobs as they end: each by one worker; of jobs that are fewer than workers, those of many logs by all."""
    if client is not None and len(jobs) < max(workers, len(client.nthreads())):
        spread = [k for k, job in enumerate(jobs) if len(job.logs) > 1]
    else:
        spread = []
    whole = [k for k in range(len(jobs)) if k not in spread]
    calls = ([jobs[k] for k in whole], [folders[k] for k in whole], [around] * len(whole))
    for number, done, error in mapped(client, do_job, *calls, progress=progress):
        k = whole[number]
        yield k, done or not_done(jobs[k], folders[k], error)
    for k in spread:
        assert client is not None
        with client.as_current():
            done = do_job(jobs[k], folders[k], around)
        yield k, done


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def chosen(jobs: tuple[Job, ...], only: tuple[str, ...]) -> tuple[Job, ...]:
    """Return the jobs with the given names, all without one."""
    from dynid.files.yamlfile import closest

    names = [job.name for job in jobs]
    for name in only:
        if name not in names:
            raise WrongUsage(
                f"no job '{name}'{closest(name, names)}", fix=f"one of {', '.join(names)}"
            )
    return tuple(job for job in jobs if job.name in only or not only)


def refuse_unknown_options(jobs: tuple[Job, ...], known: Sequence[str]) -> None:
    """Refuse options that ``dynid identify`` does not have before anything runs."""
    from dynid.files.yamlfile import closest

    for job in jobs:
        for key in job.options:
            if key.replace("-", "_") not in known:
                what = f"job '{job.name}': identify has no option '{key}'{closest(key, known)}"
                raise WrongUsage(what, fix=f"one of {', '.join(known)}")
