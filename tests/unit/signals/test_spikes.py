"""Spikes that were put into torques, and torques that have none."""

import numpy as np
import pytest

from dynid.log import Log
from dynid.signals.spikes import despiked


def log_with(tau, rate=200.0):
    t = np.arange(len(tau)) / rate
    return Log(t=t, q=np.zeros_like(tau), tau=tau, names=("a", "b"), units={}, dh=True)


def torques(noise=0.1, samples=4000, seed=0):
    t = np.arange(samples)[:, None] / 200.0
    phase = 2 * np.pi * np.array([0.4, 0.7]) * t
    clean = 10 * np.sin(phase) + 2 * np.sign(np.cos(phase))
    return clean, clean + noise * np.random.default_rng(seed).standard_normal(clean.shape)


def test_one_percent_of_spikes_is_found_and_replaced_by_values_like_those_around():
    clean, tau = torques()
    rng = np.random.default_rng(1)
    hit = rng.random(tau.shape) < 0.01
    spoilt = tau + hit * 5 * rng.choice([-1, 1], tau.shape)
    cured, findings = despiked(log_with(spoilt), 5.0)
    assert np.mean(np.abs(cured.tau - clean)[hit] < 1.0) > 0.97  # why not all: three of five may be hit
    assert np.mean((cured.tau != spoilt)[~hit]) < 1e-3  # a sample between two spikes is taken for a third
    assert findings[0].evidence["samples"] == pytest.approx(hit.sum(axis=0), rel=0.03)


@pytest.mark.parametrize("noise", [0.0, 1e-3, 0.1, 1.0])
def test_torques_without_spikes_come_back_as_they_are(noise):
    log = log_with(torques(noise)[1])
    assert despiked(log, 5.0) == (log, ())


def test_a_log_too_slow_to_tell_a_spike_from_a_motion_is_left_alone():
    tau = torques()[1]
    tau[100] += 50
    log = log_with(tau, rate=50.0)
    assert despiked(log, 5.0) == (log, ())


def test_spikes_that_are_too_many_are_no_accidents():
    tau = torques()[1]
    tau[::20] += 5
    log = log_with(tau)
    assert despiked(log, 5.0) == (log, ())
