"""What to believe of what a driver publishes; its topics: test_logs.py."""

import pytest

from dynid.drivers.interface import driver_of
from makelogs import gen2, lwr


def test_kinovas_fingers_are_not_joints_of_the_arm():
    ignores = driver_of(gen2()).ignores
    assert ignores("j2s7s300_joint_finger_tip_1")
    assert not ignores("j2s7s300_joint_7")


@pytest.mark.parametrize("robot", [gen2, lwr])
def test_velocities_that_a_driver_makes_up_are_not_trusted(robot):
    assert not driver_of(robot()).velocity_trusted
