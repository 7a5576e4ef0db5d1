"""Many robots and logs from one list, side by side; a job that fails stops no other.

Each command of a job runs in its own process: ``dynid identify``, then ``validate`` and ``compare``. What it answers
and a hash of everything it depends on stay in the job's folder: a job whose inputs are the same need not run again.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any

from dynid import children, limits
from dynid.errors import DynidError, ExitStatus, WrongUsage
from dynid.files.batchfile import Job, folder_name, read_batch
from dynid.npz import parse_json
from dynid.options import Options, option
from dynid.progress import SILENT, Progress
from dynid.table import Table
from dynid.text import shell
from dynid.version import __version__

#: What a job leaves in its folder, so that it need not run again.
RECORD = "job.json"


@dataclass(frozen=True)
class RunOptions(Options):
    """Which jobs of a batch file run, and how many at a time."""

    jobs: int | None = option(
        None, "Number of jobs that run at a time (default: the number of cores).", metavar="N", kind="count"
    )
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
) -> BatchResult:
    """Identify, validate and compare many recordings from one YAML list.

    Args:
        batch: the batch file.
        options: which jobs, and how many at a time.
        out: folder that holds the jobs' folders.
        seed: seed of every random choice.
        force: run also what was done before from the same inputs.
        known_options: options of ``dynid identify`` that a job may set; None lets that command refuse others.
        progress: told as each job ends.

    Raises:
        WrongRobotFile: the batch file is wrong.
        WrongUsage: a job or one of its options does not exist; nothing has run then.
    """
    wanted = chosen(read_batch(batch), options.only)
    if known_options is not None:
        refuse_unknown_options(wanted, known_options)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    workers = min(options.jobs or cores, len(wanted))
    runner = Runner(out, seed=seed, force=force, threads=max(1, cores // workers))
    found: dict[str, JobResult] = {}
    with ThreadPoolExecutor(workers) as pool:
        waiting = [pool.submit(runner.run, job) for job in wanted]
        try:
            for future in as_completed(waiting):
                done = future.result()
                found[done.job.name] = done
                how = "reused" if done.reused else f"{done.seconds:.1f} s"
                progress.stage(f"{len(found)}/{len(wanted)}", f"{done.job.name}: {done.outcome} ({how})")
        except BaseException:
            runner.stop()
            raise
    return BatchResult(tuple(found[job.name] for job in wanted))


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


class Runner:
    """Runs jobs; ``stop`` ends the commands that are under way.

    Args:
        out: folder that holds the jobs' folders.
        seed: passed on to every command.
        force: run also what was done before.
        threads: threads of linear algebra a command may use.
    """

    def __init__(self, out: Path, *, seed: int = 0, force: bool = False, threads: int = 1) -> None:
        self.out, self.seed, self.force, self.threads = out, seed, force, threads
        # Why: raised limits belong to the thread that raised them, and jobs run in others.
        self._limits = limits.words()
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = Lock()
        self._stopped = False

    def stop(self) -> None:
        """End all commands under way and start no more."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                process.terminate()

    def run(self, job: Job) -> JobResult:
        """Run a job, or return what it gave before when its inputs are the same."""
        folder = self.out / folder_name(job)
        try:
            key = job_key(job, self.seed)
        except (DynidError, OSError) as error:
            return JobResult(job, folder, int(getattr(error, "status", ExitStatus.INPUT)), message=str(error))
        before = None if self.force else _record(job, folder, key)
        if before is not None:
            return before
        start = time.perf_counter()
        worst, first, answers = 0, "", dict[str, list[dict[str, Any]]]()
        for name, words in commands(job, folder):
            status, answer, message = self._command([name, *words], folder)
            worst, first = max(worst, status), first or message
            if answer is not None:
                answers.setdefault(name, []).append(answer)
            if status > ExitStatus.LIMIT_NOT_MET:
                break
        done = JobResult(job, folder, worst, time.perf_counter() - start, answers, first)
        if not done.failed:
            _write_record(done, key)
        return done

    def _command(self, words: list[str], folder: Path) -> tuple[int, dict[str, Any] | None, str]:
        """Run one command and return its exit status, its JSON answer and the line that says what is wrong."""
        folder.mkdir(parents=True, exist_ok=True)
        name, *rest = words
        common = ["--json", "--no-input", "--force", "--seed", str(self.seed), *self._limits]
        own = children.command("dynid", name, *common, *rest)
        threads = {f"{name}_NUM_THREADS": str(self.threads) for name in ("OMP", "OPENBLAS", "MKL")}
        with self._lock:
            if self._stopped:
                return int(ExitStatus.INTERRUPTED), None, "interrupted"
            process = subprocess.Popen(
                own,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                env=children.environment() | threads,
            )
            self._running.add(process)
        answer, said = process.communicate()
        with self._lock:
            self._running.discard(process)
        with (folder / "run.log").open("a", encoding="utf-8") as log:
            log.write(f"$ {shell('dynid', *words)}\n{said}")
        found = json.loads(answer) if answer.strip() else None
        return process.returncode, found, _complaint(said) if process.returncode else ""


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
    from dynid.files.artifact import write_text

    facts = {"key": key, "status": done.status, "message": done.message, "answers": done.answers}
    write_text(done.folder / RECORD, json.dumps(facts, indent=1))
