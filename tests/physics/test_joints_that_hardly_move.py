"""A joint that crawls while all others move, and one whose torque is stuck, on an arm that Pinocchio moves."""

from dataclasses import replace

import numpy as np
import pytest

from dynid import identify, validate
from recorded_lwr import ROBOT, recorded

JOINT = 4
OTHERS = np.delete(np.arange(7), JOINT)


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
    log = recorded(1, reach=np.where(np.arange(7) == JOINT, crawl, 1.0))
    found = identify(ROBOT, log, holdout=None)
    check(found, other)
    assert "W406" in [finding.code for finding in found.findings]


def test_a_torque_that_is_stuck_leaves_its_joint_to_the_prior(other):
    log = recorded(1)
    tau = log.tau.copy()
    tau[:, JOINT] = 0.7
    check(identify(ROBOT, replace(log, tau=tau), holdout=None), other)
