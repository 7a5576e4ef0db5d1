"""Two arms with a model, made once for all tests of trajectories."""

from dataclasses import replace
from pathlib import Path

import pytest

from dynid.files.robotfile import load_robot
from dynid.model.base_model import BaseModel
from dynid.model.reduce import reduce
from dynid.model.regressor import build_model

ROBOTS = Path(__file__).parents[3] / "robots"


def arm(name):
    """The arm with viscous and Coulomb friction: 62 base parameters."""
    robot = load_robot(ROBOTS / f"{name}.yaml")
    return replace(
        robot, joints=tuple(replace(j, friction=("viscous", "coulomb")) for j in robot.joints)
    )


@pytest.fixture(scope="session")
def lwr():
    model = build_model(arm("kuka_lwr4plus"))
    return BaseModel(model, reduce(model))


@pytest.fixture(scope="session")
def gen2():
    model = build_model(arm("kinova_gen2"))
    return BaseModel(model, reduce(model))
