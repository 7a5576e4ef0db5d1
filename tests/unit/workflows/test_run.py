"""A batch gives the same bytes wherever it runs, does nothing twice, and names what failed."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from two_link_logs import ROBOT, log
from worker_calls import call, die, die_once, half, nap

from dynid.cli.main import run as command
from dynid.errors import PackageMissing, SchedulerSilent, WorkersDied, WrongUsage
from dynid.workflows import cluster, tuning
from dynid.workflows.cluster import mapped, opened
from dynid.workflows.run import RunOptions, run


@pytest.fixture
def batch(tmp_path, monkeypatch):
    """Three good jobs and one whose log is cut off, in the working folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.yaml").write_text(ROBOT)
    for k in range(3):
        log(k).save(tmp_path / f"log{k}.npz")
    (tmp_path / "cut.npz").write_bytes((tmp_path / "log0.npz").read_bytes()[:2000])
    jobs = "".join(f"  - {{name: job{k}, robot: arm.yaml, logs: log{k}.npz}}\n" for k in range(3))
    path = tmp_path / "batch.yaml"
    path.write_text(f"jobs:\n{jobs}  - {{name: cut, robot: arm.yaml, logs: cut.npz}}\n")
    return path


def files(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_two_workers_and_one_process_give_the_same_bytes_and_nothing_is_done_twice(batch):
    one = run(Path("batch.yaml"), command, RunOptions(jobs=1))
    here = files(Path("out"))
    for path in Path("out").rglob("*"):
        if path.is_file():
            path.unlink()
    two = run(Path("batch.yaml"), command, RunOptions(jobs=2))
    assert files(Path("out")) == here
    assert {"job0/parameters.npz", "job0/job.json", "job0/run.log"} <= here.keys()
    assert [done.status for done in two.jobs] == [done.status for done in one.jobs]
    before = {path: path.stat().st_mtime_ns for path in Path("out").rglob("parameters.npz")}
    again = run(Path("batch.yaml"), command, RunOptions(jobs=1))
    assert [done.reused for done in again.jobs] == [True, True, True, False]
    assert [done.answers for done in again.jobs] == [done.answers for done in two.jobs]
    assert {path: path.stat().st_mtime_ns for path in Path("out").rglob("parameters.npz")} == before


def test_the_log_that_failed_is_named_with_what_is_wrong(batch):
    told = []
    found = run(Path("batch.yaml"), command, RunOptions(jobs=1), told=told.append)
    (broken,) = found.failed
    assert broken.job.name == "cut"
    assert "cut.npz" in broken.message
    assert broken.message.startswith("error[E")
    assert found.passed == 3
    assert [done.job.name for done in told] == ["job0", "job1", "job2", "cut"]
    assert "cut.npz" in Path("out/cut/run.log").read_text()


def test_a_command_of_a_job_changes_nothing_in_the_process_that_runs_it(batch, monkeypatch):
    monkeypatch.setenv("DYNID_COLOR", "never")
    import dynid.reports.figures  # noqa: F401 - Matplotlib sets variables of its own

    before = (sys.argv, sys.stdout, sys.stderr, Path.cwd(), dict(os.environ))
    run(Path("batch.yaml"), command, RunOptions(jobs=1, only=("job0",)))
    assert (sys.argv, sys.stdout, sys.stderr, Path.cwd(), dict(os.environ)) == before


@pytest.mark.parametrize(
    ("text", "size"), [("4GB", 4e9), ("500 MiB", 500 * 2**20), ("1.5T", 1.5e12), ("2000", 2000)]
)
def test_sizes_of_memory_are_read_as_they_are_written(text, size):
    assert RunOptions(memory=text).memory == size


@pytest.mark.parametrize("text", ["much", "-1GB", "4XB", "0"])
def test_what_is_no_size_of_memory_is_refused(text):
    with pytest.raises(WrongUsage, match="--memory"):
        RunOptions(memory=text)


# ---------------------------------------------------------------- workers
@pytest.fixture(autouse=True)
def importable(monkeypatch):
    """Let the workers find the functions of worker_calls; they put dynid's own folder in place of the first one."""
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join(["/", str(Path(__file__).parent), *sys.path[1:]])
    )


