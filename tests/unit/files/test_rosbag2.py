"""The same joint states give the same log, whatever they were recorded in; damaged recordings give what is readable."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dynid.errors import BagTruncated, DynidError, WrongMessageType
from dynid.files.logs import read_log
from dynid.signals.columns import take_samples
from makelogs import joint_state, lwr, lwr_log
from makelogs import write_bag as write_ros1
from recordings import (
    of_ros2,
    ros1_array,
    ros2_array,
    ros2_state,
    single,
    stamps,
    write_bag,
    write_mcap,
    write_rosbag2,
    write_text,
)

TOPIC = "/lwr/joint_states"
FORMATS = {
    "rosbag2 with SQLite": lambda log, at: write_rosbag2(at / "bag", of_ros2(log, TOPIC)),
    "rosbag2 with MCAP": lambda log, at: write_rosbag2(at / "bag", of_ros2(log, TOPIC), "mcap"),
    "packed MCAP": lambda log, at: write_rosbag2(
        at / "bag", of_ros2(log, TOPIC), "mcap", compress="storage"
    ),
    "single .db3": lambda log, at: single(
        write_rosbag2(at / "bag", of_ros2(log, TOPIC)), at / "one.db3"
    ),
    "MCAP, zstd": lambda log, at: write_mcap(at / "a.mcap", of_ros2(log, TOPIC), "zstd"),
    "MCAP, lz4": lambda log, at: write_mcap(at / "a.mcap", of_ros2(log, TOPIC), "lz4"),
    "MCAP": lambda log, at: write_mcap(at / "a.mcap", of_ros2(log, TOPIC)),
    "ROS 1 bag": lambda log, at: write_bag(at / "a.bag", log, TOPIC),
    "CSV": lambda log, at: write_text(at / "a.csv", log),
    "CSV, semicolons, decimal commas": lambda log, at: write_text(
        at / "a.csv", log, ";", True, "# of a lab\n"
    ),
    "CSV, header in a comment, ns": lambda log, at: write_text(
        at / "a.csv", log, ",", False, "# ", unit=1e9
    ),
    "TSV": lambda log, at: write_text(at / "a.tsv", log, "\t", True),
    "npz": lambda log, at: log.save(at / "a.npz"),
}


@pytest.fixture(scope="module")
def log():
    some = take_samples(lwr_log(), np.arange(600))
    return replace(some, t=np.arange(600) * 0.005, qd=None, findings=(), extra={})


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_gives_the_same_numbers(kind, log, tmp_path):
    found = read_log(FORMATS[kind](log, tmp_path), robot=lwr())
    assert_allclose(found.t, log.t, rtol=0, atol=1e-15)
    assert_array_equal(found.q, log.q)
    assert_array_equal(found.tau, log.tau)
    assert set(lwr().log_names) <= set(found.names)
    assert len(found.sha256) == 64


@pytest.mark.parametrize("kind", ["ROS 2", "Float64MultiArray", "JointState"])
def test_torques_of_their_own_topic_are_taken_at_the_time_of_the_positions(kind, log, tmp_path):
    ros2, later, messages = kind == "ROS 2", 1_000_000, []
    for ns, q, tau in zip(stamps(log), log.q, log.tau, strict=True):
        state, array = (ros2_state, ros2_array) if ros2 else (joint_state, ros1_array)
        names, turned = log.names[::-1], tau[::-1].copy()
        torque = joint_state(ns + later, names, (), (), turned) if "State" in kind else array(tau)
        messages += [(TOPIC, ns, state(ns, log.names, q)), ("/tau", ns + later, torque)]
    path = (write_rosbag2 if ros2 else write_ros1)(
        tmp_path / ("bag" if ros2 else "a.bag"), messages
    )
    robot = replace(lwr(), driver=replace(lwr().driver, effort_topic="/tau", joint_names=log.names))
    found = read_log(path, robot=robot)
    between = np.stack([np.interp(log.t, log.t + 1e-3, tau) for tau in log.tau.T], axis=1)
    some = slice(1, len(found))
    assert_array_equal(found.q, log.q[-len(found) :])
    assert_allclose(
        found.tau[some], between[-len(found) :][some], atol=1e-6 * np.abs(log.tau).max()
    )
    elsewhere = replace(robot, driver=replace(robot.driver, effort_topic="/nowhere"))
    with pytest.raises(WrongMessageType, match="/nowhere, is not there"):
        read_log(path, robot=elsewhere)


@pytest.mark.parametrize("kind", ["single .db3", "MCAP"])
def test_a_cut_recording_of_ros2_says_how_to_recover_it(kind, log, tmp_path):
    path = FORMATS[kind](log, tmp_path)
    path.write_bytes(path.read_bytes()[: int(0.6 * path.stat().st_size)])
    with pytest.raises(BagTruncated, match="ends early") as caught:
        read_log(path, robot=lwr())
    assert "recover" in caught.value.fix


def test_messages_that_wait_in_a_journal_are_not_left_out_silently(log, tmp_path):
    path = FORMATS["single .db3"](log, tmp_path)
    path.with_name("one.db3-wal").write_bytes(b"messages")
    with pytest.raises(BagTruncated, match=r"one\.db3-wal"):
        read_log(path, robot=lwr())


def test_a_folder_without_metadata_or_with_a_wrong_one_is_read_by_its_files(log, tmp_path):
    bag = FORMATS["rosbag2 with SQLite"](log, tmp_path)
    for text in (
        None,
        "",
        "{",
        "rosbag2_bagfile_information: {relative_file_paths: [gone.db3], version: 5}",
    ):
        (bag / "metadata.yaml").unlink(missing_ok=True)
        if text is not None:
            (bag / "metadata.yaml").write_text(text)
        assert_array_equal(read_log(bag, robot=lwr()).q, log.q)


@pytest.mark.parametrize("store", ["sqlite3", "mcap"])
def test_a_recording_that_was_split_is_read_in_the_order_of_its_parts(store, log, tmp_path):
    """The recorder begins a new file every so many bytes; the eleventh follows the tenth, not the first."""
    suffix = ".mcap" if store == "mcap" else ".db3"
    (tmp_path / "bag").mkdir()
    for k in range(12):
        part = take_samples(log, np.arange(50 * k, 50 * k + 50))
        one = write_rosbag2(tmp_path / f"part{k}", of_ros2(part, TOPIC), store)
        next(one.glob(f"*{suffix}")).rename(tmp_path / "bag" / f"drive_{k}{suffix}")
    found = read_log(tmp_path / "bag", robot=lwr())
    assert_allclose(found.t, log.t, rtol=0, atol=1e-15)
    assert_array_equal(found.tau, log.tau)


def test_joints_that_change_places_within_a_recording_keep_their_names(log, tmp_path):
    """Messages of one length that differ in more than their numbers are not decoded together."""
    messages = of_ros2(log, TOPIC)
    turned = of_ros2(
        replace(log, names=log.names[::-1], q=log.q[:, ::-1].copy(), tau=log.tau[:, ::-1].copy()),
        TOPIC,
    )
    mixed = [
        b if 100 <= k < 200 or k % 7 == 0 else a
        for k, (a, b) in enumerate(zip(messages, turned, strict=True))
    ]
    found = read_log(write_mcap(tmp_path / "a.mcap", mixed), robot=lwr())
    places = [found.names.index(name) for name in log.names]
    assert_array_equal(found.q[:, places], log.q)
    assert_array_equal(found.tau[:, places], log.tau)


def test_a_folder_whose_files_are_gone_is_an_error(log, tmp_path):
    bag = FORMATS["rosbag2 with SQLite"](log, tmp_path)
    for part in bag.glob("*.db3"):
        part.unlink()
    with pytest.raises(DynidError, match=r"no \.db3 or \.mcap file"):
        read_log(bag, robot=lwr())


def test_a_topic_of_another_type_is_named_with_its_type(log, tmp_path):
    numbers = [(TOPIC, ns, ros2_array(tau)) for ns, tau in zip(stamps(log), log.tau, strict=True)]
    with pytest.raises(WrongMessageType, match="std_msgs/Float64MultiArray"):
        read_log(write_rosbag2(tmp_path / "bag", numbers), robot=lwr())
