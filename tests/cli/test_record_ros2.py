"""The page "Record with ROS 2": what a plan writes is what ROS 2 takes, and what its recorder writes is read."""

import json

import numpy as np
import pinocchio as pin
import pytest
import yaml

from arms import pinocchio_torques
from dynid import Motion, load_robot
from dynid.files.trajectoryfile import write_joint_trajectory
from dynid.sim.urdf import urdf_text
from motions import tones
from recordings import ROS2 as HUMBLE
from recordings import ros2_state, write_rosbag2

ROBOT = load_robot("ur5e")
T = np.linspace(0, 12, 1201)
MOTION = Motion(T, *tones(T, np.full((1, 6), 0.5), np.array([[1.1, 1.7, 2.3, 2.9, 3.1, 3.7]])))
START = 1_760_000_000
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"


def as_message(found):
    """Return what a file holds as a message of ROS 2; a key that it lacks, or does not know, fails."""
    types = HUMBLE.types
    header, duration = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Duration"]
    time, point = (
        types["builtin_interfaces/msg/Time"],
        types["trajectory_msgs/msg/JointTrajectoryPoint"],
    )
    points = []
    for given in found.pop("points"):
        after = duration(**given.pop("time_from_start"))
        arrays = {key: np.array(values, float) for key, values in given.items()}
        points.append(point(**arrays, time_from_start=after))
    head = found.pop("header")
    head = header(**head | {"stamp": time(**head["stamp"])})
    return types[TRAJECTORY](**found, header=head, points=points)


@pytest.mark.parametrize("goal", [False, True])
def test_a_plan_is_a_joint_trajectory_of_ros_2(goal, tmp_path):
    write_joint_trajectory(tmp_path / "t.yaml", ROBOT, MOTION, ros=2, goal=goal)
    found = yaml.load((tmp_path / "t.yaml").read_text(), Loader=yaml.CSafeLoader)
    if goal:
        (found,) = found.values()
    written = HUMBLE.serialize_cdr(as_message(found), TRAJECTORY)
    message = HUMBLE.deserialize_cdr(written, TRAJECTORY)
    assert message.joint_names == list(ROBOT.log_names)
    times = [point.time_from_start for point in message.points]
    assert np.allclose([time.sec + 1e-9 * time.nanosec for time in times], T, atol=1e-9)
    assert np.allclose([point.positions for point in message.points], MOTION.q, atol=1e-8)


def recorded(folder, storage, compress="none"):
    """Write what ``ros2 bag record`` leaves: a folder with metadata.yaml, by a library that is not dynid's."""
    arm, qd = pin.buildModelFromXML(urdf_text(ROBOT)), MOTION.qd
    tau = pinocchio_torques(arm, MOTION.q, qd, MOTION.qdd) + 2 * qd
    tau += np.random.default_rng(0).normal(0, 0.2, qd.shape)
    messages = []
    for t, q, effort in zip(T, MOTION.q, tau, strict=True):
        ns = START * 10**9 + round(t * 1e9)
        message = ros2_state(ns, ROBOT.log_names, q, np.zeros(6), effort)
        messages.append(("/joint_states", ns, message))
    return write_rosbag2(folder, messages, storage, compress)


@pytest.mark.slow
@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_recording_of_ros_2_is_checked_and_identified(storage, dynid):
    recorded(dynid.folder / "recording", storage)
    assert (dynid.folder / "recording" / "metadata.yaml").is_file()
    assert dynid("check recording --robot ur5e --json").facts["schema"] == "dynid/check/1"
    found = dynid("identify ur5e recording --no-input --no-report --json").facts
    assert found["relative_error_percent"] < 5


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_messages_that_were_packed_one_by_one_are_told(storage, dynid):
    recorded(dynid.folder / "recording", storage, "message")
    for words in ("--robot ur5e", ""):
        said = "are compressed one by one"
        dynid(f"check recording {words}").failed(3, "error[E304] messages of", said)


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_recording_without_joint_states_is_not_usable(storage, dynid):
    hello = HUMBLE.types["std_msgs/msg/String"]("hello")
    messages = [("/chatter", 10**9 * k, hello) for k in range(20)]
    write_rosbag2(dynid.folder / "recording", messages, storage)
    answer = json.loads(dynid("check recording --json").out)
    assert not answer["usable"]
    assert [finding["code"] for finding in answer["findings"]] == ["W333"]
    assert "not usable: no joint states" in dynid("check recording").out


def test_import_says_that_it_does_not_know_what_the_effort_column_is(dynid):
    (dynid.folder / "arm.urdf").write_text(urdf_text(ROBOT))
    done = dynid("import arm.urdf --out made")
    assert "does not say what the effort column" in done.out, done.err
    made = (dynid.folder / "made" / "arm.yaml").read_text()
    assert "# torque: {source: motor_torque}" in made
    assert "torque" not in yaml.safe_load(made)
