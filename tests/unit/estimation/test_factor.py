"""Elimination of blocks against the joint solution and the normal density."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from dynid.estimation.factor import Factor, triangle


@pytest.fixture
def problem():
    """Rows of three blocks from two recordings, and how well two of the blocks are known."""
    rng = np.random.default_rng(0)
    X = {name: rng.normal(size=(60, k)) for name, k in (("arm", 4), ("columns", 5), ("load", 2))}
    sd = {"arm": np.full(4, 10.0), "columns": np.full(5, 0.3), "load": np.array([0.1, 2.0])}
    y = X["arm"] @ [1.0, -2.0, 0.5, 0.0] + 0.3 * X["columns"] @ rng.normal(size=5)
    return X, sd, y + rng.normal(size=60)


def known(X, sd, y):
    factor = Factor.of({name: X[name][:20] for name in X}, y[:20])
    factor += Factor.of({name: X[name][20:] for name in reversed(X)}, y[20:])
    for name, each in sd.items():
        factor = factor.prior(name, each)
    return factor


def log_density(factor):
    left = factor.without(*factor.blocks)[0]
    return left.volume - 0.5 * float(np.sum(left.rows**2)) - 30 * np.log(2 * np.pi)


def test_the_volume_and_the_squares_that_are_left_are_the_normal_density(problem):
    X, sd, y = problem
    S = np.eye(60) + sum((X[name] * sd[name] ** 2) @ X[name].T for name in X)
    expected = multivariate_normal(np.zeros(60), S).logpdf(y)
    assert log_density(known(X, sd, y)) == pytest.approx(expected, abs=1e-9)
    one_by_one = known(X, sd, y).without("load")[0].without("arm")[0]
    assert log_density(one_by_one) == pytest.approx(expected, abs=1e-9)


def test_what_is_left_and_what_was_taken_are_the_joint_solution(problem):
    X, sd, y = problem
    left, taken = known(X, sd, y).without("columns", "load")
    A, scale = (
        np.column_stack([X["columns"], X["load"], X["arm"]]),
        [sd["columns"], sd["load"], sd["arm"]],
    )
    H = A.T @ A + np.diag(1 / np.concatenate(scale) ** 2)
    whole, covariance = np.linalg.solve(H, A.T @ y), np.linalg.inv(H)
    R = triangle(left.rows)
    theta = np.linalg.solve(R[:4, :4], R[:4, -1])
    assert theta == pytest.approx(whole[-4:], abs=1e-10)
    assert np.linalg.inv(R[:4, :4].T @ R[:4, :4]) == pytest.approx(covariance[-4:, -4:], abs=1e-10)
    rest = taken.conditional
    assert rest.mean + rest.slope @ theta == pytest.approx(whole[:-4], abs=1e-10)
    spread = rest.root @ rest.root.T + rest.slope @ covariance[-4:, -4:] @ rest.slope.T
    assert spread == pytest.approx(covariance[:7, :7], abs=1e-10)
