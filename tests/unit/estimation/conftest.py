import pytest

from synthetic_arm import seven_joint_arm


@pytest.fixture(scope="session")
def arm():
    return seven_joint_arm()