def test_calls_return_or_raise_alike_here_and_by_workers():
    def told(client):
        return {k: (value, str(error)) for k, value, error in mapped(client, half, range(6))}

    with opened(1) as nobody, opened(2) as client:
        assert nobody is None
        assert told(nobody) == told(client)
        assert told(client)[3] == (None, "broken")


@pytest.mark.filterwarnings("ignore")
def test_what_was_not_done_is_done_again_by_a_scheduler_that_came_back():
    from distributed import Client, LocalCluster

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]

    def started():
        return LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=False,
            scheduler_port=port,
            dashboard_address="127.0.0.1:0",
        )

    said, found = [], {}
    cluster = started()

    class Said:
        def stage(self, name, text=""):
            said.append(name)

    with Client(cluster.scheduler_address, set_as_default=False) as client:
        for k, value, _ in mapped(client, nap, range(12), progress=Said()):
            found[k] = value
            if len(found) == 3:
                cluster.close(timeout=1)
                cluster = started()
    cluster.close(timeout=1)
    assert found == {k: k for k in range(12)}
    assert said == ["scheduler"]


def test_a_worker_that_is_killed_loses_nothing_and_one_call_that_kills_all_is_named(tmp_path):
    functions = [die_once, die_once, die]
    with opened(2) as client:
        found = {
            k: (value, error)
            for k, value, error in mapped(client, call, functions, [tmp_path] * 3, range(3))
        }
    assert found[0] == (0, None)
    assert found[1] == (1, None)
    assert isinstance(found[2][1], WorkersDied)


def test_the_processes_end_with_the_block_and_listen_to_this_machine_only():
    import psutil

    before = psutil.Process().children(recursive=True)
    with opened(2) as client:
        client.wait_for_workers(2)
        started = [each for each in psutil.Process().children(recursive=True) if each not in before]
        workers = [each for each in started if "spawn_main" in " ".join(each.cmdline())]
        ports = [
            c.laddr.ip for each in started for c in each.net_connections() if c.status == "LISTEN"
        ]
    assert set(ports) == {"127.0.0.1"}
    assert len(workers) == 2
    _, alive = psutil.wait_procs(started, timeout=5)
    assert [each.cmdline() for each in alive] == []


SCRIPT = """
from pathlib import Path
from dynid.cli.main import run as command
from dynid.workflows.run import RunOptions, run
with open("started", "a") as file:
    file.write("once ")
print(run(Path("batch.yaml"), command, RunOptions(jobs=2)).passed)
"""


def test_a_script_without_a_guard_is_started_once(batch):
    Path("script.py").write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, "script.py"], capture_output=True, text=True, timeout=120
    )
    assert (done.stdout, done.stderr) == ("3\n", "")
    assert Path("started").read_text() == "once "


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_process_outlives_a_batch_that_is_interrupted_or_killed(batch, number):
    import psutil

    words = [sys.executable, "-m", "dynid", "run", "batch.yaml", "--jobs", "2"]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    every, started, spawned = psutil.Process(process.pid), [], 0
    while process.poll() is None and spawned < 2:
        time.sleep(0.05)
        # A process may end between being listed and being asked.
        with suppress(psutil.Error):
            started = every.children(recursive=True)
            spawned = sum("spawn_main" in " ".join(each.cmdline()) for each in started)
    process.send_signal(number)
    assert process.wait(20) in (130, -signal.SIGKILL)
    _, alive = psutil.wait_procs(started, timeout=5)
    assert alive == []


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch):
    monkeypatch.setattr(tuning, "SCHEDULER_PATIENCE", 0.3)
    with (
        pytest.raises(SchedulerSilent, match=r"tcp://127\.0\.0\.1:9"),
        opened(1, scheduler="tcp://127.0.0.1:9"),
    ):
        pass


def test_without_dask_jobs_run_one_after_another_and_a_scheduler_is_refused(monkeypatch):
    monkeypatch.setattr(cluster, "find_spec", lambda name: None)
    with opened(4) as client:
        assert client is None
    with pytest.raises(PackageMissing) as error, opened(4, scheduler="tcp://host:8786"):
        pass
    assert error.value.fix == "pip install 'dynid[cluster]'"
