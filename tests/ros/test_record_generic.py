"""An arm with a joint_trajectory_controller: streamed points, or one goal of its FollowJointTrajectory action."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
import yaml

from dynid.drivers.follow_joint_trajectory import (
    CANCEL,
    GOAL,
    RESULT,
    STATUS,
    action_message,
    choose_commands,
)
from dynid.files.bags import list_topics
from dynid.files.logs import read_log
from dynid.files.robotfile import load_robot

UR = "ur10"
CONTROLLER = "/joint_trajectory_controller"
ACTION = f"{CONTROLLER}/follow_joint_trajectory"
TOPIC = f"{CONTROLLER}/command"
POINTS = "trajectory_msgs/JointTrajectory"


def test_the_messages_of_the_action_are_those_of_ros():
    # Source: the MD5 sums that control_msgs 1.5 and actionlib_msgs 1.13 announce when nodes connect.
    published = {
        GOAL: "cff5c1d533bf2f82dd0138d57f4304bb",
        RESULT: "c4fb3b000dc9da4fd99699380efcc5d9",
        STATUS: "8b2b82f13216d0a8ea88bd3af735e619",
        CANCEL: "302881f31927c1df708a2dbab0e80ee8",
    }
    assert {kind: action_message(kind)._md5sum for kind in published} == published


def test_classes_of_messages_leave_no_folder_when_the_program_is_killed(tmp_path):
    program = (
        "import os; from dynid.drivers.kinova_gen2 import kinova_message, kinova_service;"
        "kinova_message('JointVelocity'); kinova_service('Start'); os.kill(os.getpid(), 9)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], env=os.environ | {"TMPDIR": str(tmp_path)}
    )
    assert done.returncode == -signal.SIGKILL
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", [(), ("--command-topic", ACTION)])
def test_an_arm_with_a_trajectory_controller_is_moved_and_recorded(lab, plan, words):
    trajectory = plan(UR, 3.0)
    driver = lab.driver(UR, "--pose", trajectory)
    done = lab.move(UR, trajectory, *words, "--json")
    assert done.status == 0, done.err
    assert done.facts["lost"] == 0
    assert done.facts["largest_deviation_rad"] < 0.1
    assert done.facts["commands"] == 1 if words else done.facts["commands"] > 290
    sent = lab.finish(driver)
    assert sent["violations"] == []
    assert sent["reference_velocity_share"] <= 1
    out = lab.folder / "out" / UR
    log = read_log(out / "log.bag", robot=load_robot(UR))
    assert np.ptp(log.q, axis=0).min() > 0.14
    asked = f"{ACTION}/goal" if words else TOPIC
    assert asked in list_topics(out / "log.bag"), "what was sent is in the log too"
    assert yaml.safe_load((out / "manifest.yaml").read_text())["driver"]["command_topic"] == asked


@pytest.mark.parametrize(
    ("fault", "status", "said"),
    [
        (
            "gives-up@0.5",
            5,
            "error[E509] the controller says that the motion is aborted: a joint left its path",
        ),
        ("deaf@0.5", 5, "error[E504]"),
        ("silent@0.5", 5, "error[E506]"),
    ],
)
def test_a_goal_that_goes_wrong_is_cancelled(lab, plan, fault, status, said):
    trajectory = plan(UR, 4.0)
    driver = lab.driver(UR, "--pose", trajectory, "--fault", fault)
    done = lab.move(UR, trajectory, "--command-topic", ACTION, "--max-deviation", "0.1rad")
    assert (done.status, done.out) == (status, "")
    assert said in done.err
    assert ("goal aborted" if "gives-up" in fault else "goal preempted") in done.err
    log = read_log(lab.folder / "out" / UR / "log.bag", robot=load_robot(UR))
    assert 0.4 < log.duration < 3.5
    assert lab.finish(driver)["violations"] == []


def test_ctrl_c_cancels_the_goal_and_a_cancel_that_nobody_confirms_is_said(lab, plan):
    trajectory = plan(UR, 5.0)
    for fault, said in (
        ((), "the arm stands still"),
        (("--fault", "stop-fails"), "use the physical stop button now"),
    ):
        driver = lab.driver(UR, "--pose", trajectory, *fault)
        child = lab.moving(UR, trajectory, "--command-topic", ACTION, "--force")
        child.send(signal.SIGINT)
        done = child.end()
        assert done.status == 130
        assert said in done.err
        assert lab.finish(driver)["violations"] == []


def test_where_to_send_motions_is_found_and_doubt_is_said():
    types = {
        TOPIC: POINTS,
        f"{ACTION}/goal": GOAL,
        "/other/command": POINTS,
        "/joint_states": "sensor_msgs/JointState",
    }
    assert choose_commands(types, {TOPIC, f"{ACTION}/goal"}, None, TOPIC) == (TOPIC, False)
    assert choose_commands(types, {f"{ACTION}/goal"}, None, TOPIC) == (f"{ACTION}/goal", True)
    assert choose_commands(types, {"/other/command"}, None, TOPIC) == ("/other/command", False)
    assert choose_commands(types, set(types), ACTION, TOPIC) == (f"{ACTION}/goal", True)
    assert choose_commands(types, set(types), f"{ACTION}/goal", TOPIC) == (f"{ACTION}/goal", True)
    assert choose_commands(types, set(types), "/other/command", TOPIC) == ("/other/command", False)
    two = types | {"/third/command": POINTS}
    with pytest.raises(
        Exception, match="several topics take motions: /other/command, /third/command"
    ):
        choose_commands(two, {"/other/command", "/third/command"}, None, "/none")
