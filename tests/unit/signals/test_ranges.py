"""A joint that leaves its limits is named with the offset that would fit; full turns and close limits are not."""

import numpy as np
import pytest

from dynid import Log, Robot
from dynid.robot import Joint, Limits
from dynid.signals.checks import check_ranges


def moved(low, high, limits=(-1.0, 2.0)):
    """Return the findings for a joint that moves from one angle to another."""
    arm = Robot("one", "standard", (Joint("a", limits=Limits(limits)),))
    q = np.linspace(low, high, 50)
    return tuple(check_ranges(Log(np.arange(50) * 0.01, q, 0 * q, dh=True), arm))


@pytest.mark.parametrize("turns", [0, 1, -2])
def test_what_lies_within_and_what_has_no_limits_is_not_named(turns):
    assert moved(-1.05 + 2 * np.pi * turns, 2.0 + 2 * np.pi * turns) == ()
    assert moved(-20.0, 20.0, None) == ()


def test_a_quarter_turn_is_named():
    (finding,) = moved(np.pi / 2 + 0.2, np.pi / 2 + 1.5)
    assert finding.code == "W332"
    assert "an offset of -90 deg would fit" in finding.text
    assert finding.evidence["beyond"] == pytest.approx(np.pi / 2 + 1.5 - 2.0)
