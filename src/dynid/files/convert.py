"""Logs as .npz and .csv, and a replay as MCAP: every number as it was recorded; files are complete or not written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Floats
from dynid.disk import written_whole
from dynid.errors import WrongUsage
from dynid.log import COLUMNS, Log
from dynid.text import column
from dynid.version import __version__

STATE, TEXT = "sensor_msgs/msg/JointState", "std_msgs/msg/String"
#: Viewers that join late are sent the description all the same.
LATCHED = """\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""


def write_log(log: Log, path: Path) -> Path:
    """Write a log in the format of a file's suffix.

    Raises:
        WrongUsage: the suffix is not known.
        CannotWrite: the file cannot be written.
    """
    if path.suffix == ".npz":
        return log.save(path)
    if path.suffix != ".csv":
        raise WrongUsage(
            f"'{path.name}' does not say what to write: .npz, .csv",
            fix="name a file like log.npz; rosbags-convert writes bags",
        )
    columns = _columns(log)
    with written_whole(path) as stream:
        stream.write(",".join(map(column, columns)).encode() + b"\n")
        for row in zip(*(values.tolist() for values in columns.values()), strict=True):
            stream.write(",".join(map(repr, row)).encode() + b"\n")
    return path


def _columns(log: Log) -> dict[str, Any]:
    """Return the columns of a table by name; those that are not a number throughout were never recorded."""
    joints = list(log.names) or [f"joint_{k + 1}" for k in range(log.n)]
    tables = {
        "i" if kind == "tau" and log.tau_unit == "A" else kind: values
        for kind, values in log.columns.items()
        if COLUMNS[kind] and np.isfinite(values).any()
    }
    columns = {"t": log.t}
    for key, values in (tables | log.further()).items():
        table = values.reshape(len(log), -1)
        names = joints if values.shape == log.q.shape else range(table.shape[1])
        for k, name in enumerate(names):
            columns[key if values.ndim == 1 else f"{key}_{name}"] = table[:, k]
    return columns


# ---------------------------------------------------------------- a replay
class JointStates(NamedTuple):
    """Motion and torques at some instants.

    Attributes:
        q: positions, (M, n) [rad or m].
        qd: velocities, (M, n) [rad/s or m/s].
        tau: torques, (M, n) [N m or N]; not a number where there is none.
    """

    q: Floats
    qd: Floats
    tau: Floats


def write_replay(
    path: Path,
    stamps: NDArray[np.int64],
    names: Sequence[str],
    topics: Mapping[str, JointStates],
    urdf: str,
) -> Path:
    """Write joint states on several topics as MCAP, and the arm's URDF on ``/robot_description`` and as an attachment.

    Args:
        path: the file.
        stamps: time of each instant, (M,) [ns since 1970].
        names: names of the joints, which are those of the URDF.
        topics: joint states by topic.
        urdf: text of the URDF.

    Raises:
        CannotWrite: the file cannot be written.
    """
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    State, Header = store.types[STATE], store.types["std_msgs/msg/Header"]
    Time = store.types["builtin_interfaces/msg/Time"]
    times = stamps.tolist()
    first = times[0] if times else 0
    with written_whole(path) as stream:
        writer: Any = Writer(stream)
        writer.start(profile="ros2", library=f"dynid {__version__}")
        schemas = {
            kind: writer.register_schema(
                kind, "ros2msg", str(store.generate_msgdef(kind, ros_version=2)[0]).encode()
            )
            for kind in (STATE, TEXT)
        }

        def channel(topic: str, kind: str, qos: str = "") -> int:
            return int(
                writer.register_channel(topic, "cdr", schemas[kind], {"offered_qos_profiles": qos})
            )

        writer.add_attachment(first, first, "robot.urdf", "application/xml", urdf.encode())
        description = bytes(store.serialize_cdr(store.types[TEXT](urdf), TEXT))
        writer.add_message(channel("/robot_description", TEXT, LATCHED), first, description, first)
        rows = [
            (channel(topic, STATE), [np.ascontiguousarray(part) for part in states])
            for topic, states in topics.items()
        ]
        for i, stamp in enumerate(times):
            header = Header(Time(*divmod(stamp, 10**9)), "")
            for number, columns in rows:
                message = State(header, list(names), *(x[i] for x in columns))
                writer.add_message(number, stamp, bytes(store.serialize_cdr(message, STATE)), stamp)
        writer.finish()
    return path
