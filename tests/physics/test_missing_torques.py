"""A spring that the model lacks, on an arm that Pinocchio moves: single tones are fitted, another motion is judged."""

from dataclasses import replace

import numpy as np
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


# ---------------------------------------------------------------- a joint that crawls, or whose torque is stuck
SLOW = 4
OTHERS = np.delete(np.arange(7), SLOW)


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
    assert all(known[f"{kind}{SLOW + 1}"] >= 0.0 for kind in ("fv", "fc", "Im"))


@pytest.mark.parametrize("crawl", [0.012, 0.05])
def test_a_joint_that_crawls_is_answered_from_the_prior(other, crawl):
    """In the slower case no row of its own is left: all of them are near standstill."""
    log = recorded(1, reach=np.where(np.arange(7) == SLOW, crawl, 1.0))
    found = identify(ROBOT, log, holdout=None)
    check(found, other)
    assert "W406" in [finding.code for finding in found.findings]


def test_a_torque_that_is_stuck_leaves_its_joint_to_the_prior(other):
    log = recorded(1)
    tau = log.tau.copy()
    tau[:, SLOW] = 0.7
    check(identify(ROBOT, replace(log, tau=tau), holdout=None), other)
