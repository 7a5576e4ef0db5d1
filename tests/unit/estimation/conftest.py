import pytest

import models
from synthetic_arm import seven_joint_arm


@pytest.fixture(scope="session")
def arm():
    return seven_joint_arm()


@pytest.fixture(scope="session")
def base():
    return models.shipped("scara")


@pytest.fixture(scope="session")
def lwr():
    return models.shipped("kuka_lwr4plus")
