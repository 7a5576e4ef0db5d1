"""Whether links do better jointly with a counterbalance, and what their prior says of one."""

import numpy as np
import pytest

from dynid.gap.counterbalance import Links, gains, suspicions
from dynid.gap.selected_effects import SelectedEffect
from dynid.model.effects.catalogue import CATALOGUE


@pytest.mark.parametrize(("carried", "sure"), [(60.0, False), (200.0, True)])
def test_it_is_likely_where_links_would_be_heavy_and_sure_where_they_would_be_absurd(
    twolinks, on_joint, carried, sure
):
    problem = twolinks.problem(lambda t, q, qd, qdd: on_joint(0, -carried * np.cos(q[:, 0])))
    (one,) = suspicions(problem, [])
    assert (one.joint, one.link) == (0, 1)
    assert one.gains[0] > 25.0
    assert one.sure is sure, (
        "a counterweight of 200 kg would do the same, one of three tons would not"
    )
    assert one.odd is True
    assert one.instead_of


def test_a_small_one_is_likely_with_its_size_and_the_link_that_it_depends_on(twolinks, on_joint):
    problem = twolinks.problem(lambda t, q, qd, qdd: on_joint(0, -12.0 * np.cos(q[:, 0])))
    (one,) = suspicions(problem, [])
    assert not one.sure
    assert 0.5 < one.probability < 0.99, "a link of another mass may be there as well"
    (a, b), (da, db) = one.sizes
    assert abs(a) < 2 * da
    assert abs(b + 12.0) < 2 * db
    assert one.instead_of.startswith("a link 1 of")
    assert not one.odd, "arms weigh as much"


def stand_in(joint):
    """Return a spring of third order as a search returns it."""
    return SelectedEffect(
        CATALOGUE["spring"], (joint,), {"order": 3.0, "constant": 1.0}, joint, 1.0, 9.0, 0.0
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("powers", "told"), [((-319.0, -17.0, 144.0, 8.0), True), ((0.0, -50.0, 0.0, 300.0), False)]
)
def test_a_curve_is_told_beside_a_counterbalance_where_a_wave_comes_as_near(
    twolinks, on_joint, powers, told
):
    """The first is what a cylinder on a crank does, to third order; no wave comes near the second."""
    problem = twolinks.problem(
        lambda t, q, qd, qdd: on_joint(0, np.polynomial.Polynomial(powers)(q[:, 0]))
    )
    assert [one.joint for one in suspicions(problem, [])] == [0], "without a curve, links are odd"
    found = [(one.joint, one.rivals) for one in suspicions(problem, [stand_in(0)])]
    assert found == ([(0, (("spring", (0,)),))] if told else [])


#: Torque of a counterbalance at the shoulder [N m], several times the arm's weight.
CARRIED = 200.0


@pytest.fixture(scope="module")
def carried(twolinks, on_joint):
    """An arm whose shoulder has a counterbalance."""
    return twolinks.problem(lambda t, q, qd, qdd: on_joint(0, -CARRIED * np.cos(q[:, 0])))


def drop_by_counterbalance(problem, joint):
    """Return by how much a counterbalance lowers twice the objective, its price not paid, and what no links say."""
    bare = problem.regression()
    columns = bare.columns_of(CATALOGUE["counterbalance"], (joint,), {})
    without, with_it = (Links.beside(bare, problem.base, more) for more in ((), (columns,)))
    price = with_it.freedom(without)[1]
    return min(gains(without, with_it)) + price, without.rest - with_it.rest


def test_rows_that_are_reduced_to_links_have_the_same_least_squares_fit(clean):
    regression, K = clean.regression(nuisance=False), clean.base.reduction.K
    links = Links.beside(regression, clean.base)
    A, r = links.rows[:, :-1], links.rows[:, -1]
    x = np.linalg.lstsq(A, r, rcond=None)[0]
    np.testing.assert_allclose(K @ x, regression.theta[: len(K)], rtol=1e-5, atol=1e-7)
    squares = sum(float(e @ e) for e in regression.e)
    assert links.rest + np.sum((A @ x - r) ** 2) == pytest.approx(squares, rel=1e-9)


def test_beside_the_base_parameters_of_a_fit_all_else_is_as_in_it(clean):
    spring = CATALOGUE["spring"]
    regression = clean.regression(nuisance=False)
    shape = {"order": 3.0, "constant": 1.0}
    fit = regression.with_effects([regression.columns_of(spring, (1,), shape)])
    covariance, base = fit.root @ fit.root.T, slice(fit.base)
    others = Links.beside(fit, clean.base).others
    beside = others.mean + others.slope @ fit.theta[base]
    spread = others.root @ others.root.T + others.slope @ covariance[base, base] @ others.slope.T
    np.testing.assert_allclose(beside, fit.amplitudes, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(spread, covariance[fit.base :, fit.base :], rtol=1e-5, atol=1e-12)


def test_a_counterbalance_vanishes_in_links_that_no_arm_has(carried):
    """All of it is absorbed when everything is refitted; with the prior of links it is worth its place."""
    (drop, absorbed), (other, _) = (drop_by_counterbalance(carried, j) for j in (0, 1))
    assert abs(absorbed) < 1.0
    assert drop > 25.0 > other


def test_an_arm_without_a_counterbalance_gains_nothing_from_one(clean):
    assert all(drop_by_counterbalance(clean, j)[0] < 12.0 for j in (0, 1))
    assert suspicions(clean, []) == []
