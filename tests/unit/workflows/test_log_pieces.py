"""Logs in stretches give what one process finds, the same bytes wherever they run, from files and from URLs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from two_link_logs import ROBOT, log

from dynid import IdentifyOptions, identify, limits, load
from dynid.errors import ExitStatus, LogNotFound, PackageMissing, TooLarge, WrongRobotFile, WrongUsage
from dynid.files import remote
from dynid.files.batchfile import read_batch
from dynid.workflows.cluster import Task
from dynid.workflows.pieces import BRANCHES, added, options_in_pieces, tree
from dynid.workflows.run import RunOptions, run


@pytest.fixture
def batch(tmp_path, monkeypatch):
    """Three logs of an arm in stretches of three seconds, and a fourth to check with."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.yaml").write_text(ROBOT)
    for k in range(4):
        log(k).save(tmp_path / f"log{k}.npz")
    return write(tmp_path, "logs: [log0.npz, log1.npz, log2.npz]")


def write(folder, logs, options="{cutoff: 5}"):
    path = folder / "batch.yaml"
    path.write_text(
        f"jobs:\n  - {{name: many, robot: arm.yaml, {logs}, options: {options}, split_s: 3, validate: log3.npz,"
        " max_unexplained: 5%}\n"
    )
    return path


def files(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_one_process_and_two_workers_give_the_same_bytes(batch):
    (one,) = run(Path("batch.yaml"), RunOptions(jobs=1)).jobs
    here = files(Path("out"))
    for name in here:
        (Path("out") / name).unlink()
    (two,) = run(Path("batch.yaml"), RunOptions(jobs=2)).jobs
    assert one.status == two.status == ExitStatus.DONE, two.message
    assert files(Path("out")) == here
    (again,) = run(Path("batch.yaml"), RunOptions(jobs=1)).jobs
    assert again.reused
    assert again.answers == two.answers
    json.dumps(two.facts(), default=str, allow_nan=False)


def test_they_find_what_one_process_finds_from_all_rows(batch, arm):
    """Rows at the seams differ by one or two; estimates by a fraction of their errors."""
    (done,) = run(Path("batch.yaml"), RunOptions(jobs=1)).jobs
    found = load(Path("out/many"))
    whole = identify(arm, [log(k) for k in range(3)], IdentifyOptions(cutoff=5, delay=0.0, method="wls", holdout=None))
    assert found.names == whole.names
    assert np.all(np.abs(found.plain - whole.plain) < 0.5 * np.sqrt(np.diag(whole.plain_covariance)))
    ratio = np.sqrt(np.diag(found.plain_covariance) / np.diag(whole.plain_covariance))
    assert np.all((ratio > 0.5) & (ratio < 2.0))
    assert found.samples == pytest.approx(whole.samples, rel=0.05)
    assert found.log_sha256 == tuple(each.sha256 for each in map(_read, range(3)))
    assert found.heldout_relative_error_percent is not None
    assert done.relative_error("validate") < 2.0


def _read(k):
    from dataclasses import replace

    from dynid.files.logs import hash_of, read_npz_log

    return replace(read_npz_log(Path(f"log{k}.npz")), sha256=hash_of(Path(f"log{k}.npz")))


@pytest.mark.parametrize("members", [1, 5, BRANCHES, BRANCHES + 1, 3 * BRANCHES**2 + 7])
def test_every_stretch_is_in_the_tree_once(members):
    from dynid.workflows.cluster import Here

    tasks = {f"leaf {k}": Task(np.float64, (2.0**-k,)) for k in range(members)}
    top = tree(tasks, "sum", list(tasks), added)
    (done,) = Here().run(tasks, [top])
    assert done.value == sum(2.0**-k for k in range(members))


def test_logs_at_a_url_are_fetched_once_and_give_the_same_parameters(batch, tmp_path):
    import fsspec

    store = fsspec.filesystem("memory")
    for k in range(3):
        store.pipe(f"/lab/log{k}.npz", Path(f"log{k}.npz").read_bytes())
    run(Path("batch.yaml"), RunOptions(jobs=1), out=Path("files"))
    write(tmp_path, "logs: ['memory://lab/log0.npz', 'memory://lab/log1.npz', 'memory://lab/log2.npz']")
    (done,) = run(Path("batch.yaml"), RunOptions(jobs=1), out=Path("urls")).jobs
    assert done.status == ExitStatus.DONE, done.message
    assert done.job.logs[0] == "memory://lab/log0.npz"
    np.testing.assert_array_equal(load(Path("urls/many")).theta, load(Path("files/many")).theta)
    copy = next(Path("urls/many/logs").rglob("log0.npz"))
    stamp = copy.stat().st_mtime_ns
    assert remote.fetch("memory://lab/log0.npz", copy.parent) == copy
    assert copy.stat().st_mtime_ns == stamp
    store.pipe("/lab/log0.npz", b"another")
    remote.fetch("memory://lab/log0.npz", copy.parent)
    assert copy.read_bytes() == b"another"


def test_a_job_of_one_task_takes_urls_too(batch, tmp_path):
    Path("batch.yaml").write_text(
        f"jobs: [{{name: one, robot: arm.yaml, logs: 'file://{tmp_path}/log0.npz', options: {{cutoff: 5}}}}]"
    )
    (done,) = run(Path("batch.yaml"), RunOptions(jobs=1)).jobs
    assert done.status == ExitStatus.DONE, done.message
    with pytest.raises(LogNotFound, match=r"memory://lab/nothing\.npz"):
        remote.fetch("memory://lab/nothing.npz", tmp_path)
    with pytest.raises(PackageMissing, match="gs://"):
        remote.fetch("gs://lab/log.npz", tmp_path)
    for url in ("nosuch://lab/log.npz", "reference://::memory://lab", "zip://log0.npz::memory://lab/x.zip"):
        with pytest.raises(LogNotFound, match="no URL of a recording"):
            remote.fetch(url, tmp_path)


def test_what_does_not_end_is_not_fetched_to_its_end(batch, tmp_path):
    import fsspec

    fsspec.filesystem("memory").pipe("/lab/long.npz", bytes(5 << 20))
    with limits.raised({"fetched_bytes": 3 << 20}), pytest.raises(TooLarge, match="a recording at a URL"):
        remote.fetch("memory://lab/long.npz", tmp_path)
    assert not (tmp_path / "long.npz").exists()
    with pytest.raises(LogNotFound, match="no regular file"):
        remote.fetch("file:///dev/zero", tmp_path)


def test_the_broken_log_of_many_is_named(batch):
    Path("log1.npz").write_bytes(b"PK nothing")
    (done,) = run(Path("batch.yaml"), RunOptions(jobs=1)).jobs
    assert done.failed
    assert "log1.npz" in done.message
    assert not Path("out/many/parameters.npz").exists()


def test_the_same_log_twice_is_refused(batch, tmp_path):
    Path("log1.npz").write_bytes(Path("log0.npz").read_bytes())
    (done,) = run(Path("batch.yaml"), RunOptions(jobs=1)).jobs
    assert "are the same recording" in done.message


@pytest.mark.parametrize(("key", "value"), [("method", "iv"), ("holdout", "20%"), ("delay", "auto")])
def test_what_needs_all_rows_in_one_process_is_refused(key, value):
    with pytest.raises(WrongUsage, match="needs all rows in one process"):
        options_in_pieces({key: value})


@pytest.mark.parametrize("text", ["0", "-3", "long", "inf"])
def test_a_length_of_stretches_that_is_none_is_refused_with_its_line(tmp_path, text):
    (tmp_path / "batch.yaml").write_text(f"jobs:\n- {{robot: arm, logs: a.bag, split_s: {text}}}")
    with pytest.raises(WrongRobotFile, match=r"batch\.yaml:2: jobs\[0\]\.split_s = .* is no number of seconds"):
        read_batch(tmp_path / "batch.yaml")


def test_stretches_of_milliseconds_are_refused(tmp_path):
    (tmp_path / "batch.yaml").write_text("jobs:\n- {robot: arm, logs: a.bag, split_s: 0.001}")
    with pytest.raises(WrongRobotFile, match=r"split_s = 0\.001, but a stretch has at least 1 s"):
        read_batch(tmp_path / "batch.yaml")
