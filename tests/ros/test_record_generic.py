"""An arm with a joint_trajectory_controller: streamed points, or one goal of its FollowJointTrajectory action."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from lab import ACTION, CONTROLLER, UR

from dynid.drivers.follow_joint_trajectory import (
    CANCEL,
    GOAL,
    RESULT,
    STATUS,
    action_message,
    choose_commands,
)
from dynid.files.bags import read_bag

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
    env = os.environ | {"TMPDIR": str(tmp_path)}
    assert subprocess.run([sys.executable, "-c", program], env=env).returncode == -signal.SIGKILL
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", ["", f"--command-topic {ACTION}"])
def test_an_arm_with_a_trajectory_controller_is_moved_and_recorded(lab, words):
    driver, trajectory = lab.ready(UR)
    facts = lab.move(UR, trajectory, words, "--json").facts
    assert facts["lost"] == 0
    assert facts["largest_deviation_rad"] < 0.1
    assert facts["commands"] == 1 if words else facts["commands"] > 290
    sent = lab.finish(driver)
    assert sent["violations"] == []
    assert np.ptp(lab.log(UR).q, axis=0).min() > 0.14
    topic = f"{ACTION}/goal" if words else TOPIC
    bag = lab.folder / "out" / UR / "log.bag"
    assert topic in read_bag(bag).topics, "what was sent is in the log too"
    assert lab.manifest(UR)["driver"]["command_topic"] == topic


def test_where_to_send_motions_is_found_and_doubt_is_said():
    goal, other, third = f"{ACTION}/goal", "/other/command", "/third/command"
    types = {TOPIC: POINTS, goal: GOAL, other: POINTS, "/joint_states": "sensor_msgs/JointState"}
    for heard, asked, found in (
        ({TOPIC, goal}, None, (TOPIC, False)),
        ({goal}, None, (goal, True)),
        ({other}, None, (other, False)),
        ({*types}, ACTION, (goal, True)),
        ({*types}, goal, (goal, True)),
        ({*types}, other, (other, False)),
    ):
        assert choose_commands(types, heard, asked, TOPIC) == found
    with pytest.raises(Exception, match=f"several topics take motions: {other}, {third}"):
        choose_commands(types | {third: POINTS}, {other, third}, None, "/none")
