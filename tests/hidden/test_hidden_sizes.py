"""Sizes of effects that are not in proportion to them, on a seven-joint arm that Pinocchio moves."""

import numpy as np
import pytest

from dynid import find_gap, identify
from recorded_lwr import ROBOT, only, recorded

pytestmark = pytest.mark.slow


def found(effects, **options):
    logs = [
        recorded(plan, seconds=12.0, noise=10 * plan + k, start=17.0 * (2 * plan + k), **options)
        for plan in (1, 2, 3)
        for k in range(2)
    ]
    return find_gap(identify(ROBOT, logs, feasible=False), logs, effects=effects).named


@pytest.mark.parametrize(
    ("name", "joint", "size", "near"),
    [("encoder_offset", 2, 0.126, 0.01), ("joint_elasticity", 3, 0.0042, 0.1)],
)
def test_a_large_size_is_right_and_leaves_nothing_for_a_companion(name, joint, size, near):
    """An encoder zero of an eighth of a radian, and a gear that bends by some hundredths of one."""

    def lead(rigid):
        return only(joint, size * (rigid[:, joint] if "elastic" in name else np.ones(len(rigid))))

    (one,) = found("encoder_offset,joint_elasticity,spring,end_stop", lead=lead)
    assert (one.effect, one.indices) == (name, (joint,))
    (value,) = one.values.values()
    assert value == pytest.approx(size, rel=near)
