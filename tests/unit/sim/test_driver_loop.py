import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dynid import load_robot
from dynid.sim.arm import SimulatedArm
from dynid.sim.driver_loop import DriverLoop
from dynid.sim.follow import PointFollower
from dynid.sim.options import SimDriverOptions
from dynid.sim.plant import Sensors
from dynid.sim.ros_drivers import doubled

UR = load_robot("ur10")
START = np.array([0.0, -1.2, 1.2, 0.3, 0.5, 0.0])


def samples(rate, skew=0.0):
    """What the driver of a moving arm measures in a third of a second, by the time in its stamp [ms]."""
    follower = PointFollower(START, 1e-3)
    follower.play([(START + 0.3, np.full(6, 0.2), 0.5)])
    arm = SimulatedArm(UR, dt=1e-3)
    sensors, options = Sensors.perfect(6), SimDriverOptions(rate=rate, skew=skew)
    loop = DriverLoop(arm, follower, sensors, options, np.random.default_rng(0))
    for _ in range(330):
        loop._step()
    return {round(1e3 * measured.elapsed): measured for _, measured in loop._waiting}


def test_torques_and_velocities_that_are_polled_later_belong_to_a_later_moment():
    fine, skewed = samples(1000), samples(100, skew=0.004)
    assert len(skewed) == 33
    for when, measured in skewed.items():
        assert_array_equal(measured.q, fine[when].q)
        assert_array_equal(measured.tau, fine[when + 4].tau)
        assert_array_equal(measured.qd, fine[when + 4].qd)


def test_kinova_doubles_velocities_and_wraps_them_afterwards():
    assert_allclose(
        np.degrees(doubled(np.radians([10.0, -80.0, 89.0, 91.0]))), [20, -160, 178, -178]
    )


def test_a_controller_brakes_to_where_it_was_stopped():
    follower = PointFollower(np.zeros(1), 1e-3)
    follower.play([(np.array([1.0]), np.array([1.0]), 1.0)])
    for _ in range(700):
        follower.step()
    moving = follower.goal[0]
    follower.stop()
    path = np.array([np.concatenate(follower.step()) for _ in range(1000)])
    assert path[-1, 0] == pytest.approx(moving, abs=1e-3)
    assert abs(path[-1, 1]) < 1e-6


def test_a_new_point_replaces_the_last_one_at_once():
    follower = PointFollower(np.zeros(1), 1e-3)
    for far in (5.0, 1.0):
        follower.push((np.array([far]), np.zeros(1), 0.5))
    for _ in range(1500):
        follower.step()
    assert follower.goal[0] == 1.0
