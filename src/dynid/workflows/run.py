"""Many robots and logs from one list: the commands of each job are processes of their own, N jobs at a time."""

from __future__ import annotations

import json
import os
import subprocess
import time
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from dynid import children
from dynid.answer import Facts
from dynid.arguments import no_such
from dynid.disk import write_text
from dynid.errors import ExitStatus, PackageMissing, SchedulerSilent
from dynid.files.batchfile import Job, folder_name, read_batch
from dynid.options import Options, option
from dynid.runs import RunFolder
from dynid.text import shell

#: How long a scheduler that does not answer is waited for [s]. evidence: none yet.
PATIENCE = 30.0


@dataclass(frozen=True)
class RunOptions(Options):
    """Which jobs of a batch file run, and where."""

    jobs: int | None = option(
        None, "How many jobs run at a time (default: one per core).", metavar="N", bounds=(1, None)
    )
    scheduler: str | None = option(
        None,
        "Run the jobs on the workers of this Dask scheduler, such as tcp://host:8786.",
        metavar="ADDRESS",
    )
    only: tuple[str, ...] = option(
        (),
        "Run only the job of this name; may be given several times.",
        metavar="NAME",
        repeatable=True,
    )


def run(
    batch: Path,
    options: RunOptions,
    out: Path,
    words: list[str],
    ended: Callable[[int, Facts], None],
) -> list[Facts]:
    """Do the jobs of a batch file and return the facts of each, in the order of the list.

    Args:
        batch: the batch file.
        options: which jobs, and where they run.
        out: folder that holds the jobs' folders.
        words: further words of every command, such as ``--seed 1``.
        ended: called with the number of all jobs and the facts of one, as it ends.

    Raises:
        WrongRobotFile: the batch file is wrong.
        WrongUsage: there is no job of a name; nothing has run then.
        PackageMissing: a scheduler is given, and Dask is not installed.
        SchedulerSilent: nothing answers where the scheduler should.
    """
    jobs = read_batch(batch)
    names = [job.name for job in jobs]
    for name in set(options.only).difference(names):
        raise no_such("no job", name, names)
    jobs = tuple(job for job in jobs if job.name in options.only or not options.only)
    pool = executor(options)
    calls = {pool.submit(run_job, job, out, words, Path.cwd()): job for job in jobs}
    facts = {}
    try:
        for call in as_completed(calls):
            try:
                facts[call] = call.result()
            except Exception as error:  # noqa: BLE001 - a worker that died, a folder that it lacks
                text = f"{type(error).__name__}: {error}"
                facts[call] = facts_of(calls[call], out, ExitStatus.MACHINE, text)
            ended(len(jobs), facts[call])
    finally:
        for call in calls:
            call.cancel()
        pool.shutdown()
    return [facts[call] for call in calls]


def executor(options: RunOptions) -> Executor:
    """Return what runs the jobs: threads that wait for processes, or the workers of a Dask scheduler."""
    if options.scheduler is None:
        return ThreadPoolExecutor(options.jobs or os.cpu_count())
    if find_spec("distributed") is None:
        raise PackageMissing("--scheduler needs Dask", fix="pip install 'dynid[cluster]'")
    from distributed import Client

    try:
        client = Client(options.scheduler, timeout=PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        text = f"no Dask scheduler answers at {options.scheduler}"
        raise SchedulerSilent(text, where=options.scheduler) from error
    return client.get_executor(pure=False)


def run_job(job: Job, out: Path, words: list[str], home: Path) -> Facts:
    """Run the commands of a job in a working folder, up to the first that fails; write run.log, return the facts."""
    start, folder = time.perf_counter(), out / folder_name(job)
    worst, message, log = 0, "", ""
    answers: dict[str, list[Facts]] = {}
    for name, *own in commands_of(job, folder):
        typed = map(str, (name, "--json", "--no-input", *words, *own))
        line = children.python("from dynid.__main__ import main; main()", *typed)
        done = subprocess.run(line, cwd=home, capture_output=True, text=True)
        status = done.returncode if done.returncode in set(ExitStatus) else ExitStatus.INTERNAL
        log += f"$ {shell('dynid', name, *own)}\n{done.stderr}"
        if status:
            worst, message = max(worst, status), message or _complaint(done.stderr)
        if done.stdout.strip():
            answers.setdefault(name, []).append(json.loads(done.stdout))
        if status > ExitStatus.LIMIT_NOT_MET:
            break
    write_text(home / folder / "run.log", log)
    return facts_of(job, out, worst, message, time.perf_counter() - start, answers)


def _complaint(said: str) -> str:
    """Return the line that says what is wrong."""
    lines = said.strip().splitlines() or ["it said nothing"]
    return next((each for each in lines if each.startswith(("error[", "limit "))), lines[-1])


def commands_of(job: Job, folder: Path) -> list[list[Any]]:
    """Return the words of a job's commands; behind -- a log that is called --force is a log."""
    words: list[Any] = ["--out", folder]
    for key, value in job.options.items():
        flag = f"--{key.replace('_', '-')}"
        words += [flag] if value == "true" else [] if value == "false" else [flag, value]
    for limit in job.fail_if:
        words += ["--fail-if", limit]
    limits = ["--max-unexplained", job.max_unexplained] if job.max_unexplained else []
    commands = [["identify", *words, "--", job.robot, *job.logs]]
    commands += [["validate", "--no-plot", *limits, "--", folder, log] for log in job.validate]
    if job.baseline is not None:
        within = ["--tolerance", job.tolerance] if job.tolerance else []
        commands.append(["compare", "--baseline", job.baseline, *within, "--", folder])
    return commands


def facts_of(
    job: Job,
    out: Path,
    status: int,
    message: str = "",
    seconds: float = 0.0,
    answers: dict[str, list[Facts]] | None = None,
) -> Facts:
    """Return what is said of a job."""
    answers, folder = answers or {}, out / folder_name(job)

    def worst(command: str) -> float | None:
        values = [answer.get("relative_error_percent") for answer in answers.get(command, [])]
        return max((value for value in values if value is not None), default=None)

    made = [path for answer in answers.get("identify", []) for path in answer.get("wrote", [])]
    kept = status <= ExitStatus.LIMIT_NOT_MET
    return {
        "name": job.name,
        "robot": job.robot,
        "logs": job.logs,
        "folder": folder,
        "status": status,
        "outcome": ("beyond a limit" if status else "passed") if kept else "failed",
        "message": message,
        "seconds": seconds,
        "reused": kept and str(RunFolder(folder).parameters) not in made,
        "relative_error_percent": worst("identify"),
        "unseen_relative_error_percent": worst("validate"),
        "answers": answers,
    }
