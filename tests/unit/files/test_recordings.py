"""The same joint states give the same log, whatever they were recorded in; damaged recordings give what is readable."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dynid import LogOptions
from dynid.errors import BagTruncated, DynidError
from dynid.files.convert import write_log
from dynid.files.logs import read_log
from dynid.files.robotfile import parse_robot
from dynid.signals.columns import take_samples
from dynid.workflows.files import convert, inspected
from makelogs import lwr, lwr_log
from recordings import of_ros2, ros2_state, stamps, write_bag, write_mcap, write_rosbag2

TOPIC = "/lwr/joint_states"
FORMATS = {
    "rosbag2 with SQLite": lambda log, at: write_rosbag2(at / "bag", of_ros2(log, TOPIC)),
    "rosbag2 with MCAP": lambda log, at: write_rosbag2(at / "bag", of_ros2(log, TOPIC), "mcap"),
    "packed MCAP": lambda log, at: write_rosbag2(
        at / "bag", of_ros2(log, TOPIC), "mcap", compress="storage"
    ),
    "single .db3": lambda log, at: next(
        write_rosbag2(at / "bag", of_ros2(log, TOPIC)).glob("*.db3")
    ),
    "MCAP, zstd": lambda log, at: write_mcap(at / "a.mcap", of_ros2(log, TOPIC), "zstd"),
    "MCAP, lz4": lambda log, at: write_mcap(at / "a.mcap", of_ros2(log, TOPIC), "lz4"),
    "MCAP": lambda log, at: write_mcap(at / "a.mcap", of_ros2(log, TOPIC)),
    "ROS 1 bag": lambda log, at: write_bag(at / "a.bag", log, TOPIC),
    "npz": lambda log, at: log.save(at / "a.npz"),
    "converted to CSV": lambda log, at: convert(
        write_rosbag2(at / "bag", of_ros2(log, TOPIC)), at / "new.csv"
    ).wrote[0],
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


@pytest.mark.parametrize("kind", ["single .db3", "MCAP"])
def test_a_cut_recording_of_ros2_says_how_to_recover_it(kind, log, tmp_path):
    path = FORMATS[kind](log, tmp_path)
    path.write_bytes(path.read_bytes()[: int(0.6 * path.stat().st_size)])
    with pytest.raises(BagTruncated, match="ends early") as caught:
        read_log(path, robot=lwr())
    assert "recover" in caught.value.fix


def test_messages_that_wait_in_a_journal_are_not_left_out_silently(log, tmp_path):
    path = FORMATS["single .db3"](log, tmp_path)
    path.with_name(f"{path.name}-wal").write_bytes(b"messages")
    with pytest.raises(BagTruncated, match=r"\.db3-wal"):
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


def test_a_folder_whose_files_are_gone_is_an_error(log, tmp_path):
    bag = FORMATS["rosbag2 with SQLite"](log, tmp_path)
    for part in bag.glob("*.db3"):
        part.unlink()
    with pytest.raises(DynidError, match=r"no \.db3 or \.mcap file"):
        read_log(bag, robot=lwr())


# ---------------------------------------------------------------- converted, and told
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
        {"name": TOPIC, "type": "sensor_msgs/JointState", "messages": 600}
    ]
    (state,) = found.facts["joint_states"]
    assert state["rate_hz"] == pytest.approx(200.0)
    joints = "".join(f"  - {{name: j{k}}}\n" for k in range(7))
    text = f"name: x\nconvention: standard\njoints:\n{joints}{found.facts['snippet']}\n"
    robot = parse_robot(text, tmp_path / "x.yaml")
    assert robot.log_names == log.names
    assert robot.driver.topic == TOPIC


def test_joint_states_with_torques_go_before_commands_that_come_more_often(log, tmp_path):
    few = take_samples(log, np.arange(0, 600, 3))
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
