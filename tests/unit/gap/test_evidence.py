"""The log evidence against the density of a Gaussian written out, and what it names against what was hidden."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import special, stats

from dynid.gap.analysis import analyse_gap, on_one_clock
from dynid.gap.bands import Bands, instants
from dynid.gap.candidates import Place, SelectionOptions, candidate, gains
from dynid.gap.evidence import Evidence, JointModel
from dynid.gap.problem import make_problem
from dynid.gap.search import Search
from dynid.gap.shapes import over_shapes
from dynid.model.effects.catalogue import CATALOGUE

#: Rows of the two bands of ``drawn``.
BANDS = slice(0, 20), slice(20, None)


def grams(X):
    return np.array([X[part].T @ X[part] for part in BANDS])


def drawn(seed, count=60):
    """Rows of two joints with three common columns and a rest of two kinds each in two bands, and their evidence."""
    rng = np.random.default_rng(seed)
    rows, models = [], []  # R and y first, then T; columns that are added come last
    for _ in range(2):
        T, R, y = rng.normal(size=(count, 3)), rng.normal(size=(count, 5)), rng.normal(size=count)
        kinds = (("place", slice(1, 3)), ("speed", slice(3, 5)))
        counts, sizes = np.array([20.0, count - 20.0]), rng.normal(-1.0, 0.3, 2)
        powers = rng.normal(0.0, 0.5, 2)
        X = np.column_stack([R, y, T])
        models.append(JointModel(grams(X), counts, kinds, 1, sizes, powers))
        rows.append((T, R, y))
    return rows, Evidence(tuple(models), np.diag([0.5, 2.0, 1.0]), np.zeros(3), 3.0, 3, 0)


def density(rows, evidence):
    """The log density of all torques, everything else being integrated out, but for constants and sizes' own prior."""
    T = np.vstack([one[0] for one in rows])
    y = np.concatenate([one[2] for one in rows])
    noise = [np.repeat(np.exp(m.powers), m.counts.astype(int)) for m in evidence.joints]
    covariance = T @ np.linalg.inv(evidence.prior) @ T.T + np.diag(np.concatenate(noise))
    at = 0
    for (_, R, own), model in zip(rows, evidence.joints, strict=True):
        part = slice(at, at + len(own))
        covariance[part, part] += R @ np.diag(1 / model.precision) @ R.T
        at += len(own)
    return float(stats.multivariate_normal(np.zeros(len(y)), covariance).logpdf(y))


def test_differences_of_the_evidence_are_those_of_the_density_of_the_torques():
    rows, evidence = drawn(0)
    model = replace(evidence.joints[1], log_rms=np.zeros(2), powers=np.array([0.7, -0.2]))
    other = evidence.replaced({1: model})
    sizes = [sum(m.log_prior(e.price) for m in e.joints) for e in (evidence, other)]
    found = (evidence.log_evidence - sizes[0]) - (other.log_evidence - sizes[1])
    assert found == pytest.approx(density(rows, evidence) - density(rows, other), abs=1e-6)


def test_a_further_column_changes_the_evidence_as_it_changes_the_density():
    rows, evidence = drawn(1)
    rng = np.random.default_rng(2)
    C = rng.normal(size=(60, 2))
    T, R, y = rows[0]
    X = np.column_stack([R, y, T])
    products = {0: (grams(C), np.array([C[part].T @ X[part] for part in BANDS]))}
    wide = evidence.with_columns(products, np.diag([4.0, 0.25]))
    more = [
        (np.column_stack([T, C]), R, y),
        (np.column_stack([rows[1][0], np.zeros((60, 2))]), *rows[1][1:]),
    ]
    assert wide.log_evidence - evidence.log_evidence == pytest.approx(
        density(more, wide) - density(rows, evidence), abs=1e-6
    )
    assert wide.without(slice(3, 5)).log_evidence == pytest.approx(evidence.log_evidence)


def test_a_rest_and_bands_are_sized_where_the_evidence_is_largest():
    """On rows that hold a kind of the rest, and noise that is louder in one band, no other size has more evidence."""
    rows, evidence = drawn(4, 400)
    T, R, y = rows[0]
    y = y + R[:, 1:3] @ np.array([1.5, -2.0])
    y[BANDS[1]] += 2.0 * np.random.default_rng(5).normal(size=380)
    first = replace(evidence.joints[0], grams=grams(np.column_stack([R, y, T])))
    best = evidence.replaced({0: first}).sized(40)
    found = best.joints[0]
    assert np.exp(found.log_rms[0]) == pytest.approx(1.8, rel=0.6)
    assert np.exp(found.powers[1]) == pytest.approx(5.0, rel=0.2)
    for move in (-0.4, 0.4):
        for moved in (
            replace(found, log_rms=found.log_rms + np.array([move, 0.0])),
            replace(found, powers=found.powers + np.array([0.0, move])),
        ):
            assert best.replaced({0: moved}).log_evidence < best.log_evidence


def test_rows_by_frequency_keep_the_noise_and_cancel_what_always_was(twolinks, on_joint, kept):
    """Old and new logs of one motion: what both have is not in their difference, and noise is of size one in all."""
    there = lambda t, q, qd, qdd: on_joint(1, np.tanh((q[:, 1] - 0.5) / 0.05))  # noqa: E731
    logs = [twolinks.logs(there, plans=(1,), first=k) for k in (0, 10)]
    problem = make_problem(logs[1], twolinks.base, kept, logs[0])
    rows = problem.searched(problem.theta)
    bands = Bands(rows, problem.noise, *instants(rows, problem.repeats))
    left = bands.transformed(1, (rows.tau - rows.W @ problem.theta)[:, 1])
    power = np.array([np.mean(left[part] ** 2) for part in bands.slices])
    half = len(power) // 2
    assert power[:half].max() > 20.0, "the mean of all"
    assert np.mean(left[bands.slices[half].start :] ** 2) == pytest.approx(1.0, abs=0.6)


