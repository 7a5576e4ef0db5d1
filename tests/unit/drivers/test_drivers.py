"""What each driver publishes: which topic, which columns, what of it to believe."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dynid.drivers.interface import Driver, KinovaGen2, driver_of
from dynid.errors import TopicMissing, WrongMessageType
from makelogs import gen2, lwr

STATE = "sensor_msgs/JointState"


def test_a_robot_without_driver_gets_the_generic_one():
    assert driver_of(replace(lwr(), driver=None)).kind == "generic"


def test_kinovas_fingers_are_not_joints_of_the_arm():
    ignores = driver_of(gen2()).ignores
    assert ignores("j2s7s300_joint_finger_tip_1")
    assert not ignores("j2s7s300_joint_7")


@pytest.mark.parametrize("robot", [gen2, lwr])
def test_velocities_that_a_driver_makes_up_are_not_trusted(robot):
    assert not driver_of(robot()).velocity_trusted


def test_kinova_is_told_how_to_publish_faster():
    assert "feedback_publish_rate" in driver_of(gen2()).rate_fix


def test_a_default_topic_is_found_in_any_namespace():
    robot = replace(gen2(), driver=None)
    topics = {"/a/out/joint_state": STATE, "/gripper/js": STATE, "/tf": "tf2_msgs/TFMessage"}
    assert KinovaGen2().choose_topic(topics, None, robot, "log.bag") == "/a/out/joint_state"


def test_the_only_joint_state_topic_needs_no_name():
    robot = replace(lwr(), driver=None)
    assert Driver().choose_topic({"/odd": STATE}, None, robot, "log.bag") == "/odd"


def test_a_bag_without_joint_states_lists_what_it_has():
    robot = replace(lwr(), driver=None)
    with pytest.raises(TopicMissing, match=r"it has /tf \(TFMessage\)"):
        Driver().choose_topic({"/tf": "tf2_msgs/TFMessage"}, None, robot, "log.bag")


def test_a_topic_of_another_type_is_refused_with_the_one_to_use():
    topics = {"/tf": "tf2_msgs/TFMessage", "/joint_states": STATE}
    with pytest.raises(
        WrongMessageType, match="/tf is tf2_msgs/TFMessage; use /joint_states"
    ) as caught:
        Driver().choose_topic(topics, "/tf", lwr(), "log.bag")
    assert caught.value.fix == "--topic /joint_states"
