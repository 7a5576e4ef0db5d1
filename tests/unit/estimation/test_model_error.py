"""The model error against the same Gaussian algebra done whole, and against torques that were hidden."""

from dataclasses import replace

import numpy as np
import pytest
from test_stack import simulated, stacked, truth

from dynid.estimation import tuning
from dynid.estimation.estimators import irls, wls
from dynid.estimation.posterior import physical_posterior, prior_covariance
from dynid.estimation.residual_model import (
    GROUPS,
    best_size,
    evidence_gain,
    model_error,
    squares,
    whitened_rows,
)
from dynid.files.robotfile import load_robot
from dynid.model import build_model
from dynid.model.base_model import BaseModel, prior_base_parameters
from dynid.model.reduce import reduce


def again(base):
    """Return what estimates the rows of some joints anew."""
    return lambda part: wls(part, prior_base_parameters(base.model, base.reduction))


@pytest.fixture(scope="module")
def base():
    model = build_model(load_robot("scara"))
    return BaseModel(model, reduce(model))


def hidden(base, seed, noise=0.05):
    """A log of an arm with friction that depends on the position of joint 1."""
    log = simulated(base, seed=seed, noise=noise)
    qd = np.gradient(log.q[:, 0], log.t)
    tau = log.tau.copy()
    tau[:, 0] += 0.5 * np.tanh(qd / 0.01) * np.sin(2 * log.q[:, 0])
    return type(log)(log.t, log.q, tau, log.names, dh=True)


@pytest.fixture(scope="module")
def found(base):
    stack = stacked(base, hidden(base, 0))
    estimate = wls(stack, prior_base_parameters(base.model, base.reduction))
    return (
        stack,
        estimate,
        physical_posterior(base, estimate, stack, refit=again(base), residual_model=None),
    )


def test_eliminating_the_columns_is_the_joint_solution_of_all_unknowns(base, found):
    stack, estimate, _ = found
    rows = whitened_rows(stack, base, estimate.theta, estimate.noise, 4.0, prior_covariance(base))
    size = np.array([0.1, 0.2, 0.3])
    left, heads = rows.eliminated(size)
    theta = np.linalg.lstsq(left[:-1, :-1], left[:-1, -1], rcond=None)[0]
    error = model_error(rows, size, 0.0, heads, theta, stack.whole[1])
    n, k, p = len(stack.joints), rows.k, len(theta)
    H, g = np.zeros((n * k + p, n * k + p)), np.zeros(n * k + p)
    for j, F in enumerate(rows.factors):
        where = np.concatenate([j * k + np.arange(k), n * k + np.arange(p)])
        H[np.ix_(where, where)] += F[:, :-1].T @ F[:, :-1]
        g[where] += F[:, :-1].T @ F[:, -1]
        H[where[:k], where[:k]] += 1 / (size[GROUPS] * estimate.noise[j] ** 2)
    whole = np.linalg.solve(H, g)
    assert theta == pytest.approx(whole[n * k :], rel=1e-6, abs=1e-8)
    assert error.mean.ravel() == pytest.approx(whole[: n * k], rel=1e-6, abs=1e-8)
    covariance = np.linalg.inv(H)
    W, Z = (
        np.random.default_rng(0).normal(size=(5, n, p)),
        np.random.default_rng(1).normal(size=(5, n, k)),
    )
    variance = error.variance(W, Z, covariance[n * k :, n * k :])
    row = np.zeros(n * k + p)
    row[:k], row[n * k :] = Z[0, 0], W[0, 0]
    assert variance[0, 0] == pytest.approx(row @ covariance @ row, rel=1e-6)


def test_the_evidence_is_that_of_the_normal_distribution_of_all_rows(base, found):
    stack, estimate, _ = found
    rows = whitened_rows(stack, base, estimate.theta, estimate.noise, 4.0, prior_covariance(base))
    p = len(estimate.theta)
    prior = np.diag(1 / (1.0 + np.abs(estimate.theta)) ** 2)
    size = best_size(rows, np.eye(p), np.zeros(p), prior)
    gain = evidence_gain(rows, np.eye(p), np.zeros(p), prior, size)

    def dense(sizes):
        total = np.zeros((0, 0))
        blocks, right, W = [], [], []
        for F, noise in zip(rows.factors, rows.noise, strict=True):
            Z = F[:, : rows.k]
            blocks.append(np.eye(len(F)) + (Z * (sizes[GROUPS] * noise**2)) @ Z.T)
            right.append(F[:, -1])
            W.append(F[:, rows.k : -1])
        y, A = np.concatenate(right), np.vstack(W)
        total = A @ np.linalg.inv(prior) @ A.T
        start = 0
        for block in blocks:
            total[start : start + len(block), start : start + len(block)] += block
            start += len(block)
        return -0.5 * (y @ np.linalg.solve(total, y) + np.linalg.slogdet(total)[1])

    assert gain == pytest.approx(dense(size) - dense(np.full(3, tuning.RESIDUAL_NOTHING)), abs=0.05)
    assert gain > 6.0
    for group in range(3):
        for factor in (0.7, 1.4):
            near = size * np.where(np.arange(3) == group, factor, 1.0)
            assert (
                dense(np.clip(near, tuning.RESIDUAL_NOTHING, tuning.RESIDUAL_LARGEST))
                < dense(size) + 1e-3
            )


def test_a_hidden_friction_is_found_and_predicted_on_another_motion(base, found):
    _, _, post = found
    other = stacked(base, hidden(base, 7))
    assert post.error is not None
    without = squares(other, post.alone, None)[0]
    assert squares(other, post.theta, post.error)[0] < 0.5 * without
    assert post.error.rms[0, 1] > 3 * post.error.rms[1, 3]


def test_an_arm_with_a_complete_model_has_no_model_error(base):
    stack = stacked(base, simulated(base, noise=0.05), cutoff=15.0)
    estimate = wls(stack, prior_base_parameters(base.model, base.reduction))
    post = physical_posterior(base, estimate, stack, refit=again(base), residual_model=None)
    assert post.error is None
    true = base.reduction.K @ truth(base)
    z = np.abs(post.theta - true) / np.sqrt(np.diag(post.covariance))
    assert np.mean(z < 1.96) >= 0.85


def test_without_model_error_the_rows_give_the_estimate_that_they_are_centred_on(base, found):
    """Instruments find other parameters than least squares of the same rows."""
    stack, estimate, _ = found
    rows = whitened_rows(stack, base, estimate.theta, estimate.noise, 4.0, prior_covariance(base))
    other = estimate.theta * (1.0 + 0.01 * np.arange(len(estimate.theta)))
    left, _ = rows.centred(other).eliminated(np.full(3, 1e-9))
    assert np.linalg.lstsq(left[:-1, :-1], left[:-1, -1], rcond=None)[0] == pytest.approx(
        other, rel=1e-5, abs=1e-6
    )


def test_spikes_are_not_taken_for_friction(base):
    """One sample in a hundred ten times as far off as the torque is large: the columns keep out of it."""
    log = simulated(base, noise=0.05)
    rng = np.random.default_rng(2)
    hit = rng.random(log.tau.shape) < 0.01
    spiky = stacked(
        base,
        replace(log, tau=log.tau + hit * rng.choice([-30.0, 30.0], log.tau.shape)),
        cutoff=15.0,
    )
    estimate = irls(spiky, prior_base_parameters(base.model, base.reduction))
    assert (
        physical_posterior(base, estimate, spiky, refit=again(base), residual_model=None).error
        is None
    )
