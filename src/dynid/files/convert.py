"""Logs and motions in the containers of other programs: every number as it was recorded, whole, or not at all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import CannotWrite, LogLayout, WrongUsage
from dynid.log import COLUMNS, Log
from dynid.npz import put_in_place
from dynid.scratch import scratch_folder
from dynid.text import column
from dynid.version import __version__

Floats = NDArray[np.float64]

TOPIC = "/joint_states"
STATE, TEXT = "sensor_msgs/msg/JointState", "std_msgs/msg/String"
#: Seconds since 1970 that the stamps of messages end with, in 2038.
LAST_STAMP = 2**31
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
        PackageMissing: Parquet without pyarrow.
    """
    if path.suffix not in WRITERS:
        raise WrongUsage(
            f"'{path.name}' does not say what to write: {', '.join(WRITERS)}",
            fix="name a file like log.mcap",
        )
    with _written_whole(path) as part:
        WRITERS[path.suffix](log, part)
    return path


@contextmanager
def _written_whole(path: Path) -> Iterator[Path]:
    """Give the place of a temporary file that takes the name of ``path`` when the block ends without an error."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with scratch_folder(path.parent) as folder:
            yield folder / path.name
            put_in_place(folder / path.name, path)
    except OSError as error:
        raise CannotWrite(f"cannot write {path}: {error.strerror}", where=str(path)) from error


def _names(log: Log) -> list[str]:
    return list(log.names) or [f"joint_{k + 1}" for k in range(log.n)]


# ---------------------------------------------------------------- tables
def _columns(log: Log) -> dict[str, Any]:
    """Return the columns of a table by name; those that are not a number throughout were never recorded."""
    word = {"tau": "i"} if log.tau_unit == "A" else {}
    found = {"t": log.t} | {
        f"{word.get(kind, kind)}_{name}": values[:, k]
        for kind, values in log.columns.items()
        if COLUMNS[kind] and np.isfinite(values).any()
        for k, name in enumerate(_names(log))
    }
    for key, values in log.further().items():
        table = values.reshape(len(log), -1)
        names = (
            [key]
            if values.ndim == 1
            else _names(log)
            if values.shape == log.q.shape
            else range(table.shape[1])
        )
        found |= {
            key if values.ndim == 1 else f"{key}_{name}": table[:, k]
            for k, name in enumerate(names)
        }
    return found


def _csv(log: Log, path: Path) -> None:
    columns = _columns(log)
    delimiter = "\t" if path.suffix == ".tsv" else ","
    with path.open("w", encoding="utf-8") as stream:
        stream.write(delimiter.join(map(column, columns)) + "\n")
        for row in zip(*(values.tolist() for values in columns.values()), strict=True):
            stream.write(delimiter.join(map(repr, row)) + "\n")


def _parquet(log: Log, path: Path) -> None:
    from dynid.files.tables import pyarrow_of

    pyarrow, parquet = pyarrow_of()
    parquet.write_table(pyarrow.table(_columns(log)), path)


# ---------------------------------------------------------------- messages of ROS
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

    @property
    def rows(self) -> list[Floats]:
        """The three arrays, in memory as messages are made from them."""
        return [np.ascontiguousarray(part) for part in (self.q, self.qd, self.tau)]


def _store(distribution: str) -> tuple[Any, Any, Any, Any]:
    """Return the types of messages of a distribution of ROS, and its JointState, Header and Time."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores[distribution])
    return (
        store,
        store.types[STATE],
        store.types["std_msgs/msg/Header"],
        store.types["builtin_interfaces/msg/Time"],
    )


def _start(log: Log) -> int:
    """Return what the time of a log counts from [ns since 1970]."""
    seconds = float(log.extra.get("t0", 0.0))
    return int(log.extra.get("start_ns", round(np.clip(seconds, -1e12, 1e12) * 1e9)))


