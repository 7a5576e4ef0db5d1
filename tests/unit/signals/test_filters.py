"""Filters against the laws they must obey: nothing delayed, polynomials kept, pieces equal the whole."""

from dataclasses import replace

import numpy as np
import pytest

from dynid import Log, Robot
from dynid.robot import Joint
from dynid.signals.conditioned_log import condition
from dynid.signals.filters import (
    choose_filter,
    decimate,
    despiked,
    lowpass_kernel,
)
from dynid.signals.stamps import without_intervals

ARM = Robot("two", "standard", (Joint("first"), Joint("second")))


def test_a_kernel_passes_slow_and_stops_fast_signals():
    kernel = lowpass_kernel(5.0, 200.0)
    k = np.arange(len(kernel)) - len(kernel) // 2

    def gain(f):
        return abs(np.sum(kernel * np.cos(2 * np.pi * f * k / 200.0)))

    assert gain(0.0) == pytest.approx(1.0)
    assert gain(1.5) == pytest.approx(1.0, abs=3e-3)
    assert gain(5.0) == pytest.approx(0.5, abs=0.02)
    assert max(gain(f) for f in np.linspace(8.5, 100, 50)) < 3e-3


@pytest.mark.parametrize(("length", "step"), [(100, 1), (333, 4), (1000, 7), (61, 9)])
def test_decimation_equals_the_sum_over_each_window(length, step):
    rng = np.random.default_rng(length)
    x, kernels = rng.normal(size=(3, length)), rng.normal(size=(2, 31))
    got = decimate(x, kernels, step)
    for i in range(got.shape[2]):
        assert got[:, :, i] == pytest.approx(kernels @ x[:, i * step : i * step + 31].T, abs=1e-12)
    assert got.shape[2] == (length - 31) // step + 1


def sine_log(rate=200.0, seconds=20.0, f=0.5, noise=1e-5, jitter=0.0, n=2):
    rng = np.random.default_rng(4)
    t = np.arange(int(rate * seconds)) / rate
    t = t + jitter / rate * rng.uniform(-0.5, 0.5, len(t))
    q = np.column_stack([np.sin(2 * np.pi * f * (j + 1) * t) for j in range(n)])
    return Log(t, q + noise * rng.normal(size=q.shape), np.cos(t)[:, None] * np.ones(n))


def test_the_cutoff_follows_the_motion_unless_given():
    assert choose_filter(sine_log(f=2.0), ARM).cutoff == pytest.approx(20.0, abs=1.0)
    assert choose_filter(sine_log(f=0.1), ARM).cutoff == 5.0
    assert choose_filter(sine_log(), ARM, cutoff=7.0).cutoff == 7.0


@pytest.mark.parametrize(("jitter", "within"), [(0.0, 1e-5), (0.4, 2e-4)])
def test_conditioning_finds_speed_and_acceleration_also_on_uneven_stamps(jitter, within):
    log = sine_log(jitter=jitter, noise=0.0)
    (segment,) = condition(log, choose_filter(log, ARM, 20.0))
    w, t = 2 * np.pi * 0.5 * np.arange(1, 3), segment.t[:, None]
    assert segment.q == pytest.approx(np.sin(w * t), abs=within)
    assert segment.qd == pytest.approx(w * np.cos(w * t), abs=within * w.max())
    assert segment.qdd == pytest.approx(-(w**2) * np.sin(w * t), abs=within * w.max() ** 2)


def test_what_is_excluded_is_cut_out_not_bridged_and_leaves_no_trace():
    log = sine_log()
    q = log.q.copy()
    q[(log.t > 8) & (log.t < 9)] = 50.0
    clean = without_intervals(Log(log.t, q, log.tau), [(7.99, 9.01)])
    before, after = condition(clean, choose_filter(log, ARM))
    assert before.t[-1] < 8
    assert 9 < after.t[0] < 9.6
    assert max(np.abs(part.q).max() for part in (before, after)) < 1.01


def test_an_exclusion_means_the_logs_own_clock_also_where_that_does_not_start_at_zero():
    log = sine_log()
    later = without_intervals(replace(log, t=log.t + 7.0), [(0.0, 8.0)])
    assert later.t[0] == pytest.approx(8.005)
    (part,) = condition(later, choose_filter(log, ARM))
    assert part.t[0] < 8.5


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
    # Why not all: three of five may be hit, and a sample between two spikes is taken for a third.
    assert np.mean(np.abs(cured.tau - clean)[hit] < 1.0) > 0.97
    assert np.mean((cured.tau != spoilt)[~hit]) < 1e-3
    assert findings[0].evidence["samples"] == pytest.approx(hit.sum(axis=0), rel=0.03)


@pytest.mark.parametrize("noise", [0.0, 1e-3, 0.1, 1.0])
def test_torques_without_spikes_come_back_as_they_are(noise):
    log = log_with(torques(noise)[1])
    assert despiked(log, 5.0) == (log, ())


@pytest.mark.parametrize(("hit", "rate"), [(slice(100, 101), 50.0), (slice(None, None, 20), 200.0)])
def test_what_may_be_motion_and_spikes_too_many_for_accidents_stay(hit, rate):
    tau = torques()[1]
    tau[hit] += 50 if rate == 50.0 else 5
    log = log_with(tau, rate)
    assert despiked(log, 5.0) == (log, ())
