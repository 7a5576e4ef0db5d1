"""Any recording -> ``Log``: which reader reads a file, and which of its numbers are the robot's.

A further format is a file with a reader, its suffixes and its case in ``read_log`` and ``inspect``, and a row in
docs/reference/log-format.md.
"""

from __future__ import annotations

import difflib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid.disk import sha256
from dynid.drivers.interface import driver_of
from dynid.errors import (
    Finding,
    JointNamesDiffer,
    LogLayout,
    LogNotFound,
    NotAnArtifact,
    WrongMessageType,
)
from dynid.files import tables, tuning
from dynid.files.artifact import require_schema
from dynid.files.bags import ROS2, read_bag
from dynid.log import SCHEMA, Log
from dynid.npz import HEADER, read_npz
from dynid.robot import Robot

#: Format of each suffix.
FORMATS = {
    ".bag": "bag",
    ".active": "bag",
    ".npz": "npz",
    ".csv": "table",
    ".tsv": "table",
    ".db3": "bag",
    ".mcap": "bag",
}


def format_of(path: Path) -> str:
    """Return the format of a recording: ``"bag"`` of ROS 1 or 2, ``"npz"``, ``"table"`` or ``"folder"`` of texts.

    Raises:
        LogNotFound: no such file, or not a log.
    """
    if path.is_dir():
        inside = any(part.suffix in ROS2 for part in path.iterdir())
        return "bag" if inside or (path / "metadata.yaml").is_file() else "folder"
    if not path.is_file():
        logs = [each.name for each in path.parent.glob("*") if each.suffix in FORMATS]
        alike = difflib.get_close_matches(path.name, sorted(logs), n=3, cutoff=0.5)
        nearby = f"; nearby: {', '.join(alike)}" * bool(alike)
        raise LogNotFound(f"no such file {path}{nearby}", where=path)
    if path.suffix not in FORMATS:
        raise LogNotFound(f"{path} is not a log", where=path, fix=LogNotFound.why)
    return FORMATS[path.suffix]


def read_log(
    path: Path, *, robot: Robot, topic: str | None = None, rate: float | None = None
) -> Log:
    """Read a recording as it is: the driver's columns, order and units.

    Args:
        path: a file of a format of ``FORMATS``, a folder of rosbag2, or one with the paper's text files.
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
    kind = format_of(path)
    if kind == "npz":
        log = read_npz_log(path)
    elif kind == "folder":
        log = tables.read_folder(path, rate)
    elif kind == "table":
        sensors = robot.torque.source == "joint_sensor"
        log = tables.read_table(path, robot.log_names, robot.columns.columns, rate, sensors=sensors)
    else:
        log = _read_joint_states(path, robot, topic)
    log = replace(log, sha256=sha256(path))
    if len(log) and np.isfinite(log.t[0]) and abs(log.t[0]) > tuning.CALENDAR_FROM_S:
        log = replace(log, t=log.t - log.t[0])
    if not log.names:
        text = f"{path.name} does not name its columns: the order {', '.join(robot.log_names)} is assumed"
        log = replace(log, findings=(*log.findings, Finding("W320", "warning", text)))
    return log


# ---------------------------------------------------------------- .npz
def read_npz_log(path: Path) -> Log:
    """Read an .npz log, which ``Log.save`` writes: arrays ``t, q, [qd], tau, [q_ref]`` and one JSON header.

    Plain .npz files of other people have no header: their columns have no names. ``q_motor`` and ``tau_motor`` in the
    place of ``q`` and ``tau`` say that the numbers are on the motor side.

    Raises:
        LogNotFound: not an .npz file, or a dynid result of another kind.
        NewerSchema: written by a newer dynid.
        TooLarge: an array unpacks like a bomb.
        LogLayout: arrays are missing or their sizes differ.
    """
    try:
        arrays = read_npz(path)
        header = dict(json.loads(str(arrays.pop(HEADER, "{}"))))
        units = {str(key): str(unit) for key, unit in dict(header.get("units") or {}).items()}
        names = tuple(header.get("joint_names") or ())
        if "schema" in header:
            require_schema(path, header, SCHEMA)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise LogNotFound(
            f"{path.name} is not an .npz log, or is damaged: {error}", where=path
        ) from error
    except NotAnArtifact as error:
        raise LogNotFound(f"{path.name} holds {header['schema']}, not a log", where=path) from error
    motor = "q_motor" in arrays
    q, tau = ("q_motor", "tau_motor") if motor else ("q", "tau")
    for key in ("t", q, tau):
        if key not in arrays:
            have = ", ".join(sorted(arrays)) or "no arrays"
            raise LogLayout(f"{path.name} has no array '{key}'; it has {have}", where=path)
    effort = units.get("effort")
    log = Log(
        t=arrays["t"],
        # Why: what is done with a log, joint by joint, takes half the time where the samples of each stand together.
        q=np.asfortranarray(arrays[q]),
        tau=np.asfortranarray(arrays[tau]),
        names=names,
        qd=arrays.get("qd"),
        source=path,
        topic=str(header.get("topic", "")),
        tau_unit="A" if effort in ("A", "mA") else "Nm" if effort else "",
        units=units,
        motor_side=motor or bool(header.get("motor_side")),
        dh=bool(header.get("dh")),
        extra={key: arrays[key] for key in ("q_ref", "qd_reported") if key in arrays},
    )
    if not log.q.size:
        raise LogLayout(f"{path.name}: array 'q' holds no numbers", where=path)
    return log


# ---------------------------------------------------------------- joint states of bags
def _read_joint_states(path: Path, robot: Robot, topic: str | None) -> Log:
    """Read the joint states of a robot from a bag; the driver chooses the topic where None is given."""
    topics, every, findings = read_bag(path)
    kinds = {name: each.type for name, each in topics.items()}
    chosen = driver_of(robot).choose_topic(kinds, topic, robot, path.name)
    logs = [log for log in every if log.topic == chosen]
    if not logs:
        raise WrongMessageType(f"{chosen} has no readable messages", where=chosen)
    # Why: other nodes may publish on the same topic.
    known = (set(robot.log_names), set(robot.joint_names))
    log = next((log for names in known for log in logs if names <= set(log.names)), logs[0])
    if not log.names:
        raise JointNamesDiffer(
            f"the messages of {chosen} name no joints",
            where=chosen,
            fix="make the driver fill the names of its JointState",
        )
    for field, numbers in (("position", log.q), ("effort", log.tau)):
        if not np.isfinite(numbers).any():
            raise WrongMessageType(
                f"{chosen} has no {field} in any of its {len(log)} messages", where=path.name
            )
    if log.extra["clock"] == "arrival":
        text = (
            f"{chosen} has no usable time stamps: "
            "the time of arrival in the bag is used, which jitters more"
        )
        findings = (*findings, Finding("W304", "warning", text))
    return replace(log, source=path, findings=findings)
