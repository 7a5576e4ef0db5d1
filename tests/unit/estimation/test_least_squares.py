"""Least squares from triangular factors against the textbook formulas on all rows."""

import numpy as np
import pytest

from dynid.errors import LogTooShort
from dynid.estimation.least_squares import (
    condition_number,
    merge,
    ordinary,
    solve,
    weighted,
)
from dynid.estimation.rows import Rows

TRUTH = np.array([3.0, -1.0, 0.5, 2.0, 0.01])
NOISE = np.array([0.1, 1.0, 10.0])


def rows(samples=400, noise=NOISE, seed=0):
    rng = np.random.default_rng(seed)
    W = rng.standard_normal((samples, len(noise), 5)) * [1, 1, 3, 1, 100]
    return W, W @ TRUTH + noise * rng.standard_normal((samples, len(noise)))


def factors(W, tau):
    rows = Rows.of(W, tau)
    return rows.factors(), rows.counts


def test_ordinary_fit_is_that_of_all_rows():
    W, tau = rows()
    fit = ordinary(*factors(W, tau))
    X, y = W.reshape(-1, 5), tau.ravel()
    theta, squares = np.linalg.lstsq(X, y, rcond=None)[:2]
    assert np.allclose(fit.theta, theta, rtol=1e-12)
    assert np.allclose(fit.covariance, squares / (1200 - 5) * np.linalg.inv(X.T @ X), rtol=1e-9)
    assert np.allclose(fit.rms, np.sqrt(np.mean((tau - W @ theta) ** 2, axis=0)))
    assert condition_number(fit.whitened, fit.solution.rank) == pytest.approx(np.linalg.cond(X))
    assert fit.solution.condition_number_scaled == pytest.approx(
        np.linalg.cond(X / np.linalg.norm(X, axis=0))
    )


def test_weighted_fit_is_generalised_least_squares_with_the_joints_own_noise():
    W, tau = rows(4000)
    fit = weighted(*factors(W, tau))
    assert np.allclose(fit.noise, NOISE, rtol=0.05)
    X = (W / fit.noise[:, None]).reshape(-1, 5)
    assert np.allclose(
        fit.theta, np.linalg.lstsq(X, (tau / fit.noise).ravel(), rcond=None)[0], rtol=1e-9
    )
    assert np.allclose(fit.covariance, np.linalg.inv(X.T @ X), rtol=1e-9)


@pytest.mark.slow
def test_noise_is_unbiased_although_few_rows_fit_many_parameters():
    ratio = [weighted(*factors(*rows(12, seed=s))).noise ** 2 / NOISE**2 for s in range(400)]
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.08)


def test_with_prior_rows_it_is_the_bayesian_posterior_mean():
    W, tau = rows(50)
    prior, covariance = TRUTH + 0.3, np.diag([0.1, 0.2, 0.1, 0.4, 0.1]) ** 2
    covariance[0, 1] = covariance[1, 0] = 0.01
    root = np.linalg.inv(np.linalg.cholesky(covariance))
    fit = weighted(*factors(W, tau), np.column_stack([root, root @ prior]))
    X, y = (W / fit.noise[:, None]).reshape(-1, 5), (tau / fit.noise).ravel()
    precision = X.T @ X + np.linalg.inv(covariance)
    assert np.allclose(
        fit.theta, np.linalg.solve(precision, X.T @ y + np.linalg.solve(covariance, prior))
    )
    assert np.allclose(fit.covariance, np.linalg.inv(precision))


def test_rank_and_open_directions_are_found_whatever_the_units():
    W, tau = rows(100)
    W[:, :, 3] = 1e-4 * (W[:, :, 0] + 2 * W[:, :, 1])
    solution = solve(merge(factors(W, tau)[0]))
    assert solution.rank == 4
    assert solution.condition_number_scaled == np.inf
    open_direction = solution.weak[:, 0] / solution.weak[3, 0]
    assert np.allclose(open_direction, [-1e-4, -2e-4, 0, 1, 0], atol=1e-10)
    assert np.allclose(W.reshape(-1, 5) @ solution.weak, 0, atol=1e-10)


def test_slow_motion_does_not_lose_rank():
    W, tau = rows(100)
    slow = np.array([1, 1, 1e-2, 1e-4, 1e-6])
    both = [merge(factors(W * s, tau)[0]) for s in (np.ones(5), slow)]
    normal, slowed = map(solve, both)
    assert slowed.rank == 5
    assert slowed.condition_number_scaled == pytest.approx(normal.condition_number_scaled)
    assert condition_number(both[1], slowed.rank) > 50 * condition_number(both[0], normal.rank)


def test_noise_free_rows_give_the_truth():
    W, tau = rows(noise=np.zeros(3))
    fit = weighted(*factors(W, tau))
    assert np.allclose(fit.theta, TRUTH, rtol=1e-10)


def test_fewer_rows_than_parameters_are_refused():
    with pytest.raises(LogTooShort):
        weighted(*factors(*rows(1)))


def test_joints_without_rows_for_the_first_links_are_merged_as_all_rows_are():
    rows = np.random.default_rng(0).standard_normal((3, 7, 7))
    rows[1, :, :3], rows[2, :, :6] = 0.0, 0.0
    for some in (rows, rows[2:]):
        together, stacked = merge(some), some.reshape(-1, 7)
        assert len(together) == 7
        np.testing.assert_allclose(together.T @ together, stacked.T @ stacked, atol=1e-12)
