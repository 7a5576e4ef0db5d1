"""A log as a ROS 1 bag of sensor_msgs/JointState, without ROS. Equal logs give equal bytes."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from dynid.errors import CannotWrite
from dynid.log import Log


def write_bag(log: Log, path: Path, topic: str, start: int = 0) -> None:
    """Write a log as a bz2-compressed bag; each message is stored at the time of its stamp.

    Args:
        log: the columns to publish, in their order.
        path: the file; an existing one is replaced.
        topic: topic of the messages.
        start: what ``log.t`` counts from, in ns since 1970.
    """
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kinds = ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    State, Header, Time = (store.types[kind] for kind in kinds)
    stamps = start + np.round(log.t * 1e9).astype(np.int64)
    speeds = np.empty((len(log), 0)) if log.qd is None else log.qd
    q, qd, tau = (np.ascontiguousarray(part, dtype=float) for part in (log.q, speeds, log.tau))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            temporary = Path(folder) / path.name
            writer = Writer(temporary)
            writer.set_compression(Writer.CompressionFormat.BZ2)
            with writer:
                channel = writer.add_connection(topic, State.__msgtype__, typestore=store)
                for i, stamp in enumerate(stamps.tolist()):
                    header = Header(i, Time(*divmod(stamp, 10**9)), "")
                    message = State(header, list(log.names), q[i], qd[i], tau[i])
                    writer.write(channel, stamp, bytes(store.serialize_ros1(message, State.__msgtype__)))
            temporary.replace(path)
    except OSError as error:
        raise CannotWrite(f"cannot write {path}: {error.strerror}", where=str(path)) from error
