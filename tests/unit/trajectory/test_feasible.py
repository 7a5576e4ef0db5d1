"""Any numbers give a motion inside the limits, and the gradient goes through the scaling."""

import numpy as np
import pytest
from randomplans import random_trajectory
from scipy.interpolate import BPoly

from dynid.trajectory.basis import Quintic
from dynid.trajectory.feasible import bounds
from dynid.trajectory.limits import check_trajectory


@pytest.mark.slow
@pytest.mark.parametrize("arm", ["lwr", "gen2"])
def test_none_of_100_random_plans_breaks_a_limit_at_10_khz_in_other_code(arm, request):
    robot = request.getfixturevalue(arm).robot
    limit = bounds(robot, 0.1)
    knots = np.linspace(0, 2.0, 5)
    basis = Quintic(tuple(knots.tolist()))
    t = np.arange(0, 2.0, 1e-4)
    for seed in range(100):
        trajectory = random_trajectory(robot, seed, basis, margin=0.1)
        at = trajectory.motion(knots)
        path = BPoly.from_derivatives(knots, np.stack([at.q, at.qd, at.qdd], axis=1))
        q, qd, qdd = path(t), path.derivative(1)(t), path.derivative(2)(t)
        assert np.all((q > limit.lower - 1e-9) & (q < limit.upper + 1e-9))
        assert np.all(np.abs(qd) < limit.velocity * (1 + 1e-9))
        assert np.all(np.abs(qdd) < limit.acceleration * (1 + 1e-9))


@pytest.mark.parametrize("basis", [Quintic.even(4.0, 6), Quintic.even(4.0, 7, smooth=True)])
def test_every_joint_uses_one_of_its_limits_to_the_full(lwr, basis):
    found = check_trajectory(random_trajectory(lwr.robot, 3, basis), lwr.robot, bounds(lwr.robot))
    assert np.allclose([peak.share for peak in found.peaks], 1.0, atol=1e-6)


def test_margin_is_taken_off_half_at_each_end(lwr):
    wide, narrow = bounds(lwr.robot), bounds(lwr.robot, 0.1)
    assert np.allclose(narrow.upper - narrow.lower, 0.9 * (wide.upper - wide.lower))
    assert np.allclose(narrow.upper + narrow.lower, wide.upper + wide.lower)
    assert np.allclose(narrow.torque, 0.9 * wide.torque)


def test_joints_without_end_may_turn_twice_each_way(gen2):
    limit = bounds(gen2.robot)
    assert (limit.lower[0], limit.upper[0]) == (-4 * np.pi, 4 * np.pi)
