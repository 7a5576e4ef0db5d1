"""A joint that leaves its limits is named with the offset that would fit; full turns and close limits are not."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.log import Log
from dynid.robot import Limits
from dynid.signals.checks import check_ranges
from makelogs import lwr


def moved(low, high, limits=(-1.0, 2.0)):
    """Return the findings for a joint that moves from one angle to another."""
    arm = lwr()
    arm = replace(arm, joints=tuple(replace(joint, limits=Limits(limits)) for joint in arm.joints))
    q = np.column_stack([np.linspace(low, high, 50), np.zeros((50, 6))])
    return tuple(check_ranges(Log(np.arange(50) * 0.01, q, 0 * q, arm.joint_names, dh=True), arm))


@pytest.mark.parametrize(
    ("low", "high"),
    [(-1.05, 2.0), (0.0, 1.0), (2 * np.pi, 1 + 2 * np.pi), (-4 * np.pi, 1 - 4 * np.pi)],
)
def test_what_lies_within_is_not_named(low, high):
    assert moved(low, high) == ()


def test_a_quarter_turn_is_named():
    (finding,) = moved(np.pi / 2 + 0.2, np.pi / 2 + 1.5)
    assert finding.code == "W332"
    assert "an offset of -90 deg would fit" in finding.text
    assert finding.evidence["beyond"] == pytest.approx(np.pi / 2 + 1.5 - 2.0)


def test_a_joint_without_limits_has_no_range():
    assert moved(-20.0, 20.0, None) == ()
