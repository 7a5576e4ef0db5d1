"""The URDF against the DH table."""

import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from arms import configuration, dh_product, random_robot
from dynid import Robot
from dynid.model.kinematics import fixed_poses
from dynid.robot import Body, Joint, Limits, roll_pitch_yaw, rotation_rpy
from dynid.sim.urdf import urdf_text


@pytest.mark.parametrize("seed", range(40))
def test_links_stand_where_the_dh_product_says(seed):
    """Both conventions, both joint types, any base pose: 1e-9 m and 1e-9 in the rotation."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng)
    model = pin.buildModelFromXML(urdf_text(robot))
    data, q = model.createData(), rng.uniform(-3, 3, robot.n)
    pin.framesForwardKinematics(model, data, configuration(model, q))
    for i, (joint, expected) in enumerate(
        zip(robot.joints, dh_product(robot, q), strict=True), start=1
    ):
        found = (
            data.oMf[model.getFrameId(f"link_{i}")].homogeneous
            @ fixed_poses(joint, robot.convention)[1]
        )
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_limits_and_types_are_those_of_the_robot_file():
    """A joint without position limits is continuous; the others carry all four limits."""
    joints = (
        Joint("free", limits=Limits(velocity=2.0)),
        Joint("held", limits=Limits((-1.0, 2.0), 3.0, None, 40.0)),
        Joint("slide", "prismatic", limits=Limits((0.0, 0.5))),
    )
    found = ET.fromstring(urdf_text(Robot("r", "standard", joints))).findall("joint")
    assert [joint.get("type") for joint in found] == ["continuous", "revolute", "prismatic"]
    limits = [{key: float(value) for key, value in joint.find("limit").items()} for joint in found]
    assert "lower" not in limits[0]
    assert limits[0]["velocity"] == 2.0
    assert limits[1] == {"lower": -1.0, "upper": 2.0, "velocity": 3.0, "effort": 40.0}
    assert (limits[2]["lower"], limits[2]["upper"]) == (0.0, 0.5)


def test_names_that_mean_something_in_xml_survive():
    """Quotes, ampersands and angle brackets in joint names are escaped."""
    names = ('a"b', "c&d", "<e>")
    robot = Robot("x & y", "standard", tuple(Joint(name, d=0.1) for name in names))
    root = ET.fromstring(
        urdf_text(robot, [Body(1.0, inertia_com=(0.1, 0.0, 0.0, 0.1, 0.0, 0.1))] * 3)
    )
    assert tuple(joint.get("name") for joint in root.findall("joint")) == names


@pytest.mark.parametrize("pitch", [0.3, np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9, 2.5])
def test_roll_pitch_yaw_is_exact_where_pitch_is_a_right_angle(pitch):
    """The three angles give the same matrix back, to rounding."""
    R = pin.rpy.rpyToMatrix(0.4, pitch, -1.2)
    np.testing.assert_allclose(rotation_rpy(roll_pitch_yaw(R)), R, atol=1e-15)
