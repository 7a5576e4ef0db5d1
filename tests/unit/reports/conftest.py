"""A small run with names that would be elements, and a motion of noise, for the tests of the report."""

from dataclasses import replace

import numpy as np
import pytest

import models
from dynid import Identification, load_robot
from dynid.errors import Finding
from dynid.estimation.evidence import evidence_of
from dynid.estimation.identified import ExpectedError, JointQuality
from dynid.estimation.least_squares import Fit
from dynid.estimation.possible_arm import PhysicalParameters
from dynid.estimation.prediction import EstimatedMotion, check
from dynid.judgement import evidence
from dynid.judgement.rules import judge
from dynid.model.parameters import columns_of
from dynid.model.regressor import prior_vector
from dynid.reports.gathered import Gathered, ValidatedLog

NASTY = '<b>x & "y"</b>'


def waves(n, residual):
    t = np.linspace(0, 10, 400)
    wave = np.sin(t[:, None] * np.arange(1, n + 1))
    return EstimatedMotion(t, *(wave,) * 6, wave + residual, wave, np.ones(wave.shape, dtype=bool))


@pytest.fixture(scope="module")
def robot():
    return load_robot("scara")


@pytest.fixture(scope="module")
def motion(robot):
    """Different numbers for every quantity and joint; a gap of 2 s at 5 s."""
    t = np.concatenate([np.arange(0, 5, 0.01), np.arange(7, 10, 0.01)])
    rng = np.random.default_rng(0)
    arrays = [rng.normal(size=(len(t), robot.n)) for _ in range(8)]
    return EstimatedMotion(t, *arrays, np.ones((len(t), robot.n), dtype=bool))


@pytest.fixture(scope="module")
def gathered(tmp_path_factory):
    robot = load_robot("scara")
    robot = replace(
        robot, name=NASTY, joints=(replace(robot.joints[0], name=NASTY), *robot.joints[1:])
    )
    base = models.base_of(robot)
    model, reduction = base.model, base.reduction
    p, c = reduction.rank, len(reduction.names)
    x = prior_vector(model)
    x[columns_of(model.parameters, "Im")] = 0.05
    theta = reduction.K @ x
    physical = PhysicalParameters(
        reduction.names,
        x,
        np.linspace(0, 1, c),
        objective=2.0,
        covariance=0.01 * np.eye(c),
        information=np.eye(c),
        prior=np.zeros((c, c)),
    )
    error = np.where(np.arange(p) == 0, np.inf, 0.01)
    rng = np.random.default_rng(0)
    seen, unseen = (waves(robot.n, size * rng.normal(size=(400, robot.n))) for size in (0.01, 0.02))
    found = Identification(
        robot=robot,
        reduction=reduction,
        why="because",
        theta=theta,
        covariance=0.0001 * np.eye(p),
        fit=Fit(
            "wls",
            theta,
            np.full(robot.n, 0.01),
            0.0001 * np.eye(p),
            np.tile(np.eye(p + 1), (robot.n, 1, 1)),
            np.zeros(robot.n, int),
        ),
        std_error=error,
        knowledge=("not determined", *("well",) * (p - 1)),
        prior=np.full(p, np.nan),
        joints=tuple(JointQuality(j.name, 0.01, 1.4, 0.7, None) for j in robot.joints),
        relative_error_percent=1.4,
        heldout_relative_error_percent=None,
        heldout="nothing held out",
        rank=p,
        condition_number=50.0,
        condition_number_scaled=30.0,
        samples=400,
        expected=ExpectedError(1.5, 2.0, np.full(robot.n, 0.01)),
        physical=physical,
        in_force="physical",
        findings=(Finding("W402", "warning", NASTY),),
    )
    folder = tmp_path_factory.mktemp("run")
    header = {
        "command": f"dynid identify {NASTY}",
        "logs": [NASTY],
        "log_findings": [],
        "dynid": "0.1.0",
    }
    header |= {"cutoff_hz": 5.0, "log_sha256": ["ab" * 32]}
    stored = replace(found, header=header, path=folder / "parameters.npz")
    checks, percent = check(unseen, unseen.tau_measured, robot.joint_names)
    other = ValidatedLog(NASTY, unseen, percent, np.array([one.relative_percent for one in checks]))
    replayed = replace(evidence_of(stored), unseen=(evidence.Unseen(NASTY, other.percent),))
    return Gathered(stored, judge(replayed), seen, (other,), np.logspace(0, -2, p), None)
