"""The reader is chosen by the kind of file; topics and drivers' traps are named."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dynid import load_robot
from dynid.errors import TopicMissing, WrongMessageType
from dynid.files.logs import read_log
from makelogs import (
    KINOVA,
    ROOT,
    START,
    gen2,
    joint_state,
    kinova,
    lwr,
    shared_data,
    state_messages,
    write_bag,
)


def test_kinovas_angles_are_refused_where_joint_states_are_recorded(tmp_path):
    driver = "/j2s7s300_driver/out"
    angles = [
        (f"{driver}/joint_angles", START + i, kinova(KINOVA[0], [180.0] * 7)) for i in range(9)
    ]
    path = write_bag(
        tmp_path / "log.bag",
        angles + state_messages(9, gen2().joint_names, f"{driver}/joint_state"),
    )
    with pytest.raises(
        WrongMessageType, match=r"kinova_msgs/JointAngles \(degrees, no time stamp\); use"
    ) as caught:
        read_log(path, robot=gen2(), topic=f"{driver}/joint_angles")
    assert caught.value.fix == f"--topic {driver}/joint_state"


@pytest.mark.parametrize("topic", ["/a/out/joint_state", "/odd"])
def test_the_only_topic_of_an_arm_without_driver_needs_no_name(topic, tmp_path):
    path = write_bag(tmp_path / "log.bag", state_messages(20, gen2().joint_names, topic))
    assert read_log(path, robot=replace(gen2(), driver=None)).topic == topic


def test_a_bag_without_joint_states_lists_what_it_has(tmp_path):
    other = [("/tf", START + i, kinova(KINOVA[0], [1.0] * 7)) for i in range(9)]
    with pytest.raises(TopicMissing, match=r"it has /tf \(JointAngles\)"):
        read_log(write_bag(tmp_path / "log.bag", other), robot=lwr())


def test_two_possible_topics_are_not_guessed_between(tmp_path):
    both = state_messages(20, ("a",), "/left/states") + state_messages(30, ("b",), "/right/states")
    robot = replace(lwr(), driver=None)
    with pytest.raises(TopicMissing, match="several joint state topics"):
        read_log(write_bag(tmp_path / "log.bag", both), robot=robot)


def test_messages_without_effort_are_refused(tmp_path):
    messages = [
        ("/lwr/joint_states", START + i, joint_state(START + i, lwr().joint_names, range(7)))
        for i in range(30)
    ]
    with pytest.raises(WrongMessageType, match="no effort"):
        read_log(write_bag(tmp_path / "log.bag", messages), robot=lwr())


def test_calendar_stamps_of_a_csv_are_counted_from_the_first_sample(tmp_path):
    rows = "\n".join(f"{1.46e9 + 0.25 * i},{i},{i}" for i in range(5))
    (tmp_path / "log.csv").write_text(f"t,q_a,tau_a\n{rows}\n")
    log = read_log(tmp_path / "log.csv", robot=lwr())
    assert_allclose(log.t, 0.25 * np.arange(5))


@pytest.mark.data
def test_the_recorded_lwr4plus_has_5027_samples_at_200_hz_without_velocity():
    log = read_log(shared_data("kuka_lwr4plus/run1.bag"), robot=lwr())
    assert (len(log), log.qd) == (5027, None)
    assert log.rate == pytest.approx(200, rel=1e-3)
    assert log.duration == pytest.approx(25.13, abs=0.01)


@pytest.mark.data
def test_the_recorded_jaco2_equals_the_arrays_that_were_published_with_it():
    robot = load_robot(ROOT / "tests" / "robots" / "jaco2_6dof.yaml")
    log = read_log(shared_data("jaco2_6dof/example_traj_2017-05-31-17-12-04.bag"), robot=robot)
    published = np.load(shared_data("jaco2_6dof/example_traj.npz"))
    assert (len(log), len(log.names)) == (420, 9)
    columns = [log.names.index(name) for name in robot.log_names]
    assert_array_equal(log.q[:, columns], published["q"])
    assert_allclose(log.tau[:, columns], published["tau"], rtol=1e-6)
    assert_allclose(log.t, published["t"], atol=1e-6)


@pytest.mark.parametrize("other", ["/joint_states", "/lwr/joint_states"])
def test_the_arm_is_read_where_another_device_talks_more_often(tmp_path, other):
    """On a topic that is not the robot's, or on the same one."""
    both = state_messages(20, lwr().joint_names, "/lwr/joint_states")
    both = sorted(both + state_messages(60, ("f",), other), key=lambda item: item[1])
    log = read_log(write_bag(tmp_path / "log.bag", both), robot=lwr())
    assert (log.topic, len(log)) == ("/lwr/joint_states", 20)
