"""A spring that the model lacks, on an arm that Pinocchio moves: single tones are fitted, another motion is judged."""

from dataclasses import replace

import pytest

from dynid import IdentifyOptions, identify, validate
from recorded_lwr import ROBOT, recorded

JOINT = 3


def sprung_log(seed, tones):
    """A log of the arm with a spring of 40 N m/rad at its fourth joint."""
    log = recorded(seed, tones)
    log.tau[:, JOINT] += 40.0 * (log.q[:, JOINT] - 0.3)
    return log


@pytest.fixture(scope="module")
def sprung():
    return sprung_log(1, 1)


@pytest.mark.slow
def test_a_large_spring_is_named_and_predicted_on_another_motion_where_a_plain_fit_is_worthless(
    sprung,
):
    options = IdentifyOptions(holdout=None)
    found = identify(ROBOT, sprung, options)
    assert found.in_force == "physical"
    assert found.model_error.free.tolist() == [JOINT]
    named = [finding for finding in found.findings if finding.code == "W404"]
    assert [finding.evidence["joint"] for finding in named] == [ROBOT.joint_names[JOINT]]
    other = sprung_log(2, 4)
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


@pytest.mark.slow
def test_held_out_rows_are_judged_with_the_same_joint_free(sprung):
    found = identify(ROBOT, sprung, IdentifyOptions(holdout=0.2))
    assert found.heldout_relative_error_percent < 4.0


def test_an_arm_without_a_spring_has_no_large_torque():
    found = identify(ROBOT, recorded(1, 1), IdentifyOptions(holdout=None))
    assert found.in_force == "physical"
    assert found.model_error is None
    assert not [finding for finding in found.findings if finding.code == "W404"]


@pytest.mark.slow
def test_where_a_possible_arm_is_contradicted_it_is_in_force_and_that_is_said(sprung):
    found = identify(ROBOT, sprung, IdentifyOptions(holdout=None, residual_model=False))
    assert found.in_force == "physical"
    assert "W404" in [finding.code for finding in found.findings]
