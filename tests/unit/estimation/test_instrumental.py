"""Instruments against the attenuation that noise in the regressor is known to cause."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.errors import RankDeficient
from dynid.estimation.estimators import huber, instrumental
from dynid.estimation.least_squares import weighted
from dynid.estimation.rows import Rows

TRUTH = np.array([2.0, -1.0])
NOISE = np.array([0.2, 1.0])


def instruments(rows):
    return instrumental(rows, weighted(rows.factors(), rows.counts))


def recording(seed=0, error=0.5, samples=2000, spikes=0.0, shift=0):
    """Regressor with unit power measured with noise; instruments are the noise-free one, scaled and shifted."""
    rng = np.random.default_rng(seed)
    clean = np.cumsum(rng.standard_normal((samples + 50, 2, 2)), axis=0)
    clean = (clean[30:] - clean[:-30]) / 30**0.5
    tau = clean @ TRUTH + NOISE * rng.standard_normal((samples + 20, 2))
    tau += NOISE * 40 * (rng.random(tau.shape) < spikes)
    W = clean + error * rng.standard_normal(clean.shape)
    return replace(Rows.of(W[20:], tau[20:]), Z=0.9 * clean[20 - shift : len(clean) - shift])


def test_least_squares_shrinks_by_the_textbook_factor_and_instruments_do_not():
    segments = [recording(seed) for seed in range(20)]
    shrunk = np.mean([weighted(s.factors(), s.counts).theta for s in segments], axis=0)
    fair = np.mean([instruments(s).theta for s in segments], axis=0)
    assert np.allclose(shrunk / TRUTH, 1 / (1 + 0.5**2), atol=0.03)
    assert np.allclose(fair / TRUTH, 1.0, atol=0.02)


def test_instruments_need_not_be_aligned():
    fair = np.mean([instruments(recording(seed, shift=8)).theta for seed in range(20)], axis=0)
    assert np.allclose(fair / TRUTH, 1.0, atol=0.03)


def test_robust_errors_cover():
    inside = []
    for seed in range(150):
        fit = instruments(recording(seed, samples=800))
        inside.append(np.abs(fit.theta - TRUTH) <= 1.96 * np.sqrt(np.diagonal(fit.covariance)))
    assert 0.90 <= np.mean(inside) <= 0.99


def test_with_the_regressor_as_instrument_it_is_the_robust_fit():
    segment = recording()
    same = replace(segment, Z=segment.W)
    fit = huber(segment, weighted(segment.factors(), segment.counts))
    assert np.allclose(instruments(same).theta, fit.theta, rtol=1e-3)


def test_instruments_stand_spikes():
    segments = [recording(seed, error=0.1, spikes=0.02) for seed in range(10)]
    errors = [np.linalg.norm(instruments(segment).theta - TRUTH) for segment in segments]
    assert np.median(errors) < 0.05


def test_a_command_that_is_not_followed_is_refused():
    segment = recording()
    Z = segment.Z.copy()
    Z[:, :, 1] = 0.0
    with pytest.raises(RankDeficient, match="commanded"):
        instruments(replace(segment, Z=Z))
