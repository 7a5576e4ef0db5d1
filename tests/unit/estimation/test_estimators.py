"""Estimates and their error bars against textbook formulas on all rows, and against many simulated recordings."""

from dataclasses import replace

import numpy as np
import pytest

import models
from dynid.errors import LogTooShort, RankDeficient
from dynid.estimation.estimators import has_spikes, near_prior, reweighted
from dynid.estimation.least_squares import (
    hac_covariance,
    judge,
    merge,
    ordinary,
    solve,
    weighted,
    widened,
)
from dynid.estimation.rows import Rows
from dynid.signals.filters import lowpass_kernel

FIVE = np.array([3.0, -1.0, 0.5, 2.0, 0.01])
NOISE_OF_FIVE = np.array([0.1, 1.0, 10.0])


# ---------------------------------------------------------------- least squares of five white columns
def white(samples=400, noise=NOISE_OF_FIVE, seed=0):
    rng = np.random.default_rng(seed)
    W = rng.standard_normal((samples, len(noise), 5)) * [1, 1, 3, 1, 100]
    return Rows.of(W, W @ FIVE + noise * rng.standard_normal((samples, len(noise))))


def plain(rows):
    return weighted(rows.factors(), rows.counts)


def whole(rows, noise=1.0):
    """Return all rows as one matrix and one vector, each joint over its noise."""
    scale = np.broadcast_to(noise, rows.tau.shape[1])
    return (rows.W / scale[:, None]).reshape(-1, 5), (rows.tau / scale).ravel()


def test_ordinary_fit_is_that_of_all_rows():
    rows = white()
    fit, (X, y) = ordinary(rows.factors(), rows.counts), whole(rows)
    theta, squares = np.linalg.lstsq(X, y, rcond=None)[:2]
    assert np.allclose(fit.theta, theta, rtol=1e-12)
    assert np.allclose(fit.covariance, squares / (1200 - 5) * np.linalg.inv(X.T @ X), rtol=1e-9)
    assert np.allclose(fit.rms, np.sqrt(np.mean(rows.residual(theta) ** 2, axis=0)))
    scaled = np.linalg.cond(X / np.linalg.norm(X, axis=0))
    assert fit.solution.condition_number == pytest.approx(np.linalg.cond(X))
    assert fit.solution.condition_number_scaled == pytest.approx(scaled)


def test_weighted_fit_is_generalised_least_squares_with_the_joints_own_noise():
    rows = white(4000)
    fit = plain(rows)
    assert np.allclose(fit.noise, NOISE_OF_FIVE, rtol=0.05)
    X, y = whole(rows, fit.noise)
    assert np.allclose(fit.theta, np.linalg.lstsq(X, y, rcond=None)[0], rtol=1e-9)
    assert np.allclose(fit.covariance, np.linalg.inv(X.T @ X), rtol=1e-9)
    assert np.allclose(plain(white(noise=np.zeros(3))).theta, FIVE, rtol=1e-10)


def test_ridge_follows_rows_that_are_sure_and_the_prior_where_they_are_not():
    base = models.two_links()
    prior = base.prior()
    W = np.random.default_rng(0).standard_normal((200, 2, base.rank))
    known = np.isfinite(prior)
    truth = np.nan_to_num(prior) + 1.0
    rows = Rows.of(W, W @ truth + 1e-4 * W[:, :, 0] ** 2)
    unsure = replace(plain(rows), noise=np.full(2, 1e9))
    assert near_prior(plain(rows), base).theta == pytest.approx(truth, abs=1e-4)
    assert near_prior(unsure, base).theta[known] == pytest.approx(prior[known], abs=1e-6)


@pytest.mark.slow
def test_noise_is_unbiased_although_few_rows_fit_many_parameters():
    ratio = [plain(white(12, seed=s)).noise ** 2 / NOISE_OF_FIVE**2 for s in range(400)]
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.08)


