"""Capsules know where the links are, how far apart, and which way to go."""

import numpy as np
import pytest

from dynid.model.kinematics import tool_pose
from dynid.trajectory.clearance import Capsules
from dynid.trajectory.scene import Box, Scene


def test_upright_arm_is_clear_of_the_floor_and_a_fallen_one_is_not(lwr):
    capsules = Capsules(lwr.robot, Scene())
    fallen = np.array([0, np.radians(119), 0, 0, 0, 0, 0.0])
    assert capsules.value(np.zeros((1, 7)))[0] == 0
    floor = next(c for c in capsules.distances(fallen[None]) if "floor" in c.pair)
    tip = tool_pose(lwr.robot, fallen)[2, 3]
    assert floor.distance == pytest.approx(tip - 0.06, abs=0.01)


def test_tool_at_a_box_has_the_distance_of_geometry(lwr):
    tip = tool_pose(lwr.robot, np.zeros(7))[:3, 3]
    box = Box((-0.1, -0.1, float(tip[2]) + 0.2), (0.1, 0.1, float(tip[2]) + 0.4))
    contacts = Capsules(lwr.robot, Scene(obstacles=(box,))).distances(np.zeros((1, 7)))
    assert next(c for c in contacts if "obstacle" in c.pair).distance == pytest.approx(0.2 - 0.06)
