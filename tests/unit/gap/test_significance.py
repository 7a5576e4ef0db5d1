"""Evidence against least squares written out, and chances against the laws that they follow without an effect."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from dynid.gap.significance import candidate_of, candidates_at, score_candidate, significance_test
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


def test_columns_that_are_kept_in_a_file_are_judged_alike(regression, monkeypatch):
    monkeypatch.setattr("dynid.scratch.IN_MEMORY", 1000)
    for name in ("torque_offset", "stribeck"):
        for many in (True, False):
            monkeypatch.setattr("dynid.gap.whitened_regression.FEW_ROWS", 0 if many else 1 << 13)
            (candidate,) = candidates_at(replace(regression), CATALOGUE[name], (1,))
            score = score_candidate(replace(regression), candidate)
            if many:
                kept, first = candidate, score
        np.testing.assert_allclose(kept.columns[1], candidate.columns[1], rtol=1e-9, atol=1e-12)
        assert (first.gain, first.index) == (pytest.approx(score.gain, rel=1e-9), score.index)


def test_each_shape_is_judged_and_the_best_is_taken(regression):
    (candidate,) = candidates_at(regression, CATALOGUE["stribeck"], (0,))
    candidate = candidate_of(regression, candidate.effect, (0,), candidate.shapes)
    drops = [left(regression) - left(regression, {0: C}) for C in candidate.columns[0]]
    amplitudes = [significance_test(regression, {0: C}).amplitudes[0] for C in candidate.columns[0]]
    best = max((drop for drop, a in zip(drops, amplitudes, strict=True) if a > 0), default=0.0)
    assert score_candidate(regression, candidate).gain == pytest.approx(best, rel=1e-5)


def test_the_penalty_is_that_of_bayes_and_of_the_grid(regression):
    (candidate,) = candidates_at(regression, CATALOGUE["stribeck"], (0,))
    score = score_candidate(regression, candidate)
    rows, shapes = len(regression.joints[0].y), len(candidate.shapes)
    assert score.penalty == pytest.approx((1 + 2) * np.log(rows) + 2 * np.log(shapes))
    assert score.score == score.gain - score.penalty


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


@pytest.mark.parametrize("name", ["p_value", "gain_p_value"])
def test_chances_are_uniform_on_white_noise(drawn, name):
    chances = [getattr(test, name) for test in drawn[1]]
    assert stats.kstest(chances, "uniform").pvalue > 0.01


def test_different_halves_are_seldom_called_different_on_white_noise(drawn):
    """Chow's test errs on the safe side: it must not throw out what is the same."""
    chances = np.array([test.chow_p_value for test in drawn[1]])
    assert np.mean(chances < 0.05) < 0.1
    assert np.mean(chances < 1e-3) < 0.02


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


def test_an_effect_that_turns_its_sign_between_motions_is_told_from_one_that_stays(regression):
    """Not with less chance: what the test allows for comes from 44 blocks, half of which err one way."""
    (candidate,) = candidates_at(regression, CATALOGUE["torque_offset"], (1,))
    columns = {1: candidate.columns[1][0]}
    torque = 3.0 * columns[1][0] / np.sqrt(np.mean(columns[1][0] ** 2))
    turned = np.where(regression.joints[1].log < 2, torque, -torque)
    assert significance_test(with_noise(regression, 6, {1: torque}), columns).chow_p_value > 0.1
    assert significance_test(with_noise(regression, 6, {1: turned}), columns).chow_p_value < 0.01


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


def test_a_joint_that_rests_all_the_time_has_no_rows_and_shows_nothing(clean):
    segments = [replace(s, use=s.use & np.array([True, False])) for s in clean.segments]
    resting = replace(clean, segments=segments).regression()
    assert len(resting.fit.e[1]) == 0
    for name, joints in (("stribeck", (1,)), ("base_tilt", ())):
        (candidate,) = candidates_at(resting, CATALOGUE[name], joints)
        assert candidate.columns[1].shape[-1] == 0
        assert np.isfinite(score_candidate(resting, candidate).score)
    (alone,) = candidates_at(resting, CATALOGUE["stribeck"], (1,))
    assert score_candidate(resting, alone).gain == 0.0
