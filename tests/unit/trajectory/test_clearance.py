"""Spheres know where the links are, how far apart, and which way to go."""

import numpy as np
import pytest

from dynid.model.kinematics import tool_pose
from dynid.robot import Joint, Robot
from dynid.trajectory.clearance import Box, Scene, Spheres, joint_axes, link_poses


def scara():
    joints = (
        Joint("a", a=0.3, twist=0.2),
        Joint("b", a=0.25, twist=np.pi, theta_offset=0.4),
        Joint("c", type="prismatic", twist=0.3, theta_offset=0.7),
    )
    return Robot("scara", "modified", joints, base_xyz=(0.1, 0.2, 0.9), base_rpy=(0.1, 0.2, 0.3))


@pytest.mark.parametrize("robot", ["lwr", "gen2", "scara"])
def test_last_frame_is_where_the_model_of_one_pose_puts_it(robot, request):
    robot = scara() if robot == "scara" else request.getfixturevalue(robot).robot
    q = np.random.default_rng(1).uniform(-1, 1, (20, robot.n))
    rotations, origins = link_poses(robot, q)
    for k, pose in enumerate(q):
        expected = tool_pose(robot, pose)
        assert np.allclose(origins[k, -1], expected[:3, 3])
        assert np.allclose(rotations[k, -1], expected[:3, :3])


@pytest.mark.parametrize("robot", ["lwr", "scara"])
def test_axes_give_the_velocity_of_the_tool(robot, request):
    robot = scara() if robot == "scara" else request.getfixturevalue(robot).robot
    rng = np.random.default_rng(2)
    q, direction = rng.uniform(-1, 1, (2, robot.n))
    rotations, origins = link_poses(robot, q[None])
    axes, feet = joint_axes(robot, rotations, origins)
    turning = np.array([joint.revolute for joint in robot.joints])[:, None]
    jacobian = np.where(turning, np.cross(axes[0], origins[0, -1] - feet[0]), axes[0])
    h = 1e-6
    up, down = (tool_pose(robot, q + s * h * direction)[:3, 3] for s in (1, -1))
    assert np.allclose(direction @ jacobian, (up - down) / (2 * h), atol=1e-8)


@pytest.mark.parametrize(
    "scene",
    [
        Scene(floor=0.3),
        Scene(floor=None, obstacles=(Box((0.1, -0.3, 0.2), (0.5, 0.3, 0.9)),)),
        Scene(floor=None, workspace=Box((-0.3, -0.3, 0.3), (0.3, 0.3, 1.0))),
        Scene(floor=None, self_distance=0.12),
    ],
)
def test_gradient_of_the_penalty_is_that_of_differences(gen2, scene):
    spheres = Spheres(gen2.robot, scene)
    rng = np.random.default_rng(3)
    q, direction = rng.uniform(-2, 4, (30, 7)), rng.standard_normal((30, 7))
    value, slope = spheres.value(q)
    h = 1e-6
    up, down = (spheres.value(q + s * h * direction)[0] for s in (1, -1))
    assert value > 0
    assert np.sum(slope * direction) == pytest.approx((up - down) / (2 * h), rel=1e-4)


def test_upright_arm_is_clear_of_the_floor_and_a_fallen_one_is_not(lwr):
    spheres = Spheres(lwr.robot, Scene())
    fallen = np.array([0, np.radians(119), 0, 0, 0, 0, 0.0])
    assert spheres.value(np.zeros((1, 7)))[0] == 0
    floor = next(c for c in spheres.contacts(fallen[None]) if "floor" in c.what)
    tip = tool_pose(lwr.robot, fallen)[2, 3]
    assert floor.distance == pytest.approx(tip - 0.06, abs=0.01)


def test_tool_at_a_box_has_the_distance_of_geometry(lwr):
    tip = tool_pose(lwr.robot, np.zeros(7))[:3, 3]
    box = Box((-0.1, -0.1, float(tip[2]) + 0.2), (0.1, 0.1, float(tip[2]) + 0.4))
    contacts = Spheres(lwr.robot, Scene(obstacles=(box,))).contacts(np.zeros((1, 7)))
    assert next(c for c in contacts if "obstacle" in c.what).distance == pytest.approx(0.2 - 0.06)
