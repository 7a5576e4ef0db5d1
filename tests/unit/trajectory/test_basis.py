"""Every family of motions is at rest at its ends, is as smooth as it claims, and knows its own extrema."""

import numpy as np
import pytest

from dynid.trajectory.basis import Quintic, basis_from

FAMILIES = {
    "quintic": Quintic((0.0, 1.3, 2.0, 4.5, 5.0)),
    "spline": Quintic.even(6.0, 9, smooth=True),
}


@pytest.fixture(params=FAMILIES)
def family(request):
    return FAMILIES[request.param]


def coefficients(family, n=3):
    return np.random.default_rng(4).standard_normal((family.size, n))


def test_motion_rests_at_both_ends(family):
    ends = np.array([0.0, family.duration])
    for order in (1, 2):
        assert np.abs(family.matrix(ends, order) @ coefficients(family)).max() < 1e-9


@pytest.mark.parametrize("order", [1, 2])
def test_derivatives_are_those_of_central_differences(family, order):
    t = np.linspace(0.1, family.duration - 0.1, 37)
    h = 1e-6
    numeric = (family.matrix(t + h, order - 1) - family.matrix(t - h, order - 1)) / (2 * h)
    assert np.abs(numeric - family.matrix(t, order)).max() < 1e-5 * np.abs(numeric).max()


def test_quintic_goes_through_its_waypoints_with_the_given_rates():
    family = FAMILIES["quintic"]
    c = np.zeros((family.size, 1))
    c[1], c[2] = 0.7, 0.4
    at = np.array([1.3])
    assert family.matrix(at) @ c == pytest.approx(0.7)
    assert family.matrix(at, 1) @ c == pytest.approx(0.4 / 1.25)
    before, after = (family.matrix(at + e, 2) @ c for e in (-1e-9, 1e-9))
    assert np.allclose(before, after, atol=1e-6)


def test_b_spline_spans_what_scipy_spans():
    from scipy.interpolate import BSpline

    family = FAMILIES["spline"]
    knots = np.concatenate([[0.0] * 5, np.linspace(0, 6, 10), [6.0] * 5])
    t = np.linspace(0, 6, 300)
    theirs = BSpline.design_matrix(np.minimum(t, 6 - 1e-12), knots, 5).toarray()
    ours = family.matrix(t)
    rest = ours - theirs @ np.linalg.lstsq(theirs, ours, rcond=None)[0]
    assert np.abs(rest).max() < 1e-8
    assert family.size == theirs.shape[1] - 4


@pytest.mark.parametrize("order", [0, 1, 2])
def test_no_sample_of_a_fine_grid_exceeds_the_exact_extrema(family, order):
    c = coefficients(family)
    fine = family.matrix(np.linspace(0, family.duration, 70001), order) @ c
    for j, (_, exact) in enumerate(family.stationary(c, order)):
        size = np.ptp(exact)
        assert -1e-6 * size < exact.max() - fine[:, j].max() + 1e-9 * size < 1e-4 * size
        assert -1e-6 * size < fine[:, j].min() - exact.min() + 1e-9 * size < 1e-4 * size


def test_family_is_made_again_from_its_facts(family):
    assert basis_from(family.facts) == family
