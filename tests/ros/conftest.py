"""A real ROS master, a simulated driver and ``dynid record``, each in its own process, on loopback."""

import shutil
from pathlib import Path

import pytest
from lab import Lab, start_master

from dynid import base_model, load_robot
from dynid.drivers.ros import missing_modules

#: What ``make test`` runs of them: each driver plays and stops, what goes wrong on the way, what is refused before.
QUICK = (
    "test_a_fault_of_the_driver_stops_the_arm_and_keeps_the_log[kinova_gen2-silent",
    "test_a_fault_of_the_driver_stops_the_arm_and_keeps_the_log[kinova_gen2-torque",
    "test_a_fault_of_the_driver_stops_the_arm_and_keeps_the_log[kuka_lwr4plus-deaf",
    "test_a_fault_of_the_driver_stops_the_arm_and_keeps_the_log[ur10-deaf",
    "test_a_wrong_name_moves_nothing_and_the_right_one_does",
    "test_an_arm_with_a_trajectory_controller_is_moved_and_recorded[words0]",
    "test_another_program_may_move_the_arm_while_it_is_recorded",
    "test_what_preflight_refuses_is_not_sent",
)


def pytest_collection_modifyitems(items):
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.ros)
            if not item.name.startswith(QUICK):
                item.add_marker(pytest.mark.slow)


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
    shutil.copytree(models, tmp_path / "out")
    lab = Lab(tmp_path, master[1])
    yield lab
    lab.close()
