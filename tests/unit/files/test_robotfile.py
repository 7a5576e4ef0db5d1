"""A robot as the text of its file, and back."""

from dataclasses import replace
from pathlib import Path

import pytest

from dynid.files.robotfile import known_robots, load_robot, parse_robot, robot_text
from dynid.robot import (
    Body,
    Coulomb,
    Cylinders,
    EffectSpec,
    JointMap,
    Known,
    Prior,
    TorqueSource,
)


@pytest.mark.parametrize("name", sorted(known_robots()))
def test_every_robot_that_comes_with_dynid_is_written_and_read_back(name):
    robot = load_robot(name)
    assert parse_robot(robot_text(robot), Path("again.yaml")) == robot


def test_everything_that_a_robot_can_say_is_written_and_read_back():
    robot = load_robot("scara")
    first = replace(robot.joints[0], friction=("viscous",), motor_inertia=False)
    made = replace(
        robot,
        path=None,
        joints=(first, *robot.joints[1:]),
        links=(3, 4),
        torque=TorqueSource("motor_current", (1.0, None, 2.0, 3.0), noise=(0.1, 0.2, 0.3, 0.4)),
        simulator=JointMap((1.0, -1.0, 1.0, 1.0), (0.0, 0.0, 0.1, 0.0)),
        prior=Prior(Cylinders(0.05, mass=12.0)),
        tool=Body(1.2, (0.1, 0.02, 0.3), (0.1, 0.01, 0.02, 0.1, 0.003, 0.2)),
        known=Known(
            (3.0, 20.0),
            ((1, (1.0, 3.0)), (2, (0.5, 2.0))),
            ((2, ((0.0, 0.0, -0.1), (0.1, 0.2, 0.3))),),
        ),
        coulomb=Coulomb("threshold", (0.1, 0.2, 0.3, 0.4)),
        effects=(EffectSpec("stribeck", (robot.joint_names[0],), {"vs": 0.1}, {"vs": 0.01}),),
    )
    assert parse_robot(robot_text(made), Path("again.yaml")) == made
