import numpy as np
import pytest
from numpy.testing import assert_allclose

from dynid import load_robot
from dynid.record.playing import ReferenceMotion, approach, nearest_turn, repeated
from motions import there_and_back

ARM = load_robot("kinova_gen2")


def sine(seconds=2.0, rate=100):
    t = np.arange(round(seconds * rate) + 1) / rate
    return there_and_back(t, np.linspace(0.1, 0.3, 7))


def test_between_samples_the_reference_is_the_motion_itself():
    fine, coarse = sine(rate=1000), ReferenceMotion(sine(rate=100), np.zeros(7))
    found = [coarse.at(t) for t in fine.t]
    assert_allclose([x.q for x in found], fine.q, atol=2e-7)
    assert_allclose([x.qd for x in found], fine.qd, atol=2e-6)
    assert_allclose([x.qdd for x in found], fine.qdd, atol=1e-3)


def test_the_gap_to_the_start_dies_away_and_the_rates_are_its_derivatives():
    reference = ReferenceMotion(sine(), np.full(7, 0.05))
    t = np.linspace(0, 1.2, 2401)
    q, qd = (np.array([getattr(reference.at(x), key) for x in t]) for key in ("q", "qd"))
    assert_allclose(q[0], 0.05)
    assert_allclose(np.gradient(q, t, axis=0)[1:-1], qd[1:-1], atol=1e-4)
    assert (
        np.abs(reference.at(1.0).q - ReferenceMotion(sine(), np.zeros(7)).at(1.0).q).max() < 1e-12
    )


def test_an_approach_stays_within_a_tenth_of_the_limits():
    way = approach(ARM, np.zeros(7), np.array([1.0, -2.0, 0.1, 0, 0.5, 0, 3.0]))
    limits = [(joint.limits.velocity, joint.limits.acceleration) for joint in ARM.joints]
    assert (np.abs(way.qd).max(axis=0) <= 0.1 * np.array([v for v, _ in limits]) + 1e-9).all()
    assert (np.abs(way.qdd).max(axis=0) <= 0.1 * np.array([a for _, a in limits]) + 1e-9).all()
    assert_allclose(np.gradient(way.q, way.t, axis=0)[1:-1], way.qd[1:-1], atol=1e-3)


def test_repeated_motions_join_without_a_jump():
    motion = sine()
    thrice = repeated(ARM, motion, 3)
    assert thrice.t[-1] == pytest.approx(6.0)
    assert np.diff(thrice.t).min() > 0
    assert np.abs(np.diff(thrice.q, axis=0)).max() < 0.01
    motion.q[-1] += 0.2
    assert repeated(ARM, motion, 2).t[-1] > 4.0 + 1.9


def test_endless_joints_follow_the_turns_that_the_arm_has_made():
    motion = sine()
    turned = nearest_turn(
        ARM, motion, motion.q[0] + 2 * np.pi * np.array([1, 0, -2, 0, 0, 0, 1]) + 0.01
    )
    assert_allclose((turned.q - motion.q)[0] / (2 * np.pi), [1, 0, -2, 0, 0, 0, 1])
