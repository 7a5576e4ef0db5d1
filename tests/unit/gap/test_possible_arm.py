"""The prior of possible links as rows of a search: where they hold, and what they say of a counterbalance."""

import numpy as np
import pytest

from dynid.estimation.possible_arm import constraints_of, fit_pooled
from dynid.gap.analysis import analyse_gap, with_counterbalances
from dynid.gap.candidates import SelectionOptions
from dynid.gap.possible_arm import least_gain, prior_rows, reduced
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


def test_with_the_prior_as_rows_the_fit_is_the_best_possible_arm(twolinks, clean):
    """Laplace's parabola has its least value where the objective has it."""
    regression = clean.regression(nuisance=False)
    K, links, rows = twolinks.base.reduction.K, constraints_of(twolinks.base), reduced(regression)
    best = K @ fit_pooled(rows.R @ K, rows.r, links)[0].x
    held = prior_rows(regression, K, links)
    A, y = np.vstack([rows.R, held[:, :-1]]), np.append(rows.r, held[:, -1])
    np.testing.assert_allclose(np.linalg.lstsq(A, y, rcond=None)[0], best, rtol=1e-3, atol=1e-5)


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
