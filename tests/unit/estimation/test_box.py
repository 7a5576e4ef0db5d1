"""Between bounds, nothing smaller is found by SciPy."""

import numpy as np
import pytest
from scipy.optimize import minimize

from dynid.estimation.residual_model import smallest_in_box


def bowl(random):
    """A convex function of three numbers that is no parabola."""
    A, centre = random.standard_normal((3, 3)), 2 * random.standard_normal(3)
    H = A @ A.T + 0.01 * np.eye(3)

    def function(x):
        away = x - centre
        return float(0.5 * away @ H @ away + np.sum(np.log1p(np.exp(x)))), H @ away + 1 / (
            1 + np.exp(-x)
        )

    return function


def valley(x):
    """Rosenbrock's banana."""
    value = 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2
    return value, np.array(
        [-400 * x[0] * (x[1] - x[0] ** 2) - 2 * (1 - x[0]), 200 * (x[1] - x[0] ** 2)]
    )


def test_nothing_between_the_bounds_is_smaller():
    random = np.random.default_rng(0)
    low, high = np.full(3, -2.0), np.full(3, 1.5)
    for _ in range(40):
        function = bowl(random)
        x = smallest_in_box(function, np.zeros(3), low, high, 100, 1e-15)
        best = minimize(
            function,
            np.zeros(3),
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(low, high, strict=True)),
        )
        assert function(x)[0] <= best.fun + 1e-9 * abs(best.fun)
        assert np.all((low <= x) & (x <= high))


@pytest.mark.parametrize(("wall", "expected"), [(2.0, (1.0, 1.0)), (0.5, (0.5, 0.25))])
def test_a_bent_valley_is_followed_to_its_end_or_to_the_wall(wall, expected):
    x = smallest_in_box(
        valley, np.array([-1.2, 1.0]), np.array([-2.0, -2.0]), np.array([wall, 2.0]), 100, 1e-15
    )
    assert x == pytest.approx(expected, abs=1e-6)


def test_the_end_is_found_where_the_value_is_rounded_away():
    # Why 1e6: a value of that size resolves 1e-10, which is a place to 1e-5.
    random = np.random.default_rng(1)
    bounds = np.full(3, 5.0)
    for _ in range(40):
        A, centre = random.standard_normal((3, 3)), random.uniform(-2.0, 2.0, 3)
        H = A @ A.T + 0.1 * np.eye(3)

        def deep(x, H=H, centre=centre):
            return 1e6 + float(0.5 * (x - centre) @ H @ (x - centre)), H @ (x - centre)

        assert smallest_in_box(deep, np.zeros(3), -bounds, bounds, 100, 1e-9) == pytest.approx(
            centre, abs=1e-6
        )
