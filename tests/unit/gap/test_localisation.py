"""The residual is put somewhere, and the search has to say where."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.gap.localisation import (
    REVERSAL,
    localise_residual,
    near_reversal,
)

RATE = 25.0


def with_residual(problem, where):
    """Return a regression on white noise, and three times as much where ``where(rows, joint)`` says, (M,)."""
    regression = problem.regression()
    rows, rng = regression.rows, np.random.default_rng(1)
    y = []
    for j in range(2):
        mask = where(rows, j)[regression.noise.counting(rows, j)]
        y.append(rng.standard_normal(len(mask)) * np.where(mask, 3.0, 1.0))
    return replace(regression, y=y)


def upper_third(rows, joint):
    return above(rows.q[:, joint])


def above(x):
    return x > np.quantile(x, 2 / 3)


CASES = {
    "at the upper end of its travel": upper_third,
    "when fast": lambda s, j: above(np.abs(s.qd[:, j])),
    "when moving backward": lambda s, j: s.qd[:, j] < 0,
    "at high load": lambda s, j: above(np.abs(s.tau[:, j])),
    "late in the recording": lambda s, j: s.part >= 3,
    "at reversals": lambda s, j: np.concatenate(
        [near_reversal(s.qd[part, j], s.rate) for part in s.parts]
    ),
}


def test_noise_is_nowhere(clean):
    for gap in localise_residual(with_residual(clean, lambda s, j: np.zeros(len(s), dtype=bool))):
        assert gap.text == "at the noise level"
        assert gap.chi == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("text", CASES)
@pytest.mark.parametrize("joint", [0, 1])
def test_a_residual_is_found_on_its_joint_and_where_it_is(clean, text, joint):
    regression = with_residual(clean, lambda s, j: (j == joint) & CASES[text](s, j))
    gaps = localise_residual(regression)
    assert gaps[joint].share > 0.95
    assert text in gaps[joint].text
    assert gaps[1 - joint].text == "at the noise level"


def test_shares_are_of_power_in_torque_not_in_noise(clean):
    """Both joints have the same excess in units of their noise, and the first has three times the noise."""
    regression = with_residual(clean, upper_third)
    sigma = np.array([3.0, 1.0])
    gaps = localise_residual(replace(regression, noise=replace(regression.noise, sigma=sigma)))
    assert gaps[0].share == pytest.approx(0.9, abs=0.05)
    assert sum(gap.share for gap in gaps) == pytest.approx(1.0)


def test_a_reversal_begins_as_long_before_as_it_ends_after():
    qd = np.sin(2 * np.pi * 0.2 * np.arange(230) / RATE + 0.1)
    near = near_reversal(qd, RATE)
    turns = np.flatnonzero(np.diff(np.sign(qd)))
    width = round(REVERSAL * RATE)
    assert near.sum() == len(turns) * (2 * width + 1)
    assert near[turns].all()
