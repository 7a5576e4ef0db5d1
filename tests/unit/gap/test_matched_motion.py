"""Recordings of the same motion, compared with each other: what was missing before cancels, what changed is left."""

from dataclasses import dataclass

import numpy as np
import pytest

from dynid.estimation.rows import ObservationRows, dense_rows
from dynid.gap.matched_motion import subtract_matched_motion

RATE = 40.0


@dataclass(frozen=True)
class Segment:
    """A segment with just what the comparison needs."""

    rows: ObservationRows
    q: np.ndarray
    use: np.ndarray
    rate: float = RATE
    tau = property(lambda self: self.rows.tau)
    W = property(lambda self: self.rows.W)

    def __len__(self):
        return len(self.q)


def motion(t):
    return np.stack(
        [np.sin(0.7 * t) + 0.3 * np.sin(1.9 * t), np.cos(0.5 * t) + 0.2 * np.sin(2.3 * t)], axis=1
    )


def recording(start, seconds=30.0, change=0.0, pace=1.0, seed=0):
    """Return rows whose torques hold the model (one parameter, 2.0), something that it lacks, noise and a change."""
    t = start + np.arange(round(seconds * RATE)) / RATE
    q = motion(pace * t)
    noise = 0.01 * np.random.default_rng(seed).normal(size=q.shape)
    tau = 2.0 * np.cos(q) + 0.5 * np.sin(4 * q) + change * q + noise
    return Segment(dense_rows(np.cos(q)[:, :, None], tau), q, np.ones(q.shape, dtype=bool))


def test_what_was_missing_before_cancels_and_the_change_is_left():
    now, then = recording(1.37, change=0.3, seed=1), recording(0.0, seed=2)
    found, matched = subtract_matched_motion([now], [then], np.array([2.0]))
    now = found[0]
    left = (now.tau - now.W[:, :, 0] * 2.0 - 0.3 * now.q)[now.use]
    assert matched == pytest.approx(1.0)
    assert np.std(left) == pytest.approx(0.01 * np.sqrt(2), rel=0.1)


def test_rows_that_were_not_driven_before_do_not_count():
    now, then = recording(0.0, seed=1), recording(5.0, seed=2)
    found, _ = subtract_matched_motion([now], [then], np.array([2.0]))
    assert not found[0].use[: round(4.9 * RATE)].any()
    assert found[0].use[round(5.1 * RATE) : -2].all()


def test_several_earlier_recordings_are_averaged():
    earlier = [recording(0.1 * k, seed=k) for k in range(4)]
    found, matched = subtract_matched_motion([recording(0.05, seed=9)], earlier, np.array([2.0]))
    left = (found[0].tau - found[0].W[:, :, 0] * 2.0)[found[0].use]
    assert matched == pytest.approx(4.0, rel=0.02)
    assert np.std(left) == pytest.approx(0.01 * np.sqrt(1.25), rel=0.1)


def test_another_motion_is_not_compared():
    assert (
        subtract_matched_motion([recording(0.0)], [recording(2.0, pace=1.3)], np.array([2.0]))
        is None
    )


def test_a_little_of_the_same_motion_is_not_enough():
    assert subtract_matched_motion([recording(0.0)], [recording(20.0)], np.array([2.0])) is None
