"""Error bars against hand formulas and against the spread over many simulated recordings."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.estimation.covariance import (
    hac_covariance,
    judge,
    long_run_variance,
    widened,
)
from dynid.estimation.least_squares import weighted
from dynid.estimation.rows import Rows
from dynid.signals.filters import lowpass_kernel

TRUTH = np.array([2.0, -1.0, 0.5, 0.0])
CUTOFF, RATE = 5.0, 20.0


def ar1(rng, shape, rho):
    """Unit-variance AR(1) noise along the first axis."""
    e = rng.standard_normal(shape)
    e[1:] *= (1 - rho**2) ** 0.5
    for t in range(1, shape[0]):
        e[t] += rho * e[t - 1]
    return e


def recording(seed, rho, samples=1000, joints=2):
    """Slowly varying regressors with AR(1) torque noise, partly common to the joints."""
    rng = np.random.default_rng(seed)
    W = ar1(rng, (samples, joints * 4), 0.95).reshape(samples, joints, 4)
    noise = ar1(rng, (samples, joints), rho) @ np.array([[1.0, 0.5], [0.0, 0.5]])
    return Rows.of(W, W @ TRUTH + noise)


def fitted(segment):
    fit = weighted(segment.factors(), segment.counts)
    return fit, hac_covariance(segment, fit.theta, fit.noise)


@pytest.fixture(scope="module")
def many():
    return [fitted(recording(seed, 0.8)) for seed in range(150)]


def coverage(thetas, errors):
    return float(np.mean(np.abs(np.array(thetas) - TRUTH) <= 1.96 * np.array(errors)))


def test_moving_sums_are_newey_west():
    rng = np.random.default_rng(0)
    series, lags = [rng.standard_normal((40, 3)), rng.standard_normal((25, 3))], 6
    expected = np.zeros((3, 3))
    for s in series:
        expected += s.T @ s
        for lag in range(1, lags + 1):
            gamma = s[lag:].T @ s[:-lag]
            expected += (1 - lag / (lags + 1)) * (gamma + gamma.T)
    assert np.allclose(long_run_variance(series, lags), expected)


@pytest.mark.slow
def test_robust_intervals_cover_where_textbook_ones_do_not(many):
    thetas = [fit.theta for fit, _ in many]
    textbook = coverage(thetas, [np.sqrt(np.diagonal(fit.covariance)) for fit, _ in many])
    robust = coverage(thetas, [np.sqrt(np.diagonal(hac)) for _, hac in many])
    assert textbook < 0.70
    assert 0.90 <= robust <= 0.99


def test_white_residuals_keep_the_textbook_width():
    both = [fitted(recording(seed, 0.0)) for seed in range(60)]
    robust = coverage([f.theta for f, _ in both], [np.sqrt(np.diagonal(h)) for _, h in both])
    assert 0.90 <= robust <= 0.99


def slow_log(seed, instants=120, columns=24):
    """Many slow columns, and noise that has passed the filter of the rows."""
    t = np.arange(instants) / RATE
    w = 2 * np.pi * 0.1 * np.arange(1, columns // 2 + 1)
    W = np.hstack([np.sin(np.outer(t, w)), np.cos(np.outer(t, w))])[:, None]
    kernel = lowpass_kernel(CUTOFF, RATE)
    white = np.random.default_rng(seed).standard_normal(instants + len(kernel) - 1)
    noise = np.convolve(white, kernel / np.linalg.norm(kernel), "valid")
    theta = np.linspace(-1, 1, columns)
    return theta, replace(Rows.of(W, W @ theta + 0.1 * noise[:, None], t), cutoff=CUTOFF)


def test_intervals_of_a_short_log_cover_what_they_say():
    inside = []
    for seed in range(100):
        theta, rows = slow_log(seed)
        fit = weighted(rows.factors(), rows.counts)
        covariance = widened(rows, fit, hac_covariance(rows, fit.theta, fit.noise))
        inside.append(np.abs(fit.theta - theta) <= 1.96 * np.sqrt(np.diagonal(covariance)))
    assert 0.92 <= np.mean(inside) <= 0.98


@pytest.mark.parametrize(
    ("instants", "columns", "bounds"), [(4000, 2, (0.95, 1.15)), (120, 24, (1.2, 4.0))]
)
def test_a_long_log_needs_no_widening_and_a_short_one_does(instants, columns, bounds):
    rows = slow_log(0, instants, columns)[1]
    fit = weighted(rows.factors(), rows.counts)
    plain = hac_covariance(rows, fit.theta, fit.noise)
    wide = widened(rows, fit, plain)
    factor = np.median(np.sqrt(np.diagonal(wide) / np.diagonal(plain)))
    assert bounds[0] < factor < bounds[1]


def test_judgement_separates_unknown_from_known_to_be_zero():
    theta = np.array([1.0, 1.0, 1.0, 1e-6, 0.0])
    error = np.array([0.05, 0.2, 0.5, 1e-4, 1.0])
    effect = np.array([10.0, 10.0, 10.0, 10.0, 0.0])
    assert judge(theta, error, effect) == (
        "well",
        "roughly",
        "not determined",
        "negligible",
        "not determined",
    )


def test_parameters_that_the_log_hardly_tells_have_a_covariance_all_the_same():
    """The correlation of no two numbers is more than one, also where columns differ by rounding alone."""
    rng = np.random.default_rng(5)
    W = ar1(rng, (400, 6), 0.95).reshape(400, 2, 3)
    nearly = W @ rng.standard_normal((3, 3)) + 1e-5 * rng.standard_normal((400, 2, 3))
    segment = Rows.of(np.concatenate([W, nearly], axis=2), ar1(rng, (400, 2), 0.5))
    covariance = hac_covariance(segment, np.zeros(6), np.ones(2))
    spread = np.sqrt(np.diagonal(covariance))
    assert np.array_equal(covariance, covariance.T)
    assert (np.abs(covariance) <= (1 + 1e-9) * np.outer(spread, spread)).all()
