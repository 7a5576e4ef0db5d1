"""What holds a kept model, what is held out, and how much whitened rows really say."""

from types import SimpleNamespace

import numpy as np
import pytest

from dynid.gap.setting import TRUST, Known, overcounted, prior_rows, split

RATE = 40.0


def test_prior_rows_cost_what_the_earlier_errors_say():
    covariance = np.diag([0.04, 0.01])
    rows = prior_rows(Known(np.array([1.0, 2.0]), covariance, np.ones(1)))
    move = np.array([1.2, 2.0])  # one standard error along the first parameter
    rest = rows[:, :-1] @ move - rows[:, -1]
    assert rest @ rest == pytest.approx(1 / TRUST**2)


def test_directions_that_the_earlier_log_left_open_are_not_held():
    seen = np.array([[1.0, 1.0]]) / np.sqrt(2)
    rows = prior_rows(Known(np.array([1.0, 2.0]), 0.01 * seen.T @ seen, np.ones(1)))
    assert len(rows) == 1
    np.testing.assert_allclose(rows[:, :-1] @ np.array([1.0, -1.0]), 0.0, atol=1e-9)


def board_of(residual, rng):
    """Return a board with one joint whose baseline has slow columns, as a motion has."""
    t = np.arange(len(residual)) / RATE
    A = np.stack([np.ones_like(t), np.sin(0.8 * t), np.cos(0.5 * t)], axis=1)
    Q = np.linalg.qr(A)[0]
    rows = SimpleNamespace(block=(t // 1.0).astype(int))
    return SimpleNamespace(joints=[rows], Q=[Q], e=[residual])


def test_white_rows_count_once_and_slow_ones_as_often_as_they_go_on():
    rng = np.random.default_rng(2)
    white = rng.normal(size=40_000)
    assert overcounted(board_of(white, rng), (0,)) == pytest.approx(1.0, abs=0.35)
    slow = np.repeat(rng.normal(size=4_000), 10)
    assert overcounted(board_of(slow, rng), (0,)) == pytest.approx(10.0, rel=0.35)
    assert overcounted(board_of(7 * slow, rng), (0,)) == pytest.approx(10.0, rel=0.35), "size does not matter"


def stretch(log, seconds, moving):
    t = np.arange(round(seconds * RATE)) / RATE
    use = np.repeat((t < moving)[:, None], 2, axis=1)
    return SimpleNamespace(log=log, t=t, use=use, source=SimpleNamespace(name=f"log {log}"), __len__=lambda: len(t))


def test_what_is_held_out_is_motion_not_the_rest_at_the_end():
    one = stretch(0, 30.0, 20.0)
    train, held, _ = split([one], [])
    moved = held[0] & one.use.any(axis=1)
    assert moved.sum() == pytest.approx(0.2 * 20.0 * RATE, abs=2)
    assert not np.any(train[0] & held[0])
