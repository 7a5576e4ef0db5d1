"""The prior of possible links as rows of a search: where they hold, and what they say of a counterbalance."""

import numpy as np
import pytest

from dynid.gap.analysis import analyse_gap, with_counterbalances
from dynid.gap.candidates import SelectionOptions
from dynid.gap.counterbalance import amplitudes_beside, least_gain, reduced
from dynid.model.effects.catalogue import CATALOGUE

#: Torque of a counterbalance at the shoulder [N m], several times the arm's weight.
CARRIED = 200.0


@pytest.fixture(scope="module")
def carried(twolinks, on_joint):
    """An arm whose shoulder has a counterbalance."""
    return twolinks.problem(lambda t, q, qd, qdd: on_joint(0, -CARRIED * np.cos(q[:, 0])))


def counterbalance(regression, joint):
    return regression.columns_of(CATALOGUE["counterbalance"], (joint,), {})


def test_rows_that_are_reduced_to_base_parameters_have_the_same_least_squares_fit(clean):
    regression = clean.regression(nuisance=False)
    rows = reduced(regression)
    theta = np.linalg.lstsq(rows.R, rows.r, rcond=None)[0]
    np.testing.assert_allclose(theta, regression.theta[: len(theta)], rtol=1e-5, atol=1e-7)
    left = rows.rest + np.sum((rows.R @ theta - rows.r) ** 2)
    squares = sum(float(e @ e) for e in regression.e)
    assert left == pytest.approx(squares, rel=1e-9)


def test_beside_the_base_parameters_of_a_fit_all_else_is_as_in_it(clean):
    spring = CATALOGUE["spring"]
    regression = clean.regression(nuisance=False)
    shape = {"order": 3.0, "constant": 1.0}
    fit = regression.with_effects([regression.columns_of(spring, (1,), shape)])
    covariance = fit.root @ fit.root.T
    base = slice(fit.base)
    beside, spread = amplitudes_beside(fit, fit.theta[base], covariance[base, base])
    np.testing.assert_allclose(beside, fit.amplitudes, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(spread, covariance[fit.base :, fit.base :], rtol=1e-5, atol=1e-12)


def test_a_counterbalance_vanishes_in_links_that_no_arm_has(carried):
    """All of it is absorbed when everything is refitted; with the prior of links it is worth its place."""
    bare = carried.regression()
    assert abs(reduced(bare, [counterbalance(bare, 0)]).rest - reduced(bare).rest) < 1.0
    gains = [least_gain(bare, carried.base, counterbalance(bare, j)) for j in (0, 1)]
    assert gains[0] > 25.0 > gains[1]


def test_an_arm_without_a_counterbalance_gains_nothing_from_one(twolinks):
    bare = twolinks.problem().regression()
    assert all(least_gain(bare, twolinks.base, counterbalance(bare, j)) < 12.0 for j in (0, 1))
    some = SelectionOptions(effects=("spring", "counterbalance"))
    seen = analyse_gap(twolinks.logs(), twolinks.base, None, some, simulate=False)
    assert with_counterbalances(seen, some, (0, 1), simulate=False).verdict.named == ()
