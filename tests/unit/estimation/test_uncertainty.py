"""Error bars against hand formulas and against the spread over many simulated recordings."""

import numpy as np
import pytest

from dynid.estimation.hac import hac_covariance
from dynid.estimation.least_squares import weighted
from dynid.estimation.observation_rows import dense_rows, joint_factors
from dynid.estimation.uncertainty import (
    Knowledge,
    automatic_lags,
    block_bootstrap,
    effective_samples,
    f_test,
    jackknife,
    judge,
    long_run_variance,
    simultaneous_factor,
    wald_test,
)

TRUTH = np.array([2.0, -1.0, 0.5, 0.0])


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
    return dense_rows(W, W @ TRUTH + noise)


def fitted(segment):
    fit = weighted(*joint_factors([segment]))
    return fit, hac_covariance([segment], fit.theta, fit.noise)


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


def test_honest_intervals_cover_where_textbook_ones_do_not(many):
    thetas = [fit.theta for fit, _ in many]
    textbook = coverage(thetas, [np.sqrt(np.diagonal(fit.covariance)) for fit, _ in many])
    honest = coverage(thetas, [np.sqrt(np.diagonal(hac.covariance)) for _, hac in many])
    assert textbook < 0.70
    assert 0.90 <= honest <= 0.99


def test_white_residuals_keep_the_textbook_width():
    both = [fitted(recording(seed, 0.0)) for seed in range(60)]
    honest = coverage([f.theta for f, _ in both], [np.sqrt(np.diagonal(h.covariance)) for _, h in both])
    assert 0.90 <= honest <= 0.99


def test_jackknife_and_bootstrap_match_the_spread_over_recordings(many):
    spread = np.std([fit.theta for fit, _ in many], axis=0)
    ratios = []
    for seed in range(15):
        segment = recording(seed, 0.8)
        blocks = [joint_factors([segment.part(k, k + 25, follows=False, block=0)])[0] for k in range(0, 1000, 25)]
        factors, noise = np.stack(blocks, axis=1), many[seed][0].noise
        by_jackknife = np.sqrt(np.diagonal(jackknife(factors, noise)))
        by_bootstrap = np.std(block_bootstrap(factors, noise, draws=200), axis=0)
        ratios.append([by_jackknife / spread, by_bootstrap / spread])
    assert np.all(np.abs(np.mean(ratios, axis=0) - 1) < 0.25)


def test_effective_samples_follow_the_ar1_formula():
    rng = np.random.default_rng(3)
    for rho in (0.0, 0.5, 0.9):
        worth = np.mean([effective_samples(ar1(rng, (4000, 1), rho)) for _ in range(10)])
        assert worth == pytest.approx(4000 * (1 - rho) / (1 + rho), rel=0.25)


def test_lags_grow_with_the_memory_of_the_scores():
    rng = np.random.default_rng(4)
    lags = [automatic_lags([ar1(rng, (2000, 3), rho)]) for rho in (0.0, 0.5, 0.9)]
    assert lags[0] <= 3 < lags[1] < lags[2] < 100


@pytest.mark.parametrize(
    ("p", "method", "expected"),
    [
        (1, "single", 1.960),
        (1, "max_t", 1.960),
        (1, "scheffe", 1.960),
        (10, "bonferroni", 2.807),
        (10, "max_t", 2.799),  # Sidak, independent
        (2, "scheffe", 5.991**0.5),
    ],
)
def test_simultaneous_factors_match_tables(p, method, expected):
    assert simultaneous_factor(np.diag(np.arange(1.0, p + 1)), 0.95, method) == pytest.approx(expected, rel=0.01)


def test_simultaneous_factors_with_few_degrees_of_freedom_match_tables():
    one = np.eye(1)
    assert simultaneous_factor(one, 0.95, "single", 10) == pytest.approx(2.228, rel=1e-3)
    assert simultaneous_factor(one, 0.95, "max_t", 10) == pytest.approx(2.228, rel=0.02)
    assert simultaneous_factor(np.eye(3), 0.95, "scheffe", 20) == pytest.approx((3 * 3.098) ** 0.5, rel=1e-3)


def test_correlated_parameters_need_narrower_simultaneous_intervals():
    together = 0.99 * np.ones((10, 10)) + 0.01 * np.eye(10)
    assert simultaneous_factor(together) < simultaneous_factor(np.eye(10)) - 0.3


def test_simultaneous_intervals_hold_for_all_parameters_at_once(many):
    hits = []
    for fit, hac in many:
        factor = simultaneous_factor(hac.covariance)
        hits.append(np.all(np.abs(fit.theta - TRUTH) <= factor * np.sqrt(np.diagonal(hac.covariance))))
    assert 0.87 <= np.mean(hits) <= 0.99


def test_zero_group_is_dropped_and_real_one_kept(many):
    zero, real = np.array([3]), np.array([1, 2])
    p_values = [wald_test(fit.theta, hac.covariance, zero).p_value for fit, hac in many]
    assert np.mean(np.array(p_values) < 0.05) < 0.12
    assert all(wald_test(fit.theta, hac.covariance, real).p_value < 1e-3 for fit, hac in many[:20])


def test_f_test_has_its_nominal_size_on_white_residuals():
    p_values = []
    for seed in range(200):
        segment = recording(seed, 0.0, samples=60, joints=2)
        fit = weighted(*joint_factors([segment]))
        p_values.append(f_test(fit.whitened, np.array([3]), 120).p_value)
    assert np.mean(np.array(p_values) < 0.10) == pytest.approx(0.10, abs=0.06)
    assert f_test(fit.whitened, np.array([0]), 120).p_value < 1e-6


def test_f_test_allows_for_coloured_residuals(many):
    counts = []
    for seed in range(60):
        segment = recording(seed, 0.8)
        fit = many[seed][0]
        worth = 2 * effective_samples(segment.residual(fit.theta))
        group = np.array([3])
        pair = (f_test(fit.whitened, group, 2000).p_value, f_test(fit.whitened, group, 2000, worth).p_value)
        counts.append(np.array(pair) < 0.05)
    naive, honest = np.mean(counts, axis=0)
    assert naive > 0.25
    assert honest < 0.12


def test_judgement_separates_unknown_from_known_to_be_zero():
    theta = np.array([1.0, 1.0, 1.0, 1e-6, 0.0])
    error = np.array([0.05, 0.2, 0.5, 1e-4, 1.0])
    effect = np.array([10.0, 10.0, 10.0, 10.0, 0.0])
    assert judge(theta, error, effect) == (
        Knowledge.WELL,
        Knowledge.ROUGHLY,
        Knowledge.NOT_DETERMINED,
        Knowledge.WELL,
        Knowledge.NOT_DETERMINED,
    )
