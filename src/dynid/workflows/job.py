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
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass, field, replace
from importlib import import_module
from io import StringIO
from pathlib import Path
from threading import Lock
from typing import Any

from dynid import limits
from dynid.errors import DynidError, ExitStatus, WorkerDiffers, WrongUsage
from dynid.files.artifact import sha256, write_text
from dynid.files.batchfile import Job
from dynid.files.contents import Contents, Fact
from dynid.files.remote import fetch
from dynid.npz import parse_json
from dynid.progress import SILENT, Progress
from dynid.text import shell
from dynid.version import __version__
from dynid.workflows.cluster import Pool, Task

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
    here = with_copies(job, folder)
    key = job_key(here, seed)
    before = None if force else _record(job, folder, key)
    if before is not None:
        return before
    start = time.perf_counter()
    if not (folder / RECORD).exists():
        # Why: what a job that was killed has left behind would show in what this one says.
        for left in MODEL:
            (folder / left).unlink(missing_ok=True)
    status, message, answers, said = _commanded(commands(here, folder), seed, raised)
    write_text(folder / "run.log", said)
    done = JobResult(job, folder, status, time.perf_counter() - start, answers, message)
    if not done.failed:
        _write_record(done, key)
    return done


#: Worst status, first complaint, JSON answers by command, and what was said.
Said = tuple[int, str, dict[str, list[dict[str, Any]]], str]


def _commanded(words: Iterator[tuple[str, list[str]]], seed: int, raised: Sequence[str]) -> Said:
    """Run commands one after another, up to the first that fails."""
    worst, first, answers, said = 0, "", dict[str, list[dict[str, Any]]](), ""
    for name, rest in words:
        status, answer, text = call([name, "--json", "--no-input", "--force", "--seed", str(seed), *raised, *rest])
        said += f"$ {shell('dynid', name, *rest)}\n{text}"
        worst, first = max(worst, status), first or (_complaint(text) if status else "")
        if answer is not None:
            answers.setdefault(name, []).append(answer)
        if status > ExitStatus.LIMIT_NOT_MET:
            break
    return worst, first, answers, said


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


def with_copies(job: Job, folder: Path) -> Job:
    """Return a job whose logs are files: what is at a URL is fetched into its folder."""

    def local(log: Path | str, place: str) -> Path:
        return fetch(log, folder / "logs" / place) if isinstance(log, str) else log

    return replace(
        job,
        logs=tuple(local(log, str(k)) for k, log in enumerate(job.logs, start=1)),
        validate=tuple(local(log, f"validate{k}") for k, log in enumerate(job.validate, start=1)),
    )


def job_key(job: Job, seed: int, hashes: Sequence[str] | None = None) -> str:
    """Return the hash of everything a job depends on: its text, its files, the robot, the program.

    Args:
        job: with logs that are files.
        seed: seed of every random choice.
        hashes: of its logs, where they are known already.
    """
    from dynid.workflows.robots import robot_hash

    if hashes is None:
        hashes = [hash_of_log(job.robot, Path(log)) for log in (*job.logs, *job.validate)]
    baseline = []
    if job.baseline is not None:
        baseline.append(sha256(job.baseline / "parameters.npz" if job.baseline.is_dir() else job.baseline))
    # Why: a job without stretches has the key that it always had.
    text = {key: value for key, value in asdict(job).items() if key != "split_s" or value}
    facts = {
        "job": text,
        "seed": seed,
        "dynid": __version__,
        "files": [robot_hash(job.robot), *hashes, *baseline],
    }
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()


def hash_of_log(robot: str, log: Path) -> str:
    """Return the hash of a log; of a missing one the mistake that names it."""
    from dynid.files.logs import read_log
    from dynid.workflows.robots import load_robot

    if not log.exists():
        read_log(log, robot=load_robot(robot))
    return sha256(log)


