"""Rows carry the same information as triangular factors, and rows that do not count carry none."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.estimation.rows import Rows, joined, robust_noise

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


@pytest.mark.parametrize("theta", [THETA, np.array([THETA, -THETA])])
def test_torques_are_those_of_the_parameters_of_all_or_of_each_joint(rows, theta):
    expected = np.einsum("mjp,jp->mj", rows.W, np.broadcast_to(theta, (2, 3)))
    assert rows.torque(theta) == pytest.approx(expected)


def test_rows_taken_apart_and_joined_are_the_same_with_a_gap(rows):
    first = np.arange(120) < 50
    both = joined([rows.take(first), rows.take(~first)])
    assert np.array_equal(both.W, rows.W)
    assert [run.start for run in both.runs] == [0, 50]
    assert rows.take(np.arange(120) % 60 > 9).runs == [slice(0, 50), slice(50, 100)]
