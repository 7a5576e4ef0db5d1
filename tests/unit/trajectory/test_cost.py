"""Costs are functions of W's singular values, with exact gradients."""

import numpy as np
import pytest

from dynid.trajectory.cost import Cost, figures

RNG = np.random.default_rng(5)
W = RNG.standard_normal((40, 6)) * [1, 2, 0.3, 5, 1, 0.7]
V = np.cov(RNG.standard_normal((6, 30)))
COSTS = {
    "condition": Cost("condition"),
    "condition, normalised": Cost("condition", normalised=True),
    "paper": Cost("paper", weights=(1.0, 7.0)),
    "paper, normalised": Cost("paper", normalised=True),
    "d": Cost("d"),
    "i": Cost("i", V=V),
}


@pytest.mark.parametrize("power", [2.0, 8.0, np.inf])
@pytest.mark.parametrize("name", COSTS)
def test_gradient_is_that_of_differences(name, power):
    direction = RNG.standard_normal((6, 6))
    direction += direction.T
    G, h = W.T @ W, 1e-5
    slope = np.sum(COSTS[name].value(G, power)[1] * direction)
    up, down = (COSTS[name].value(G + s * h * direction, power)[0] for s in (1, -1))
    assert slope == pytest.approx((up - down) / (2 * h), rel=1e-5)


def test_costs_are_what_their_names_say():
    s = np.linalg.svd(W, compute_uv=False)
    unit = W / np.linalg.norm(W, axis=0)
    G = W.T @ W
    assert np.exp(COSTS["condition"].value(G)[0]) == pytest.approx(np.linalg.cond(W))
    assert np.exp(COSTS["condition, normalised"].value(G)[0]) == pytest.approx(np.linalg.cond(unit))
    assert np.exp(COSTS["paper"].value(G)[0]) == pytest.approx(np.linalg.cond(W) + 7 / s[-1])
    assert COSTS["d"].value(G)[0] == pytest.approx(-2 * np.log(s).sum() / 6)
    assert np.exp(COSTS["i"].value(G)[0]) == pytest.approx(np.trace(V @ np.linalg.inv(G)))


def test_smooth_condition_number_approaches_the_true_one_from_above():
    G = W.T @ W
    values = [COSTS["condition"].value(G, power)[0] for power in (1.0, 2.0, 8.0, 64.0)]
    assert values == sorted(values, reverse=True)
    assert values[-1] == pytest.approx(np.log(np.linalg.cond(W)), rel=0.02)


def test_figures_are_those_of_the_matrix():
    found = figures(W.T @ W)
    assert found.condition == pytest.approx(np.linalg.cond(W))
    assert found.condition_scaled == pytest.approx(np.linalg.cond(W / np.linalg.norm(W, axis=0)))
    assert found.smallest == pytest.approx(np.linalg.svd(W, compute_uv=False)[-1])
