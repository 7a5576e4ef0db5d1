"""Physical fits against the equations of their optimum, and what the prior of poor data is worth."""

import numpy as np
import pytest

from dynid import load_robot
from dynid.errors import NotPhysical
from dynid.estimation import tuning
from dynid.estimation.possible_arm import (
    curvature,
    feasible_start,
    fit_physical,
    fit_pooled,
    rounded,
    with_honest_errors,
)
from dynid.estimation.possible_set import (
    basis,
    body_parameters,
    make_constraints,
    pseudo_inertia,
    smallest_eigenvalues,
)
from dynid.model import build_model
from dynid.model.parameters import numbered
from dynid.model.regressor import prior_vector
from dynid.robot import Body, Known
from synthetic_arm import arm_with_measured_friction, holds, model

REGIMES = {"rich": (2000, 1.0, 1.0), "slow": (2000, 0.2, 3.0), "poor": (300, 0.2, 10.0)}


@pytest.mark.parametrize("regime", REGIMES)
def test_entropic_fit_is_the_optimum_of_its_convex_objective(arm, regime):
    """Slope and curvature of the paper's objective, written anew: a step of Newton's would gain next to nothing."""
    R, r = arm.whitened(*REGIMES[regime])
    constraints = arm.constraints
    x = fit_physical(R, r, constraints)[0]
    near = constraints.G / constraints.slack(x)[:, None]
    slope = R.T @ (R @ x - r) - 1e-5 * near.sum(axis=0)
    bent = R.T @ R + 1e-5 * near.T @ near
    for link, foreseen in zip(constraints.bodies, constraints.prior_pseudo_inertia, strict=True):
        inverse = np.linalg.inv(pseudo_inertia(x[link]))
        turned = inverse @ basis()
        change = np.linalg.inv(foreseen) - inverse
        slope[link] += tuning.PRIOR_WEIGHT * np.tensordot(basis(), change)
        bent[np.ix_(link, link)] += tuning.PRIOR_WEIGHT * np.einsum("jab,kba->jk", turned, turned)
    scale = np.sqrt(np.diagonal(bent))
    gain = 0.5 * (slope / scale) @ np.linalg.solve(bent / np.outer(scale, scale), slope / scale)
    assert 0.0 <= gain < 1e-3
    assert holds(constraints, x)


def test_without_data_the_answer_is_the_prior(arm):
    fit = fit_pooled(np.zeros((1, 91)), np.zeros(1), arm.constraints)[0]
    assert np.allclose(
        fit.x[arm.constraints.bodies], arm.prior[arm.constraints.bodies], rtol=1e-5, atol=1e-7
    )
    assert fit.data_share[arm.constraints.bodies].max() < 1e-6


def test_facts_are_kept_even_where_the_prior_breaks_them(arm):
    box = ((-0.01, -0.01, -0.03), (0.01, 0.01, 0.03))
    facts = Known((14.8, 14.9), ((3, (2.0, 2.1)),), ((7, box),))
    constraints = make_constraints(arm.constraints.parameters, arm.prior, facts)
    assert not holds(constraints, np.where(arm.prior == 0, 1.0, arm.prior))
    R, r = arm.whitened()
    x = fit_physical(R, r, constraints)[0]
    masses = x[constraints.bodies[:, 0]]
    assert 14.8 <= masses.sum() <= 14.9
    assert 2.0 <= masses[2] <= 2.1
    assert np.all(np.abs(x[constraints.bodies[6, 1:4]] / masses[6]) <= [0.01, 0.01, 0.03])
    assert holds(constraints, x)


def test_a_mass_that_may_be_zero_is_no_mass_that_is_foreseen(arm):
    known = Known(link_mass=((3, (0.0, 50.0)),))
    constraints = make_constraints(arm.constraints.parameters, arm.prior, known)
    data = arm.whitened(*REGIMES["poor"])
    bound, free = (fit_physical(*data, each)[0] for each in (constraints, arm.constraints))
    assert bound == pytest.approx(free, rel=1e-2, abs=1e-4)


def test_contradicting_facts_are_named(arm):
    known = Known((1.0, 2.0), ((1, (3.0, 4.0)),))
    constraints = make_constraints(arm.constraints.parameters, arm.prior, known)
    with pytest.raises(NotPhysical, match="contradict"):
        feasible_start(constraints)


def test_an_impossible_prior_is_named(arm):
    prior = arm.prior.copy()
    prior[11] = -1.0
    with pytest.raises(NotPhysical, match="link 2"):
        feasible_start(make_constraints(arm.constraints.parameters, prior))


def misses(arm, x, move=None):
    """Torque error on another, fast motion [%]."""
    W = model().regressor(*(move or arm.motion)(300, seed=5))
    return 100 * np.linalg.norm(W @ (x - arm.truth)) / np.linalg.norm(W @ arm.truth)


def pooled(constraints):
    return lambda R, r: fit_pooled(R, r, constraints)[0].x


def shortest(R, r):
    return np.linalg.lstsq(R, r, rcond=1e-10)[0]


def medians(arm, noise, *fits, seeds=16, move=None):
    """Torque errors on another motion of fits to poor data, (fits,) [%]."""
    errors = []
    for seed in range(1, 1 + seeds):
        R, r = arm.whitened(300, 0.2, noise, seed=seed, motion=move or arm.motion)
        errors.append([misses(arm, fit(R, r), move) for fit in fits])
    return np.median(errors, axis=0)


