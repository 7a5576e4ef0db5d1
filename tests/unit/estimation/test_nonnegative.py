"""Parameters that cannot be negative leave as little as with SciPy's solver."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear, nnls

from dynid.estimation.least_squares import nonnegative, nonnegative_least_squares


@pytest.mark.parametrize(
    "kind", ["any", "positive", "repeated", "nearly dependent", "zero columns"]
)
def test_nonnegative_parameters_leave_the_least(kind):
    random = np.random.default_rng(1)
    for _ in range(60):
        m, p = random.integers(1, 40), random.integers(1, 80)
        A, b = random.standard_normal((m, p)), random.standard_normal(m)
        if kind == "positive":
            A, b = np.abs(A), np.abs(b)
        elif kind == "repeated":
            A = A[:, random.integers(0, max(1, p // 2), p)]
        elif kind == "nearly dependent":
            A = A[:, :1] + 1e-5 * A
        elif kind == "zero columns":
            A[:, random.random(p) < 0.5] = 0.0
        x, (_, least) = nonnegative_least_squares(A, b, 10 * p), nnls(A, b)
        assert x.min() >= 0.0
        assert np.linalg.norm(A @ x - b) <= least * (1 + 1e-7) + 1e-12
        # Karush, Kuhn, Tucker: no column would help, and those in use do not either.
        slope = A.T @ (b - A @ x)
        assert slope.max() <= 1e-9 * np.linalg.norm(A)
        assert np.abs(slope[x > 0.0]).max(initial=0.0) <= 1e-9 * np.linalg.norm(A)


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_some_parameters_that_cannot_be_negative_are_those_of_scipy(share):
    random, negative = np.random.default_rng(2), 0
    for _ in range(30):
        p = random.integers(2, 60)
        size = 10.0 ** random.uniform(-3.0, 3.0, p)
        A = (
            random.standard_normal((150, p))
            @ (np.eye(p) + 0.5 * random.standard_normal((p, p)) / np.sqrt(p))
            * size
        )
        tau = A @ (random.standard_normal(p) / size) + random.standard_normal(150)
        theta = np.linalg.lstsq(A, tau, rcond=None)[0]
        positive = random.random(p) < share
        found = nonnegative(np.linalg.qr(np.column_stack([A, tau]), mode="r"), theta, positive)
        bound = np.where(positive, 0.0, -np.inf)
        wanted = lsq_linear(A / size, tau, (bound, np.inf), method="bvls").x / size
        np.testing.assert_allclose(
            found * size, wanted * size, atol=1e-9 * np.abs(wanted * size).max()
        )
        negative += bool(np.any(theta[positive] < 0.0))
    assert negative > 10
