"""What is converted is read again with the same numbers; a recording without a robot file tells what to paste."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dynid import LogOptions
from dynid.files.convert import write_log
from dynid.files.logs import read_log
from dynid.files.robotfile import parse_robot
from dynid.signals.columns import take_samples
from dynid.workflows.files import convert, inspected
from makelogs import lwr, lwr_log
from recordings import of_ros2, ros2_state, stamps, write_rosbag2

TOPIC = "/lwr/joint_states"


@pytest.fixture(scope="module")
def log():
    some = take_samples(lwr_log(), slice(300))
    return replace(some, t=np.arange(300) * 0.005, qd=None, findings=(), extra={})


def test_a_converted_recording_has_the_same_numbers(log, tmp_path):
    source = write_rosbag2(tmp_path / "bag", of_ros2(log, TOPIC))
    found = read_log(convert(source, tmp_path / "new.csv").wrote[0], robot=lwr())
    assert_allclose(found.t, log.t, rtol=0, atol=1e-15)
    assert_array_equal(found.q, log.q)
    assert_array_equal(found.tau, log.tau)


def test_names_that_break_a_table_are_written_out(log, tmp_path):
    names = ('a,b;c"d\te', "line\nbreak", "=1+1", "\u202ereordered", *log.names[4:])
    write_log(replace(log, names=names), tmp_path / "new.csv")
    lines = (tmp_path / "new.csv").read_text(encoding="utf-8").split("\n")
    assert len(lines) == len(log) + 2
    assert len({line.count(",") for line in lines[:-1]}) == 1
    assert lines[0].replace("\t", "").isprintable()


def test_a_recording_without_a_robot_tells_what_to_paste(log, tmp_path):
    found = inspected(write_rosbag2(tmp_path / "bag", of_ros2(log, TOPIC)), LogOptions())
    assert found.facts["topics"] == [
        {"name": TOPIC, "type": "sensor_msgs/JointState", "messages": 300}
    ]
    (state,) = found.facts["joint_states"]
    assert state["rate_hz"] == pytest.approx(200.0)
    joints = "".join(f"  - {{name: j{k}}}\n" for k in range(7))
    text = f"name: x\nconvention: standard\njoints:\n{joints}{found.facts['snippet']}\n"
    robot = parse_robot(text, tmp_path / "x.yaml")
    assert robot.log_names == log.names
    assert robot.driver.topic == TOPIC


def test_joint_states_with_torques_go_before_commands_that_come_more_often(log, tmp_path):
    few = take_samples(log, np.arange(0, 300, 3))
    commands = [
        ("/commands", ns, ros2_state(ns, log.names, q))
        for ns, q in zip(stamps(log), log.q, strict=True)
    ]
    messages = sorted([*of_ros2(few, TOPIC), *commands], key=lambda entry: entry[1])
    found = inspected(write_rosbag2(tmp_path / "bag", messages), LogOptions())
    assert f"topic: {TOPIC}" in found.facts["snippet"]
    assert ["no torques" in text for label, text in found.description if label == "units"] == [
        False,
        True,
    ]
