"""Two arms with a model, made once for all tests of trajectories."""

from dataclasses import replace

import pytest

import models
from dynid import load_robot


def arm(name):
    """The arm with viscous and Coulomb friction: 62 base parameters."""
    robot = load_robot(name)
    joints = tuple(replace(j, friction=("viscous", "coulomb")) for j in robot.joints)
    return models.base_of(replace(robot, joints=joints))


@pytest.fixture(scope="session")
def lwr():
    return arm("kuka_lwr4plus")


@pytest.fixture(scope="session")
def gen2():
    return arm("kinova_gen2")
