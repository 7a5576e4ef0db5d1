"""A simulated log holds what was put into it, and nothing else."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose

from dynid import Motion, SimulateOptions, base_model, load_robot, simulate
from dynid.errors import DynidError
from dynid.robot import Body, Prior
from motions import tones

BARE = SimulateOptions(viscous=0.0, coulomb=0.0, noise=0.0, resolution=0.0)


@pytest.fixture(scope="module")
def arm():
    robot = load_robot("scara")
    bodies = tuple(
        Body(2.0 + k, (0.05, 0.01, 0.02), (0.02, 0.0, 0.0, 0.03, 0.0, 0.04)) for k in range(robot.n)
    )
    return replace(robot, prior=Prior(links=bodies), tool=None, effects=())


@pytest.fixture(scope="module")
def base(arm):
    return base_model(arm)


def about_the_middle(robot, t, size, w, phase=0.0):
    """One tone of each joint about the middle of its range."""
    middle = np.array([np.mean(joint.limits.position or (0.0, 0.0)) for joint in robot.joints])
    q, qd, qdd = tones(t, size, w, phase)
    return Motion(t, middle + q, qd, qdd)


@pytest.fixture(scope="module")
def motion(arm):
    t = np.arange(0.0, 2.0, 0.01)
    w, size = np.array([1.0, 2.0, 3.0, 1.5]) * 2, np.array([0.5, 0.4, 0.05, 0.6])
    return about_the_middle(arm, t, size, w)


@pytest.fixture
def bare(arm, motion):
    return partial(simulate, arm, motion, BARE)


def test_payload_weighs_what_it_weighs_on_the_sliding_joint(arm, motion, bare):
    more = bare(payload=2.0).torque - bare().torque
    slide = next(j for j, joint in enumerate(arm.joints) if not joint.revolute)
    sign = np.sign(more[:, slide].mean())
    assert (
        np.abs(more[:, slide] - sign * 2.0 * 9.81).max()
        < 2.0 * np.abs(motion.qdd[:, slide]).max() + 1e-6
    )


def test_an_effect_of_the_catalogue_is_added_with_its_numbers(motion, bare):
    plain, bent = bare(), bare(effects=("viscous@2:fv=4.5",))
    assert_allclose(bent.torque[:, 1] - plain.torque[:, 1], 4.5 * motion.qd[:, 1], atol=1e-9)
    assert_allclose(np.delete(bent.torque - plain.torque, 1, axis=1), 0.0, atol=1e-12)


def test_delay_noise_and_resolution_are_as_large_as_asked(arm, motion, bare):
    plain = bare()
    late = bare(delay=0.05)
    assert_allclose(late.log.tau[5:], plain.log.tau[:-5], atol=1e-9)
    coarse = bare(resolution=1e-3)
    assert np.abs(coarse.log.q - motion.q).max() <= 0.5e-3 + 1e-12
    noisy = bare(noise=0.01)
    rated = np.array([joint.limits.torque for joint in arm.joints])
    assert_allclose((noisy.log.tau - plain.log.tau).std(axis=0) / rated, 0.01, rtol=0.25)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("viscous@2:fv", "."),
        ("viscous@2:fv=much", "."),
        ("viscous@2", "takes fv"),
        ("tool_force:x=1,yy=2", "takes x, y, z"),
        ("sprign@2:k1=3", "did you mean 'spring'"),
    ],
)
def test_an_effect_without_its_numbers_or_of_another_name_is_refused(bare, text, said):
    with pytest.raises(DynidError, match=said):
        bare(effects=(text,))
