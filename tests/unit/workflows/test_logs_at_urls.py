"""Logs at URLs are fetched once, as far as they may be, and give what files give."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from two_link_logs import ROBOT, log

from dynid import limits, load
from dynid.cli.main import run as command
from dynid.errors import ExitStatus, LogNotFound, PackageMissing, TooLarge
from dynid.files import remote
from dynid.workflows.run import RunOptions, run


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A working folder with an arm and two of its logs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.yaml").write_text(ROBOT)
    for k in range(2):
        log(k).save(tmp_path / f"log{k}.npz")


def identified(logs, out):
    job = (
        f"{{name: many, robot: arm.yaml, logs: {logs}, validate: log1.npz, options: {{cutoff: 5}}}}"
    )
    Path("batch.yaml").write_text(f"jobs: [{job}]")
    (done,) = run(Path("batch.yaml"), command, RunOptions(jobs=1), out=Path(out)).jobs
    assert done.status == ExitStatus.DONE, done.message
    return done


def test_logs_at_a_url_are_fetched_once_and_give_the_same_parameters(tmp_path):
    import fsspec

    store = fsspec.filesystem("memory")
    store.pipe("/lab/log0.npz", Path("log0.npz").read_bytes())
    identified("log0.npz", "files")
    done = identified("['memory://lab/log0.npz']", "urls")
    assert done.job.logs[0] == "memory://lab/log0.npz"
    np.testing.assert_array_equal(load(Path("urls/many")).theta, load(Path("files/many")).theta)
    identified(f"'file://{tmp_path}/log0.npz'", "here")
    copy = next(Path("urls/many/logs").rglob("log0.npz"))
    stamp = copy.stat().st_mtime_ns
    assert remote.fetch("memory://lab/log0.npz", copy.parent) == copy
    assert copy.stat().st_mtime_ns == stamp
    store.pipe("/lab/log0.npz", b"another")
    remote.fetch("memory://lab/log0.npz", copy.parent)
    assert copy.read_bytes() == b"another"


def test_what_is_not_there_or_no_url_of_a_recording_is_named(tmp_path):
    with pytest.raises(LogNotFound, match=r"memory://lab/nothing\.npz"):
        remote.fetch("memory://lab/nothing.npz", tmp_path)
    with pytest.raises(PackageMissing, match="gs://"):
        remote.fetch("gs://lab/log.npz", tmp_path)
    for url in (
        "nosuch://lab/log.npz",
        "reference://::memory://lab",
        "zip://log0.npz::memory://lab/x.zip",
    ):
        with pytest.raises(LogNotFound, match="not the URL of a recording"):
            remote.fetch(url, tmp_path)


def test_what_does_not_end_is_not_fetched_to_its_end(tmp_path):
    import fsspec

    fsspec.filesystem("memory").pipe("/lab/long.npz", bytes(5 << 20))
    with (
        limits.raised({"fetched_bytes": 3 << 20}),
        pytest.raises(TooLarge, match="a recording at a URL"),
    ):
        remote.fetch("memory://lab/long.npz", tmp_path)
    assert not (tmp_path / "long.npz").exists()
    with pytest.raises(LogNotFound, match="no regular file"):
        remote.fetch("file:///dev/zero", tmp_path)
