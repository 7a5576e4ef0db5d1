"""Everything that can go wrong while the arm moves: the right exit status, the log kept, the arm stopped."""

import signal
import subprocess
import time

import pytest
from lab import ACTION, KINOVA, LWR, UR

from dynid.files.bags import read_bag
from runner import rows

PRESS = "use the physical stop button now"
#: How each arm is stopped; the third one by a goal that is cancelled.
STOPPED = {
    KINOVA: ("Arm stopped", "the arm stands still"),
    LWR: ("emergency_stop is pressed", "the arm stands still"),
    UR: ("the arm stands still",),
}


def sent_as(robot):
    """Return the words that send the motion as one goal where the arm takes goals."""
    return f"--command-topic {ACTION}" if robot == UR else ""


@pytest.mark.parametrize(
    ("robot", "fault", "code", "said"),
    rows("""
        kinova_gen2   | deaf@1       | E504 | Arm stopped
        kuka_lwr4plus | deaf@1       | E504 | emergency_stop is pressed
        kinova_gen2   | torque@1     | E508 | Arm stopped
        kinova_gen2   | silent@1     | E506 | Arm stopped
        kuka_lwr4plus | dies@1       | E506 | use the physical stop button now
        ur10          | deaf@0.5     | E504 | goal preempted
        ur10          | silent@0.5   | E506 | goal preempted
        ur10          | gives-up@0.5 | E509 | the controller says that the motion is aborted: a joint left its path
    """),
)
def test_a_fault_of_the_driver_stops_the_arm_and_keeps_the_log(lab, robot, fault, code, said):
    driver, trajectory = lab.ready(robot, 4.0, fault)
    done = lab.move(robot, trajectory, sent_as(robot), "--max-deviation 0.1rad")
    err = done.failed(5, f"error[{code}]", said)
    assert (PRESS in err) == (said == PRESS)
    stops = "Arm stopped", "emergency_stop is pressed", "goal aborted", "goal preempted"
    assert any(stop in err for stop in stops) == (said != PRESS)
    assert ("goal aborted" in err) == (code == "E509")
    begin = float(fault.split("@")[1])
    assert begin - 0.1 < lab.log(robot).duration < 2.5 + 2.0 * begin
    assert lab.manifest(robot)["verdict"].startswith(f"aborted, {code}")
    if driver.running():
        sent = lab.finish(driver)
        assert sent["commands"] < 330 or robot == UR, "commands went on after the fault"
        assert not sent["violations"]


@pytest.mark.parametrize("robot", [KINOVA, UR])
def test_a_stop_that_fails_is_said(lab, robot):
    # Why: the arm goes deaf and the stop is tried once before the motion, so it fails from the first command on.
    driver, trajectory = lab.ready(robot, 4.0, "stop-fails")
    child = lab.moving(robot, trajectory, sent_as(robot))
    child.send(signal.SIGINT)
    child.end().failed(130, PRESS, *["FAILED"] * (robot == KINOVA))
    sent = lab.finish(driver)
    assert sent["commands"] < 300 if robot == KINOVA else sent["violations"] == []


@pytest.mark.parametrize("robot", [KINOVA, LWR])
def test_a_driver_without_a_stop_is_not_moved(lab, robot):
    driver, trajectory = lab.ready(robot, 3.0, "no-stop")
    lab.move(robot, trajectory).failed(6, "error[E607]")
    assert lab.finish(driver)["commands"] == 0


@pytest.mark.parametrize(
    ("robot", "number"), [(KINOVA, signal.SIGINT), (LWR, signal.SIGTERM), (UR, signal.SIGINT)]
)
def test_a_signal_stops_the_arm_first_and_keeps_the_log(lab, robot, number):
    driver, trajectory = lab.ready(robot, 5.0)
    child = lab.moving(robot, trajectory, sent_as(robot))
    child.send(number)
    child.send(number)
    child.end().failed(130, *STOPPED[robot])
    assert lab.manifest(robot)["verdict"] == "stopped by the operator"
    assert len(lab.log(robot)) > 80
    sent = lab.finish(driver)
    assert sent["violations"] == [], "the last command before the stop keeps the limits"
    if robot != UR:
        assert sent["commands"] < 300, "of the 500 of the motion"


def test_a_killed_recorder_leaves_a_bag_of_which_99_percent_are_read(lab):
    driver, trajectory = lab.ready(LWR, 6.0, "", "--rate 200")
    child = lab.moving(LWR, trajectory)
    time.sleep(3.0)
    killed = time.time()
    child.send(signal.SIGKILL)
    child.end()
    log = lab.log(LWR)
    assert log.findings[0].code == "W305"
    first, last = (ns * 1e-9 for ns in log.extra["arrival_ns"])
    assert killed - last < 0.01 * (killed - first), "what came last is not in the file"
    assert len(log) >= 0.99 * 200 * (killed - first)
    assert lab.manifest(LWR)["verdict"] == "running"
    assert lab.finish(driver)["commands"] < 520


def test_a_master_that_dies_ends_the_motion_through_the_open_stop(lab, master):
    driver, trajectory = lab.ready(KINOVA, 6.0)
    child = lab.moving(KINOVA, trajectory)
    master[0].kill()
    master[0].wait()
    child.end().failed(6, "error[E602]", *STOPPED[KINOVA])
    assert len(lab.log(KINOVA)) > 80
    driver.send(signal.SIGKILL)


@pytest.fixture
def small_disk(tmp_path):
    """A folder on a disk with room for one second of messages."""
    folder = tmp_path / "small"
    folder.mkdir()
    mount = f"mount -t tmpfs -o size=256k none '{folder}'"
    if subprocess.run(mount, shell=True, capture_output=True).returncode:
        pytest.skip("a small disk cannot be mounted here (root only)")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


def test_a_full_disk_stops_the_arm_and_keeps_what_was_written(lab, small_disk):
    driver, trajectory = lab.ready(KINOVA, 5.0)
    done = lab.move(KINOVA, trajectory, "--out", small_disk)
    done.failed(6, "error[E606]", "No space left", *STOPPED[KINOVA])
    topic = "/j2s7s300_driver/out/joint_state"
    assert read_bag(small_disk / "log.bag").topics[topic].count > 40
    assert lab.finish(driver)["commands"] < 400
