"""A log in another container: every number as it was recorded, columns in their order; whole, or not at all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dynid.errors import CannotWrite, WrongUsage
from dynid.files.bag import message_stamps, write_bag
from dynid.log import Log
from dynid.npz import put_in_place
from dynid.scratch import scratch_folder
from dynid.text import column

TOPIC = "/joint_states"


def write_log(log: Log, path: Path) -> Path:
    """Write a log in the format of a file's suffix.

    Raises:
        WrongUsage: the suffix is not known.
        CannotWrite: the file cannot be written.
        PackageMissing: Parquet without pyarrow.
    """
    if path.suffix not in WRITERS:
        raise WrongUsage(
            f"'{path.name}' does not say what to write: {', '.join(WRITERS)}", fix="name a file like log.mcap"
        )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        WRITERS[path.suffix](log, path)
    except OSError as error:
        raise CannotWrite(f"cannot write {path}: {error.strerror}", where=str(path)) from error
    return path


def _names(log: Log) -> list[str]:
    return list(log.names) or [f"joint_{k + 1}" for k in range(log.n)]


def _start(log: Log) -> int:
    """Return what the time of a log counts from [ns since 1970]."""
    seconds = float(log.extra.get("t0", 0.0))
    return int(log.extra.get("start_ns", round(np.clip(seconds, -1e12, 1e12) * 1e9)))


def _columns(log: Log) -> dict[str, Any]:
    """Return the columns of a table by name; those that are not a number throughout were never recorded."""
    torque = "i" if log.tau_unit == "A" else "tau"
    kinds = {"q": log.q, "qd": log.qd, torque: log.tau, "q_ref": log.extra.get("q_ref")}
    return {"t": log.t} | {
        f"{kind}_{name}": values[:, k]
        for kind, values in kinds.items()
        if values is not None and np.isfinite(values).any()
        for k, name in enumerate(_names(log))
    }


def _csv(log: Log, path: Path) -> None:
    columns = _columns(log)
    delimiter = "\t" if path.suffix == ".tsv" else ","
    with scratch_folder(path.parent) as folder:
        temporary = folder / path.name
        with temporary.open("w", encoding="utf-8") as stream:
            stream.write(delimiter.join(map(column, columns)) + "\n")
            for row in zip(*(values.tolist() for values in columns.values()), strict=True):
                stream.write(delimiter.join(map(repr, row)) + "\n")
        put_in_place(temporary, path)


def _parquet(log: Log, path: Path) -> None:
    from dynid.files.tablelog import pyarrow_of

    pyarrow, parquet = pyarrow_of()
    with scratch_folder(path.parent) as folder:
        parquet.write_table(pyarrow.table(_columns(log)), folder / path.name)
        put_in_place(folder / path.name, path)


def _ros2(log: Log, path: Path) -> None:
    """Write a single file of rosbag2: sensor_msgs/msg/JointState in CDR."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    State, Header, Time = (store.types[kind] for kind in kinds)
    plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
    stamps = message_stamps(log, _start(log))
    none = np.empty((len(log), 0))
    q, qd, tau = (
        np.ascontiguousarray(x) if x is not None and np.isfinite(x).any() else none for x in (log.q, log.qd, log.tau)
    )
    with scratch_folder(path.parent) as folder:
        writer = Writer(folder / "bag", version=9, storage_plugin=plugin)
        with writer:
            channel = writer.add_connection(log.topic or TOPIC, State.__msgtype__, typestore=store)
            for i, stamp in enumerate(stamps.tolist()):
                message = State(Header(Time(*divmod(stamp, 10**9)), ""), _names(log), q[i], qd[i], tau[i])
                writer.write(channel, stamp, bytes(store.serialize_cdr(message, State.__msgtype__)))
        (part,) = (folder / "bag").glob(f"*{path.suffix}")
        put_in_place(part, path)


WRITERS: dict[str, Callable[[Log, Path], object]] = {
    ".mcap": _ros2,
    ".db3": _ros2,
    ".bag": lambda log, path: write_bag(log, path, log.topic or TOPIC, _start(log)),
    ".npz": lambda log, path: log.save(path),
    ".csv": _csv,
    ".tsv": _csv,
    ".parquet": _parquet,
}
