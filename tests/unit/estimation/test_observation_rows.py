"""Rows walked again carry the same information as triangular factors, and rows that do not count carry none."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.estimation.covariance import hac_covariance
from dynid.estimation.rows import (
    ObservationRows,
    dense_rows,
    joint_factors,
    robust_noise,
)


def pieces():
    rng = np.random.default_rng(0)
    for k in range(3):
        W = rng.standard_normal((40, 2, 3))
        usable = rng.random((40, 2)) > 0.1
        yield dense_rows(
            W,
            np.where(usable, W @ [1.0, 2.0, 3.0] + [0.0, 1.0], 1e9),
            usable=usable,
            follows=k == 1,
        )


def test_factors_hold_the_normal_equations_of_the_rows_that_count():
    factors, counts = joint_factors(list(pieces()))
    for j in range(2):
        A = np.concatenate(
            [np.column_stack([p.W[p.mask[:, j], j], p.tau[p.mask[:, j], j]]) for p in pieces()]
        )
        assert factors[j].T @ factors[j] == pytest.approx(A.T @ A)
        assert counts[j] == len(A)


def test_rows_that_do_not_count_leave_no_trace():
    theta = np.array([1.0, 2.0, 3.0])
    assert robust_noise(list(pieces()), theta) == pytest.approx([0.0, 1.4826], abs=1e-6)


def sparse_rows():
    """Rows of two joints: the first has columns 3, 0 and 2, the second only 1 and 2; entries in no order."""
    rng = np.random.default_rng(5)
    joints, columns = np.array([1, 0, 0, 1, 0]), np.array([2, 3, 0, 1, 2])
    entries, usable = rng.standard_normal((5, 600)), rng.random((600, 2)) > 0.2
    return ObservationRows(
        entries, joints, columns, 4, rng.standard_normal((600, 2)), usable=usable
    )


def test_torques_and_factors_need_no_whole_matrix():
    rows, rng = sparse_rows(), np.random.default_rng(6)
    W = np.zeros((600, 2, 4))
    W[:, rows.joints, rows.columns] = rows.entries.T
    assert pytest.approx(W) == rows.W
    for theta in (rng.standard_normal(4), rng.standard_normal((2, 4))):
        expected = np.einsum("mjp,jp->mj", W, np.broadcast_to(theta, (2, 4)))
        np.testing.assert_allclose(rows.torque(theta), expected, rtol=1e-12, atol=1e-12)
    for j in range(2):
        columns, entries = rows.of_joint(j)
        assert columns.tolist() == [[0, 2, 3], [1, 2]][j]
        np.testing.assert_array_equal(entries.T, W[:, j, columns])
    factors, _ = joint_factors([rows])
    dense, _ = joint_factors([dense_rows(W, rows.tau, usable=rows.usable)])
    for one, two in zip(factors, dense, strict=True):
        np.testing.assert_allclose(one.T @ one, two.T @ two, rtol=1e-12, atol=1e-11)


def test_scores_of_sparse_rows_have_the_covariance_of_the_whole_matrix():
    rows = replace(sparse_rows(), command=np.random.default_rng(7).standard_normal((5, 600)))
    theta, noise = np.array([0.1, 0.2, -0.3, 0.1]), np.array([1.0, 0.5])
    basis = np.random.default_rng(8).standard_normal((4, 3))
    W = rows.with_arrays(rows.W, rows.tau, rows.Z)
    for robust in (False, True):
        one, two = (hac_covariance([each], theta, noise, robust=robust) for each in (rows, W))
        np.testing.assert_allclose(one, two, rtol=1e-10, atol=1e-14)
    mixed = rows.with_arrays(rows.W @ basis, rows.tau)
    one = hac_covariance([replace(rows, command=None)], theta[:3], noise, basis=basis)
    np.testing.assert_allclose(
        one, hac_covariance([mixed], theta[:3], noise), rtol=1e-9, atol=1e-14
    )