def selection(twolinks, added):
    return Search(make_problem(on_one_clock(twolinks.logs(added)), twolinks.base, None))


def test_a_bayes_factor_is_the_evidence_with_the_column_over_that_without(twolinks, on_joint):
    chosen = selection(
        twolinks,
        lambda t, q, qd, qdd: on_joint(1, 0.05 * np.abs(qd[:, 1])),
    )
    one = candidate(chosen.rows, Place(CATALOGUE["asymmetric_viscous"], (1,)), [{}])
    factors = [
        one.among(chosen.first, scale).log_evidence - chosen.first.log_evidence
        for scale in (1.0, 10.0, 100.0)
    ]
    assert gains(chosen.first, one).log_odds[0] == pytest.approx(
        np.log(np.mean(np.exp(factors))), abs=1e-4
    )


@pytest.mark.slow
def test_narrow_stribeck_friction_is_named_with_its_size(twolinks, on_joint):
    """A hump of 0.04 rad/s, which columns of free width would swallow."""
    logs = on_one_clock(twolinks.logs(hump(on_joint, 0.3, 0.04, 1.5)))
    seen = analyse_gap(logs, twolinks.base, None, SelectionOptions())
    (one,) = seen.named
    assert one.key == ("stribeck", (1,))
    assert one.probability >= 0.99
    assert abs(one.values["a"] - 0.3) < 3 * one.std_errors["a"]
    assert one.values["vs"] == pytest.approx(0.04, rel=0.5)
    assert abs(one.values["vs"] - 0.04) < 3 * one.std_errors["vs"]
    assert seen.remainder == ()


@pytest.mark.slow
def test_a_push_that_nothing_repeats_is_told_by_log_time_and_joint(twolinks, on_joint):
    """Without repeats: nobody but the rows themselves can tell. Of two, one is told."""

    def push(t, q, qd, qdd):
        return on_joint(1, 10.0 * np.exp(-(((t - 27.0 + 3.0 * (t < 25.5)) / 0.1) ** 2)))

    logs = twolinks.logs(push, repeats=1)
    seen = analyse_gap(on_one_clock(logs), twolinks.base, None, SelectionOptions())
    assert seen.verdict == "unexplained"
    (one,) = [event for event in seen.search.events if event.joint == "elbow"]
    assert one.log == "log 2"
    assert one.end - one.start < 1.0
    assert f"elbow in log 2 from {one.start:.1f}" in seen.advice


def summed(beside, rows, place, shapes):
    """Return weights of shapes, and mean and error of the amplitude, summed over all of them."""
    one = gains(beside, candidate(rows, place, shapes))
    weights, sizes = special.softmax(one.log_odds), one.amplitudes[:, 0]
    mean = np.sum(weights * sizes)
    spread = one.covariance[:, 0, 0] + (sizes - mean) ** 2
    return weights, mean, np.sqrt(np.sum(weights * spread))


def test_sizes_are_those_of_a_sum_over_many_shapes(twolinks, on_joint):
    chosen = selection(
        twolinks,
        lambda t, q, qd, qdd: on_joint(1, 0.5 * np.sign(qd[:, 1]) * np.abs(qd[:, 1]) ** 1.7),
    )
    place, beside = Place(CATALOGUE["nonlinear_viscous"], (1,)), chosen.first.smaller(1.0)
    found = over_shapes(beside, chosen.rows, place, {"p": 1.7})
    x = np.linspace(np.log(1.05), np.log(3.0), 400)
    weights, mean, error = summed(beside, chosen.rows, place, [{"p": p} for p in np.exp(x)])
    assert found.amplitudes[0] == pytest.approx(mean, abs=0.1 * error)
    assert found.covariance[0, 0] == pytest.approx(error**2, rel=0.1)
    assert np.log(found.shape["p"]) == pytest.approx(
        weights @ x, abs=0.1 * np.sqrt(weights @ (x - weights @ x) ** 2)
    )
    assert abs(found.amplitudes[0] - 0.5) < 3 * error


def hump(on_joint, height, speed, sharpness):
    """Return torques of Stribeck friction at the elbow."""

    def added(t, q, qd, qdd):
        law = np.exp(-((np.abs(qd[:, 1]) / speed) ** sharpness)) * np.tanh(qd[:, 1] / 0.01)
        return on_joint(1, height * law)

    return added


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "sharpness"), [(0.035, 1.8), (0.06, 2.2), (0.04, 0.9)])
def test_sizes_of_a_hump_are_those_of_a_sum_over_many_shapes(twolinks, on_joint, speed, sharpness):
    """Its speed and sharpness go together: the posterior is a ridge that is thin across both."""
    chosen = selection(twolinks, hump(on_joint, 0.3, speed, sharpness))
    place, beside = Place(CATALOGUE["stribeck"], (1,)), chosen.first.smaller(1.0)
    found = over_shapes(beside, chosen.rows, place, {"vs": speed, "d": sharpness})
    axes = np.geomspace(0.018, 0.25, 70), np.geomspace(0.6, 2.5, 50)
    shapes = [{"vs": vs, "d": d} for d in axes[1] for vs in axes[0]]
    _, mean, error = summed(beside, chosen.rows, place, shapes)
    assert found.amplitudes[0] == pytest.approx(mean, abs=0.25 * error)
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(error, rel=0.2)
    assert abs(found.amplitudes[0] - 0.3) < 3 * error
