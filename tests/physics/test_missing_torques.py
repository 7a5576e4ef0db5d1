"""A spring that the model lacks, on an arm that Pinocchio moves: single tones are fitted, another motion is judged."""

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
RATE, JOINT = 200.0, 3
VISCOUS, COULOMB = np.array([3.0, 3, 2, 2, 1, 1, 0.5]), np.array([2.0, 2, 1.5, 1.5, 0.8, 0.6, 0.4])


def recorded(seed, tones, stiffness, seconds=16.0):
    """Sums of sines of every joint, white noise of the torques, and a spring at the fourth joint [N m/rad]."""
    rng, n = np.random.default_rng(seed), ROBOT.n
    t = np.arange(round(seconds * RATE)) / RATE
    f, phase = rng.uniform(0.1, 0.3 if tones == 1 else 0.5, (2, tones, n))
    size, w = rng.uniform(0.6, 1.0, (tones, n)) * 1.2 / tones, 2 * np.pi * f
    angle = w * t[:, None, None] + 2 * np.pi * phase
    q, qd = (size * np.sin(angle)).sum(1), (size * w * np.cos(angle)).sum(1)
    tau = pinocchio_torques(ENGINE, q, qd, (-size * w**2 * np.sin(angle)).sum(1))
    tau = tau + VISCOUS * qd + COULOMB * np.tanh(qd / 0.003) + 0.1 * rng.normal(size=q.shape)
    tau[:, JOINT] += stiffness * (q[:, JOINT] - 0.3)
    return Log(t, q, tau, ROBOT.joint_names, tau_unit="Nm", dh=True)


@pytest.fixture(scope="module")
def sprung():
    return recorded(1, 1, 40.0)


def test_a_large_spring_is_named_and_predicted_on_another_motion_where_a_plain_fit_is_worthless(
    sprung,
):
    options = IdentifyOptions(holdout=None)
    found = identify(ROBOT, sprung, options)
    assert found.in_force == "physical"
    assert found.model_error.free.tolist() == [JOINT]
    named = [finding for finding in found.findings if finding.code == "W404"]
    assert [finding.evidence["joint"] for finding in named] == [ROBOT.joint_names[JOINT]]
    other = recorded(2, 4, 40.0)
    seen = validate(found, other).relative_error_percent
    plain = validate(
        identify(ROBOT, sprung, replace(options, feasible=False)), other
    ).relative_error_percent
    alone = validate(
        identify(ROBOT, sprung, replace(options, feasible=True, residual_model=False)), other
    )
    assert seen < 4.0
    assert plain > 4 * seen
    assert alone.relative_error_percent > 4 * seen


def test_held_out_rows_are_judged_with_the_same_joint_free(sprung):
    found = identify(ROBOT, sprung, IdentifyOptions(holdout=0.2))
    assert found.heldout_relative_error_percent < 4.0


def test_an_arm_without_a_spring_has_no_large_torque():
    found = identify(ROBOT, recorded(1, 1, 0.0), IdentifyOptions(holdout=None))
    assert found.in_force == "physical"
    assert found.model_error is None
    assert not [finding for finding in found.findings if finding.code == "W404"]


def test_where_a_possible_arm_is_contradicted_it_is_in_force_and_that_is_said(sprung):
    found = identify(ROBOT, sprung, IdentifyOptions(holdout=None, residual_model=False))
    assert found.in_force == "physical"
    assert "W404" in [finding.code for finding in found.findings]