# ---------------------------------------------------------------- logs in stretches
def do_split(
    job: Job, folder: Path, seed: int, force: bool, place: Place, pool: Pool, progress: Progress = SILENT
) -> JobResult:
    """Run a job whose logs are read in stretches by all workers; its checks are one more task."""
    from dynid.workflows.identify import answer_of
    from dynid.workflows.pieces import Arm, identify_in_pieces, options_in_pieces, results

    start = time.perf_counter()
    try:
        if job.fail_if:
            raise WrongUsage(
                f"job '{job.name}': fail_if needs all rows in one process", fix="max_unexplained, baseline"
            )
        reading, of_estimate = options_in_pieces(job.options)
        logs = (*job.logs, *job.validate)
        tasks = {
            f"hash {k}": Task(copied, (job.robot, log, folder.absolute() / "logs" / str(k), place))
            for k, log in enumerate(logs)
        }
        copies = results(pool, tasks, list(tasks), progress, "hash")
        here = replace(
            job,
            logs=tuple(path for path, _ in copies[: len(job.logs)]),
            validate=tuple(path for path, _ in copies[len(job.logs) :]),
        )
        hashes = [sha for _, sha in copies]
        key = job_key(here, seed, hashes)
        before = None if force else _record(job, folder, key)
        if before is not None:
            return before
        raised = tuple(limits.read_limits(word) for word in place.limits if "=" in word)
        arm = Arm(_whole(job.robot), reading, raised)
        paths = [Path(log) for log in here.logs]
        found = identify_in_pieces(arm, paths, pool, seconds=job.split_s, options=of_estimate, progress=progress)
        inputs = {"robot": found.robot.model_key, "split_s": repr(job.split_s), **reading.texts()}
        inputs |= {f"log {k}": sha for k, sha in enumerate(hashes[: len(job.logs)], start=1)}
        wrote = [found.save_yaml(folder / "parameters.yaml")]
        wrote.append(found.save(folder / "parameters.npz", {"seed": seed, "inputs": inputs}))
        answer = _plain({**answer_of(found), "wrote": wrote, "folder": folder, "inputs": inputs})
        checks = {"checks": Task(do_checks, (here, folder, seed, place))}
        ((status, message, answers, said),) = results(pool, checks, ["checks"], progress, "check")
    except (DynidError, OSError) as error:
        return not_done(job, folder, error)
    write_text(folder / "run.log", said)
    answers = {"identify": [answer], **answers}
    done = JobResult(job, folder, status, time.perf_counter() - start, answers, message)
    if not done.failed:
        _write_record(done, key)
    return done


def copied(robot: str, log: Path | str, folder: Path, place: Place) -> tuple[Path, str]:
    """Return a log as a file, and its hash."""
    with place.entered():
        path = fetch(log, folder) if isinstance(log, str) else log.absolute()
        return path, hash_of_log(robot, path)


def do_checks(job: Job, folder: Path, seed: int, place: Place) -> Said:
    """Run the commands of a job that come after the identification."""
    with _ONE_AT_A_TIME, place.entered():
        every = commands(job, folder)
        next(every)
        return _commanded(every, seed, place.limits)


def _whole(robot: str) -> str:
    """Return the word for a robot that holds in every folder."""
    return str(Path(robot).absolute()) if robot.endswith((".yaml", ".yml", ".urdf")) else robot


def _plain(value: Any) -> Any:  # noqa: ANN401
    """Return a value as JSON keeps it; what is not finite as None."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if abs(value) < float("inf") else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)


# ---------------------------------------------------------------- what is done already
def _record(job: Job, folder: Path, key: str) -> JobResult | None:
    """Return what a job gave that was done before from the same inputs."""
    try:
        found = parse_json(limits.read_bytes(folder / RECORD, "header_bytes").decode("utf-8"), folder / RECORD)
        RECORDED.require(found, {}, folder / RECORD)
        if found["key"] == key and (folder / "parameters.npz").is_file():
            facts = {name: found[name] for name in ("status", "answers", "message")}
            return JobResult(job, folder, **facts, reused=True)
    except (OSError, ValueError, KeyError, TypeError, DynidError):
        pass
    return None


def _write_record(done: JobResult, key: str) -> None:
    facts = {"key": key, "status": done.status, "message": done.message, "answers": done.answers}
    write_text(done.folder / RECORD, json.dumps(facts, indent=1))
