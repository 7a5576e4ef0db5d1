"""Elimination of blocks against the joint solution and the normal density."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from dynid.estimation.factor import Factor, triangle
from dynid.estimation.rows import Rows, joined, robust_noise


@pytest.fixture
def problem():
    """Rows of three blocks from two recordings, and how well two of the blocks are known."""
    rng = np.random.default_rng(0)
    X = {name: rng.normal(size=(60, k)) for name, k in (("arm", 4), ("columns", 5), ("load", 2))}
    sd = {"arm": np.full(4, 10.0), "columns": np.full(5, 0.3), "load": np.array([0.1, 2.0])}
    y = X["arm"] @ [1.0, -2.0, 0.5, 0.0] + 0.3 * X["columns"] @ rng.normal(size=5)
    return X, sd, y + rng.normal(size=60)


def known(X, sd, y):
    factor = Factor({name: X[name][:20] for name in X}, y[:20])
    factor += Factor({name: X[name][20:] for name in reversed(X)}, y[20:])
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
    blocks = "columns", "load", "arm"
    A, scale = (np.concatenate([x[name] for name in blocks], axis=-1) for x in (X, sd))
    H = A.T @ A + np.diag(1 / scale**2)
    whole, covariance = np.linalg.solve(H, A.T @ y), np.linalg.inv(H)
    R = triangle(left.rows)
    theta = np.linalg.solve(R[:4, :4], R[:4, -1])
    assert theta == pytest.approx(whole[-4:], abs=1e-10)
    assert np.linalg.inv(R[:4, :4].T @ R[:4, :4]) == pytest.approx(covariance[-4:, -4:], abs=1e-10)
    rest = taken.conditional
    assert rest.mean + rest.slope @ theta == pytest.approx(whole[:-4], abs=1e-10)
    spread = rest.root @ rest.root.T + rest.slope @ covariance[-4:, -4:] @ rest.slope.T
    assert spread == pytest.approx(covariance[:7, :7], abs=1e-10)


# ---------------------------------------------------------------- rows
THETA = np.array([1.0, 2.0, 3.0])


@pytest.fixture
def rows():
    """Rows of two joints; the second lacks the first column, and a tenth of all do not count."""
    rng = np.random.default_rng(0)
    W, use = rng.standard_normal((120, 2, 3)), rng.random((120, 2)) > 0.1
    W[:, 1, 0] = 0.0
    return replace(Rows.of(W, np.where(use, W @ THETA + [0.0, 1.0], 1e9)), use=use)


def test_factors_hold_the_normal_equations_of_the_rows_that_count(rows):
    weight = np.random.default_rng(1).random((120, 2))
    for scale in (None, weight):
        for j, R in enumerate(rows.factors(scale)):
            good = rows.use[:, j]
            A = np.column_stack([rows.W[good, j], rows.tau[good, j]])
            A = A if scale is None else A * scale[good, j, None]
            assert pytest.approx(A.T @ A) == R.T @ R
    assert rows.counts.tolist() == rows.use.sum(axis=0).tolist()


def test_rows_that_do_not_count_leave_no_trace(rows):
    assert robust_noise(rows, THETA) == pytest.approx([0.0, 1.4826], abs=1e-6)


def test_rows_taken_apart_and_joined_are_the_same_with_a_gap(rows):
    first = np.arange(120) < 50
    both = joined([rows.take(first), rows.take(~first)])
    assert np.array_equal(both.W, rows.W)
    assert [run.start for run in both.runs] == [0, 50]
    assert rows.take(np.arange(120) % 60 > 9).runs == [slice(0, 50), slice(50, 100)]
