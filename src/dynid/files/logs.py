"""Any recording -> ``Log``: the reader is chosen by the kind of file.

A further format is a file with a reader, an entry in ``READERS``, and a row in docs/reference/log-format.md.
"""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid import limits
from dynid.errors import Finding, LogNotFound
from dynid.files import bag, rosbag2, tablelog
from dynid.files.artifact import sha256
from dynid.files.bag import START
from dynid.files.inspect import Inspected, inspect
from dynid.files.joint_states import read_joint_states
from dynid.files.npzlog import read_npz_log
from dynid.files.textlog import read_folder
from dynid.log import Log
from dynid.robot import Robot

#: From path, robot, ROS topic and sample rate [Hz], of which a reader takes what it needs.
Reader = Callable[[Path, Robot, str | None, float | None], Log]


def _bag(path: Path, robot: Robot, topic: str | None, rate: float | None) -> Log:
    return read_joint_states(path, robot, topic, bag)


def _rosbag2(path: Path, robot: Robot, topic: str | None, rate: float | None) -> Log:
    return read_joint_states(path, robot, topic, rosbag2)


def _table(path: Path, robot: Robot, topic: str | None, rate: float | None) -> Log:
    return tablelog.read_table(path, robot.log_names, robot.driver.columns if robot.driver else None, rate)


#: Reader of each suffix; a bag without one of these is known by its first bytes.
READERS: dict[str, Reader] = {
    ".bag": _bag,
    ".active": _bag,
    ".npz": lambda path, robot, topic, rate: read_npz_log(path),
    **dict.fromkeys(tablelog.SUFFIXES, _table),
    **dict.fromkeys(rosbag2.SUFFIXES, _rosbag2),
}
#: A log that starts later than this [s] is stamped with a calendar clock; its time is counted from the first sample.
EPOCH = 1e6


def read_log(path: Path, *, robot: Robot, topic: str | None = None, rate: float | None = None) -> Log:
    """Read a recording as it is: the driver's columns, order and units.

    Args:
        path: a .bag, .npz or .csv file, or a folder with the paper's text files.
        robot: the robot, whose driver chooses the topic and columns.
        topic: ROS topic, None for the robot file's or the driver's.
        rate: sample rate of text files without time [Hz].

    Raises:
        LogNotFound: no such file, or not a log.
        TopicMissing: the topic is not in the bag.
        WrongMessageType: the topic holds no joint states.
        BagTruncated: a damaged bag in which nothing is readable.
        LogLayout: columns are missing.
    """
    path = Path(path)
    read = _reader(path)
    log = replace(read(path, robot, topic, rate), sha256=hash_of(path))
    if len(log) and np.isfinite(log.t[0]) and abs(log.t[0]) > EPOCH:
        log = replace(log, t=log.t - log.t[0], extra={**log.extra, "t0": float(log.t[0])})
    if not log.names:
        text = f"{path.name} does not name its columns: the order {', '.join(robot.log_names)} is assumed"
        log = replace(log, findings=(*log.findings, Finding("W320", "warning", text)))
    return log


def inspect_log(path: Path, rate: float | None = None) -> Inspected:
    """Return what a recording holds, without knowing its arm.

    Args:
        path: any recording.
        rate: sample rate of text files without time [Hz].

    Raises:
        DynidError: it is no recording, or nothing of it can be read.
    """
    kinds: dict[Reader, str] = {_bag: "bag", _rosbag2: "rosbag2", _table: "table"}
    read = _reader(path)
    return inspect(path, kinds.get(read, "npz" if path.suffix == ".npz" else "folder"), rate)


def _reader(path: Path) -> Reader:
    if not path.exists():
        raise LogNotFound(f"no such file {path}{_nearby(path)}", where=str(path))
    if path.is_dir():
        if rosbag2.is_recording(path):
            return _rosbag2
        return lambda path, robot, topic, rate: read_folder(path, rate)
    if path.suffix in READERS:
        return READERS[path.suffix]
    try:
        with limits.open_file(path) as stream:
            if stream.read(len(START)) == START:
                return _bag
    except OSError as error:
        raise LogNotFound(f"cannot read {path}: {error.strerror}", where=str(path)) from error
    if rosbag2.is_recording(path):
        return _rosbag2
    raise LogNotFound(
        f"{path} is not a log",
        where=str(path),
        fix=f"give a {', '.join(READERS)} file, or a folder of rosbag2 or with position.txt and torque.txt",
    )


def hash_of(path: Path) -> str:
    """Return the SHA-256 of a file; of a folder of rosbag2 that of its recordings, one after the other."""
    if not path.is_dir() or not rosbag2.is_recording(path):
        return sha256(path)
    parts = rosbag2.parts_of(path)
    return sha256(parts[0]) if len(parts) == 1 else hashlib.sha256("".join(map(sha256, parts)).encode()).hexdigest()


def _nearby(path: Path) -> str:
    """Return the logs beside a missing one, the most alike first."""
    folder = path.parent
    if not folder.is_dir():
        return f"; there is no folder {folder}"
    logs = [entry.name for entry in sorted(folder.iterdir()) if entry.suffix in READERS or entry.is_dir()]
    alike = difflib.get_close_matches(path.name, logs, n=3, cutoff=0.5)
    return f"; nearby: {', '.join(alike)}" if alike else ""
