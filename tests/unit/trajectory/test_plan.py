"""A plan runs at alpha with the right powers, and goes through waypoints without breaking a rate."""

import numpy as np
import pytest
from randomplans import random_trajectory
from scipy.interpolate import make_interp_spline

from dynid.errors import WrongUsage
from dynid.trajectory.feasible import bounds
from dynid.trajectory.limits import check_trajectory
from dynid.trajectory.plan import through_waypoints


def test_alpha_slows_position_speed_and_acceleration_by_its_powers(lwr):
    plan = random_trajectory(lwr.robot, 1)
    slow = plan.slowed(0.2)
    t = np.linspace(0, plan.duration, 50)
    fast, run = plan.motion(t), slow.motion(t / 0.2)
    assert slow.duration == pytest.approx(5 * plan.duration)
    assert np.allclose(run.q, fast.q)
    assert np.allclose(run.qd, 0.2 * fast.qd)
    assert np.allclose(run.qdd, 0.04 * fast.qdd)


@pytest.mark.parametrize("alpha", [0.0, -1.0, 1.5])
def test_alpha_outside_zero_to_one_is_refused(lwr, alpha):
    with pytest.raises(WrongUsage, match="alpha"):
        random_trajectory(lwr.robot, 1, alpha=alpha)


def test_least_jerk_through_waypoints_is_the_quintic_spline_of_scipy(lwr):
    q = np.random.default_rng(8).uniform(-1, 1, (6, 7))
    times = np.array([0.0, 20, 35, 60, 80, 100])
    plan = through_waypoints(q, bounds(lwr.robot), times)
    zeros = [(1, np.zeros(7)), (2, np.zeros(7))]
    theirs = make_interp_spline(times, q, k=5, bc_type=(zeros, zeros))
    t = np.linspace(0, 100, 300)
    assert np.abs(plan.motion(t).q - theirs(t)).max() < 1e-9


def test_intervals_are_stretched_until_no_rate_is_broken(gen2):
    limit = bounds(gen2.robot, 0.1)
    q = np.random.default_rng(9).uniform(-0.5, 0.5, (7, 7)) + np.array([0, np.pi] * 3 + [0])
    plan = through_waypoints(q, limit, np.arange(7) * 0.2)
    assert plan.duration > 1.2
    assert check_trajectory(plan, gen2.robot, limit).violations == ()
    assert np.allclose(plan.motion(np.array(plan.basis.knots)).q, q, atol=1e-9)


def test_intervals_without_times_are_nearly_as_short_as_the_limits_allow(lwr):
    limit = bounds(lwr.robot)
    plan = through_waypoints(np.array([np.zeros(7), np.full(7, 0.5)]), limit)
    peaks = check_trajectory(plan, lwr.robot, limit).peaks
    assert max(peak.share for peak in peaks) == pytest.approx(1.0, abs=1e-4)
