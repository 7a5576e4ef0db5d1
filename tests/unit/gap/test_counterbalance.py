"""Whether links do better jointly with a counterbalance, before anything is searched."""

import numpy as np
import pytest

from dynid.gap.counterbalance import suspicions
from dynid.gap.selected_effects import SelectedEffect
from dynid.model.effects.catalogue import CATALOGUE


@pytest.mark.parametrize(("carried", "sure"), [(60.0, False), (200.0, True)])
def test_it_is_likely_where_links_would_be_heavy_and_sure_where_they_would_be_absurd(
    twolinks, on_joint, carried, sure
):
    problem = twolinks.problem(lambda t, q, qd, qdd: on_joint(0, -carried * np.cos(q[:, 0])))
    (one,) = suspicions(problem, [])
    assert (one.joint, one.link) == (0, 1)
    assert one.gain > 25.0
    assert one.sure is sure, (
        "a counterweight of 200 kg would do the same, one of three tons would not"
    )
    without, with_it = one.masses
    assert without > 10 * with_it


def test_a_small_one_is_likely_with_its_size_and_the_link_that_it_depends_on(twolinks, on_joint):
    problem = twolinks.problem(lambda t, q, qd, qdd: on_joint(0, -12.0 * np.cos(q[:, 0])))
    (one,) = suspicions(problem, [])
    assert not one.searched
    assert 0.5 < one.probability < 0.99, "a link of another mass may be there as well"
    (a, b), (da, db) = one.sizes
    assert abs(a) < 2 * da
    assert abs(b + 12.0) < 2 * db
    assert one.instead_of.startswith("a link 1 of")
    assert not one.odd, "arms weigh as much"


def test_an_arm_without_one_is_not_suspected(clean):
    assert suspicions(clean, []) == []


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
    found = [(one.joint, one.instead, one.beaten) for one in suspicions(problem, [stand_in(0)])]
    assert found == ([(0, ("spring", (0,)), False)] if told else [])
