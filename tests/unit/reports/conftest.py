"""A small run with names that would be elements, and a motion of noise, for the tests of the report."""

from dataclasses import replace

import numpy as np
import pytest

from dynid import identify, load_robot, simulate
from dynid.errors import Finding
from dynid.estimation.evidence import evidence_of
from dynid.estimation.identified import JointQuality
from dynid.estimation.prediction import EstimatedMotion, check
from dynid.judgement import evidence
from dynid.judgement.rules import judge
from dynid.reports.gathered import Gathered, ValidatedLog
from dynid.sim.sines import SineSpec, sines

NASTY = '<b>x & "y"</b>'


def waves(n, residual):
    t = np.linspace(0, 10, 400)
    wave = np.sin(t[:, None] * np.arange(1, n + 1))
    return EstimatedMotion(t, *(wave,) * 6, wave + residual, wave, wave < 2, 0 * t)


@pytest.fixture(scope="module")
def robot():
    return load_robot("scara")


@pytest.fixture(scope="module")
def motion(robot):
    """Different numbers for every quantity and joint; a gap of 2 s at 5 s."""
    t = np.concatenate([np.arange(0, 5, 0.01), np.arange(7, 10, 0.01)])
    rng = np.random.default_rng(0)
    arrays = [rng.normal(size=(len(t), robot.n)) for _ in range(8)]
    return EstimatedMotion(t, *arrays, arrays[0] < np.inf, 0 * t)


@pytest.fixture(scope="module")
def gathered(tmp_path_factory):
    robot = load_robot("scara")
    first, *others = robot.joints
    robot = replace(robot, name=NASTY, joints=(replace(first, name=NASTY), *others))
    rng = np.random.default_rng(0)
    motion = sines(robot, SineSpec(10.0, 5.0, 0.8, 0.9, 0.9, -np.inf), 0.005, rng)
    found = identify(robot, simulate(robot, motion).log, holdout=None)
    header = {"command": f"dynid identify {NASTY}", "logs": [NASTY], "log_findings": []}
    header |= {"dynid": "0.1.0", "cutoff_hz": 5.0, "log_sha256": ["ab" * 32]}
    stored = replace(
        found,
        joints=tuple(JointQuality(j.name, 0.01, 1.4, 0.7, None) for j in robot.joints),
        knowledge=("not determined", *found.knowledge[1:]),
        findings=(Finding("W402", "warning", NASTY),),
        header=header,
        path=tmp_path_factory.mktemp("run") / "parameters.npz",
    )
    seen, unseen = (waves(robot.n, size * rng.normal(size=(400, robot.n))) for size in (0.01, 0.02))
    checks, percent = check(unseen, unseen.tau_measured, robot.joint_names)
    other = ValidatedLog(NASTY, unseen, percent, np.array([one.relative_percent for one in checks]))
    replayed = replace(evidence_of(stored), unseen=(evidence.Unseen(NASTY, other.percent),))
    singular = np.logspace(0, -2, len(stored.names))
    return Gathered(stored, judge(replayed), seen, (other,), singular, None)
