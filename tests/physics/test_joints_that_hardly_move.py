"""A joint that crawls while all others move, and one whose torque is stuck, on an arm that Pinocchio moves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from arms import pinocchio_model, pinocchio_torques

from dynid import IdentifyOptions, Log, identify, load_robot
from dynid.sim.plant import read_plant
from dynid.workflows.validate import validate

PLANT = read_plant(Path(__file__).parents[2] / "trajectories" / "lwr4plus_truth.yaml")
ROBOT = load_robot("kuka_lwr4plus")
ENGINE = pinocchio_model(ROBOT, PLANT.bodies)
RATE, JOINT = 200.0, 4
VISCOUS, COULOMB = np.array([3.0, 3, 2, 2, 1, 1, 0.5]), np.array([2.0, 2, 1.5, 1.5, 0.8, 0.6, 0.4])
OTHERS = np.delete(np.arange(7), JOINT)


def recorded(seed, crawl=1.0, seconds=16.0):
    """Sums of four sines of every joint with white noise of the torques; one joint moves ``crawl`` times as far."""
    rng, n = np.random.default_rng(seed), ROBOT.n
    t = np.arange(round(seconds * RATE)) / RATE
    f, phase = rng.uniform(0.1, 0.5, (2, 4, n))
    size, w = (
        rng.uniform(0.2, 0.3, (4, n)) * np.where(np.arange(n) == JOINT, crawl, 1.0),
        2 * np.pi * f,
    )
    angle = w * t[:, None, None] + 2 * np.pi * phase
    q, qd = (size * np.sin(angle)).sum(1), (size * w * np.cos(angle)).sum(1)
    tau = pinocchio_torques(ENGINE, q, qd, (-size * w**2 * np.sin(angle)).sum(1))
    tau = tau + VISCOUS * qd + COULOMB * np.tanh(qd / 0.003) + 0.1 * rng.normal(size=q.shape)
    return Log(t, q, tau, ROBOT.joint_names, tau_unit="Nm", dh=True)


@pytest.fixture(scope="module")
def other():
    return recorded(2)


def check(found, other):
    """The other joints are as good as ever, and the error of the whole is no larger than was said."""
    seen = validate(found, other)
    errors = np.array([joint.rms for joint in seen.joints])
    assert found.in_force == "physical"
    assert np.all(errors[OTHERS] < 0.25)
    assert seen.relative_error_percent < 1.5 * seen.expected_percent
    known = dict(zip(found.physical.names, found.physical.x, strict=True))
    assert all(known[f"{kind}{JOINT + 1}"] >= 0.0 for kind in ("fv", "fc", "Im"))


@pytest.mark.parametrize("crawl", [0.012, 0.05])
def test_a_joint_that_crawls_is_answered_from_the_prior(other, crawl):
    """In the slower case no row of its own is left: all of them are near standstill."""
    found = identify(ROBOT, recorded(1, crawl), IdentifyOptions(holdout=None))
    check(found, other)
    assert "W406" in [finding.code for finding in found.findings]


def test_a_torque_that_is_stuck_leaves_its_joint_to_the_prior(other):
    log = recorded(1)
    tau = log.tau.copy()
    tau[:, JOINT] = 0.7
    check(identify(ROBOT, replace(log, tau=tau), IdentifyOptions(holdout=None)), other)
