"""Logs that workers stack give the result that one process finds, byte for byte."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from two_link_logs import ROBOT, log

import dynid
from dynid.cli.main import run as command
from dynid.errors import DynidError
from dynid.workflows import parameters
from dynid.workflows.cluster import mapped, opened
from dynid.workflows.run import RunOptions, run


@pytest.mark.parametrize("workers", [2, 3])
def test_a_client_gives_the_same_bytes(arm, workers, tmp_path):
    logs = [log(k) for k in range(4)]
    dynid.identify(arm, logs).save(tmp_path / "here.npz")
    with opened(workers) as client:
        dynid.identify(arm, logs, client=client).save(tmp_path / "there.npz")
    assert (tmp_path / "there.npz").read_bytes() == (tmp_path / "here.npz").read_bytes()


def test_an_unfit_log_is_named_as_without_workers(arm, tmp_path):
    broken = dynid.Log(t=log(1).t, q=log(1).q * np.nan, tau=log(1).tau, names=("shoulder", "elbow"))
    with opened(2) as client:
        for given in (None, client):
            with pytest.raises(DynidError, match="position is not a number"):
                dynid.identify(arm, [log(0), broken], client=given)


def test_a_job_of_many_logs_is_spread_over_all_workers_to_the_same_bytes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("arm.yaml").write_text(ROBOT)
    for k in range(3):
        log(k).save(tmp_path / f"log{k}.npz")
    Path("batch.yaml").write_text(
        "jobs: [{name: many, robot: arm.yaml, logs: [log0.npz, log1.npz, log2.npz]}]"
    )
    found, workers_of = {}, []
    monkeypatch.setattr(
        parameters,
        "mapped",
        lambda *given, **more: workers_of.append(given[0]) or mapped(*given, **more),
    )
    for workers in (1, 2):
        done = run(Path("batch.yaml"), command, RunOptions(jobs=workers), out=Path("out"))
        assert done.passed == 1, done.jobs[0].message
        every = sorted(Path("out").rglob("*"))
        found[workers] = {path: path.read_bytes() for path in every if path.is_file()}
        for path in found[workers]:
            path.unlink()
    assert found[1] == found[2]
    assert len(workers_of) == 1
    assert workers_of[0] is not None
