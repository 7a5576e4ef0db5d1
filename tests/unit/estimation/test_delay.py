"""The delay of the torques: what was put in comes out, and what was never there is left alone."""

from dataclasses import replace

import numpy as np
import pytest
from test_stack import simulated, stacked

import dynid
from dynid import Log
from dynid.estimation.least_squares import relative_error, weighted
from dynid.estimation.stack import estimate_delay, is_clear, on_time, stack_logs
from dynid.signals.conditioned_log import condition_log, torques_moved_back


def late(base, delay):
    """A log whose torques belong to the exact motion ``delay`` earlier, with noise."""
    log = simulated(base)
    moved = np.column_stack([np.interp(log.t - delay, log.t, column) for column in log.tau.T])
    noise = np.random.default_rng(0).normal(size=log.tau.shape) * 0.02 * np.std(log.tau, axis=0)
    return replace(log, tau=moved + noise)


@pytest.mark.parametrize("delay", [0.020, 0.006, -0.010])
def test_a_delay_that_was_put_in_is_found_and_removed(base, delay):
    log = late(base, delay)
    found, std_error = estimate_delay(stacked(base, log))
    assert is_clear(found, std_error, reach=0.05)
    assert found == pytest.approx(delay, abs=max(4 * std_error, 0.06 * abs(delay)))
    logs = [torques_moved_back(each, base.model, found) for each in stacked(base, log).logs]
    left, _ = estimate_delay(stack_logs(logs, base))
    assert abs(left) < 1e-3


def test_logs_whose_torques_are_late_are_stacked_on_time_without_reading_them_again(base):
    log, prompt = late(base, 0.012), late(base, 0.0)
    rows, (found, _), findings = on_time(stacked(base, log))
    applied = rows.logs[0].delay
    assert applied == pytest.approx(0.012, abs=1e-3)
    assert found == pytest.approx(applied, abs=1e-3)
    assert [finding.code for finding in findings] == ["W321"]
    clean = stacked(base, prompt)
    left, best = (
        relative_error(each.factors, weighted(each.factors, each.counts).theta)
        for each in (rows, clean)
    )
    assert left < 1.2 * best


def test_a_delay_that_is_given_is_not_estimated(base):
    found = dynid.observe(base.robot, late(base, 0.012), dynid.LogOptions(delay=0.005), base=base)
    assert (found.delay, found.applied_delay) == (None, 0.005)
    assert found.stack.logs[0].delay == 0.005


def test_torques_on_time_are_not_moved(base):
    assert not is_clear(*estimate_delay(stacked(base, late(base, 0.0))), reach=0.05)


def test_the_torque_of_a_later_time_is_taken_and_the_end_does_not_count(base):
    t = np.arange(400) / 100.0
    x = np.column_stack([np.sin(t)] * base.robot.n)
    log = Log(t, x, x**2, base.robot.joint_names, dh=True)
    plain, moved = (
        condition_log(log, base.model, cutoff=20.0, delay=delay).segments[0]
        for delay in (0.0, 0.013)
    )
    good = moved.usable[:, 0] & (moved.t < 3.5)
    assert moved.tau[good, 0] == pytest.approx(
        np.interp(moved.t[good] + 0.013, plain.t, plain.tau[:, 0]), abs=1e-3
    )
    assert not moved.usable[moved.t + 0.013 > plain.t[-1]].any()
    assert plain.usable[plain.t > 3.5].any()
