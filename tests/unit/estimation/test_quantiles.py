"""Quantiles are those of SciPy."""

import numpy as np
import pytest
from scipy import special

from dynid.estimation.quantiles import normal_quantile, student_quantile


@pytest.mark.parametrize("p", [0.6, 0.9, 0.975, 0.99])
def test_quantiles_are_those_of_scipy(p):
    freedom = np.array([2.0, 2.5, 3.0, 5.0, 10.0, 50.0, 199.9, 200.1, 1e3, 1e5, 1e8])
    np.testing.assert_allclose(student_quantile(freedom, p), special.stdtrit(freedom, p), rtol=1e-11)
    assert normal_quantile(p) == pytest.approx(special.ndtri(p), rel=1e-14)
