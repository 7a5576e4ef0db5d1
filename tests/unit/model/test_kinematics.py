"""Link frames against products of elementary transforms and differences of positions."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from arms import dh_product, random_robot
from dynid import load_robot
from dynid.model.kinematics import base_pose, link_frames, tip_jacobian, tool_pose

ARMS = {
    "lwr": load_robot("kuka_lwr4plus"),
    "panda": load_robot("franka_panda"),
    "modified": random_robot(np.random.default_rng(6), 4, "modified"),
    "standard": random_robot(np.random.default_rng(6), 4, "standard"),
}


@pytest.mark.parametrize("name", ARMS)
def test_frames_are_the_product_of_turns_and_shifts(name):
    robot = ARMS[name]
    q = np.random.default_rng(1).uniform(-2, 2, (20, robot.n))
    expected = np.array([dh_product(robot, one) for one in q])
    assert_allclose(link_frames(robot, q, world=True).poses, expected, atol=1e-14)
    assert_allclose(base_pose(robot) @ link_frames(robot, q).poses, expected, atol=1e-14)
    assert_allclose(tool_pose(robot, q[3]), expected[3, -1], atol=1e-14)
    assert link_frames(robot, q.reshape(4, 5, -1)).axis.shape == (4, 5, robot.n, 3)


@pytest.mark.parametrize("name", ARMS)
def test_the_jacobian_is_the_slope_of_the_tool_position(name):
    robot, rng, h = ARMS[name], np.random.default_rng(2), 1e-6
    q, direction = rng.uniform(-1, 1, (2, robot.n))
    jacobian = tip_jacobian(robot, link_frames(robot, q, world=True))
    up, down = (tool_pose(robot, q + s * h * direction)[:3, 3] for s in (1, -1))
    assert_allclose(direction @ jacobian, (up - down) / (2 * h), atol=1e-8)
