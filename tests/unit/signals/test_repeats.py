"""Samples that were not measured again are recognised, said and left out; coarse encoders are not taken for them."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from signal_cases import RNG, moving_log, robot

from dynid.signals.columns import take_samples
from dynid.signals.stamps import with_rising_time, without_copies, without_stale


@pytest.mark.parametrize("every", [2, 4, 7])
def test_samples_held_by_the_driver_are_left_out(every):
    log = moving_log()
    index = np.arange(len(log)) // every * every
    kept = without_stale(replace(take_samples(log, index), t=log.t), robot())
    assert_array_equal(kept.t, log.t[::every])
    assert_array_equal(kept.q, log.q[::every])
    assert [finding.code for finding in kept.findings] == ["W325"]
    assert kept.findings[0].evidence["rate_hz"] == pytest.approx(log.rate / every, rel=0.02)


def test_positions_held_beside_fresh_torques_are_left_out():
    log = moving_log()
    kept = without_stale(replace(log, q=log.q[np.arange(len(log)) // 4 * 4]), robot())
    assert_array_equal(kept.t, log.t[::4])


def test_encoders_so_coarse_that_positions_repeat_are_no_held_samples():
    log = moving_log()
    coarse = replace(log, q=np.round(log.q / 0.01) * 0.01)
    assert np.mean(np.all(np.diff(coarse.q, axis=0) == 0, axis=1)) > 0.05
    assert without_stale(coarse, robot()) is coarse


def test_an_arm_at_rest_repeats_nothing():
    log = moving_log()
    still = replace(take_samples(log, np.zeros(len(log), dtype=int)), t=log.t)
    assert without_stale(still, robot()) is still


def test_a_clean_log_is_the_same_object():
    log = moving_log()
    assert without_stale(log, robot()) is log
    assert without_copies([log]) == ([log], ())


def test_samples_stored_twice_under_one_stamp_are_dropped():
    log = moving_log()
    index = np.repeat(np.arange(len(log)), 2)
    kept = with_rising_time(take_samples(log, index), sort_time=False)
    assert_array_equal(kept.t, log.t)
    assert [finding.code for finding in kept.findings] == ["W311"]


def test_a_log_given_again_is_left_out_whatever_its_clock_says():
    log = moving_log()
    other = replace(log, q=log.q + 0.01 * RNG.standard_normal(log.q.shape))
    kept, findings = without_copies([log, other, replace(log, t=log.t + 100.0)])
    assert kept == [log, other]
    assert [finding.code for finding in findings] == ["W326"]


def test_the_part_of_a_log_that_an_earlier_one_has_is_left_out():
    log = moving_log()
    half = len(log) // 2
    first = take_samples(log, slice(half))
    kept, findings = without_copies([first, log])
    assert kept[0] is first
    assert_array_equal(kept[1].t, log.t[half:])
    assert findings[0].evidence["share"] == pytest.approx(0.5, abs=0.01)


def test_a_recording_joined_to_itself_counts_once():
    log = moving_log()
    twice = take_samples(log, np.tile(np.arange(len(log)), 2))
    twice = replace(twice, t=np.append(log.t, log.t + log.t[-1] + 0.01))
    kept, _ = without_copies([twice])
    assert_array_equal(kept[0].q, log.q)


def test_copies_are_found_among_many_logs():
    log = moving_log()
    part = take_samples(log, slice(200))
    logs = [replace(part, q=part.q + 0.01 * RNG.standard_normal(part.q.shape)) for _ in range(300)]
    kept, findings = without_copies([*logs, logs[7], logs[250], *logs[:100]])
    assert kept == logs
    assert [finding.evidence["log"] for finding in findings] == list(range(301, 403))
