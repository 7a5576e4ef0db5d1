"""The whitened regression against least squares written out."""

from dataclasses import replace

import numpy as np
import pytest


@pytest.fixture(scope="module")
def regression(clean):
    return clean.regression(nuisance=False)


def stacked(regression):
    """Return all rows of all joints, and those of the prior, as one matrix and one vector."""
    A, y = [rows.A for rows in regression.joints], [rows.y for rows in regression.joints]
    if regression.prior is not None:
        A, y = [*A, regression.prior[:, :-1]], [*y, regression.prior[:, -1]]
    return np.concatenate(A), np.concatenate(y)


def test_the_fit_is_the_least_squares_solution(regression):
    A, y = stacked(regression)
    theta = np.linalg.lstsq(A, y, rcond=None)[0]
    np.testing.assert_allclose(
        np.concatenate(regression.fit.e), y - A @ theta, atol=1e-7 * np.abs(y).max()
    )
    np.testing.assert_allclose(regression.fit.theta, theta, rtol=1e-5, atol=1e-7)


def test_the_basis_is_orthonormal_over_all_joints_and_orthogonal_to_the_residual(regression):
    Q, e = np.concatenate([regression.basis(j) for j in range(2)]), np.concatenate(regression.fit.e)
    np.testing.assert_allclose(Q.T @ Q, np.eye(Q.shape[1]), atol=1e-7)
    np.testing.assert_allclose(Q.T @ e, 0.0, atol=1e-6)


def test_rows_of_a_prior_hold_parameters_as_further_observations_do(regression):
    rng = np.random.default_rng(1)
    prior = rng.normal(size=(4, regression.size + 1)) * 30
    held = replace(regression, prior=prior)
    A, y = stacked(held)
    theta = np.linalg.lstsq(A, y, rcond=None)[0]
    np.testing.assert_allclose(held.fit.theta, theta, rtol=1e-5, atol=1e-7)
    assert held.squares == pytest.approx(float(np.sum((y - A @ theta) ** 2)), rel=1e-9)


def test_columns_of_an_effect_join_those_of_the_baseline(regression):
    rng = np.random.default_rng(2)
    column = {1: rng.normal(size=(2, len(regression.joints[1].y)))}
    with_effect = regression.with_effects([column])
    wide = [
        np.hstack([rows.A, column[1].T if j == 1 else np.zeros((len(rows.y), 2))])
        for j, rows in enumerate(regression.joints)
    ]
    y = np.concatenate([rows.y for rows in regression.joints])
    theta = np.linalg.lstsq(np.concatenate(wide), y, rcond=None)[0]
    np.testing.assert_allclose(with_effect.amplitudes, theta[-2:], rtol=1e-6)
    assert with_effect.squares < regression.squares


def test_directions_that_the_motion_does_not_excite_stay_at_zero(regression):
    """The same column twice: least squares of smallest norm shares it equally, and nothing becomes infinite."""
    double = replace(
        regression,
        joints=tuple(
            replace(rows, A=np.hstack([rows.A, rows.A[:, :1]])) for rows in regression.joints
        ),
    )
    assert double.fit.theta[0] == pytest.approx(double.fit.theta[-1])
    assert double.fit.theta[0] == pytest.approx(regression.fit.theta[0] / 2, rel=1e-5)


def test_white_rows_have_a_reduced_chi_square_of_one(regression):
    rng = np.random.default_rng(3)
    found = []
    for _ in range(50):
        rows = tuple(replace(one, y=rng.standard_normal(len(one.y))) for one in regression.joints)
        found.append(replace(regression, joints=rows).reduced_chi_square())
    freedom = len(regression.joints[0].y)
    np.testing.assert_allclose(np.mean(found, axis=0), 1.0, atol=5 * np.sqrt(2 / freedom / 50))


def test_base_columns_of_some_logs_alone_are_what_has_changed_in_them(twolinks, on_joint):
    """The elbow has 0.3 N m s/rad more viscous friction in the last two of four logs; all else is the same in all."""
    problem = twolinks.problem(
        lambda t, q, qd, qdd: on_joint(1, np.where(t < 39, 0.0, 0.3) * qd[:, 1])
    )
    regression = problem.regression()
    new = [s.W * (s.number >= 2) for s in regression.segments]
    changed = regression.with_effects(
        [{j: regression.whiten(j, [W[:, j].T for W in new]) for j in range(2)}]
    )
    names = twolinks.base.reduction.base_names
    std_errors = np.sqrt(np.diag(changed.fit.inverse))[regression.size :]
    for name, value, error in zip(names, changed.amplitudes, std_errors, strict=True):
        assert abs(value - (0.3 if name == "fv2" else 0.0)) < 4 * error, name
    assert std_errors[names.index("fv2")] < 0.02
