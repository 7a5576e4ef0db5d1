"""Columns are assigned to joints as SciPy assigns them."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from dynid.diagnose.mistakes import assignment


def test_columns_are_assigned_at_the_least_cost():
    random = np.random.default_rng(0)
    for n in [*range(1, 9)] * 30:
        cost = random.standard_normal((n, n))
        assert assignment(cost) == linear_sum_assignment(cost)[1].tolist()