def test_where_least_squares_begin_to_be_worthless_the_physical_set_misses_six_percent():
    arm = arm_with_measured_friction()
    fits = shortest, pooled(arm.constraints)
    least_squares, physical = medians(arm, 7.0, *fits, move=arm.within_limits)
    assert least_squares > 100
    assert physical < 7


def test_how_large_all_of_a_kind_are_together_is_known_from_the_rows_alone(arm):
    """The penalty of bodies, friction and rotors is the same for all common sizes."""
    R, r = arm.whitened(*REGIMES["poor"])
    fit, constraints = fit_pooled(R, r, arm.constraints)
    told, none = R.T @ R, np.zeros((len(fit.x), 0))
    opened, halved = (with_honest_errors(fit, constraints, less, none) for less in (1.0, 2.0))
    after, half = (np.linalg.pinv(each.covariance, hermitian=True) for each in (opened, halved))
    for columns in (constraints.bodies.ravel(), *constraints.pools):
        together = np.zeros(len(fit.x))
        together[columns] = fit.x[columns]
        rows = together @ told @ together
        assert together @ (fit.information + fit.prior) @ together > rows + 1.0
        assert together @ after @ together == pytest.approx(rows, 1e-6, 1e-6)
    assert np.all(opened.std_error >= 0.999999 * fit.std_error)
    assert after - half == pytest.approx(told / 2.0, rel=1e-3, abs=1e-3 * told.max())


def test_joints_with_ratings_lend_each_other_friction_in_proportion_to_them(arm):
    joint = np.array([3.0, 3, 2, 2, 1, 1, 0.5])
    ratings = {f"{kind}{k + 1}": 50 * joint[k] for kind in ("fv", "fc") for k in range(7)}
    constraints = make_constraints(arm.constraints.parameters, arm.prior, ratings=ratings)
    equal, rated = medians(arm, 10.0, pooled(arm.constraints), pooled(constraints), seeds=8)
    assert rated < 0.8 * equal


def test_good_data_override_the_pooling(arm):
    R, r = arm.whitened(5000)
    fits = fit_physical(R, r, arm.constraints)[0], pooled(arm.constraints)(R, r)
    one, other = (misses(arm, x) for x in fits)
    assert abs(one - other) < 0.05


def test_a_joint_that_moves_one_way_only_has_friction_of_the_size_of_the_others():
    """Its Coulomb friction and its offset are one number to the data: 1000 and -1000 N m fit as well."""
    friction = [numbered(kind, k, "N m") for kind in ("fc", "fo") for k in (1, 2, 3)]
    truth = np.array([2.0, 1.5, 2.5, 0.1, -0.2, 0.3])
    R = 100 * np.eye(6)
    R[:, [0, 3]] = 0
    R[0, [0, 3]] = 100
    constraints = make_constraints(friction, np.zeros(6))
    x = fit_pooled(R, R @ truth, constraints)[0].x
    assert x[0] + x[3] == pytest.approx(2.1, abs=0.05)
    assert 0.7 < x[0] < 2.5
    np.testing.assert_allclose(x[[1, 2, 4, 5]], truth[[1, 2, 4, 5]], atol=0.05)


# ---------------------------------------------------------------- pseudo-inertias and bounds of textbook bodies
def test_pseudo_inertia_is_the_second_moment_of_point_masses():
    rng = np.random.default_rng(1)
    points, masses = rng.standard_normal((20, 3)), rng.uniform(0.1, 1, 20)
    homogeneous = np.column_stack([points, np.ones(20)])
    expected = np.einsum("k,ka,kb->ab", masses, homogeneous, homogeneous)
    total = sum(Body(m, tuple(p)).parameters() for m, p in zip(masses, points, strict=True))
    assert np.allclose(pseudo_inertia(total), expected)
    assert np.allclose(body_parameters(expected), total)


def test_a_rod_thicker_than_its_length_allows_is_refused():
    bodies = [Body(1.0, (0.1, 0, 0), (0.01, 0, 0, 0.01, 0, izz)) for izz in (0.015, 0.021)]
    possible, impossible = smallest_eigenvalues(np.array([body.parameters() for body in bodies]))
    assert possible > 0.0
    assert impossible == pytest.approx(-0.0005, rel=0.05)


# ---------------------------------------------------------------- the prior of bodies far from what was foreseen
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

    def objective(link, size):
        x = fit.x.copy()
        x[link] *= np.exp(size)
        return 0.5 * np.sum((R @ x - r) ** 2) + price(constraints, x, 3.0)

    for link in constraints.bodies:
        assert abs(objective(link, 1e-4) - objective(link, -1e-4)) / 2e-4 < 0.2
        assert objective(link, 0.0) < min(objective(link, 0.3), objective(link, -0.3))


def test_a_body_ten_times_as_large_as_foreseen_is_believed_sooner(constraints):
    """One measurement, worth 10 % of it, says that the last link has ten times its prior mass."""
    R = np.zeros((1, len(constraints.prior)))
    mass = constraints.bodies[-1, 0]
    true = 10.0 * constraints.prior[mass]
    R[0, mass] = 1.0 / (0.1 * true)
    masses = [
        x[mass] / true
        for x in (
            fit_physical(R, R[:, mass] * true, constraints)[0],
            fit_pooled(R, R[:, mass] * true, constraints)[0].x,
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
    before, after = (x.prior[x.bodies[:, 0]] for x in (constraints, found))
    assert after.sum() == pytest.approx(before.sum())
    assert after.min() > 0.09 * after.mean() > before.min()
    assert smallest_eigenvalues(found.prior[found.bodies]).min() > 0.0
