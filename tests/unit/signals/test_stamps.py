"""Time: what goes back, stands still, is missing or too slow is named, and the fix that is printed mends it."""

import re
from dataclasses import replace

import numpy as np
import pytest

from dynid import Log
from dynid.errors import LogTooShort, NotFinite, RateTooLow, TimeNotIncreasing, TooManyLost
from dynid.signals.checks import prepare
from dynid.signals.columns import take_samples
from dynid.signals.stamps import with_even_clock
from makelogs import gen2, gen2_log, lwr, lwr_log


def test_shuffled_stamps_are_put_in_order_when_asked_to():
    log = lwr_log()
    order = np.arange(len(log)).reshape(-1, 4)[:, [1, 0, 3, 2]].ravel()
    broken = take_samples(log, order)
    with pytest.raises(TimeNotIncreasing, match="shuffled") as caught:
        prepare(broken, lwr())
    assert caught.value.fix == "--sort-time"
    np.testing.assert_array_equal(prepare(broken, lwr(), sort_time=True).q, prepare(log, lwr()).q)


def test_samples_with_the_stamp_of_their_predecessor_are_dropped():
    twice = np.sort(np.concatenate([np.arange(len(lwr_log())), [100, 200, 300]]))
    log = prepare(take_samples(lwr_log(), twice), lwr())
    assert len(log) == len(lwr_log())
    assert "W311" in [finding.code for finding in log.findings]


def test_stamps_too_coarse_to_tell_samples_apart_are_refused():
    with pytest.raises(TimeNotIncreasing, match="too coarse"):
        prepare(replace(lwr_log(), t=np.round(lwr_log().t, 2)), lwr())


def test_a_few_gaps_are_reported_with_the_longest():
    rows = np.delete(np.arange(len(lwr_log())), np.r_[500:510, 1500:1530])
    log = prepare(take_samples(lwr_log(), rows), lwr())
    (finding,) = log.findings
    assert finding.code == "W312"
    assert re.match(r"lwr4plus_validate\.bag: 2 gaps, longest 15\d ms at 7\.50 s", finding.text)


def test_more_than_one_sample_in_twenty_missing_is_too_many():
    keep = np.random.default_rng(0).random(len(lwr_log())) > 0.08
    with pytest.raises(TooManyLost, match="8 % of the samples are missing"):
        prepare(take_samples(lwr_log(), np.flatnonzero(keep)), lwr())


def test_late_stamps_are_not_lost_samples():
    jitter = np.random.default_rng(0).exponential(0.0015, len(lwr_log()))
    prepare(replace(lwr_log(), t=lwr_log().t + np.minimum(jitter, 0.004)), lwr())


def test_an_excluded_stretch_is_no_gap():
    assert prepare(lwr_log(), lwr(), exclude=[(5.0, 9.0)]).findings == ()


def test_excluding_everything_leaves_no_log():
    with pytest.raises(LogTooShort, match="no sample"):
        prepare(lwr_log(), lwr(), exclude=[(0.0, 100.0)])


def test_a_stamp_that_is_no_number_is_named_with_its_row():
    t = lwr_log().t.copy()
    t[321] = np.nan
    with pytest.raises(NotFinite, match="row 322"):
        prepare(replace(lwr_log(), t=t), lwr())


def test_kinovas_default_rate_is_too_low_and_the_launch_argument_is_named():
    slow = take_samples(gen2_log(), np.arange(0, len(gen2_log()), 10))
    with pytest.raises(
        RateTooLow, match=r"joint states arrive at 10\.0 Hz; the fastest motion, .* needs >= 50 Hz"
    ) as caught:
        prepare(slow, gen2())
    assert "feedback_publish_rate:=0.01" in caught.value.fix


def test_a_handful_of_samples_is_no_recording():
    with pytest.raises(LogTooShort, match="5 samples"):
        prepare(take_samples(lwr_log(), np.arange(5)), lwr())


def moved(t):
    """Return a log of a motion that is known at every time."""
    q = np.stack([np.sin(0.9 * t) + 0.2 * np.sin(4 * t), 0.8 * np.cos(0.7 * t)], axis=1)
    return Log(t, q, np.zeros_like(q), ("a", "b"))


def test_stamps_that_come_late_are_put_on_an_even_clock():
    rng = np.random.default_rng(3)
    t = np.arange(4000) / 200.0
    stamps = np.maximum.accumulate(t + rng.exponential(5e-4, len(t))) + 1e-9 * np.arange(4000)
    late = with_even_clock(replace(moved(t), t=stamps))
    off = late.t - t
    assert np.std(off) < 2e-5  # the mean lateness cannot be known
    assert [f.code for f in late.findings] == ["W323"]


def test_lost_samples_keep_their_places_on_the_even_clock():
    rng = np.random.default_rng(4)
    t = np.arange(4000) / 200.0
    kept = rng.random(4000) > 0.02
    log = moved(t)
    log = with_even_clock(
        replace(log, t=(t + rng.uniform(0, 1e-3, 4000))[kept], q=log.q[kept], tau=log.tau[kept])
    )
    assert np.std(log.t - t[kept]) < 3e-5


def test_samples_taken_unevenly_keep_their_stamps():
    t = np.arange(4000) / 200.0 + np.random.default_rng(5).uniform(-0.0015, 0.0015, 4000)
    log = moved(t)
    assert with_even_clock(log) is log


def test_coarse_encoders_that_cannot_tell_keep_their_stamps():
    rng = np.random.default_rng(6)
    t = np.arange(2000) / 100.0
    log = moved(t)
    log = replace(log, t=t + rng.exponential(1e-4, len(t)), q=np.round(log.q / 0.01) * 0.01)
    assert with_even_clock(log) is log
