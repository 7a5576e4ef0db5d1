"""How much motion there is: still joints and too few swings are named, good recordings pass."""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from dynid import Log
from dynid.errors import LogTooShort
from dynid.signals.checks import describe, prepare
from dynid.signals.columns import take_samples
from dynid.signals.motion import (
    bandwidth,
    check_amount,
    motion_numbers,
    rest_slices,
    same_motion,
    sampled,
    swings,
)
from makelogs import gen2, gen2_log, lwr, lwr_log

ONE = replace(lwr(), joints=lwr().joints[:1], driver=None)


def tone(frequency, seconds=20.0, rate=200.0):
    t = np.arange(round(seconds * rate)) / rate
    return Log(t, np.sin(2 * np.pi * frequency * t)[:, None], np.zeros((len(t), 1)))


@pytest.mark.parametrize("frequency", [0.2, 0.5, 1.5])
def test_a_tone_has_its_frequency_and_swings_twice_a_period(frequency):
    assert bandwidth(tone(frequency), ONE) == pytest.approx(frequency, abs=0.11)
    assert swings(tone(frequency), ONE)[0] == pytest.approx(40 * frequency, abs=1)


def test_rests_are_the_stretches_in_which_nothing_moves():
    log = tone(0.5)
    q = np.concatenate([log.q, np.repeat(log.q[-1:], 400, axis=0), log.q])
    still = Log(np.arange(len(q)) / 200, q, 0 * q)
    (rest,) = rest_slices(still, ONE)
    assert 4000 <= rest.start < rest.stop <= 4400
    assert rest.stop - rest.start > 300


def test_a_short_stretch_of_motion_is_named():
    short = take_samples(lwr_log(), np.arange(400))
    (finding,) = (each for each in prepare(short, lwr()).findings if each.code == "W313")
    assert re.match(r"1\.3 s of motion; about 70 parameters need about \d+ s here", finding.text)
    assert "W313" not in [each.code for each in prepare(short, lwr(), identify=False).findings]


def test_a_log_that_never_moves_raises_nothing_unless_it_is_to_identify_from():
    q = lwr_log().q
    still = replace(lwr_log(), q=q[0] + np.random.default_rng(0).normal(0, 1e-5, q.shape))
    assert len(prepare(still, lwr(), identify=False)) == len(q)
    with pytest.raises(LogTooShort, match=r"0\.0 s of motion"):
        prepare(still, lwr())


def test_a_log_is_described_by_its_numbers():
    robot = replace(gen2(), driver=replace(gen2().driver, kind="generic"))
    log = prepare(gen2_log(), robot)
    found = describe(log, robot)
    assert (found["samples"], found["gaps"]) == (3000, 0)
    assert found["rate_hz"] == pytest.approx(100, rel=0.01)
    assert_allclose(found["position_span_rad"], np.ptp(log.q, axis=0))
    assert_allclose(found["velocity_slope"], 1.0, rtol=0.02)
    ratings = [joint.limits.torque for joint in gen2().joints]
    assert_allclose(found["torque_share"], np.max(np.abs(log.tau), axis=0) / ratings)


def test_short_logs_count_together():
    log = prepare(lwr_log(), lwr(), identify=False)
    parts = [take_samples(log, part) for part in np.array_split(np.arange(len(log)), 12)]
    assert [finding.code for finding in check_amount(parts[2:3], lwr())] == ["W313"]
    assert check_amount(parts, lwr()) == ()


# ---------------------------------------------------------------- the same motion
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


def test_a_pause_of_days_is_compared_as_a_short_one():
    t = np.arange(0, 25.0, 0.005)
    rest = np.where(t < 10.0, t, t + 1e6)
    q = np.sin(np.outer(t, [0.7, 1.3]))
    paused, short = sampled(rest, q), sampled(np.where(t < 10.0, t, t + 0.995), q)
    assert same_motion(paused, short)
    recorded = np.r_[0:49, 56 : len(short)]
    np.testing.assert_allclose(paused[recorded], short[recorded], atol=1e-6)
