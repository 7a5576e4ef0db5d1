"""Rows walked again carry the same information as triangular factors, and rows that do not count carry none."""

import numpy as np
import pytest

from dynid.estimation.observation_rows import dense_rows, joint_factors, robust_noise, root_mean_square


def pieces():
    rng = np.random.default_rng(0)
    for k in range(3):
        W = rng.standard_normal((40, 2, 3))
        usable = rng.random((40, 2)) > 0.1
        yield dense_rows(W, np.where(usable, W @ [1.0, 2.0, 3.0] + [0.0, 1.0], 1e9), usable=usable, follows=k == 1)


def test_factors_hold_the_normal_equations_of_the_rows_that_count():
    factors, counts = joint_factors(list(pieces()))
    for j in range(2):
        A = np.concatenate([np.column_stack([p.W[p.mask[:, j], j], p.tau[p.mask[:, j], j]]) for p in pieces()])
        assert factors[j].T @ factors[j] == pytest.approx(A.T @ A)
        assert counts[j] == len(A)


def test_rows_that_do_not_count_leave_no_trace():
    theta = np.array([1.0, 2.0, 3.0])
    assert root_mean_square(list(pieces()), theta) == pytest.approx([0.0, 1.0], abs=1e-2)
    assert robust_noise(list(pieces()), theta) == pytest.approx([0.0, 1.4826], abs=1e-6)
