"""What holds a kept model, and what is held out."""

from types import SimpleNamespace

import numpy as np
import pytest

from dynid.gap.problem import TRUST, KeptModel, split

RATE = 40.0


def test_prior_rows_cost_what_the_earlier_errors_say():
    covariance = np.diag([0.04, 0.01])
    rows = KeptModel(np.array([1.0, 2.0]), covariance, np.ones(1)).prior_rows
    move = np.array([1.2, 2.0])  # one standard error along the first parameter
    rest = rows[:, :-1] @ move - rows[:, -1]
    assert rest @ rest == pytest.approx(1 / TRUST**2)


def test_directions_that_the_earlier_log_left_open_are_not_held():
    seen = np.array([[1.0, 1.0]]) / np.sqrt(2)
    rows = KeptModel(np.array([1.0, 2.0]), 0.01 * seen.T @ seen, np.ones(1)).prior_rows
    assert len(rows) == 1
    np.testing.assert_allclose(rows[:, :-1] @ np.array([1.0, -1.0]), 0.0, atol=1e-9)


def segment(log, seconds, moving):
    t = np.arange(round(seconds * RATE)) / RATE
    use = np.repeat((t < moving)[:, None], 2, axis=1)
    return SimpleNamespace(number=log, t=t, use=use, log=SimpleNamespace(name=f"log {log}"))


def test_what_is_held_out_is_motion_not_the_rest_at_the_end():
    one = segment(0, 30.0, 20.0)
    train, held, _ = split([one], [], 0.2)
    moved = held[0] & one.use.any(axis=1)
    assert moved.sum() == pytest.approx(0.2 * 20.0 * RATE, abs=2)
    assert not np.any(train[0] & held[0])