def test_rank_and_open_directions_are_found_whatever_the_units():
    """Slow motion does not lose rank."""
    rows, slow = white(100), np.array([1, 1, 1e-2, 1e-4, 1e-6])
    normal, slowed = (solve(merge(x.factors())) for x in (rows, replace(rows, W=rows.W * slow)))
    assert slowed.rank == 5
    assert slowed.condition_number_scaled == pytest.approx(normal.condition_number_scaled)
    W = rows.W
    W[:, :, 3] = 1e-4 * (W[:, :, 0] + 2 * W[:, :, 1])
    solution = solve(merge(rows.factors()))
    assert solution.rank == 4
    assert solution.condition_number_scaled == np.inf
    assert np.allclose(
        solution.weak[:, 0] / solution.weak[3, 0], [-1e-4, -2e-4, 0, 1, 0], atol=1e-10
    )
    assert np.allclose(W.reshape(-1, 5) @ solution.weak, 0, atol=1e-10)


def test_fewer_rows_than_parameters_are_refused():
    with pytest.raises(LogTooShort):
        plain(white(1))


# ---------------------------------------------------------------- many recordings of two parameters
TRUTH = np.array([2.0, -1.0])
#: Noise of the second joint is in part that of the first.
MIXED = np.array([[0.2, 0.5], [0.0, 0.75**0.5]])
NOISE = np.linalg.norm(MIXED, axis=0)


def ar1(rng, shape, rho):
    """Unit-variance AR(1) noise along the first axis."""
    e = rng.standard_normal(shape)
    e[1:] *= (1 - rho**2) ** 0.5
    for t in range(1, shape[0]):
        e[t] += rho * e[t - 1]
    return e


def recording(seed=0, samples=2000, rho=0.0, spikes=0.0, error=0.0, shift=0):
    """Slow columns of unit power, measured with an error; instruments are those without it, scaled and shifted."""
    rng = np.random.default_rng(seed)
    clean = ar1(rng, (samples + 20, 2, 2), 0.95)
    tau = clean @ TRUTH + ar1(rng, (samples + 20, 2), rho) @ MIXED
    tau += NOISE * rng.uniform(20, 60, tau.shape) * (rng.random(tau.shape) < spikes)
    W = clean + error * rng.standard_normal(clean.shape)
    return replace(Rows.of(W[20:], tau[20:]), Z=0.9 * clean[20 - shift : len(clean) - shift])


def robust(rows):
    return reweighted(rows, plain(rows), "irls")


def instruments(rows):
    return reweighted(rows, plain(rows), "iv")


def covers(theta, truth, covariance):
    return np.abs(theta - truth) <= 1.96 * np.sqrt(np.diagonal(covariance))


@pytest.mark.parametrize(
    ("estimate", "options"),
    [
        pytest.param(plain, {"rho": 0.8}, marks=pytest.mark.slow),
        (plain, {}),
        (robust, {"spikes": 0.01}),
        (instruments, {"error": 0.5}),
    ],
)
def test_intervals_cover_what_they_say(estimate, options):
    """Of noise that remembers, of white noise, beside spikes, and with noise in the columns."""
    inside, textbook = [], []
    for seed in range(150):
        rows = recording(seed, 800, **options)
        fit = estimate(rows)
        textbook.append(covers(fit.theta, TRUTH, fit.covariance))
        covariance = hac_covariance(rows, fit.theta, fit.noise, robust=estimate is not plain)
        inside.append(covers(fit.theta, TRUTH, covariance))
    assert 0.90 <= np.mean(inside) <= 0.99
    assert "rho" not in options or np.mean(textbook) < 0.70


