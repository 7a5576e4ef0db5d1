"""Many robots and logs from one list, side by side; a job that fails stops no other.

A job is one task of a pool of workers (``dynid.workflows.cluster``): ``dynid identify``, then ``validate`` and
``compare``. What it answers and a hash of everything it depends on stay in the job's folder, whose files are written
whole: a job whose inputs are the same need not run again, whoever did it and whatever ended that run.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass, field
from importlib import import_module
from io import StringIO
from pathlib import Path
from threading import Lock
from typing import Any

from dynid import limits
from dynid.errors import DynidError, ExitStatus, WorkerDiffers, WrongUsage
from dynid.files.artifact import write_text
from dynid.files.batchfile import Job, folder_name, read_batch
from dynid.npz import parse_json
from dynid.options import Options, bytes_or_none, option
from dynid.progress import SILENT, Progress
from dynid.scratch import sweep
from dynid.table import Table
from dynid.text import shell
from dynid.version import __version__
from dynid.workflows.cluster import Task, opened

#: What a job leaves in its folder, so that it need not run again.
RECORD = "job.json"


@dataclass(frozen=True)
class RunOptions(Options):
    """Which jobs of a batch file run, and where."""

    jobs: int | None = option(
        None, "Number of jobs that run at a time (default: the number of cores).", metavar="N", kind="count"
    )
    scheduler: str | None = option(
        None,
        "Address of a Dask scheduler, such as tcp://host:8786, whose workers run the jobs instead of this machine.",
        metavar="ADDRESS",
    )
    memory: int | None = option(
        None,
        "Memory of each worker of this machine, such as 4GB; one that takes more is ended, and its job fails "
        "(default: an equal share of the machine's).",
        metavar="SIZE", read=bytes_or_none,
    )  # fmt: skip
    dashboard: bool = option(False, "Show Dask's dashboard of the workers on http://127.0.0.1:8787; needs bokeh.")
    only: tuple[str, ...] = option(
        (), "Run only the job of this name; may be given several times.", metavar="NAME", repeatable=True
    )


@dataclass(frozen=True)
class JobResult:
    """What came out of a job.

    Attributes:
        job: the job.
        folder: its results.
        status: the worst exit status of its commands.
        seconds: how long it took [s].
        answers: JSON answers by command.
        message: the first line of what went wrong, or which limit was not met.
        reused: whether it was done before from the same inputs.
    """

    job: Job
    folder: Path
    status: int = 0
    seconds: float = 0.0
    answers: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    message: str = ""
    reused: bool = False

    @property
    def failed(self) -> bool:
        """Whether a command could not do its job, as opposed to a limit that was not met."""
        return self.status > ExitStatus.LIMIT_NOT_MET

    @property
    def outcome(self) -> str:
        """How the job ended, in a word."""
        return "failed" if self.failed else "beyond a limit" if self.status else "passed"

    def relative_error(self, command: str) -> float | None:
        """Return the largest relative error that a command of the job answered [%]."""
        answers = (answer.get("relative_error_percent") for answer in self.answers.get(command, []))
        values = [float(value) for value in answers if isinstance(value, (int, float))]
        return max(values) if values else None

    def facts(self) -> dict[str, Any]:
        """Return the job's part of the JSON answer of ``dynid run``."""
        return {
            "name": self.job.name,
            "robot": self.job.robot,
            "logs": list(self.job.logs),
            "folder": str(self.folder),
            "status": self.status,
            "outcome": self.outcome,
            "message": self.message,
            "seconds": self.seconds,
            "reused": self.reused,
            "relative_error_percent": self.relative_error("identify"),
            "unseen_relative_error_percent": self.relative_error("validate"),
            "answers": self.answers,
        }


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
        options: which jobs, and where they run.
        out: folder that holds the jobs' folders.
        seed: seed of every random choice.
        force: run also what was done before from the same inputs.
        known_options: options of ``dynid identify`` that a job may set; None lets that command refuse others.
        progress: told where the jobs run, and as each ends.
        told: called with each job as it ends.

    Raises:
        WrongRobotFile: the batch file is wrong.
        WrongUsage: a job or one of its options does not exist; nothing has run then.
        SchedulerSilent: nothing answers where a scheduler should.
    """
    wanted = chosen(read_batch(batch), options.only)
    if known_options is not None:
        refuse_unknown_options(wanted, known_options)
    workers = min(options.jobs or cores(), len(wanted))
    jobs = {job.name: job for job in wanted}
    place = Place.here()
    tasks = {job.name: Task(do_job, (job, out / folder_name(job), seed, force, place)) for job in wanted}
    found: dict[str, JobResult] = {}
    with opened(
        workers, scheduler=options.scheduler, memory=options.memory, dashboard=options.dashboard, progress=progress
    ) as pool:
        try:
            for done in pool.run(tasks, list(tasks)):
                result = done.value or not_done(jobs[done.name], out / folder_name(jobs[done.name]), done.error)
                found[done.name] = result
                how = "reused" if result.reused else f"{result.seconds:.1f} s"
                progress.stage(f"{len(found)}/{len(wanted)}", f"{done.name}: {result.outcome} ({how})")
                told(result)
        finally:
            for name in jobs.keys() - found.keys():
                sweep(out / folder_name(jobs[name]))
    return BatchResult(tuple(found[job.name] for job in wanted))


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def chosen(jobs: tuple[Job, ...], only: tuple[str, ...]) -> tuple[Job, ...]:
    """Return the jobs with the given names, all without one."""
    from dynid.files.yamlfile import closest

    names = [job.name for job in jobs]
    for name in only:
        if name not in names:
            raise WrongUsage(f"no job '{name}'{closest(name, names)}", fix=f"one of {', '.join(names)}")
    return tuple(job for job in jobs if job.name in only or not only)


def refuse_unknown_options(jobs: tuple[Job, ...], known: Sequence[str]) -> None:
    """Refuse options that ``dynid identify`` does not have before anything runs."""
    from dynid.files.yamlfile import closest

    for job in jobs:
        for key in job.options:
            if key.replace("-", "_") not in known:
                what = f"job '{job.name}': identify has no option '{key}'{closest(key, known)}"
                raise WrongUsage(what, fix=f"one of {', '.join(known)}")


@dataclass(frozen=True)
class Place:
    """What the commands of a job depend on besides their words.

    Attributes:
        folder: the working folder.
        settings: the variables of the environment that dynid reads.
        limits: words that raise limits.
        version: of dynid.
    """

    folder: Path
    settings: tuple[tuple[str, str], ...]
    limits: tuple[str, ...]
    version: str

    @staticmethod
    def here() -> Place:
        """Return where this process is."""
        settings = {key: value for key, value in os.environ.items() if key.startswith("DYNID_")}
        return Place(Path.cwd(), tuple(sorted(settings.items())), tuple(limits.words()), __version__)

    @contextmanager
    def entered(self) -> Iterator[None]:
        """Put the commands of a block there; nothing where this process is there already.

        Raises:
            WorkerDiffers: this worker has another dynid, or no such folder.
        """
        if self.version != __version__:
            raise WorkerDiffers(f"a worker has dynid {__version__}, and this is {self.version}")
        if not self.folder.is_dir():
            raise WorkerDiffers(f"a worker on {platform.node()} sees no folder {self.folder}")
        before, variables = Path.cwd(), dict(os.environ)
        try:
            os.environ.update(self.settings)
            if before != self.folder:
                os.chdir(self.folder)
            yield
        finally:
            for key, _ in self.settings:
                if key not in variables:
                    del os.environ[key]
            os.environ.update(variables)
            if before != self.folder:
                os.chdir(before)


#: Streams, working folder and command line belong to a whole process: its threads do one job at a time.
_ONE_AT_A_TIME = Lock()


def do_job(job: Job, folder: Path, seed: int, force: bool, place: Place) -> JobResult:
    """Run the commands of a job, or return what it gave before when its inputs are the same."""
    with _ONE_AT_A_TIME:
        try:
            with place.entered():
                return _do(job, folder, seed, force, place.limits)
        except (DynidError, OSError) as error:
            return not_done(job, folder, error)


def not_done(job: Job, folder: Path, error: BaseException | None) -> JobResult:
    """Return the result of a job that a mistake has ended before its commands could say so."""
    if isinstance(error, DynidError):
        return JobResult(job, folder, int(error.status), message=error.what)
    if isinstance(error, OSError):
        return JobResult(job, folder, int(ExitStatus.INPUT), message=str(error))
    return JobResult(job, folder, int(ExitStatus.INTERNAL), message=f"{type(error).__name__}: {error}")


def _do(job: Job, folder: Path, seed: int, force: bool, raised: Sequence[str]) -> JobResult:
    key = job_key(job, seed)
    before = None if force else _record(job, folder, key)
    if before is not None:
        return before
    start = time.perf_counter()
    worst, first, answers, said = 0, "", dict[str, list[dict[str, Any]]](), ""
    for name, words in commands(job, folder):
        status, answer, text = call([name, "--json", "--no-input", "--force", "--seed", str(seed), *raised, *words])
        said += f"$ {shell('dynid', name, *words)}\n{text}"
        worst, first = max(worst, status), first or (_complaint(text) if status else "")
        if answer is not None:
            answers.setdefault(name, []).append(answer)
        if status > ExitStatus.LIMIT_NOT_MET:
            break
    write_text(folder / "run.log", said)
    done = JobResult(job, folder, worst, time.perf_counter() - start, answers, first)
    if not done.failed:
        _write_record(done, key)
    return done


def call(words: Sequence[str]) -> tuple[int, dict[str, Any] | None, str]:
    """Run a command of dynid in this process; return its exit status, its JSON answer and what it said besides."""
    # Why by its name: a job is what it would be on a command line, and nothing below the commands knows them.
    program = import_module("dynid.cli.main")
    answer, said, before = StringIO(), StringIO(), sys.argv
    sys.argv = ["dynid", *words]
    try:
        with redirect_stdout(answer), redirect_stderr(said), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            status = int(program.run(words))
    finally:
        sys.argv = before
    if status == ExitStatus.INTERRUPTED:
        raise KeyboardInterrupt
    return status, json.loads(answer.getvalue()) if answer.getvalue().strip() else None, said.getvalue()


def _complaint(said: str) -> str:
    """Return the line that says what is wrong."""
    for start in ("error[", "limit "):
        for line in said.splitlines():
            if line.startswith(start):
                return line
    lines = said.strip().splitlines()
    return lines[-1] if lines else "it said nothing"


def commands(job: Job, folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the commands of a job: name and words."""
    words = ["--out", str(folder)]
    for key, value in job.options.items():
        flag = f"--{key.replace('_', '-')}"
        words += [flag] if value == "true" else [] if value == "false" else [flag, value]
    for limit in job.fail_if:
        words += ["--fail-if", limit]
    # Why: behind -- a log that is called --force is a log.
    yield "identify", [*words, "--", job.robot, *map(str, job.logs)]
    result = str(folder / "parameters.npz")
    for log in job.validate:
        most = ["--max-unexplained", job.max_unexplained] if job.max_unexplained else []
        yield "validate", ["--no-plot", *most, "--", result, str(log)]
    if job.baseline is not None:
        within = ["--tolerance", job.tolerance] if job.tolerance else []
        yield "compare", ["--baseline", str(job.baseline), *within, "--", result]