def _stamps(log: Log, start: int) -> list[int]:
    """Return the stamps of a log's samples [ns since 1970].

    Raises:
        LogLayout: a message cannot hold them.
    """
    whole = bool(np.isfinite(log.t).all()) and abs(start) < LAST_STAMP * 10**9
    if not whole or log.t.min() + start * 1e-9 < 0 or log.t.max() + start * 1e-9 >= LAST_STAMP:
        raise LogLayout(
            f"{log.name} has times that are not numbers, or lie before 1970 or after 2038",
            where=log.name,
            why="time stamps of ROS cannot hold them",
            fix="write .npz, .csv or .parquet",
        )
    return [int(stamp) for stamp in start + np.round(log.t * 1e9).astype(np.int64)]


def write_bag(log: Log, path: Path, topic: str, start: int = 0) -> None:
    """Write a log as a bz2-compressed bag of ROS 1 with sensor_msgs/JointState; equal logs give equal bytes.

    Args:
        log: the columns to publish, in their order.
        path: the file; an existing one is replaced.
        topic: topic of the messages, each stored at the time of its stamp.
        start: what ``log.t`` counts from [ns since 1970].
    """
    from rosbags.rosbag1 import Writer

    store, State, Header, Time = _store("ROS1_NOETIC")
    stamps = _stamps(log, start)
    columns = JointStates(
        log.q, np.empty((len(log), 0)) if log.qd is None else log.qd, log.tau
    ).rows
    with _written_whole(path) as part:
        writer = Writer(part)
        writer.set_compression(Writer.CompressionFormat.BZ2)
        with writer:
            channel = writer.add_connection(topic, STATE, typestore=store)
            for i, stamp in enumerate(stamps):
                message = State(
                    Header(i, Time(*divmod(stamp, 10**9)), ""),
                    list(log.names),
                    *(x[i] for x in columns),
                )
                writer.write(channel, stamp, bytes(store.serialize_ros1(message, STATE)))


def _ros2(log: Log, path: Path) -> None:
    """Write a single file of rosbag2: sensor_msgs/msg/JointState in CDR."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    store, State, Header, Time = _store("ROS2_HUMBLE")
    plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
    stamps, none = _stamps(log, _start(log)), np.empty((len(log), 0))
    known = (
        x if x is not None and np.isfinite(x).any() else none for x in (log.q, log.qd, log.tau)
    )
    columns, bag = JointStates(*known).rows, path.parent / "bag"
    with Writer(bag, version=9, storage_plugin=plugin) as writer:
        channel = writer.add_connection(log.topic or TOPIC, STATE, typestore=store)
        for i, stamp in enumerate(stamps):
            message = State(
                Header(Time(*divmod(stamp, 10**9)), ""), _names(log), *(x[i] for x in columns)
            )
            writer.write(channel, stamp, bytes(store.serialize_cdr(message, STATE)))
    (part,) = bag.glob(f"*{path.suffix}")
    part.replace(path)


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

    store, State, Header, Time = _store("ROS2_HUMBLE")
    times = stamps.tolist()
    first = times[0] if times else 0
    with _written_whole(path) as part, part.open("wb") as stream:
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
        rows = [(channel(topic, STATE), states.rows) for topic, states in topics.items()]
        for i, stamp in enumerate(times):
            header = Header(Time(*divmod(stamp, 10**9)), "")
            for number, columns in rows:
                message = State(header, list(names), *(x[i] for x in columns))
                writer.add_message(number, stamp, bytes(store.serialize_cdr(message, STATE)), stamp)
        writer.finish()
    return path


WRITERS: dict[str, Callable[[Log, Path], object]] = {
    ".mcap": _ros2,
    ".db3": _ros2,
    ".bag": lambda log, path: write_bag(log, path, log.topic or TOPIC, _start(log)),
    ".npz": lambda log, path: log.save(path),
    ".csv": _csv,
    ".tsv": _csv,
    ".parquet": _parquet,
}
