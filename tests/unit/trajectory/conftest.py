"""Two arms with a model, made once for all tests of trajectories."""

import pytest

import models


@pytest.fixture(scope="session")
def lwr():
    return models.with_plain_friction("kuka_lwr4plus")


@pytest.fixture(scope="session")
def gen2():
    return models.with_plain_friction("kinova_gen2")
