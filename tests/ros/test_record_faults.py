"""Everything that can go wrong while the arm moves: the right exit status, the log kept, the arm stopped."""

import signal
import subprocess
import time

import pytest
import yaml

from dynid.files import logs
from dynid.files.bags import list_topics
from dynid.files.logs import read_log
from dynid.files.robotfile import load_robot

KINOVA, LWR = "kinova_gen2", "kuka_lwr4plus"


def log_of(lab, robot=KINOVA):
    return read_log(lab.folder / "out" / robot / "log.bag", robot=load_robot(robot))


def manifest_of(lab, robot=KINOVA):
    return yaml.safe_load((lab.folder / "out" / robot / "manifest.yaml").read_text())


@pytest.mark.parametrize(
    ("robot", "fault", "status", "code", "stopped"),
    [
        (KINOVA, "deaf@1", 5, "E504", True),
        (LWR, "deaf@1", 5, "E504", True),
        (KINOVA, "torque@1", 5, "E508", True),
        (KINOVA, "silent@1", 5, "E506", True),
        (LWR, "dies@1", 5, "E506", False),
    ],
)
def test_a_fault_of_the_driver_stops_the_arm_and_keeps_the_log(
    lab, plan, robot, fault, status, code, stopped
):
    trajectory = plan(robot, 4.0)
    driver = lab.driver(robot, "--pose", trajectory, "--fault", fault)
    done = lab.move(robot, trajectory, "--max-deviation", "0.1rad")
    assert (done.status, done.out) == (status, "")
    assert f"error[{code}]" in done.err
    assert ("Arm stopped" in done.err or "emergency_stop is pressed" in done.err) == stopped
    assert ("use the physical stop button now" in done.err) == (not stopped)
    assert 0.9 < log_of(lab, robot).duration < 4.5
    assert manifest_of(lab, robot)["verdict"].startswith(f"aborted, {code}")
    if driver.running():
        sent = lab.finish(driver)
        assert sent["commands"] < 330, "commands went on after the fault"
        assert not sent["violations"]


def test_a_stop_that_fails_is_said(lab, plan):
    trajectory = plan(KINOVA, 4.0)
    # Why: the arm goes deaf and the stop is tried once before the motion, so it fails from the first command on.
    driver = lab.driver(KINOVA, "--pose", trajectory, "--fault", "stop-fails")
    child = lab.moving(KINOVA, trajectory)
    child.send(signal.SIGINT)
    done = child.end()
    assert done.status == 130
    assert "FAILED" in done.err
    assert "use the physical stop button now" in done.err
    assert lab.finish(driver)["commands"] < 300


def test_a_driver_without_a_stop_is_not_moved(lab, plan):
    for robot in (KINOVA, LWR):
        trajectory = plan(robot)
        driver = lab.driver(robot, "--pose", trajectory, "--fault", "no-stop")
        done = lab.move(robot, trajectory)
        assert done.status == 6
        assert "error[E607]" in done.err
        assert lab.finish(driver)["commands"] == 0


@pytest.mark.parametrize(("robot", "number"), [(KINOVA, signal.SIGINT), (LWR, signal.SIGTERM)])
def test_a_signal_stops_the_arm_first_and_keeps_the_log(lab, plan, robot, number):
    trajectory = plan(robot, 5.0)
    driver = lab.driver(robot, "--pose", trajectory)
    child = lab.moving(robot, trajectory)
    child.send(number)
    child.send(number)
    done = child.end()
    assert done.status == 130
    assert ("Arm stopped" if robot == KINOVA else "emergency_stop is pressed") in done.err
    assert "the arm stands still" in done.err
    assert manifest_of(lab, robot)["verdict"] == "stopped by the operator"
    assert len(log_of(lab, robot)) > 80
    sent = lab.finish(driver)
    assert sent["commands"] < 300, "of the 500 of the motion"
    assert sent["violations"] == [], (
        "the last command before the stop keeps the limits like all others"
    )
    assert sent["stop_acceleration_share"] > 0, (
        "how hard this driver brakes is told; dynid sends nothing then"
    )


def test_a_killed_recorder_leaves_a_bag_of_which_99_percent_are_read(lab, plan):
    trajectory = plan(LWR, 6.0)
    driver = lab.driver(LWR, "--pose", trajectory, "--rate", "200")
    child = lab.moving(LWR, trajectory)
    time.sleep(3.0)
    killed = time.time()
    child.send(signal.SIGKILL)
    child.end()
    path = lab.folder / "out" / LWR / "log.bag"
    assert log_of(lab, LWR).findings[0].code == "W305"
    log = logs.read_topics(path, ["/lwr/joint_states"])[0]["/lwr/joint_states"][0]
    first, last = (ns * 1e-9 for ns in log.extra["arrival_ns"])
    assert killed - last < 0.01 * (killed - first), "what came last is not in the file"
    assert len(log) >= 0.99 * 200 * (killed - first)
    assert manifest_of(lab, LWR)["verdict"] == "running"
    assert lab.finish(driver)["commands"] < 520


def test_a_master_that_dies_ends_the_motion_through_the_open_stop(lab, plan, master):
    trajectory = plan(KINOVA, 6.0)
    driver = lab.driver(KINOVA, "--pose", trajectory)
    child = lab.moving(KINOVA, trajectory)
    master[0].kill()
    master[0].wait()
    done = child.end()
    assert done.status == 6
    assert "error[E602]" in done.err
    assert "Arm stopped" in done.err
    assert "the arm stands still" in done.err
    assert len(log_of(lab)) > 80
    driver.send(signal.SIGKILL)


@pytest.fixture
def small_disk(tmp_path):
    """A folder on a disk with room for one second of messages."""
    folder = tmp_path / "small"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=256k", "none", folder], capture_output=True
    )
    if mounted.returncode:
        pytest.skip("a small disk cannot be mounted here (root only)")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


def test_a_full_disk_stops_the_arm_and_keeps_what_was_written(lab, plan, small_disk):
    trajectory = plan(KINOVA, 5.0)
    driver = lab.driver(KINOVA, "--pose", trajectory)
    done = lab.move(KINOVA, trajectory, "--out", small_disk)
    assert done.status == 6
    assert "error[E606]" in done.err
    assert "No space left" in done.err
    assert "Arm stopped" in done.err
    assert "the arm stands still" in done.err
    topic = "/j2s7s300_driver/out/joint_state"
    assert list_topics(small_disk / "log.bag")[topic].count > 40
    sent = lab.finish(driver)
    assert sent["commands"] < 400
