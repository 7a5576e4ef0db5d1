"""The motion that answers a gap search, judged by least squares of its own and by what is plain to see."""

import numpy as np
import pytest

import models
from dynid import Motion
from dynid.model.effects.catalogue import CATALOGUE
from dynid.trajectory import tuning
from dynid.trajectory.separation import GapQuestion, Rivalry, separation
from motions import tones


@pytest.fixture
def base():
    return models.two_links()


def rivals(first, amplitudes, second, joint=1, **shape):
    return Rivalry(
        CATALOGUE[first],
        (joint,),
        shape,
        np.array(amplitudes),
        CATALOGUE[second],
        (joint,),
        "the two",
    )


def question(base, *pairs):
    return GapQuestion(tuple(pairs), np.array([0.1, 0.05]), np.zeros(base.rank))


def swing(reach, speed=1.0, count=800):
    """Two sines on each joint: with one, a spring is the same as an inertia."""
    t, w = np.linspace(0, 20, count), speed * np.array([[0.7, 1.0], [1.9, 2.2]])
    return Motion(t, *tones(t, np.outer((0.7, 0.3), (1.0, reach)), w))


def test_the_lead_is_what_least_squares_with_the_rival_leaves(base):
    motion = swing(1.5)
    pair = rivals("spring", [2.0, 0.3], "counterbalance", order=1.0, constant=1.0)
    W = base.observer.dense(motion.q, motion.qd, motion.qdd)
    torque, rival = np.zeros((800, 2)), np.zeros((800, 2, 2))
    torque[:, 1] = 2.0 * motion.q[:, 1] + 0.3
    rival[:, 1] = np.column_stack([np.sin(motion.q[:, 1]), np.cos(motion.q[:, 1])])
    noise = np.array([0.1, 0.05])
    A = (np.concatenate([W, rival], axis=2) / noise[:, None]).reshape(1600, -1)
    y = (torque / noise).ravel()
    left = y - A @ np.linalg.lstsq(A, y, rcond=None)[0]
    expected = left @ left * tuning.INDEPENDENT_ROWS_A_SECOND * 20 / 800
    assert separation(base, question(base, pair), motion)[0] == pytest.approx(expected, rel=1e-6)


def test_a_wide_swing_tells_a_line_from_a_wave_and_a_small_one_does_not(base):
    asked = question(base, rivals("spring", [1.0, 0.0], "counterbalance", order=1.0, constant=1.0))
    small, wide = (separation(base, asked, swing(reach))[0] for reach in (0.1, 1.8))
    assert small < 1 < 100 < wide
