"""A real ROS master, a simulated driver and ``dynid record``, each in its own process, on loopback."""

import shutil
from pathlib import Path

import pytest
from lab import Lab, start_master, store, swing

from dynid.drivers.ros import missing_modules
from dynid.files.robotfile import load_robot
from dynid.workflows.model import base_model


def pytest_collection_modifyitems(items):
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.ros)


@pytest.fixture(scope="session", autouse=True)
def _ros():
    if missing := missing_modules():
        pytest.skip(f"ROS 1 is not installed: {', '.join(missing)}")


@pytest.fixture
def master(tmp_path):
    process, uri = start_master(tmp_path)
    yield process, uri
    process.kill()
    process.wait()


@pytest.fixture(scope="session")
def models(tmp_path_factory):
    """Return a folder with the models of the arms, which would be derived anew in each test's folder otherwise."""
    folder = tmp_path_factory.mktemp("models")
    for robot in ("kinova_gen2", "kuka_lwr4plus", "ur10"):
        base_model(load_robot(robot), folder / robot)
    return folder


@pytest.fixture
def lab(tmp_path, master, models):
    (tmp_path / "home").mkdir()
    shutil.copytree(models, tmp_path / "out")
    lab = Lab(tmp_path, master[1])
    yield lab
    lab.close()


@pytest.fixture
def plan(tmp_path):
    """Return a function that writes a reviewed trajectory."""

    def make(robot, seconds=3.0, name="trajectory.npz", **options):
        return store(tmp_path / name, robot, swing(robot, seconds), **options)

    return make
