"""A batch gives the same bytes wherever it runs, does nothing twice, and names what failed."""

import json
import os
from pathlib import Path

import pytest

from dynid.errors import PackageMissing, SchedulerSilent, WrongRobotFile, WrongUsage
from dynid.workflows import run as module
from dynid.workflows.run import RunOptions, run
from twolink import ROBOT, log


@pytest.fixture
def batch(dynid, monkeypatch):
    """Two good jobs, one beyond a limit, and one whose log is cut off, in the working folder."""
    folder = dynid.folder
    monkeypatch.chdir(folder)
    (folder / "arm.yaml").write_text(ROBOT)
    for k in range(3):
        log(k).save(folder / f"log{k}.npz")
    (folder / "cut.npz").write_bytes((folder / "log0.npz").read_bytes()[:2000])
    jobs = [{"name": f"job{k}", "robot": "arm.yaml", "logs": f"log{k}.npz"} for k in range(3)]
    jobs[2]["fail_if"] = "max_rms_nm > 1e-6"
    jobs.append({"name": "cut", "robot": "arm.yaml", "logs": "cut.npz"})
    (folder / "batch.yaml").write_text(json.dumps({"jobs": jobs}))
    return dynid


@pytest.mark.slow
def test_jobs_side_by_side_and_on_dask_give_the_same_bytes_and_the_failed_one_is_named(
    batch, monkeypatch
):
    """Its message and status stand in the table, and its status is that of the command."""
    from distributed import LocalCluster

    # Why: variables choose what a BLAS computes with, and the other jobs have none.
    for name in os.environ.keys() - batch.env.keys():
        monkeypatch.delenv(name)
    out = batch.folder / "out"
    ended = batch("run batch.yaml --jobs 1")
    out.rename(batch.folder / "one")
    assert ended.status == 3, ended.err
    assert "cut failed" in " ".join(ended.out.split())
    assert "error[E" in ended.out
    assert "cut.npz" in ended.out
    assert "2 of 4 passed, 1 beyond a limit, 1 failed" in ended.out
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        words = ("run", "batch.yaml", "--scheduler", cluster.scheduler_address, "--json")
        far = json.loads(batch.fresh(*words).out)
    out.rename(batch.folder / "two")
    near = json.loads(batch("run batch.yaml --jobs 4 --json").out)
    outcomes = ["passed", "passed", "beyond a limit", "failed"]
    for answer in (far, near):
        assert [job["outcome"] for job in answer["jobs"]] == outcomes
        assert [job["status"] for job in answer["jobs"]] == [0, 0, 1, 3]
        assert answer["jobs"][3]["message"].startswith("error[E")
        assert (answer["passed"], answer["beyond_limit"], answer["failed"]) == (2, 1, 1)
    one, two, three = (
        [(batch.folder / f"{name}/job{k}/parameters.npz").read_bytes() for k in range(3)]
        for name in ("one", "two", "out")
    )
    assert one == two == three
    assert b"cut.npz" in (batch.folder / "one/cut/run.log").read_bytes()


@pytest.mark.slow
def test_a_job_that_its_worker_cannot_do_fails_alone(batch, monkeypatch):
    def killed(job, *_):
        if job.name == "job1":
            raise RuntimeError("the worker died")
        return module.facts_of(job, Path("out"), 0)

    monkeypatch.setattr(module, "run_job", killed)
    told = []
    done = run(Path("batch.yaml"), RunOptions(jobs=2), Path("out"), [], lambda n, d: told.append(d))
    assert [each["status"] for each in done] == [0, 6, 0, 0]
    assert done[1]["message"] == "RuntimeError: the worker died"
    assert sorted(each["name"] for each in told) == ["cut", "job0", "job1", "job2"]


def test_what_cannot_run_is_refused_before_anything_does(batch, monkeypatch):
    def refused(**options):
        run(Path("batch.yaml"), RunOptions(**options), Path("out"), [], print)

    with pytest.raises(WrongUsage, match="no job 'job9'; did you mean"):
        refused(only=("job9",))
    monkeypatch.setattr(module, "PATIENCE", 1.0)
    with pytest.raises(SchedulerSilent, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        refused(scheduler="tcp://127.0.0.1:9")
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    with pytest.raises(PackageMissing) as error:
        refused(scheduler="tcp://host:8786")
    assert error.value.fix == "pip install 'dynid[cluster]'"
    Path("batch.yaml").write_text("jobs: [{robot: arm}]")
    with pytest.raises(WrongRobotFile, match="lacks the key 'logs'"):
        refused()
    assert not Path("out").exists()
