"""Intervals of logs so short that the fit takes most slow errors away."""

import numpy as np
import pytest

from dynid.estimation.hac import hac_covariance
from dynid.estimation.least_squares import weighted
from dynid.estimation.observation_rows import dense_rows, joint_factors
from dynid.estimation.small_sample import short_log_factor
from dynid.signals.filters import pulse, pulse_width

CUTOFF, RATE = 5.0, 20.0


def slow_log(seed, instants=120, columns=24):
    """Many slow columns, and noise that has passed the filter of the rows."""
    t = np.arange(instants) / RATE
    w = 2 * np.pi * 0.1 * np.arange(1, columns // 2 + 1)
    W = np.hstack([np.sin(np.outer(t, w)), np.cos(np.outer(t, w))])[:, None]
    half = int(pulse_width(CUTOFF) * RATE)
    kernel = pulse(np.arange(-half, half + 1.0) / RATE, CUTOFF)
    noise = np.convolve(np.random.default_rng(seed).standard_normal(instants + 2 * half), kernel, "valid")
    theta = np.linspace(-1, 1, columns)
    return theta, dense_rows(W, W @ theta + 0.1 * noise[:, None], t=t, cutoff=CUTOFF)


def test_intervals_of_a_short_log_cover_what_they_say():
    inside = []
    for seed in range(100):
        theta, rows = slow_log(seed)
        fit = weighted(*joint_factors([rows]))
        covariance = hac_covariance([rows], fit.theta, fit.noise).covariance
        inside.append(np.abs(fit.theta - theta) <= 1.96 * np.sqrt(np.diagonal(covariance)))
    assert 0.92 <= np.mean(inside) <= 0.98


@pytest.mark.parametrize(("instants", "columns", "bounds"), [(4000, 2, (0.95, 1.15)), (120, 24, (1.2, 4.0))])
def test_a_long_log_needs_no_widening_and_a_short_one_does(instants, columns, bounds):
    rows = slow_log(0, instants, columns)[1]
    factors, counts = joint_factors([rows])
    fit = weighted(factors, counts)
    factor = short_log_factor([rows], fit.covariance, fit.noise, lags=6)
    assert bounds[0] < np.median(factor) < bounds[1]
