"""The prior of bodies that may be far from what was foreseen, against its formula and against brute force."""

from dataclasses import replace

import numpy as np
import pytest

from dynid import load_robot
from dynid.estimation import tuning
from dynid.estimation.possible_arm import (
    curvature,
    fit_physical,
    fit_pooled,
    rounded,
)
from dynid.estimation.possible_set import (
    basis,
    make_constraints,
    pseudo_inertia,
    smallest_eigenvalues,
)
from dynid.model import build_model
from dynid.model.regressor import prior_vector


@pytest.fixture(scope="module")
def constraints():
    model = build_model(load_robot("kinova_gen2"))
    return make_constraints(model.parameters, prior_vector(model))


def price(constraints, x, gamma):
    """gamma sum [-logdet P + 1/s logdet((1 - s) B + s P)], written from the paper's density."""
    P, B = pseudo_inertia(x[constraints.bodies]), constraints.prior_pseudo_inertia
    mixed = np.linalg.slogdet((1 - tuning.PRIOR_FOLLOWED) * B + tuning.PRIOR_FOLLOWED * P)[1]
    return gamma * np.sum(mixed / tuning.PRIOR_FOLLOWED - np.linalg.slogdet(P)[1])


def test_bodies_minimise_the_price_and_the_misfit(constraints):
    """The objective, written anew, neither falls nor rises with the size of any link."""
    rng = np.random.default_rng(0)
    c = len(constraints.prior)
    R = np.zeros((c, c))
    bodies = constraints.bodies.ravel()
    size = np.abs(constraints.prior[bodies]) + 0.01 * np.abs(constraints.prior[bodies]).max()
    R[:, bodies] = rng.normal(size=(c, len(bodies))) / size
    r = R @ (5.0 * constraints.prior)
    fit, _ = fit_pooled(R, r, constraints)

    def objective(x):
        return 0.5 * np.sum((R @ x - r) ** 2) + price(constraints, x, 3.0)

    for link in constraints.bodies:
        larger, smaller = fit.x.copy(), fit.x.copy()
        larger[link] *= np.exp(1e-4)
        smaller[link] *= np.exp(-1e-4)
        assert abs(objective(larger) - objective(smaller)) / 2e-4 < 0.2
        larger[link] = fit.x[link] * np.exp(0.3)
        smaller[link] = fit.x[link] * np.exp(-0.3)
        assert objective(fit.x) < min(objective(larger), objective(smaller))


def test_a_body_ten_times_as_large_as_foreseen_is_believed_sooner(constraints):
    """One measurement, worth 10 % of it, says that the last link has ten times its prior mass."""
    R = np.zeros((1, len(constraints.prior)))
    mass = constraints.bodies[-1, 0]
    true = 10.0 * constraints.prior[mass]
    R[0, mass] = 1.0 / (0.1 * true)
    masses = [
        fit.x[mass] / true
        for fit in (
            fit_physical(R, R[:, mass] * true, constraints),
            fit_pooled(R, R[:, mass] * true, constraints)[0],
        )
    ]
    assert masses[0] < 0.8
    assert masses[1] > 0.9


def test_curvature_is_that_of_the_price_along_geodesics(constraints):
    """P(t) = P^1/2 exp(t V) P^1/2: the second derivative at 0, for the last link away from its prior."""
    rng = np.random.default_rng(1)
    x = constraints.prior * 1.0
    last = constraints.bodies[-1]
    x[last] = 4.0 * x[last]
    H = curvature(constraints, x)[-1]
    P = pseudo_inertia(x[last])
    value, vector = np.linalg.eigh(P)
    half = vector * np.sqrt(value) @ vector.T
    B = constraints.prior_pseudo_inertia[-1]
    A = rng.normal(size=(4, 4))
    w, U = np.linalg.eigh(A + A.T)

    def along(t):
        Pt = half @ (U * np.exp(t * w)) @ U.T @ half
        mixed = np.linalg.slogdet((1 - tuning.PRIOR_FOLLOWED) * B + tuning.PRIOR_FOLLOWED * Pt)[1]
        return 3.0 * (mixed / tuning.PRIOR_FOLLOWED - np.linalg.slogdet(Pt)[1])

    second = (along(1e-3) - 2 * along(0.0) + along(-1e-3)) / 1e-6
    tangent = half @ (U * w) @ U.T @ half
    step = np.linalg.lstsq(basis().reshape(10, 16).T, tangent.ravel(), rcond=None)[0]
    assert step @ H @ step == pytest.approx(second, rel=1e-4)


def test_rounded_cylinders_weigh_the_same_together_and_none_is_a_needle(constraints):
    found = rounded(constraints)
    masses = (x.prior[x.bodies[:, 0]] for x in (constraints, found))
    before, after = masses
    assert after.sum() == pytest.approx(before.sum())
    assert after.min() > 0.09 * after.mean() > before.min()
    assert smallest_eigenvalues(found.prior[found.bodies]).min() > 0.0
    empty = replace(constraints, bodies=constraints.bodies[:0])
    assert rounded(empty) is empty
