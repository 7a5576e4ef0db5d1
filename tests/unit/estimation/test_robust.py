"""Huber weights: harmless without spikes, needed with them."""

import numpy as np
import pytest

from dynid.estimation.covariance import hac_covariance
from dynid.estimation.estimators import huber, look_for_spikes
from dynid.estimation.least_squares import weighted
from dynid.estimation.rows import Rows

TRUTH = np.array([3.0, -1.0, 0.5])
NOISE = np.array([0.1, 2.0])


def recording(spikes, seed=0, samples=2000):
    rng = np.random.default_rng(seed)
    W = rng.standard_normal((samples, 2, 3))
    tau = W @ TRUTH + NOISE * rng.standard_normal((samples, 2))
    return Rows.of(
        W, tau + NOISE * rng.uniform(20, 60, (samples, 2)) * (rng.random((samples, 2)) < spikes)
    )


def fits(segment):
    plain = weighted(segment.factors(), segment.counts)
    return plain, huber(segment, plain)


def test_one_percent_of_spikes_is_noticed():
    for spikes in (0.0, 0.01):
        segment = recording(spikes)
        shares, found = look_for_spikes(segment, fits(segment)[0].theta)
        assert found == (spikes > 0)
        assert np.allclose(shares, spikes, atol=0.006)


def test_coloured_and_uniform_residuals_are_no_spikes():
    segment = recording(0.0)
    t = np.arange(2000)[:, None]
    for shape in (
        np.sin(t / 50),
        np.sign(np.sin(t / 80)),
        np.random.default_rng(1).laplace(size=(2000, 2)),
    ):
        disturbed = Rows.of(segment.W, segment.W @ TRUTH + NOISE * shape)
        assert not look_for_spikes(disturbed, TRUTH)[1]


def test_huber_removes_most_of_the_damage_of_spikes():
    errors = []
    for seed in range(10):
        plain, robust = fits(recording(0.01, seed))
        errors.append([np.linalg.norm(plain.theta - TRUTH), np.linalg.norm(robust.theta - TRUTH)])
    plain, robust = np.median(errors, axis=0)
    assert robust < 0.3 * plain


def test_huber_costs_little_without_spikes():
    squares = np.array(
        [
            [np.sum((f.theta - TRUTH) ** 2) for f in fits(recording(0.0, seed, 300))]
            for seed in range(60)
        ]
    ).mean(axis=0)
    assert squares[0] / squares[1] == pytest.approx(0.95, abs=0.08)  # Huber 1981: 95 % efficient


def test_huber_fit_solves_its_estimating_equations():
    segment = recording(0.01)
    _, robust = fits(segment)
    clipped = np.clip(segment.residual(robust.theta) / robust.noise, -1.345, 1.345) / robust.noise
    score = np.einsum("tjp,tj->p", segment.W, clipped)
    assert np.all(np.abs(score) < 0.01 * np.sqrt(np.einsum("tjp,tj->p", segment.W**2, clipped**2)))
    assert np.allclose(robust.noise, NOISE, rtol=0.07)


def test_robust_errors_of_the_robust_fit_cover():
    inside = []
    for seed in range(100):
        segment = recording(0.01, seed, 400)
        _, robust = fits(segment)
        covariance = hac_covariance(segment, robust.theta, robust.noise, robust=True)
        inside.append(np.abs(robust.theta - TRUTH) <= 1.96 * np.sqrt(np.diagonal(covariance)))
    assert 0.90 <= np.mean(inside) <= 0.99
