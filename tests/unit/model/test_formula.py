"""Formulas of the robot file: what they mean, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from dynid import load_robot
from dynid.errors import WrongRobotFile
from dynid.files.robotfile import robot_text
from dynid.model.effects.catalogue import added_effects
from dynid.model.effects.motion import ArmMotion
from dynid.model.regressor import build_model
from dynid.robot import EffectSpec


class Torques:
    """A model with a torque that is known."""

    def rigid(self, q, qd, qdd):
        return 3 * q + qdd

    total = rigid


@pytest.fixture
def motion():
    q, qd, qdd = np.random.default_rng(3).normal(size=(3, 50, 4))
    return ArmMotion(np.arange(50) / 10, q, qd, qdd, None, Torques(), lambda x: x, np.sign(qd))


def added(text, robot="scara", joint=1):
    arm = load_robot(robot)
    spec = EffectSpec("formula", (arm.joint_names[joint],), {}, {}, text)
    return added_effects(replace(arm, effects=(spec,)))[0]


def columns(text, motion):
    return added(text).evaluate(motion)


def test_a_formula_is_what_it_says(motion):
    q, qd, qdd, t = motion.q, motion.qd, motion.qdd, motion.t
    assert_allclose(
        columns(
            "a cos(2 q4) |qd4| + b tau2*qd - 2 c tau3 sign(qd1) / (1 + t) + d (q2 - q3)^2 qdd1",
            motion,
        ),
        [
            np.cos(2 * q[:, 3]) * np.abs(qd[:, 3]),
            motion.rigid[:, 1] * qd[:, 1],
            -2 * motion.rigid[:, 2] * np.sign(qd[:, 0]) / (1 + t),
            (q[:, 1] - q[:, 2]) ** 2 * qdd[:, 0],
        ],
    )
    assert_allclose(columns("-a", motion), [-np.ones(50)])


def test_precedence_is_that_of_algebra(motion):
    q = motion.q
    assert_allclose(
        columns("a (-2 q1^2 + q2 q3 / 4)", motion)[0], -2 * q[:, 0] ** 2 + q[:, 1] * q[:, 2] / 4
    )
    assert_allclose(columns("a |q1 - abs(q2)|", motion)[0], np.abs(q[:, 0] - np.abs(q[:, 1])))


@pytest.mark.parametrize(("joint", "torque"), [(0, "N m"), (2, "N")])
def test_an_amplitude_is_a_torque_or_force_per_unit_of_its_factor(joint, torque):
    made = added("a |qd1| + b", joint=joint)
    assert made.effect.amplitudes({}) == dict.fromkeys("ab", f"{torque} per unit of its factor")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "qd4",
        "a b qd4",
        "a sin(b q1)",
        "a qd9",
        "a qd1 + a qd2",
        "a __import__('os')",
        "a qd1; b",
        "a open(q1)",
        "a (q1",
        "a q1)",
        "a |q1",
        "a clip(q1)",
        "a q1 ^ q2",
        "a sqrt(q1)",
        "a / (q1 - q1)",
        "a " + "(" * 400 + "q1" + ")" * 400,
        "a q1 +",
        "a q0",
        "a lambda",
        "a 1e999 q1",
        "a.b q1",
        "a exp(900 + 900)",
    ],
)
def test_what_is_no_formula_is_refused(text, motion):
    with pytest.raises(WrongRobotFile):
        added(text).evaluate(replace(motion, robot=load_robot("scara")))


def test_a_robot_file_keeps_its_formula(tmp_path):
    robot = load_robot("kuka_lwr4plus")
    spec = EffectSpec(
        "formula", (robot.joint_names[3],), {"a": 0.5}, {"a": 0.01}, "a cos(2 q4) |qd4|"
    )
    path = tmp_path / "arm.yaml"
    path.write_text(robot_text(replace(robot, effects=(spec,))))
    again = load_robot(str(path))
    assert again.effects == (spec,)
    assert build_model(again).parameter_names[-1] == "formula4_a"
