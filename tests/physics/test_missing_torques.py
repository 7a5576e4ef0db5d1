"""A spring that the model lacks, on an arm that Pinocchio moves: single tones are fitted, another motion is judged."""

import pytest

from dynid import identify, validate
from recorded_lwr import ROBOT, recorded

JOINT = 3


def sprung_log(seed, tones):
    """A log of the arm with a spring of 40 N m/rad at its fourth joint."""
    log = recorded(seed, tones)
    log.tau[:, JOINT] += 40.0 * (log.q[:, JOINT] - 0.3)
    return log


def large(found):
    """Return what was said of torques that the model lacks."""
    return [finding for finding in found.findings if finding.code == "W404"]


@pytest.fixture(scope="module")
def sprung():
    return sprung_log(1, 1)


@pytest.mark.slow
def test_a_large_spring_is_named_and_predicted_on_another_motion_where_a_plain_fit_is_worthless(
    sprung,
):
    found = identify(ROBOT, sprung, holdout=None)
    assert found.in_force == "physical"
    assert found.model_error.free.tolist() == [JOINT]
    assert [finding.evidence["joint"] for finding in large(found)] == [ROBOT.joint_names[JOINT]]
    other = sprung_log(2, 4)
    seen = validate(found, other).relative_error_percent
    assert seen < 4.0
    for changed in ({"feasible": False}, {"residual_model": False}):
        less = identify(ROBOT, sprung, holdout=None, **changed)
        assert validate(less, other).relative_error_percent > 4 * seen


@pytest.mark.slow
def test_held_out_rows_are_judged_with_the_same_joint_free(sprung):
    found = identify(ROBOT, sprung, holdout=0.2)
    assert found.heldout_relative_error_percent < 4.0


def test_an_arm_without_a_spring_has_no_large_torque():
    found = identify(ROBOT, recorded(1, 1), holdout=None)
    assert found.in_force == "physical"
    assert found.model_error is None
    assert not large(found)


@pytest.mark.slow
def test_where_a_possible_arm_is_contradicted_it_is_in_force_and_that_is_said(sprung):
    found = identify(ROBOT, sprung, holdout=None, residual_model=False)
    assert found.in_force == "physical"
    assert large(found)
