"""Any recording -> ``Log``: the reader is chosen by the kind of file."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.drivers.interface import JOINT_STATE
from dynid.drivers.registry import driver_of
from dynid.errors import Finding, JointNamesDiffer, LogNotFound, WrongMessageType
from dynid.files.artifact import sha256
from dynid.files.bag import list_topics, read_topics
from dynid.files.bag_records import MAGIC
from dynid.files.messages import KINOVA_TYPES
from dynid.files.npzlog import read_npz_log
from dynid.files.textlog import read_csv, read_folder
from dynid.log import Log
from dynid.robot import Robot
from dynid.units import POSITION

Floats = NDArray[np.float64]

SUFFIXES = (".bag", ".active", ".npz", ".csv")
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
    kind = _kind(path)
    if kind == "bag":
        return _read_bag(path, robot, topic)
    log = read_folder(path, rate) if kind == "folder" else read_csv(path, rate) if kind == "csv" else read_npz_log(path)
    if len(log) and np.isfinite(log.t[0]) and abs(log.t[0]) > EPOCH:
        log = replace(log, t=log.t - log.t[0], extra={**log.extra, "t0": float(log.t[0])})
    if not log.names:
        text = f"{path.name} does not name its columns: the order {', '.join(robot.log_names)} is assumed"
        log = replace(log, findings=(*log.findings, Finding("W320", "warning", text)))
    return log


def _kind(path: Path) -> str:
    if not path.exists():
        raise LogNotFound(f"no such file {path}{_nearby(path)}", where=str(path))
    if path.is_dir():
        return "folder"
    if path.suffix in (".npz", ".csv"):
        return path.suffix[1:]
    try:
        with path.open("rb") as stream:
            start = stream.read(len(MAGIC))
    except OSError as error:
        raise LogNotFound(f"cannot read {path}: {error.strerror}", where=str(path)) from error
    if path.suffix in (".bag", ".active") or start.startswith(b"#ROSBAG"):
        return "bag"
    raise LogNotFound(
        f"{path} is not a log",
        where=str(path),
        fix="give a .bag, .npz or .csv file, or a folder with position.txt and torque.txt",
    )


def _nearby(path: Path) -> str:
    """Return the logs beside a missing one, the most alike first."""
    folder = path.parent
    if not folder.is_dir():
        return f"; there is no folder {folder}"
    logs = [entry.name for entry in sorted(folder.iterdir()) if entry.suffix in SUFFIXES or entry.is_dir()]
    alike = difflib.get_close_matches(path.name, logs, n=3, cutoff=0.5)
    return f"; nearby: {', '.join(alike)}" if alike else ""


def _read_bag(path: Path, robot: Robot, topic: str | None) -> Log:
    topics = {name: found.type for name, found in list_topics(path).items()}
    driver = driver_of(robot)
    if JOINT_STATE not in topics.values() and (pair := _kinova_pair(topics, topic)):
        return _read_kinova_pair(path, robot, *pair)
    chosen = driver.choose_topic(topics, topic, robot, path.name)
    groups, findings = read_topics(path, [chosen])
    log = _of_robot(groups.get(chosen, []), robot, chosen)
    for key in ("position", "effort"):
        if key in log.extra["absent"]:
            raise WrongMessageType(f"{chosen} has no {key} in any of its {len(log)} messages", where=path.name)
    if log.extra["clock"] == "arrival":
        findings = (*findings, _arrival(chosen))
    return replace(log, source=path, sha256=sha256(path), findings=findings)


def _of_robot(groups: Sequence[Log], robot: Robot, topic: str) -> Log:
    """Return the log whose names cover the robot's; other nodes may publish on the same topic."""
    for names in (robot.log_names, robot.joint_names):
        for log in groups:
            if set(names) <= set(log.names):
                return log
    if not groups:
        raise WrongMessageType(f"{topic} has no messages", where=topic)
    if not groups[0].names:
        raise JointNamesDiffer(
            f"the messages of {topic} name no joints",
            where=topic,
            fix="make the driver fill the names of its JointState",
        )
    return groups[0]


def _kinova_pair(topics: dict[str, str], asked: str | None) -> tuple[str, str] | None:
    """Return the topics of angles and torques of a bag that has only Kinova's own messages."""
    own = [name for name, kind in topics.items() if kind in KINOVA_TYPES]
    angles = [name for name in own if name.endswith("joint_angles")]
    torques = [name for name in own if name.endswith("joint_torques")]
    if not angles or not torques or (asked is not None and asked not in (angles[0], torques[0])):
        return None
    return angles[0], torques[0]


def _read_kinova_pair(path: Path, robot: Robot, angles: str, torques: str) -> Log:
    """Read angles and torques from two topics; each angle gets the torque at its time of arrival."""
    groups, findings = read_topics(path, [angles, torques])
    if angles not in groups or torques not in groups:
        raise WrongMessageType(f"{path.name} needs messages on both {angles} and {torques}", where=path.name)
    position, torque = groups[angles][0], groups[torques][0]
    # Unit: these messages have no stamps, so that both logs count from the arrival of their own first message.
    grid = torque.t + (torque.extra["arrival_ns"][0] - position.extra["arrival_ns"][0]) * 1e-9
    both = (position.t >= grid[0]) & (position.t <= grid[-1])
    if not both.any():
        raise WrongMessageType(f"{angles} and {torques} share no time", where=path.name)
    t, n = position.t[both], min(robot.n, 7)
    unit = robot.driver.units["position"] if robot.driver else "rad"
    # Unit: these messages are in degrees by definition; the log is handed over in the unit that the robot file expects.
    q = position.q[both, :n] * POSITION["deg"] / POSITION[unit]
    tau = np.column_stack([np.interp(t, grid, torque.q[:, j]) for j in range(n)])
    return Log(
        t - t[0], q, tau, robot.log_names[:n], source=path, sha256=sha256(path), topic=angles,
        findings=(*findings, _arrival(f"{angles} and {torques}")), extra={"clock": "arrival"},
    )  # fmt: skip


def _arrival(topic: str) -> Finding:
    text = f"{topic} has no usable time stamps: the time of arrival in the bag is used, which jitters more"
    return Finding("W304", "warning", text)
