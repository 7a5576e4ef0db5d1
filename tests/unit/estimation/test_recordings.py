"""How much less recordings tell than their rows, and what others will differ by: parts that agree widen nothing."""

from dataclasses import replace

import numpy as np
import pytest
from test_stack import simulated, stacked

from dynid.estimation import tuning
from dynid.estimation.estimators import fitted as estimated
from dynid.estimation.recordings import Parts


def fitted(base, log):
    stack = stacked(base, log)
    return stack, estimated(stack, "wls")


def asked(stack, fit, like):
    """By how much parts disagree when rows are said to be worth what they are in another fit."""
    A = like.whitened[:-1, :-1]
    told = np.ones(len(fit.theta), dtype=bool)
    covariance = np.linalg.inv(A.T @ A) * like.inflation
    parts = Parts.of(stack, fit.theta, None, like.noise, like.inflation, None)
    return parts.disagreement(covariance, None, told)


def test_parts_that_differ_by_noise_alone_widen_nothing(base):
    stack, fit = fitted(base, simulated(base, seed=0, noise=0.05))
    assert asked(stack, fit, fit) == 1.0


def test_torques_whose_scale_changes_in_the_recording_widen_unless_the_fit_counts_it_already(base):
    log = simulated(base, seed=0, noise=0.05)
    _, steady = fitted(base, log)
    scale = 1.0 + 0.3 * ((log.t - log.t[0]) / np.ptp(log.t) - 0.5)
    stack, fit = fitted(base, replace(log, tau=log.tau * scale[:, None]))
    assert asked(stack, fit, steady) == tuning.LARGEST_INFLATION
    assert asked(stack, fit, fit) == 1.0


def wandering(base, theta, within, between, logs=3, seed=0, error=0.002):
    """Return parts whose levels of friction differ, known to an error: within recordings, and between these."""
    rng, p, n = np.random.default_rng(seed), len(theta), base.robot.n
    every = []
    for _ in range(logs):
        level = between * rng.normal(size=n)
        for _ in range(tuning.PARTS_OF_LOG):
            grams = np.zeros((n, p + 1, p + 1))
            for j in range(n):
                k = base.names.index(f"fc{j + 1}")
                told = 1.0 / (error * theta[k]) ** 2
                grams[j, k, k] = told
                asked_for = theta[k] * (level[j] + within * rng.normal() + error * rng.normal())
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
        added(base, friction, wandering(base, friction, 0.02, 0.16, seed=seed)) for seed in range(8)
    ]
    assert np.median(found) == pytest.approx(0.16 / np.sqrt(3.0), rel=0.3)


def test_one_recording_that_wanders_tells_that_others_differ_and_a_steady_one_that_they_do_not(
    base, friction
):
    moving = [
        added(base, friction, wandering(base, friction, 0.02, 0.0, logs=1, seed=seed))
        for seed in range(8)
    ]
    steady = [
        added(base, friction, wandering(base, friction, 0.0, 0.0, logs=1, seed=seed))
        for seed in range(8)
    ]
    assert np.median(moving) == pytest.approx(0.02 * tuning.CHANGE_BETWEEN, rel=0.4)
    assert np.median(steady) < 0.1 * np.median(moving)
