import numpy as np
import pytest

from dynid.sim.follow import VelocityFollower

DT = 1e-3


def steps(follower, count):
    return np.array([np.concatenate(follower.step()) for _ in range(count)])


def test_velocities_cover_their_distance_in_whatever_rhythm_they_come():
    even, uneven = VelocityFollower(np.zeros(1), DT), VelocityFollower(np.zeros(1), DT)
    for k in range(100):
        even.push(np.array([0.5]))
        if k % 3 == 2:
            for _ in range(3):
                uneven.push(np.array([0.5]))
        for follower in (even, uneven):
            steps(follower, 10)
    for follower in (even, uneven):
        follower.push(np.zeros(1))
        steps(follower, 1000)
    assert even.goal[0] == pytest.approx(0.5, abs=0.01)
    assert uneven.goal[0] == pytest.approx(0.5, abs=0.02)


def test_what_is_queued_ahead_outlives_the_stream():
    follower = VelocityFollower(np.zeros(1), DT)
    for _ in range(200):
        follower.push(np.ones(1))
    steps(follower, 1000)
    assert follower.goal[0] > 0.9, "nothing was sent for a second, and the arm still moves"
    follower.stop()
    where = follower.goal[0]
    steps(follower, 1000)
    assert follower.goal[0] == where


def test_a_stopped_arm_ignores_commands_until_it_is_started():
    follower = VelocityFollower(np.zeros(1), DT)
    follower.stop()
    follower.push(np.ones(1))
    steps(follower, 100)
    assert follower.goal[0] == 0
    follower.start()
    follower.push(np.ones(1))
    steps(follower, 100)
    assert follower.goal[0] > 0
