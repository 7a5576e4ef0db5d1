"""The model error against the same Gaussian algebra done whole, and against torques that were hidden."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_stack import simulated, stacked, truth

from dynid.estimation import tuning
from dynid.estimation.estimators import fitted as estimated
from dynid.estimation.factor import Factor
from dynid.estimation.posterior import Parts, physical_posterior
from dynid.estimation.residual_model import (
    NONE,
    SIZE,
    JointRows,
    best_size,
    log_evidence,
    squares,
    torque_variance,
)


def fitted_to(base, log, **options):
    stack = stacked(base, log, **options)
    return stack, estimated(stack, "wls")


def hidden(base, seed, noise=0.05):
    """A log of an arm with friction that depends on the position of joint 1."""
    log = simulated(base, seed=seed, noise=noise)
    qd = np.gradient(log.q[:, 0], log.t)
    tau = log.tau.copy()
    tau[:, 0] += 0.5 * np.tanh(qd / 0.01) * np.sin(2 * log.q[:, 0])
    return replace(log, tau=tau)


@pytest.fixture(scope="module")
def fitted(base):
    """The rows of a log with something hidden, their estimate, and both for the residual model."""
    stack, estimate = fitted_to(base, hidden(base, 0))
    rows = JointRows.of(stack, estimate, estimate.theta)
    return (
        stack,
        estimate,
        replace(rows, inflation=4.0, shaped=rows.shaped * (rows.inflation / 4.0) ** 0.5),
    )


def posterior(stack, estimate):
    return physical_posterior(estimate, stack, residual_model=None)


def all_unknowns(rows, size, released=None):
    """Return the rows of all joints in the columns of each, what one joint has of its own, and the arm."""
    total = Factor({}, np.zeros(0))
    for j, (F, sd) in enumerate(zip(rows.factors, rows.deviations(size), strict=True)):
        Z, W = np.split(F[:, :-1], [SIZE], axis=1)
        own = {"own": W @ rows.spread} if j == released else {}
        total += Factor({f"columns{j}": Z, **own, "arm": W}, F[:, -1]).prior(f"columns{j}", sd)
    return total


def test_parameters_own_ones_and_columns_are_the_joint_solution_of_all_unknowns(base, fitted):
    stack, estimate, rows = fitted
    rows = replace(rows, apart=np.r_[0.0, 0.3, np.zeros(len(estimate.noise) - 2)])
    size = np.array([0.1, 0.2, 0.3])
    left = rows.of_arm(size).rows
    theta = np.linalg.lstsq(left[:, :-1], left[:, -1], rcond=None)[0]
    error = rows.residual(size, 0.0, theta, stack.counts)
    n, k, p = len(stack.joints), SIZE, len(theta)
    whole = all_unknowns(rows, size, 1).prior("own", np.full(p, 0.3**0.5))
    names = [*(f"columns{j}" for j in range(n)), "own", "arm"]
    A = np.column_stack([*(whole.blocks[name] for name in names), whole.right])
    covariance = np.linalg.inv(A[:, :-1].T @ A[:, :-1])
    x = np.linalg.lstsq(A[:, :-1], A[:, -1], rcond=None)[0]
    assert theta == pytest.approx(x[-p:], rel=1e-5, abs=1e-7)
    assert error.own[1] == pytest.approx(rows.spread @ x[n * k : -p], rel=1e-4, abs=1e-6)
    assert error.mean[:, :k].ravel() == pytest.approx(x[: n * k], rel=1e-4, abs=1e-6)
    rng = np.random.default_rng(0)
    W, shapes = rng.normal(size=(5, n, p)), rng.normal(size=(5, n, k))
    columns = error.columns(W, shapes)
    row, Z = np.zeros(len(x)), columns[:, :, :k]
    row[k : 2 * k], row[n * k : -p], row[-p:] = Z[0, 1], W[0, 1] @ rows.spread, W[0, 1]
    variance = torque_variance(columns, covariance[-p:, -p:], error)
    assert variance[0, 1] == pytest.approx(row @ covariance @ row, rel=1e-4)


def test_the_evidence_is_that_of_the_normal_distribution_of_all_rows(fitted):
    _, estimate, rows = fitted
    sd = 1.0 + np.abs(estimate.theta)
    known = SimpleNamespace(x=np.zeros(len(sd)), prior=np.diag(1 / sd**2))
    rows = replace(rows, K=np.eye(len(sd)))
    size = best_size(rows, known)

    def density(size):
        whole = all_unknowns(rows, size).prior("arm", sd)
        left = whole.without(*whole.blocks)[0]
        return left.volume - 0.5 * np.sum(left.rows**2)

    gain = log_evidence(rows, known, size)[0] - log_evidence(rows, known, NONE)[0]
    assert gain == pytest.approx(density(size) - density(NONE), abs=0.05)
    assert gain > 6.0
    for group in range(3):
        for factor in (0.7, 1.4):
            near = size * np.where(np.arange(3) == group, factor, 1.0)
            assert density(np.clip(near, NONE, tuning.RESIDUAL_LARGEST)) < density(size) + 1e-3


def test_a_hidden_friction_is_found_and_predicted_on_another_motion(base, fitted):
    post, other = posterior(*fitted[:2]), stacked(base, hidden(base, 7))
    assert post.error is not None
    without = squares(other, post.alone, None)[0]
    assert squares(other, post.theta, post.error)[0] < 0.5 * without
    assert post.error.rms[0, 1] > 3 * post.error.rms[1, 3]


def test_an_arm_with_a_complete_model_has_no_model_error(base):
    post = posterior(*fitted_to(base, simulated(base, noise=0.05), cutoff=15.0))
    assert post.error is None
    true = base.reduction.K @ truth(base)
    z = np.abs(post.theta - true) / np.sqrt(np.diag(post.covariance))
    assert np.mean(z < 1.96) >= 0.85


def test_without_model_error_the_rows_give_the_estimate_that_they_are_centred_on(base, fitted):
    """Instruments find other parameters than least squares of the same rows."""
    stack, estimate, _ = fitted
    other = estimate.theta * (1.0 + 0.01 * np.arange(len(estimate.theta)))
    rows = JointRows.of(stack, replace(estimate, theta=other), other)
    left = rows.of_arm(np.full(3, 1e-9)).rows
    assert np.linalg.lstsq(left[:, :-1], left[:, -1], rcond=None)[0] == pytest.approx(
        other, rel=1e-5, abs=1e-6
    )


def test_spikes_are_not_taken_for_friction(base):
    """One sample in a hundred ten times as far off as the torque is large: the columns keep out of it."""
    log = simulated(base, noise=0.05)
    rng = np.random.default_rng(2)
    hit = rng.random(log.tau.shape) < 0.01
    tau = log.tau + hit * rng.choice([-30.0, 30.0], log.tau.shape)
    spiky = stacked(base, replace(log, tau=tau), cutoff=15.0)
    assert posterior(spiky, estimated(spiky, "irls")).error is None


# ---------------------------------------------------------------- parts of recordings that disagree
def asked(stack, fit, like):
    """By how much parts disagree when rows are said to be worth what they are in another fit."""
    A = like.whitened[:-1, :-1]
    covariance = np.linalg.inv(A.T @ A) * like.inflation
    parts = Parts.of(stack, like, fit.theta, None)
    return parts.disagreement(covariance, None, np.diag(covariance) > 0)


def test_of_parts_that_differ_by_noise_alone_rows_are_not_held_back(base):
    stack, fit = fitted_to(base, simulated(base, seed=0, noise=0.05))
    assert asked(stack, fit, fit) < 0.6


def test_torques_whose_scale_changes_in_the_recording_widen_unless_the_fit_counts_it_already(base):
    log = simulated(base, seed=0, noise=0.05)
    _, steady = fitted_to(base, log)
    scale = 1.0 + 0.3 * ((log.t - log.t[0]) / np.ptp(log.t) - 0.5)
    stack, fit = fitted_to(base, replace(log, tau=log.tau * scale[:, None]))
    assert asked(stack, fit, steady) == tuning.LARGEST_INFLATION
    assert asked(stack, fit, fit) == 0.5


def wandering(base, theta, within, between, seed, logs=3):
    """Return parts whose levels of friction differ, known to 0.2 %: within recordings, and between these."""
    rng, p, n = np.random.default_rng(seed), len(theta), base.robot.n
    every = []
    for _ in range(logs):
        level = between * rng.normal(size=n)
        for _ in range(tuning.PARTS_OF_LOG):
            grams = np.zeros((n, p + 1, p + 1))
            for j in range(n):
                k = base.names.index(f"fc{j + 1}")
                told = 1.0 / (0.002 * theta[k]) ** 2
                grams[j, k, k] = told
                asked_for = theta[k] * (level[j] + within * rng.normal() + 0.002 * rng.normal())
                grams[j, k, -1] = grams[j, -1, k] = told * asked_for
            every.append(grams)
    return Parts(np.repeat(np.arange(logs), tuning.PARTS_OF_LOG), np.array(every))


@pytest.fixture(scope="module")
def friction(base):
    """Parameters with Coulomb friction alone."""
    theta = np.zeros(len(base.names))
    for j in range(base.robot.n):
        theta[base.names.index(f"fc{j + 1}")] = 2.0 + j
    return theta


def added(base, theta, parts):
    """What a further recording adds to the standard error of each joint's Coulomb friction, as a share of it."""
    places = [base.names.index(f"fc{j + 1}") for j in range(base.robot.n)]
    return np.sqrt(np.sum(parts.changes(base, theta) ** 2, axis=1))[places] / theta[places]


def test_what_differs_between_recordings_is_the_error_of_their_mean(base, friction):
    found = [
        added(base, friction, wandering(base, friction, 0.02, 0.16, seed)) for seed in range(8)
    ]
    assert np.median(found) == pytest.approx(0.16 / np.sqrt(3.0), rel=0.3)


def test_one_recording_that_wanders_tells_that_others_differ_and_a_steady_one_that_they_do_not(
    base, friction
):
    moving, steady = (
        [
            added(base, friction, wandering(base, friction, within, 0.0, seed, logs=1))
            for seed in range(8)
        ]
        for within in (0.02, 0.0)
    )
    assert np.median(moving) == pytest.approx(0.02 * tuning.CHANGE_BETWEEN, rel=0.4)
    assert np.median(steady) < 0.1 * np.median(moving)
