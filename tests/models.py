"""Models of arms with their base parameters, each derived once for all tests of a process."""

from dataclasses import replace
from functools import cache

import twolink
from dynid import BaseModel, load_robot
from dynid.model.reduce import reduce, with_added
from dynid.model.regressor import build_model


def base_of(robot):
    model = build_model(robot)
    return BaseModel(model, with_added(reduce(model), model))


@cache
def shipped(name):
    return base_of(load_robot(name))


@cache
def with_plain_friction(name):
    """An arm with viscous and Coulomb friction alone: 62 base parameters of seven joints."""
    robot = load_robot(name)
    joints = tuple(replace(j, friction=("viscous", "coulomb")) for j in robot.joints)
    return base_of(replace(robot, joints=joints))


@cache
def two_links():
    return base_of(twolink.robot())
