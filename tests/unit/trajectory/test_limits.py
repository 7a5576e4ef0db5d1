"""A motion that breaks a limit is refused with the number, the joint, the time and what would pass."""

from dataclasses import replace

import numpy as np
import pytest
from randomplans import random_trajectory

from dynid import load_robot
from dynid.errors import LimitBroken
from dynid.trajectory.basis import Quintic
from dynid.trajectory.feasible import Bounds, bounds
from dynid.trajectory.limits import check_trajectory, require_within_limits
from dynid.trajectory.plan import Trajectory, through_waypoints


def scaled(limit, **factors):
    return Bounds(**{name: value * factors.get(name, 1.0) for name, value in vars(limit).items()})


def refused(match, *checked, margin=0.0, **limits):
    """Return the mistake that a motion is refused with."""
    with pytest.raises(LimitBroken, match=match) as caught:
        require_within_limits(check_trajectory(*checked, **limits), margin=margin)
    return caught.value


def suggested(error):
    assert error.fix.startswith("--alpha ")
    return float(error.fix.split()[1])


@pytest.mark.parametrize(
    ("quantity", "share", "order"), [("velocity", 0.5, 1), ("acceleration", 0.3, 2)]
)
def test_broken_rate_is_refused_and_the_alpha_of_the_advice_passes(lwr, quantity, share, order):
    plan = random_trajectory(lwr.robot, 1)
    found = check_trajectory(plan, lwr.robot, bounds(lwr.robot)).peaks
    peaks = np.array([getattr(peak, quantity) for peak in found])
    limit = replace(bounds(lwr.robot), **{quantity: share * peaks})
    alpha = suggested(refused(r"lwr_\d_joint .* at t = .* s; limit", plan, lwr.robot, limit))
    assert alpha == pytest.approx(share ** (1 / order), abs=0.01)
    assert check_trajectory(plan.slowed(alpha), lwr.robot, limit).violations == ()


def test_overshoot_between_samples_of_a_coarse_grid_is_seen(lwr):
    basis = Quintic((0.0, 1.0))
    c = np.zeros((2, 7))
    c[1] = 1.0
    plan = Trajectory(basis, c)
    peak = 15 / 8
    limit = replace(
        bounds(lwr.robot), velocity=np.full(7, peak * 0.9999), acceleration=np.full(7, 100.0)
    )
    found = check_trajectory(plan, lwr.robot, limit)
    assert len(found.violations) == 7
    assert found.violations[0].value == pytest.approx(peak, rel=1e-12)
    assert found.violations[0].time == pytest.approx(0.5, abs=1e-6)


def test_broken_position_is_refused_and_says_that_slower_does_not_help(lwr):
    plan = random_trajectory(lwr.robot, 1)
    limit = scaled(bounds(lwr.robot), lower=0.3, upper=0.3)
    mistake = refused("reaches", plan, lwr.robot, limit, margin=0.1)
    assert "10 % margin" in mistake.what
    assert "slower does not help" in mistake.fix


def test_torque_limit_gives_an_alpha_that_keeps_it_or_says_the_pose_is_too_heavy(lwr):
    plan = random_trajectory(lwr.robot, 1)
    limit = replace(bounds(lwr.robot), torque=np.full(7, 10.0))

    def inertial(motion):
        return 5.0 * motion.qdd

    alpha = suggested(refused("needs", plan, lwr.robot, limit, inertial))
    assert check_trajectory(plan.slowed(alpha), lwr.robot, limit, inertial).violations == ()
    assert check_trajectory(plan.slowed(alpha * 1.1), lwr.robot, limit, inertial).violations
    heavy = refused("needs", plan, lwr.robot, limit, lambda motion: np.full_like(motion.q, 11.0))
    assert "too heavy" in heavy.fix


@pytest.mark.slow
def test_tool_speed_is_that_of_differentiated_positions_and_can_be_limited(gen2):
    from dynid.model.kinematics import tool_pose

    plan = random_trajectory(gen2.robot, 4)
    motion = plan.sampled(1000)
    tips = np.array([tool_pose(gen2.robot, q)[:3, 3] for q in motion.q])
    fastest = np.linalg.norm(np.gradient(tips, motion.t, axis=0), axis=1).max()
    assert check_trajectory(plan, gen2.robot, bounds(gen2.robot)).tool_speed == pytest.approx(
        fastest, rel=1e-3
    )
    mistake = refused("tool moves at", plan, gen2.robot, bounds(gen2.robot), speed=0.25 * fastest)
    assert suggested(mistake) == pytest.approx(0.25, abs=0.0101)


def test_a_slide_beyond_its_limit_is_told_in_metres_and_newtons():
    robot = load_robot("scara")
    limits = bounds(robot)
    points = np.array([[0, 0, 0.1, 0], [0, 0, 0.5, 0]])
    there = through_waypoints(points, replace(limits, velocity=10 * limits.velocity))
    refused(r"slide reaches 0\.5 m at", there, robot, limits)
    strong = replace(limits, torque=np.array([60.0, 30.0, 1.0, 6.0]))
    still = through_waypoints(np.array([[0, 0, 0.1, 0], [0, 0, 0.11, 0]]), limits)
    refused("slide needs 2 N at", still, robot, strong, lambda x: np.full((len(x), 4), 2.0))
