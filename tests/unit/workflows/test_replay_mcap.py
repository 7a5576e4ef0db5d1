"""What ``dynid validate --mcap`` writes is read by other libraries, with numbers, stamps and the arm itself in it."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from mcap.reader import make_reader
from numpy.testing import assert_allclose, assert_array_equal
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

import twolink
from dynid import validate
from dynid.workflows.validate import urdf_of

KINDS, NAMES = ("measured", "predicted", "residual"), ["shoulder", "elbow"]


@pytest.fixture(scope="module")
def replay(result, tmp_path_factory):
    found = validate(result, twolink.log(2))
    path = tmp_path_factory.mktemp("replay") / "replay.mcap"
    return found, found.save_mcap(path, urdf_of(result))


def test_mcap_reads_the_topics(replay):
    found, path = replay
    with path.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
    counts = {
        summary.channels[k].topic: n for k, n in summary.statistics.channel_message_counts.items()
    }
    states = dict.fromkeys((f"/{kind}/joint_states" for kind in KINDS), len(found.motion.t))
    assert counts == {"/robot_description": 1, **states}


def test_rosbags_reads_the_numbers_and_the_description(replay):
    found, path = replay
    motion, rows = found.motion, {kind: [] for kind in KINDS}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, stamp, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            if connection.topic == "/robot_description":
                urdf = ET.fromstring(message.data)
                assert [joint.get("name") for joint in urdf.findall("joint")] == NAMES
                continue
            assert message.name == NAMES
            assert stamp == message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            rows[connection.topic.split("/")[1]].append((stamp, message.position, message.effort))
    for kind, tau in (("measured", motion.tau_measured), ("predicted", motion.tau_estimated)):
        stamps, q, effort = (np.array(each) for each in zip(*rows[kind], strict=True))
        assert_allclose((stamps - stamps[0]) / 1e9, motion.t - motion.t[0], atol=2e-9)
        assert_array_equal(effort[motion.usable], tau[motion.usable])
        assert_array_equal(q, getattr(motion, {"measured": "q_measured"}.get(kind, "q_estimated")))
    residual = np.array([row[2] for row in rows["residual"]])[motion.usable]
    assert_array_equal(residual, (motion.tau_measured - motion.tau_estimated)[motion.usable])
    assert residual.std() < 0.02  # the noise of the log before the filter [N m]
