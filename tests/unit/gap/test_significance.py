"""Evidence against least squares written out, and chances against the laws that they follow without an effect."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dynid.gap.significance import candidates_at, score_candidate, significance_test
from dynid.model.effects.catalogue import CATALOGUE

DRAWS = 300


@pytest.fixture(scope="module")
def regression(clean):
    return clean.regression(nuisance=False)


def left(regression, extra=None):
    """Return the sum of squares that the baseline, and further columns {joint: (k, M)}, leave."""
    k = 0 if extra is None else len(next(iter(extra.values())))
    parts = []
    for j, rows in enumerate(regression.joints):
        C = (
            np.zeros((k, len(rows.y)))
            if extra is None
            else extra.get(j, np.zeros((k, len(rows.y))))
        )
        parts.append(np.hstack([rows.A, C.T]))
    A, y = np.concatenate(parts), np.concatenate([rows.y for rows in regression.joints])
    return float(np.sum((y - A @ np.linalg.lstsq(A, y, rcond=None)[0]) ** 2))


def with_noise(regression, seed, extra=0.0):
    """Return the regression on white noise of variance one, with a torque {joint: (M,)} jointly with it."""
    rng = np.random.default_rng(seed)
    rows = [replace(one, y=rng.standard_normal(len(one.y))) for one in regression.joints]
    if extra:
        rows = [replace(one, y=one.y + extra.get(one.joint, 0.0)) for one in rows]
    return replace(regression, joints=tuple(rows))


@pytest.mark.parametrize(
    ("name", "joints"),
    [
        ("torque_offset", (1,)),
        ("position_friction", (0,)),
        ("spring", (1,)),
        ("joint_coupling", (0, 1)),
        ("base_tilt", ()),
    ],
)
def test_the_gain_is_the_drop_of_the_sum_of_squares(regression, name, joints):
    for candidate in candidates_at(regression, CATALOGUE[name], joints):
        score = score_candidate(regression, candidate)
        columns = {j: C[score.index] for j, C in candidate.columns.items()}
        assert score.gain == pytest.approx(
            left(regression) - left(regression, columns), rel=1e-5, abs=1e-5
        )


def test_what_the_model_has_already_is_not_visible_and_gains_nothing(regression):
    (candidate,) = candidates_at(regression, CATALOGUE["viscous"], (1,))
    score = score_candidate(regression, candidate)
    assert score.visibility < 1e-6
    assert score.gain == 0.0


def test_the_visible_share_is_what_projection_leaves_of_the_power(regression):
    (candidate,) = candidates_at(regression, CATALOGUE["torque_offset"], (0,))
    column = candidate.columns[0][0, 0]
    A = np.concatenate([rows.A for rows in regression.joints])
    c = np.concatenate([column, np.zeros(len(regression.joints[1].y))])
    rest = c - A @ np.linalg.lstsq(A, c, rcond=None)[0]
    assert score_candidate(regression, candidate).visibility == pytest.approx(
        rest @ rest / (c @ c), rel=1e-6
    )


@pytest.fixture(scope="module")
def drawn(regression):
    """Tests of a spring on joint 2, two columns, on rows that hold nothing but white noise."""
    candidate = next(
        c for c in candidates_at(regression, CATALOGUE["spring"], (1,)) if c.gram.shape[1] == 2
    )
    columns = {1: candidate.columns[1][0]}
    return columns, [
        significance_test(with_noise(regression, seed), columns) for seed in range(DRAWS)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["p_value", "gain_p_value"])
def test_chances_are_uniform_on_white_noise(drawn, name):
    chances = [getattr(test, name) for test in drawn[1]]
    assert stats.kstest(chances, "uniform").pvalue > 0.01


def test_the_covariance_is_the_spread_of_the_amplitudes(drawn):
    amplitudes = np.array([test.amplitudes for test in drawn[1]])
    stated = np.mean([test.covariance for test in drawn[1]], axis=0)
    np.testing.assert_allclose(np.sqrt(np.diag(stated)), amplitudes.std(axis=0), rtol=0.15)


def test_amplitudes_are_those_of_least_squares_and_gains_add_up(regression, drawn):
    columns = drawn[0]
    noisy = with_noise(regression, 1)
    test = significance_test(noisy, columns)
    wide = noisy.with_effects([columns])
    np.testing.assert_allclose(test.amplitudes, wide.amplitudes, rtol=1e-5)
    assert test.gains.sum() == pytest.approx(left(noisy) - left(noisy, columns), rel=1e-6)


def test_what_is_there_is_significant_and_its_visible_size_is_that_of_what_is_left_of_it(
    regression, drawn
):
    columns = drawn[0]
    torque = np.array([2.0, -1.0]) @ columns[1]
    torque *= 0.5 / np.std(torque)
    test = significance_test(with_noise(regression, 5, {1: torque}), columns)
    A = np.concatenate([rows.A for rows in regression.joints])
    c = np.concatenate([np.zeros(len(regression.joints[0].y)), torque])
    seen = (c - A @ np.linalg.lstsq(A, c, rcond=None)[0])[-len(torque) :]
    assert test.joint == 1
    assert test.visible_rms == pytest.approx(np.sqrt(np.mean(seen**2)), abs=0.1)
    assert max(test.p_value, test.gain_p_value) < 1e-4
    assert test.chow_p_value > 0.01


def test_noise_that_comes_in_bursts_widens_the_covariance(regression):
    """Amplitudes of a column whose rows all err together are less sure than independent rows would say."""
    rows = regression.joints[0]
    rng = np.random.default_rng(7)
    column = np.repeat(rng.standard_normal(rows.block[-1] + 1), np.bincount(rows.block))
    columns = {0: column[None]}
    alone = significance_test(with_noise(regression, 8), columns)
    shared = {0: 2.0 * np.repeat(rng.standard_normal(rows.block[-1] + 1), np.bincount(rows.block))}
    together = significance_test(with_noise(regression, 8, shared), columns)
    per_block = np.median(np.bincount(rows.block)[np.bincount(rows.block) > 0])
    ratio = together.covariance[0, 0] / alone.covariance[0, 0]
    assert ratio == pytest.approx(1 + 4 * per_block, rel=0.5)
