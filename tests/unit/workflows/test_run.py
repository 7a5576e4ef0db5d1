"""A batch gives the same bytes wherever it runs, does nothing twice, and names what failed."""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress
from pathlib import Path

import pytest
from two_link_logs import ROBOT, log

from dynid.errors import PackageMissing, SchedulerSilent, WorkersDied, WrongUsage
from dynid.workflows import cluster
from dynid.workflows.cluster import Cluster, Here, Of, Task, opened
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
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_two_workers_and_one_process_give_the_same_bytes_and_nothing_is_done_twice(batch):
    one = run(Path("batch.yaml"), RunOptions(jobs=1))
    here = files(Path("out"))
    for path in Path("out").rglob("*"):
        if path.is_file():
            path.unlink()
    two = run(Path("batch.yaml"), RunOptions(jobs=2))
    assert files(Path("out")) == here
    assert {"job0/parameters.npz", "job0/job.json", "job0/run.log"} <= here.keys()
    assert [done.status for done in two.jobs] == [done.status for done in one.jobs]
    before = {path: path.stat().st_mtime_ns for path in Path("out").rglob("parameters.npz")}
    again = run(Path("batch.yaml"), RunOptions(jobs=1))
    assert [done.reused for done in again.jobs] == [True, True, True, False]
    assert [done.answers for done in again.jobs] == [done.answers for done in two.jobs]
    assert {path: path.stat().st_mtime_ns for path in Path("out").rglob("parameters.npz")} == before


def test_the_log_that_failed_is_named_with_what_is_wrong(batch):
    told = []
    found = run(Path("batch.yaml"), RunOptions(jobs=1), told=told.append)
    (broken,) = found.failed
    assert broken.job.name == "cut"
    assert "cut.npz" in broken.message
    assert broken.message.startswith("error[E")
    assert found.passed == 3
    assert [done.job.name for done in told] == ["job0", "job1", "job2", "cut"]
    assert "cut.npz" in Path("out/cut/run.log").read_text()


def test_a_command_of_a_job_changes_nothing_in_the_process_that_runs_it(batch, monkeypatch):
    import sys

    monkeypatch.setenv("DYNID_COLOR", "never")
    before = (sys.argv, sys.stdout, sys.stderr, Path.cwd(), dict(os.environ))
    run(Path("batch.yaml"), RunOptions(jobs=1, only=("job0",)))
    assert (sys.argv, sys.stdout, sys.stderr, Path.cwd(), dict(os.environ)) == before


@pytest.mark.parametrize(("text", "size"), [("4GB", 4e9), ("500 MiB", 500 * 2**20), ("1.5T", 1.5e12), ("2000", 2000)])
def test_sizes_of_memory_are_read_as_they_are_written(text, size):
    assert RunOptions(memory=text).memory == size


@pytest.mark.parametrize("text", ["much", "-1GB", "4XB", "0"])
def test_what_is_no_size_of_memory_is_refused(text):
    with pytest.raises(WrongUsage, match="--memory"):
        RunOptions(memory=text)


# ---------------------------------------------------------------- pools
def graph():
    """A tree of sums over eight numbers."""
    tasks = {f"leaf {k}": Task(float, (k,)) for k in range(8)}
    tasks |= {f"pair {k}": Task(_add, ([Of(f"leaf {2 * k}"), Of(f"leaf {2 * k + 1}")],)) for k in range(4)}
    return tasks | {"sum": Task(_add, ([Of(f"pair {k}") for k in range(4)],))}


def _add(numbers):
    return sum(numbers)


def _fail(text):
    raise ValueError(text)


def test_tasks_that_rest_on_others_get_their_results_and_their_mistakes():
    (done,) = Here().run(graph(), ["sum"])
    assert done.value == 28
    tasks = {"bad": Task(_fail, ("broken",)), "sum": Task(_add, ([Of("bad")],)), "other": Task(_add, ([1, 2],))}
    bad, other = Here().run(tasks, ["sum", "other"])
    assert str(bad.error) == "broken"
    assert other.value == 3


def in_process(workers=2):
    from distributed import LocalCluster

    return LocalCluster(n_workers=workers, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0")


@pytest.mark.filterwarnings("ignore")
def test_what_was_not_done_is_done_again_by_the_next_scheduler():
    """Each scheduler but the last is lost while it works."""
    from distributed import Client

    lost, said = [in_process()], []

    class Said:
        def stage(self, name, text=""):
            said.append(name)

    def connect():
        return Client(lost[-1], set_as_default=False)

    pool = Cluster(connect, "test", Said())
    tasks = {f"nap {k}": Task(_nap, (k,)) for k in range(12)}
    found = {}
    for done in pool.run(tasks, list(tasks)):
        found[done.name] = done.value
        if len(found) == 3:
            lost.append(in_process())
            lost[0].close(timeout=1)
    pool.close()
    lost[-1].close(timeout=1)
    assert found == {f"nap {k}": k for k in range(12)}
    assert said == ["scheduler"]


def _nap(k):
    time.sleep(0.1)
    return k


def _die_once(folder, k):
    """Kill the worker that does this for the first time."""
    mark = Path(folder) / f"done{k}"
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return k


def _die():
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_worker_that_is_killed_loses_nothing_and_one_task_that_kills_all_is_named(tmp_path, monkeypatch):
    # Enough that a task which waits behind the killer now and then does not die with it every time.
    monkeypatch.setattr(cluster, "DEATHS", 8)
    tasks = {f"task {k}": Task(_die_once, (str(tmp_path), k)) for k in range(2)} | {"killer": Task(_die)}
    with opened(2) as pool:
        found = {done.name: done for done in pool.run(tasks, list(tasks))}
    assert [found[f"task {k}"].value for k in range(2)] == [0, 1]
    assert isinstance(found["killer"].error, WorkersDied)


def test_the_processes_end_with_the_block_and_listen_to_this_machine_only():
    import psutil

    with opened(2) as pool:
        assert "2 processes" in pool.text
        deadline, workers, ports = time.monotonic() + 30, [], []
        while len(workers) < 2 and time.monotonic() < deadline:
            with suppress(psutil.NoSuchProcess):
                every = [psutil.Process(), *psutil.Process().children(recursive=True)]
                workers = [each for each in every if "spawn_main" in " ".join(each.cmdline())]
                ports = [c.laddr.ip for each in every for c in each.net_connections() if c.status == "LISTEN"]
    assert set(ports) == {"127.0.0.1"}
    assert len(workers) == 2
    _, alive = psutil.wait_procs(workers, timeout=5)
    assert alive == []


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch):
    monkeypatch.setattr(cluster, "FIRST_ANSWER", 0.3)
    with pytest.raises(SchedulerSilent, match=r"tcp://127\.0\.0\.1:9"), opened(1, scheduler="tcp://127.0.0.1:9"):
        pass


def test_without_dask_jobs_run_one_after_another_and_a_scheduler_is_refused(monkeypatch):
    monkeypatch.setattr(cluster, "find_spec", lambda name: None)
    with opened(4) as pool:
        assert isinstance(pool, Here)
    with pytest.raises(PackageMissing) as error, opened(4, scheduler="tcp://host:8786"):
        pass
    assert error.value.fix == "pip install 'dynid[cluster]'"