def job_key(job: Job, seed: int) -> str:
    """Return the hash of everything a job depends on: its text, its files, the robot, the program."""
    from dynid.files.artifact import sha256
    from dynid.files.logs import read_log
    from dynid.workflows.robots import load_robot, robot_hash

    files = [*job.logs, *job.validate]
    if job.baseline is not None:
        files.append(job.baseline / "parameters.npz" if job.baseline.is_dir() else job.baseline)
    for log in (*job.logs, *job.validate):
        if not log.exists():
            read_log(log, robot=load_robot(job.robot))
    facts = {
        "job": asdict(job),
        "seed": seed,
        "dynid": __version__,
        "files": [robot_hash(job.robot), *(sha256(file) for file in files)],
    }
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()


def _record(job: Job, folder: Path, key: str) -> JobResult | None:
    """Return what a job gave that was done before from the same inputs."""
    try:
        found = parse_json(limits.read_bytes(folder / RECORD, "header_bytes").decode("utf-8"), folder / RECORD)
        if found["key"] == key and (folder / "parameters.npz").is_file():
            status, answers, message = int(found["status"]), dict(found["answers"]), str(found["message"])
            return JobResult(job, folder, status, answers=answers, message=message, reused=True)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, DynidError):
        pass
    return None


def _write_record(done: JobResult, key: str) -> None:
    facts = {"key": key, "status": done.status, "message": done.message, "answers": done.answers}
    write_text(done.folder / RECORD, json.dumps(facts, indent=1))
