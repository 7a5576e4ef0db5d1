"""Reversals whose friction nobody knows: fitted with and without them, against the truth that was put in."""

import numpy as np
import pytest

from dynid.estimation.least_squares import weighted
from dynid.estimation.rows import (
    dense_rows,
    joint_factors,
    reversal_effects,
    whitened,
    whitened_factors,
)
from dynid.signals.filters import lowpass_kernel

TRUTH = np.array([1.5, 0.8, 2.0])
RATE, CUTOFF, EVERY = 1000, 5.0, 50


def recording(seed=0, late=0.0, stuck=0.0, seconds=20, noise=0.05):
    """One joint with inertia, viscous and Coulomb friction; its sign turns late, and friction sags while it creeps."""
    rng = np.random.default_rng(seed)
    t = np.arange(seconds * RATE) / RATE
    w = 2 * np.pi * np.array([0.23, 0.41, 0.67])
    a, phase = np.array([1.0, 0.6, 0.4]), rng.uniform(0, 6, 3)
    qd = np.sin(np.outer(t, w) + phase) @ a
    qdd = np.cos(np.outer(t, w) + phase) @ (a * w)
    reversals = t[np.flatnonzero(np.diff(np.sign(qd)))]
    since = t - reversals[np.clip(np.searchsorted(reversals, t, side="right") - 1, 0, None)]
    sign = np.where((since >= 0) & (since < late), -np.sign(qd), np.sign(qd))
    near = np.abs(t[:, None] - reversals).min(axis=1)
    sign = np.where(near < stuck, 0.3 * sign, sign)
    tau = (
        np.stack([qdd, qd, sign]).T @ TRUTH
        + noise * rng.standard_normal(len(t)) * (RATE / CUTOFF) ** 0.5
    )
    kernel = lowpass_kernel(CUTOFF, RATE)
    columns = np.stack([qdd, qd, np.sign(qd), tau])
    filtered = np.array([np.convolve(x, kernel, "valid")[::EVERY] for x in columns]).T
    times = t[len(kernel) // 2 :][: len(t) - len(kernel) + 1 : EVERY]
    return dense_rows(
        filtered[:, None, :3], filtered[:, 3:], t=times, reversal_times=(reversals,), cutoff=CUTOFF
    )


def fitted(rows):
    return weighted(*joint_factors(rows)).theta


def without_reversals(rows):
    return whitened(rows, reversal_effects(rows, *joint_factors(rows)))


def errors(**what):
    both = []
    for seed in range(10):
        rows = [recording(seed, **what)]
        both.append([fitted(rows) - TRUTH, fitted(without_reversals(rows)) - TRUTH])
    return np.abs(np.mean(both, axis=0))


@pytest.mark.parametrize("what", [{"late": 0.02}, {"stuck": 0.03}])
def test_reversals_that_are_late_or_creep_no_longer_bias_friction(what):
    plain, without = errors(**what)
    assert plain.max() > 0.015
    assert without.max() < 0.3 * plain.max()


def test_reversals_as_modelled_keep_their_weight():
    squares = []
    for seed in range(20):
        rows = [recording(seed)]
        squares.append([(fitted(x) - TRUTH) ** 2 for x in (rows, without_reversals(rows))])
    plain, without = np.mean(squares, axis=0)
    assert np.all(without < 1.1 * plain)


def test_factors_of_whitened_rows_are_those_of_walking_over_them():
    rows = [recording(late=0.02)]
    factors, counts = joint_factors(rows)
    effects = reversal_effects(rows, factors, counts)
    ours, walked = (
        whitened_factors(factors, effects)[0],
        joint_factors(whitened(rows, effects))[0][0],
    )
    assert np.allclose(
        ours.T @ ours, walked.T @ walked, rtol=1e-9, atol=1e-9 * np.linalg.norm(walked) ** 2
    )