def slow_log(seed, instants=120, columns=24, cutoff=5.0, rate=20.0):
    """Many slow columns, and noise that has passed the filter: what is covered, errors as found and widened."""
    t = np.arange(instants) / rate
    w = 2 * np.pi * 0.1 * np.arange(1, columns // 2 + 1)
    W = np.hstack([np.sin(np.outer(t, w)), np.cos(np.outer(t, w))])[:, None]
    kernel = lowpass_kernel(cutoff, rate)
    white = np.random.default_rng(seed).standard_normal(instants + len(kernel) - 1)
    noise = np.convolve(white, kernel / np.linalg.norm(kernel), "valid")
    theta = np.linspace(-1, 1, columns)
    rows = replace(Rows.of(W, W @ theta + 0.1 * noise[:, None], t), cutoff=cutoff)
    fit = plain(rows)
    known = hac_covariance(rows, fit.theta, fit.noise)
    wide = widened(rows, fit, known)
    return covers(fit.theta, theta, wide), known, wide


def test_intervals_of_a_short_log_cover_what_they_say():
    assert 0.92 <= np.mean([slow_log(seed)[0] for seed in range(100)]) <= 0.98


def test_a_long_log_needs_no_widening_and_a_short_one_does():
    for *size, low, high in ((4000, 2, 0.95, 1.15), (120, 24, 1.2, 4.0)):
        _, known, wide = slow_log(0, *size)
        assert low < np.median(np.sqrt(np.diagonal(wide) / np.diagonal(known))) < high


def test_judgement_separates_unknown_from_known_to_be_zero():
    theta = np.array([1.0, 1.0, 1.0, 1e-6, 0.0])
    error = np.array([0.05, 0.2, 0.5, 1e-4, 1.0])
    effect = np.array([10.0, 10.0, 10.0, 10.0, 0.0])
    words = ("well", "roughly", "not determined", "negligible", "not determined")
    assert judge(theta, error, effect) == words


def test_parameters_that_the_log_hardly_tells_have_a_covariance_all_the_same():
    """The correlation of no two numbers is more than one, also where columns differ by rounding alone."""
    rng = np.random.default_rng(5)
    W = ar1(rng, (400, 6), 0.95).reshape(400, 2, 3)
    nearly = W @ rng.standard_normal((3, 3)) + 1e-5 * rng.standard_normal((400, 2, 3))
    rows = Rows.of(np.concatenate([W, nearly], axis=2), ar1(rng, (400, 2), 0.5))
    covariance = hac_covariance(rows, np.zeros(6), np.ones(2))
    spread = np.sqrt(np.diagonal(covariance))
    assert np.array_equal(covariance, covariance.T)
    assert (np.abs(covariance) <= (1 + 1e-9) * np.outer(spread, spread)).all()


# ---------------------------------------------------------------- spikes
@pytest.mark.parametrize("noise", ["white", "wave", "square", "laplace", "spikes"])
def test_one_percent_of_spikes_is_noticed_and_other_residuals_are_none(noise):
    rows, wave = recording(spikes=0.01 * (noise == "spikes")), np.sin(np.arange(2000) / 50)[:, None]
    shapes = {"wave": wave, "square": np.sign(wave)}
    shapes["laplace"] = np.random.default_rng(1).laplace(size=(2000, 2))
    if noise in shapes:
        rows = replace(rows, tau=rows.W @ TRUTH + NOISE * shapes[noise])
    assert has_spikes(rows, plain(rows).theta) == (noise == "spikes")


def test_huber_removes_most_of_the_damage_of_spikes_and_costs_little_without_them():
    def misses(seed, *options):
        rows = recording(seed, *options)
        return [np.linalg.norm(fit(rows).theta - TRUTH) for fit in (plain, robust)]

    usual, better = np.median([misses(seed, 2000, 0.0, 0.01) for seed in range(40)], axis=0)
    assert better < 0.3 * usual
    usual, worse = np.mean(np.square([misses(seed, 300) for seed in range(60)]), axis=0)
    assert usual / worse == pytest.approx(0.95, abs=0.08)  # Huber 1981: 95 % efficient


# ---------------------------------------------------------------- noise in the columns
def test_least_squares_shrinks_by_the_textbook_factor_and_instruments_do_not():
    """The instruments need not be aligned with the rows."""
    every = [recording(seed, error=0.5) for seed in range(20)]
    shifted = [recording(seed, error=0.5, shift=8) for seed in range(20)]

    def mean(fit, some):
        return np.mean([fit(rows).theta for rows in some], axis=0) / TRUTH

    assert np.allclose(mean(plain, every), 1 / (1 + 0.5**2), atol=0.03)
    assert np.allclose(mean(instruments, every), 1.0, atol=0.02)
    assert np.allclose(mean(instruments, shifted), 1.0, atol=0.03)


def test_with_the_regressor_as_instrument_it_is_the_robust_fit():
    rows = recording(error=0.5)
    assert np.allclose(instruments(replace(rows, Z=rows.W)).theta, robust(rows).theta, rtol=1e-3)


def test_instruments_stand_spikes():
    every = [recording(seed, error=0.1, spikes=0.02) for seed in range(10)]
    assert np.median([np.linalg.norm(instruments(rows).theta - TRUTH) for rows in every]) < 0.05


def test_a_command_that_is_not_followed_is_refused():
    rows = recording()
    with pytest.raises(RankDeficient, match="commanded"):
        instruments(replace(rows, Z=rows.Z * [1.0, 0.0]))
