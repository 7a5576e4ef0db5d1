"""Recordings for tests: bags written with rosbags, and logs broken in one way each."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from dynid import load_robot
from dynid.files.logs import read_log

ROOT = Path(__file__).parents[1]
STORE = get_typestore(Stores.ROS1_NOETIC)
JOINT_STATE = "sensor_msgs/msg/JointState"
SEVEN_FLOATS = "\n".join(f"float32 joint{i}" for i in range(1, 8)) + "\n"
KINOVA = [f"kinova_msgs/msg/{name}" for name in ("JointAngles", "JointTorque", "JointVelocity")]
for _name in KINOVA:
    STORE.register(get_types_from_msg(SEVEN_FLOATS, _name))


def shared_data(name):
    """Return a real recording; skip where they are absent (CI makes that a failure, see conftest)."""
    path = ROOT.parent / "shared" / "data" / name
    if not path.exists():
        pytest.skip(f"the recordings are not here: {path}")
    return path


def joint_state(
    ns,
    names,
    position,
    velocity=(),
    effort=(),
    frame="",
    seq=0,
):
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
    header = types["std_msgs/msg/Header"](seq=seq, stamp=stamp, frame_id=frame)
    arrays = [np.asarray(values, dtype=float) for values in (position, velocity, effort)]
    return types[JOINT_STATE](header, list(names), *arrays)


def kinova(kind, values):
    padded = [*values, *([0.0] * (7 - len(values)))]
    return STORE.types[kind](*padded)


def write_bag(
    path,
    messages,
    compression="none",
    chunk=None,
    closing=True,
):
    """Write (topic, arrival [ns], message) as a bag; ``closing`` False leaves it as a killed recorder does."""
    writer = Writer(path)
    if chunk is not None:
        writer.chunk_threshold = chunk
    if compression == "bz2":
        writer.set_compression(Writer.CompressionFormat.BZ2)
    elif compression == "lz4":
        import lz4.frame

        writer.set_compression(Writer.CompressionFormat.LZ4)
    writer.open()
    if compression == "lz4":
        # Why: the linked blocks that rosbags writes are refused by ROS's own reader; a recorder writes these.
        writer.compressor = lambda data: lz4.frame.compress(
            data,
            block_linked=False,
            block_size=lz4.frame.BLOCKSIZE_MAX1MB,
            content_checksum=True,
            store_size=False,
        )
    connections = {}
    for topic, ns, message in messages:
        kind = message.__msgtype__
        if topic not in connections:
            connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
        writer.write(connections[topic], ns, STORE.serialize_ros1(message, kind))
    if closing:
        writer.close()
    else:
        writer.bio.close()
    return path


START = 1_460_000_000 * 10**9


def state_messages(
    n_messages,
    names,
    topic="/joint_states",
    rate=100.0,
    header=None,
):
    """JointStates whose numbers tell row and column: position row + column / 100, the others 10 and 100 times that."""
    found = []
    for i in range(n_messages):
        ns = START + round(i * 1e9 / rate)
        row = i + np.arange(len(names)) / 100.0
        stamp = header(i) if header else ns
        found.append((topic, ns, joint_state(stamp, names, row, 10 * row, 100 * row, seq=i)))
    return found


@cache
def lwr():
    return load_robot(ROOT / "robots" / "kuka_lwr4plus.yaml")


@cache
def gen2():
    return load_robot(ROOT / "robots" / "kinova_gen2.yaml")


@cache
def lwr_log():
    """The shipped simulation of the LWR4+ (20 s, 200 Hz), as it comes from the bag."""
    return read_log(ROOT / "trajectories" / "lwr4plus_validate.bag", robot=lwr())


@cache
def gen2_log():
    """The shipped simulation of the Gen2 (30 s, 100 Hz), with fingers and velocity."""
    return read_log(ROOT / "trajectories" / "kinova_gen2_validate.bag", robot=gen2())
