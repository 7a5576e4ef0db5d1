"""The same joint states in every container that people have, written with other people's libraries."""

from functools import partial

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from makelogs import joint_state
from makelogs import write_bag as write_ros1

ROS2 = get_typestore(Stores.ROS2_HUMBLE)
KIND = "sensor_msgs/msg/JointState"


def stamps(log, start=1_700_000_000_000_000_000):
    return (start + np.round(log.t * 1e9).astype(np.int64)).tolist()


def ros2_state(ns, names, q, qd=(), tau=()):
    types = ROS2.types
    header = types["std_msgs/msg/Header"](
        types["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9), "base"
    )
    return types[KIND](header, list(names), *(np.asarray(x, dtype=float) for x in (q, qd, tau)))


def cdr(message):
    return bytes(ROS2.serialize_cdr(message, message.__msgtype__))


def write_rosbag2(folder, messages, storage="sqlite3", compress="none"):
    """Write (topic, arrival [ns], message) as a folder of rosbag2; ``compress`` the ``storage`` or each ``message``."""
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin[storage.upper()])
    if compress != "none":
        writer.set_compression(CompressionMode[compress.upper()], CompressionFormat.ZSTD)
    connections = {}
    with writer:
        for topic, ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(
                    topic, message.__msgtype__, typestore=ROS2
                )
            writer.write(connections[topic], ns, cdr(message))
    return folder


def write_mcap(path, messages, compression="none"):
    """Write (topic, arrival [ns], message) with the mcap library."""
    from mcap.writer import CompressionType
    from mcap.writer import Writer as McapWriter

    with path.open("wb") as stream:
        writer = McapWriter(
            stream, chunk_size=1 << 16, compression=CompressionType[compression.upper()]
        )
        writer.start("ros2", "test")
        channels = {}
        for topic, ns, message in messages:
            name = message.__msgtype__
            if topic not in channels:
                text, _ = ROS2.generate_msgdef(name, ros_version=2)
                schema = writer.register_schema(name, "ros2msg", text.encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channels[topic], ns, cdr(message), ns)
        writer.finish()
    return path


def states_of(make, log, topic):
    return [
        (topic, ns, make(ns, log.names, q, (), tau))
        for ns, q, tau in zip(stamps(log), log.q, log.tau, strict=True)
    ]


of_ros1, of_ros2 = partial(states_of, joint_state), partial(states_of, ros2_state)


def write_bag(path, log, topic):
    return write_ros1(path, of_ros1(log, topic))
