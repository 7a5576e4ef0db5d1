"""The same command is recognised at any beginning and with noise; another one, or another speed of it, is not it."""

import numpy as np

from dynid.signals.motion import motion_numbers, same_motion, sampled


def motion(seed, seconds=25.0, begin=0.0, speed=1.0, noise=0.0):
    rng = np.random.default_rng(seed)
    f, a, phase = rng.uniform(0.05, 0.5, 6), rng.uniform(0.3, 1.2, 6), rng.uniform(0, 6, 6)
    t = np.arange(0, seconds, 0.005)
    q = a * np.sin(2 * np.pi * f * speed * (t[:, None] + begin) + phase)
    return sampled(t, q + noise * np.random.default_rng(9).normal(size=q.shape))


def test_the_same_command_a_little_later_is_one_motion_and_another_command_is_not():
    recordings = [
        motion(1),
        motion(1, begin=3.2, noise=1e-3),
        motion(2),
        motion(1, seconds=18.0, begin=1.0),
    ]
    assert motion_numbers(recordings) == (0, 0, 1, 0)


def test_a_slower_run_is_another_motion_and_a_still_joint_decides_nothing():
    assert not same_motion(motion(1), motion(1, speed=0.8))
    still = motion(1)
    still[:, 3] = 0.1 + 1e-4 * np.random.default_rng(0).normal(size=len(still))
    other = still.copy()
    other[:, 3] += 2e-4
    assert same_motion(still, other)


def test_motions_are_compared_at_every_beginning():
    rng = np.random.default_rng(4)
    for _ in range(60):
        one = np.cumsum(rng.normal(size=(int(rng.integers(5, 40)), 2)), axis=0) + 1e3
        begin, length = int(rng.integers(0, len(one))), int(rng.integers(3, 40))
        other = one[begin : begin + length]
        other = other + rng.choice([0.0, 0.05, 0.3]) * rng.normal(size=other.shape)
        if len(other) < 2:
            continue
        reach = np.maximum(np.ptp(one, axis=0), np.ptp(other, axis=0))
        needed = max(2, int(np.ceil(0.7 * min(len(one), len(other)))))
        overlaps = [
            [
                (one[i + lag] - other[i]) / reach
                for i in range(len(other))
                if 0 <= i + lag < len(one)
            ]
            for lag in range(-len(other), len(one))
        ]
        alike = [
            np.sqrt(np.mean(np.square(each), axis=0)) < 0.05
            for each in overlaps
            if len(each) >= needed
        ]
        assert same_motion(one, other) == any(map(np.all, alike))


def test_a_pause_of_days_is_compared_as_a_short_one():
    t = np.arange(0, 25.0, 0.005)
    rest = np.where(t < 10.0, t, t + 1e6)
    q = np.sin(np.outer(t, [0.7, 1.3]))
    paused, short = sampled(rest, q), sampled(np.where(t < 10.0, t, t + 0.995), q)
    assert same_motion(paused, short)
    recorded = np.r_[0:49, 56 : len(short)]
    np.testing.assert_allclose(paused[recorded], short[recorded], atol=1e-6)
