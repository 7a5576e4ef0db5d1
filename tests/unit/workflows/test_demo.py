"""A demo on somebody's own arm: what is simulated has known parameters, and they are found."""

import pytest
from numpy.testing import assert_allclose

import twolink
from dynid import identify, load_robot, simulate
from dynid.files.logs import read_log
from dynid.loading import as_motion
from dynid.model.parameters import prior_bodies
from dynid.workflows.demo import against_truth, simulate_own

BARE = {"viscous": 0.0, "coulomb": 0.0, "noise": 0.0, "resolution": 0.0}


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    twolink.write_arm(folder)
    return load_robot(folder / "arm.yaml"), folder


def test_the_bodies_are_not_those_of_the_file_and_are_found(arm):
    robot, folder = arm
    own = simulate_own(robot, folder, seed=3)
    ratio = [own.truth[f"m{k + 1}"] / body.mass for k, body in enumerate(prior_bodies(robot))]
    assert all(0.8 <= each <= 1.2 and abs(each - 1) > 1e-3 for each in ratio)
    found = against_truth(identify(robot, read_log(own.logs[0], robot=robot)), own.truth)
    assert found["parameters"] >= 8
    assert found["inside_95_percent"] >= 0.8 * found["parameters"]


def test_the_motion_of_a_log_is_simulated_with_the_torques_of_the_arm_on_it(arm):
    robot, folder = arm
    motion = as_motion(folder / "log.csv", robot)
    t, q, qd, qdd = twolink.motion(1)
    inside = slice(20, -20)
    assert_allclose(motion.q[inside], q[inside], atol=1e-6)
    assert_allclose(motion.qd[inside], qd[inside], atol=1e-3)
    assert_allclose(motion.qdd[inside], qdd[inside], atol=0.05)
    log = simulate(robot, motion, **BARE).log
    assert len(log) == len(t)
    assert_allclose(log.q, motion.q)
