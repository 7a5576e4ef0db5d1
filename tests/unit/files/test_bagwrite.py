"""Bags written without ROS, read back by rosbags."""

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from dynid.errors import CannotWrite
from dynid.files.bagwrite import write_bag
from dynid.log import Log

LOG = Log(np.array([0.0, 0.01, 0.02]), np.arange(6.0).reshape(3, 2), np.ones((3, 2)), ("b", "a"))


def test_messages_come_back_as_they_were_written(tmp_path):
    """Names, positions, torques and stamps; velocity is empty where the log has none."""
    write_bag(LOG, tmp_path / "x.bag", "/arm/joint_states", start=7 * 10**9)
    with AnyReader([tmp_path / "x.bag"]) as reader:
        (channel,) = reader.connections
        rows = [(stamp, reader.deserialize(raw, channel.msgtype)) for _, stamp, raw in reader.messages()]
    assert (channel.topic, channel.msgtype) == ("/arm/joint_states", "sensor_msgs/msg/JointState")
    assert [stamp for stamp, _ in rows] == [7_000_000_000, 7_010_000_000, 7_020_000_000]
    message = rows[1][1]
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (7, 10_000_000)
    assert message.name == ["b", "a"]
    np.testing.assert_array_equal(message.position, [2.0, 3.0])
    np.testing.assert_array_equal(message.effort, [1.0, 1.0])
    assert len(message.velocity) == 0


def test_equal_logs_give_equal_bytes(tmp_path):
    """Also over an existing file."""
    for name in ("a", "b", "a"):
        write_bag(LOG, tmp_path / name / "x.bag", "/t")
    assert (tmp_path / "a/x.bag").read_bytes() == (tmp_path / "b/x.bag").read_bytes()
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["x.bag"]


def test_a_folder_that_is_a_file_is_named(tmp_path):
    """The message says which path could not be written."""
    (tmp_path / "file").write_text("")
    with pytest.raises(CannotWrite, match=r"file/x\.bag"):
        write_bag(LOG, tmp_path / "file" / "x.bag", "/t")
