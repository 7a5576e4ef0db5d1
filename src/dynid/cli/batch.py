"""One job of a batch: the commands it runs, each in its own process, and when it need not run again."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from threading import Lock
from typing import Any

from dynid.errors import DynidError, ExitStatus
from dynid.files.batchfile import Job, folder_name
from dynid.version import __version__

#: What a job leaves in its folder, so that it need not run again.
RECORD = "job.json"


@dataclass
class Done:
    """What came out of a job.

    Attributes:
        job: the job.
        folder: its results.
        status: the worst exit status of its commands.
        seconds: how long it took.
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
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = Lock()
        self._stopped = False

    def stop(self) -> None:
        """End all commands under way and start no more."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                process.terminate()

    def run(self, job: Job) -> Done:
        """Run a job, or return what it gave before when its inputs are the same."""
        done = Done(job, self.out / folder_name(job))
        try:
            key = job_key(job, self.seed)
        except (DynidError, OSError) as error:
            done.status, done.message = int(getattr(error, "status", ExitStatus.INPUT)), str(error)
            return done
        before = None if self.force else _record(done.folder, key)
        if before is not None:
            done.status, done.answers, done.message, done.reused = *before, True
            return done
        start = time.perf_counter()
        for name, words in commands(job, done.folder):
            status, answer, message = self._command([name, *words], done.folder)
            done.status = max(done.status, status)
            done.message = done.message or message
            if answer is not None:
                done.answers.setdefault(name, []).append(answer)
            if status > ExitStatus.LIMIT_NOT_MET:
                break
        done.seconds = time.perf_counter() - start
        if not done.failed:
            _write_record(done, key)
        return done

    def _command(self, words: list[str], folder: Path) -> tuple[int, dict[str, Any] | None, str]:
        """Run one command and return its exit status, its JSON answer and the line that says what is wrong."""
        folder.mkdir(parents=True, exist_ok=True)
        own = [sys.executable, "-m", "dynid", *words, "--json", "--no-input", "--force", "--seed", str(self.seed)]
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
                env=os.environ | threads,
            )
            self._running.add(process)
        answer, said = process.communicate()
        with self._lock:
            self._running.discard(process)
        with (folder / "run.log").open("a", encoding="utf-8") as log:
            log.write(f"$ dynid {' '.join(words)}\n{said}")
        found = json.loads(answer) if answer.strip() else None
        return process.returncode, found, _complaint(said) if process.returncode else ""


def _complaint(said: str) -> str:
    """Return the line that tells what is wrong."""
    for start in ("error[", "limit "):
        for line in said.splitlines():
            if line.startswith(start):
                return line
    lines = said.strip().splitlines()
    return lines[-1] if lines else "it said nothing"


def commands(job: Job, folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the commands of a job: name and words."""
    words = [job.robot, *map(str, job.logs), "--out", str(folder)]
    for key, value in job.options.items():
        flag = f"--{key.replace('_', '-')}"
        words += [flag] if value == "true" else [] if value == "false" else [flag, value]
    for limit in job.fail_if:
        words += ["--fail-if", limit]
    yield "identify", words
    result = str(folder / "parameters.npz")
    for log in job.validate:
        most = ["--max-unexplained", job.max_unexplained] if job.max_unexplained else []
        yield "validate", [result, str(log), "--no-plot", *most]
    if job.baseline is not None:
        within = ["--tolerance", job.tolerance] if job.tolerance else []
        yield "compare", [result, "--baseline", str(job.baseline), *within]


def job_key(job: Job, seed: int) -> str:
    """Return the hash of everything a job depends on: its text, its files, the robot, the program."""
    from dynid.files.artifact import sha256
    from dynid.files.logs import read_log
    from dynid.files.robotfile import find_robot, load_robot

    files = [find_robot(job.robot), *job.logs, *job.validate]
    if job.baseline is not None:
        files.append(job.baseline / "parameters.npz" if job.baseline.is_dir() else job.baseline)
    for log in (*job.logs, *job.validate):
        if not log.exists():
            read_log(log, robot=load_robot(job.robot))
    facts = {"job": asdict(job), "seed": seed, "dynid": __version__, "files": [sha256(file) for file in files]}
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()


def _record(folder: Path, key: str) -> tuple[int, dict[str, list[dict[str, Any]]], str] | None:
    """Return status, answers and message of a job done before from the same inputs."""
    try:
        found = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        if found["key"] == key and (folder / "parameters.npz").is_file():
            return int(found["status"]), dict(found["answers"]), str(found["message"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    return None


def _write_record(done: Done, key: str) -> None:
    from dynid.files.artifact import write_text

    facts = {"key": key, "status": done.status, "message": done.message, "answers": done.answers}
    write_text(done.folder / RECORD, json.dumps(facts, indent=1))
