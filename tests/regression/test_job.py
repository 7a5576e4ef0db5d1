"""The regression job of docs/how-to/ci-regression.md on every log: it passes, on another BLAS too, and sees 2 %."""

import json
import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

pytestmark = [pytest.mark.data, pytest.mark.slow]
SHIPPED = Path(__file__).parents[2] / "trajectories"
#: Job, robot, log, and which of its joints (from 0) gets a torque column that is 2 % too large.
LOGS = (
    ("lwr_shipped", "kuka_lwr4plus", SHIPPED / "lwr4plus_identify.bag", 5),
    ("kinova_shipped", "kinova_gen2", SHIPPED / "kinova_gen2_identify.bag", 3),
    ("lwr", "kuka_lwr4plus", "kuka_lwr4plus/run1.bag", 6),
    ("ur10", "ur10", "ur10_salerno/exc.npz", 4),
    ("tx40", "staubli_tx40", "tx40/exc.npz", 0),
    ("panda", "franka_panda", "panda_salerno/exc.npz", 1),
)
#: OpenBLAS picks its kernels by processor; these round differently, as two machines do.
ONE = {"OPENBLAS_CORETYPE": "Haswell", "OPENBLAS_NUM_THREADS": "1"}
OTHER = {"OPENBLAS_CORETYPE": "Prescott", "OPENBLAS_NUM_THREADS": "2"}
#: Members of an answer that say when and where, not what.
ELSEWHERE = {"seconds", "folder", "wrote", "reused", "name", "command"}


def batch(path, logs, baseline=None):
    jobs = [
        {"name": name, "robot": robot, "logs": str(log)}
        | ({"baseline": f"{baseline}/{name}", "tolerance": "1%"} if baseline else {})
        for (name, robot, *_), log in logs
    ]
    path.write_text(json.dumps({"defaults": {"options": {"report": False}}, "jobs": jobs}))


@pytest.fixture(scope="module")
def job(workshop, recordings):
    """A folder where all logs were identified, and those results are what is expected from now on."""
    run = workshop()
    run.logs = [(row, recordings / row[2]) for row in LOGS]
    batch(run.folder / "first.yaml", run.logs)
    run.first = run.fresh("run first.yaml -o expected --json", **ONE).facts
    batch(run.folder / "batch.yaml", run.logs, baseline="expected")
    return run


def counts(path):
    """Return how many tests, failures and errors a file of JUnit has."""
    suite = ET.parse(path).getroot()
    return tuple(int(suite.get(key)) for key in ("tests", "failures", "errors"))


def verdict(answer, place=""):
    """Return what an answer says at each place, without when and where."""
    if not isinstance(answer, (dict, list)):
        return {place: answer}
    pairs = answer.items() if isinstance(answer, dict) else enumerate(answer)
    inner = [verdict(value, f"{place}/{key}") for key, value in pairs if key not in ELSEWHERE]
    return {f"{place} of {len(inner)}": 0} | {k: v for each in inner for k, v in each.items()}


def differences(one, other):
    """Return where two answers differ: words, counts and truths at all, numbers by more than rounding."""
    found = sorted(one.keys() ^ other.keys())
    for place in one.keys() & other.keys():
        pair = one[place], other[place]
        alike = pair[0] == pair[1] and type(pair[0]) is type(pair[1])
        if all(isinstance(each, float) for each in pair):
            alike = math.isclose(*pair, rel_tol=1e-6, abs_tol=1e-7)
        found += [] if alike else [f"{place}: {pair}"]
    return found


def test_the_job_passes_on_another_blas_with_the_same_verdicts(job):
    """Ranks, classes, findings, choices and outcomes are the same; numbers differ by rounding."""
    ended = job.fresh("run batch.yaml -o again --json --junit again.xml", **OTHER)
    answer = ended.facts
    assert [each["outcome"] for each in answer["jobs"]] == ["passed"] * len(LOGS)
    assert counts(job.folder / "again.xml") == (len(LOGS), 0, 0)
    for one, other in zip(job.first["jobs"], answer["jobs"], strict=True):
        assert differences(*(verdict(x["answers"]["identify"]) for x in (one, other))) == []


def test_a_torque_column_times_1_02_fails_in_every_log(job):
    """Each failure names the joint whose column it was."""
    logs = []
    for row, log in job.logs:
        where = f"scaled_{row[0]}"
        if log.suffix == ".bag":
            assert job(f"check {log} --robot {row[1]} --convert -o {where}").good
            log = job.folder / where / "log.npz"
        with np.load(log) as archive:
            arrays = dict(archive)
        key = "tau" if "tau" in arrays else "tau_motor"
        arrays[key] = arrays[key] * np.where(np.arange(arrays[key].shape[1]) == row[3], 1.02, 1.0)
        np.savez(job.folder / f"{where}.npz", **arrays)
        logs.append((row, job.folder / f"{where}.npz"))
    batch(job.folder / "scaled.yaml", logs, baseline="expected")
    ended = job.fresh("run scaled.yaml -o scaled --json --junit scaled.xml", **ONE)
    assert ended.status == 1, ended.err
    answer = json.loads(ended.out)
    assert [each["outcome"] for each in answer["jobs"]] == ["beyond a limit"] * len(LOGS)
    assert counts(job.folder / "scaled.xml") == (len(LOGS), len(LOGS), 0)
    for row, each in zip(LOGS, answer["jobs"], strict=True):
        changes = each["answers"]["compare"][0]["comparisons"][0]["beyond_tolerance"]
        moved = [one["name"] for one in changes if one["name"].endswith(" torque_rms_nm")]
        wanted = each["answers"]["identify"][0]["joints"][row[3]]["joint"]
        assert moved == [f"{wanted} torque_rms_nm"]
