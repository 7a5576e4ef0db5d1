"""Conditioned logs: one filter for all, spikes and known torques taken off, faults with the name of their log."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynid import Log, load_robot
from dynid.errors import LogTooShort
from dynid.model import build_model
from dynid.model.regressor import prior_vector
from dynid.signals.conditioned_log import (
    condition_log,
    condition_logs,
    known_torque,
    stretches,
)
from motions import tones

RATE = 200.0


@pytest.fixture(scope="module")
def model():
    return build_model(load_robot("scara"))


def log(model, frequency=0.5, seconds=12.0, seed=0):
    """Sines whose torques are those of the prior bodies."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    w, phase = 2 * np.pi * frequency, rng.uniform(0, 6, model.robot.n)
    q, qd, qdd = tones(t, 0.2, w, phase)
    tau = model.regressor(q, qd, qdd) @ prior_vector(model)
    return Log(t, q, tau, model.robot.joint_names, dh=True)


def test_one_filter_serves_the_fastest_of_several_logs(model):
    slow, fast = log(model, 0.3), log(model, 2.5)
    alone = [condition_log(each, model).filter.cutoff for each in (slow, fast)]
    together = condition_logs([slow, fast], model)
    assert alone[0] < alone[1]
    assert [each.filter.cutoff for each in together] == [max(alone)] * 2
    assert [each.name for each in together] == ["log 1", "log 2"]


def test_a_spike_is_taken_out_before_the_filter_and_said(model):
    clean, spike = log(model), np.zeros((2400, model.robot.n))
    spike[1000, 1] = 100
    found = condition_log(replace(clean, tau=clean.tau + spike), model)
    assert [finding.code for finding in found.findings] == ["W324"]
    expected = condition_log(clean, model).segments[0].tau
    assert found.segments[0].tau == pytest.approx(expected, abs=0.02 * np.ptp(expected))


def test_torques_of_links_that_keep_their_prior_are_taken_off(model):
    """With the prior's bodies nothing but the identified links is left."""
    part = replace(model, robot=replace(model.robot, links=(4,)))
    (segment,) = condition_log(log(model), part, cutoff=20.0).segments
    whole = replace(model, robot=replace(model.robot, links=(1, 2, 3)))
    others = known_torque(whole, segment.q, segment.qd, segment.qdd)
    inner = slice(50, -50)
    assert segment.tau[inner] == pytest.approx(others[inner], abs=2e-3 * np.abs(others).max())
    assert not known_torque(model, segment.q, segment.qd, segment.qdd).any()


def test_a_fault_says_which_log_it_was_found_in(model):
    short = replace(log(model, seconds=0.1), source=Path("runs/short.bag"))
    with pytest.raises(LogTooShort) as caught:
        condition_logs([log(model), short], model)
    assert "short.bag" in str(caught.value.where)


def test_logs_of_few_samples_stay_whole_however_long_they_take(model):
    logs = condition_logs([log(model, seconds=12.0)], model)
    assert stretches(logs, 3.0) == (logs, 0)
