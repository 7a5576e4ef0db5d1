"""Logs as .npz and .csv, and a replay as MCAP: every number as it was recorded; files are complete or not written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Floats
from dynid.disk import written_whole
from dynid.errors import WrongUsage
from dynid.log import Log
from dynid.text import column

STATE, TEXT = "sensor_msgs/msg/JointState", "std_msgs/msg/String"


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
    return write_columns(path, log.named_columns(" [{}]"))


def write_columns(path: Path, columns: Mapping[str, Floats]) -> Path:
    """Write a table of numbers, (N,) each, by the names of its columns."""
    with written_whole(path) as stream:
        stream.write(",".join(map(column, columns)).encode() + b"\n")
        for row in zip(*(values.tolist() for values in columns.values()), strict=True):
            stream.write(",".join(map(repr, row)).encode() + b"\n")
    return path


# ---------------------------------------------------------------- a replay
def write_replay(
    path: Path,
    stamps: NDArray[np.int64],
    names: Sequence[str],
    topics: Mapping[str, tuple[Floats, Floats, Floats]],
    urdf: str,
) -> Path:
    """Write joint states on several topics as MCAP, and the arm's URDF on ``/robot_description``.

    Args:
        path: the file.
        stamps: time of each instant, (M,) [ns since 1970].
        names: names of the joints, which are those of the URDF.
        topics: by topic positions [rad or m], velocities [rad/s or m/s] and torques [N m or N], (M, n) each; not a
            number where there is none.
        urdf: text of the URDF.

    Raises:
        CannotWrite: the file cannot be written.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    State, Header = store.types[STATE], store.types["std_msgs/msg/Header"]
    Time = store.types["builtin_interfaces/msg/Time"]
    times = stamps.tolist()
    with TemporaryDirectory() as folder:
        bag = Path(folder) / "replay"
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            description = writer.add_connection("/robot_description", TEXT, typestore=store)
            writer.write(description, times[0], store.serialize_cdr(store.types[TEXT](urdf), TEXT))
            rows = [
                (
                    writer.add_connection(topic, STATE, typestore=store),
                    [np.ascontiguousarray(part) for part in states],
                )
                for topic, states in topics.items()
            ]
            for i, stamp in enumerate(times):
                header = Header(Time(*divmod(stamp, 10**9)), "")
                for topic, columns in rows:
                    message = State(header, list(names), *(x[i] for x in columns))
                    writer.write(topic, stamp, store.serialize_cdr(message, STATE))
        (made,) = bag.glob("*.mcap")
        with written_whole(path) as stream:
            stream.write(made.read_bytes())
    return path
