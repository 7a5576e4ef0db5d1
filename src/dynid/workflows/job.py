"""One job of a batch: its commands, what they answer, and the record that it is done.

What the commands answer and a hash of everything that the job depends on stay in its folder, whose files are written
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
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass, field, replace
from io import StringIO
from pathlib import Path
from threading import Lock
from typing import Any

from dynid import limits
from dynid.errors import DynidError, ExitStatus, WorkerDiffers
from dynid.files.artifact import write_text
from dynid.files.batchfile import Job
from dynid.files.contents import Contents, Fact
from dynid.files.remote import fetch
from dynid.npz import parse_json, sha256
from dynid.text import shell
from dynid.version import __version__

#: What a job leaves in its folder, so that it need not run again.
RECORD = "job.json"
RECORDED = Contents(
    RECORD,
    {
        "key": Fact(str),
        "status": Fact(int, least=ExitStatus.DONE, most=ExitStatus.LIMIT_NOT_MET),
        "message": Fact(str),
        "answers": Fact(dict[str, list[dict[str, Any]]]),
    },
)
#: The model in a job's folder, which is made first.
MODEL = ("regressor.npz", "fullregressor.npz")
#: What runs a command line of dynid in this process and returns its exit status.
Command = Callable[[Sequence[str]], int]
#: Streams, working folder and command line belong to a whole process: its threads do one job at a time.
_ONE_AT_A_TIME = Lock()


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


@dataclass(frozen=True)
class Surroundings:
    """What the commands of a job depend on besides their words, as it is where the batch was started.

    Attributes:
        command: what runs them.
        seed: seed of every random choice.
        force: whether to do again what was done before from the same inputs.
        folder: the working folder.
        settings: the variables of the environment that dynid reads.
        raised: words that raise limits.
        version: of dynid.
    """

    command: Command
    seed: int = 0
    force: bool = False
    folder: Path = field(default_factory=Path.cwd)
    settings: dict[str, str] = field(
        default_factory=lambda: {k: v for k, v in os.environ.items() if _is_ours(k)}
    )
    raised: list[str] = field(default_factory=limits.words)
    version: str = __version__

    def enter(self) -> None:
        """Make them those of this process; where the batch was started they are so already.

        Raises:
            WorkerDiffers: this worker has another dynid, or no such folder.
        """
        if self.version != __version__:
            raise WorkerDiffers(f"a worker has dynid {__version__}, and this is {self.version}")
        if not self.folder.is_dir():
            raise WorkerDiffers(f"a worker on {platform.node()} sees no folder {self.folder}")
        os.chdir(self.folder)
        for key in [key for key in os.environ if _is_ours(key) and key not in self.settings]:
            del os.environ[key]
        os.environ.update(self.settings)

    def run(self, name: str, words: list[str]) -> tuple[int, str, str]:
        """Run a command; return its exit status, its answer and what it said besides."""
        answer, said, before = StringIO(), StringIO(), sys.argv
        line = [
            name,
            "--json",
            "--no-input",
            "--force",
            "--seed",
            str(self.seed),
            *self.raised,
            *words,
        ]
        sys.argv = ["dynid", *line]
        try:
            with redirect_stdout(answer), redirect_stderr(said), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                status = int(self.command(line))
        finally:
            sys.argv = before
        if status == ExitStatus.INTERRUPTED:
            raise KeyboardInterrupt
        return status, answer.getvalue().strip(), said.getvalue()


def _is_ours(variable: str) -> bool:
    return variable.startswith("DYNID_")


def do_job(job: Job, folder: Path, around: Surroundings) -> JobResult:
    """Run the commands of a job, or return what it gave before when its inputs are the same."""
    try:
        with _ONE_AT_A_TIME:
            around.enter()
            local = with_copies(job, folder)
            key = job_key(local, around.seed)
            before = None if around.force else recorded(job, folder, key)
            return before or _done(job, commands(local, folder), folder, around, key)
    except (DynidError, OSError) as error:
        return not_done(job, folder, error)


def not_done(job: Job, folder: Path, error: BaseException | None) -> JobResult:
    """Return the result of a job that a mistake has ended before its commands could say so."""
    if isinstance(error, DynidError):
        return JobResult(job, folder, int(error.status), message=error.what)
    if isinstance(error, OSError):
        return JobResult(job, folder, int(ExitStatus.INPUT), message=str(error))
    return JobResult(
        job, folder, int(ExitStatus.INTERNAL), message=f"{type(error).__name__}: {error}"
    )


def _done(
    job: Job, lines: list[tuple[str, list[str]]], folder: Path, around: Surroundings, key: str
) -> JobResult:
    """Run commands one after another, up to the first that fails, and write down what they said and answered."""
    start = time.perf_counter()
    if not (folder / RECORD).exists():
        # Why: what a job that was killed has left behind would show in what this one says.
        for left in MODEL:
            (folder / left).unlink(missing_ok=True)
    worst, message, log, answers = 0, "", "", dict[str, list[dict[str, Any]]]()
    for name, words in lines:
        status, answer, said = around.run(name, words)
        log += f"$ {shell('dynid', name, *words)}\n{said}"
        worst, message = max(worst, status), message or (_complaint(said) if status else "")
        if answer:
            answers.setdefault(name, []).append(json.loads(answer))
        if status > ExitStatus.LIMIT_NOT_MET:
            break
    write_text(folder / "run.log", log)
    done = JobResult(job, folder, worst, time.perf_counter() - start, answers, message)
    if not done.failed:
        facts = {"key": key, "status": worst, "message": message, "answers": answers}
        write_text(folder / RECORD, json.dumps(facts, indent=1))
    return done


def _complaint(said: str) -> str:
    """Return the line that says what is wrong."""
    lines = said.strip().splitlines() or ["it said nothing"]
    return next(
        (line for start in ("error[", "limit ") for line in lines if line.startswith(start)),
        lines[-1],
    )


def commands(job: Job, folder: Path) -> list[tuple[str, list[str]]]:
    """Return the commands of a job: name and words."""
    words = ["--out", str(folder)]
    for key, value in job.options.items():
        flag = f"--{key.replace('_', '-')}"
        words += [flag] if value == "true" else [] if value == "false" else [flag, value]
    for limit in job.fail_if:
        words += ["--fail-if", limit]
    result, most = str(folder / "parameters.npz"), ["--max-unexplained", job.max_unexplained]
    # Why: behind -- a log that is called --force is a log.
    found = [("identify", [*words, "--", job.robot, *map(str, job.logs)])]
    for log in job.validate:
        found.append(
            (
                "validate",
                ["--no-plot", *(most if job.max_unexplained else []), "--", result, str(log)],
            )
        )
    if job.baseline is not None:
        within = ["--tolerance", job.tolerance] if job.tolerance else []
        found.append(("compare", ["--baseline", str(job.baseline), *within, "--", result]))
    return found


def with_copies(job: Job, folder: Path) -> Job:
    """Return a job whose logs are files: what is at a URL is fetched into its folder."""

    def local(logs: Sequence[Path | str], place: str) -> tuple[Path | str, ...]:
        every = enumerate(logs, start=1)
        return tuple(
            fetch(log, folder / "logs" / f"{place}{k}") if isinstance(log, str) else log
            for k, log in every
        )

    return replace(job, logs=local(job.logs, ""), validate=local(job.validate, "validate"))


def job_key(job: Job, seed: int) -> str:
    """Return the hash of everything a job depends on: its text, its files, the robot, the program.

    Args:
        job: with logs that are files.
        seed: seed of every random choice.
    """
    from dynid.files.logs import read_log
    from dynid.workflows.robots import load_robot, robot_hash

    files = [robot_hash(job.robot)]
    for log in map(Path, (*job.logs, *job.validate)):
        if not log.exists():
            read_log(log, robot=load_robot(job.robot))
        files.append(sha256(log))
    if job.baseline is not None:
        files.append(
            sha256(job.baseline / "parameters.npz" if job.baseline.is_dir() else job.baseline)
        )
    facts = {"job": asdict(job), "seed": seed, "dynid": __version__, "files": files}
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()


def recorded(job: Job, folder: Path, key: str) -> JobResult | None:
    """Return what a job gave that was done before from the same inputs."""
    try:
        found = parse_json(
            limits.read_bytes(folder / RECORD, "header_bytes").decode("utf-8"), folder / RECORD
        )
        RECORDED.require(found, {}, folder / RECORD)
        if found["key"] == key and (folder / "parameters.npz").is_file():
            facts = {name: found[name] for name in ("status", "answers", "message")}
            return JobResult(job, folder, **facts, reused=True)
    except (OSError, ValueError, KeyError, TypeError, DynidError):
        pass
    return None
