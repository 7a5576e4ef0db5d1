"""Results of a two-link arm whose torques are written out by hand, for the tests of the workflows."""

import pytest

import twolink
from dynid import identify, load_robot


@pytest.fixture(scope="session")
def arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("robot") / "arm.yaml"
    path.write_text(twolink.ROBOT)
    return load_robot(path)


@pytest.fixture(scope="session")
def result(arm):
    return identify(arm, [twolink.log(1)])


@pytest.fixture(scope="session")
def other(arm):
    """The same arm on another motion."""
    return identify(arm, [twolink.log(2)])


@pytest.fixture(scope="session")
def scaled(arm):
    """The same arm with an elbow whose torque is 5 % larger."""
    return identify(arm, [twolink.log(1, scale=(1.0, 1.05))])
