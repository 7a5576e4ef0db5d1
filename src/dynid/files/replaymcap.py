"""Measured, predicted and residual motion and torques of an arm as an MCAP file for Foxglove, PlotJuggler and Rerun."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import CannotWrite
from dynid.npz import put_in_place
from dynid.scratch import scratch_folder
from dynid.version import __version__

Floats = NDArray[np.float64]

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
STATE, TEXT = "sensor_msgs/msg/JointState", "std_msgs/msg/String"


@dataclass(frozen=True)
class JointStates:
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
    path: Path, stamps: NDArray[np.int64], names: Sequence[str], topics: Mapping[str, JointStates], urdf: str
) -> Path:
    """Write joint states on several topics, and the arm's URDF on ``/robot_description`` and as an attachment.

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
    State, Header, Time = (store.types[kind] for kind in (STATE, "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    times = stamps.tolist()
    first = times[0] if times else 0

    def channel(writer: Any, topic: str, kind: str, schema: int, qos: str = "") -> int:  # noqa: ANN401
        return int(writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": qos}))

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with scratch_folder(path.parent) as folder:
            part = folder / path.name
            with part.open("wb") as stream:
                writer: Any = Writer(stream)
                writer.start(profile="ros2", library=f"dynid {__version__}")
                schemas = {
                    kind: writer.register_schema(kind, "ros2msg", _definition(store, kind)) for kind in (STATE, TEXT)
                }
                writer.add_attachment(first, first, "robot.urdf", "application/xml", urdf.encode())
                description = channel(writer, "/robot_description", TEXT, schemas[TEXT], LATCHED)
                said = store.types[TEXT](urdf)
                writer.add_message(description, first, bytes(store.serialize_cdr(said, TEXT)), first)
                rows = {topic: [np.ascontiguousarray(x) for x in (s.q, s.qd, s.tau)] for topic, s in topics.items()}
                channels = {topic: channel(writer, topic, STATE, schemas[STATE]) for topic in topics}
                for i, stamp in enumerate(times):
                    header = Header(Time(*divmod(stamp, 10**9)), "")
                    for topic, columns in rows.items():
                        message = State(header, list(names), *(x[i] for x in columns))
                        writer.add_message(channels[topic], stamp, bytes(store.serialize_cdr(message, STATE)), stamp)
                writer.finish()
            put_in_place(part, path)
    except OSError as error:
        raise CannotWrite(f"cannot write {path}: {error.strerror}", where=str(path)) from error
    return path


def _definition(store: Any, kind: str) -> bytes:  # noqa: ANN401
    """Return a message's definition as viewers read it."""
    return str(store.generate_msgdef(kind, ros_version=2)[0]).encode()
