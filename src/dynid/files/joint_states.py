"""Joint states of one robot out of a bag of any kind: which topic, which joints, torques from a topic of their own."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from dynid.drivers.interface import JOINT_STATE
from dynid.drivers.registry import driver_of
from dynid.errors import Finding, JointNamesDiffer, WrongMessageType
from dynid.files.bag import Topic
from dynid.files.cdr import MULTI_ARRAY
from dynid.files.messages import KINOVA_TYPES
from dynid.log import Log
from dynid.robot import Robot
from dynid.units import POSITION


class Container(Protocol):
    """What a kind of bag can do: the modules ``bag`` and ``rosbag2``."""

    def list_topics(self, path: Path) -> dict[str, Topic]:
        """Return the topics of a bag by name."""

    def read_topics(self, path: Path, names: Collection[str]) -> tuple[dict[str, list[Log]], tuple[Finding, ...]]:
        """Return for each topic its raw logs, the largest first, and what was noticed."""


def read_joint_states(path: Path, robot: Robot, topic: str | None, container: Container) -> Log:
    """Read the joint states of a robot from a bag.

    Args:
        path: the bag.
        robot: the robot, whose driver chooses the topic, and whose joint names the messages.
        topic: topic of the joint states, None for the robot file's or the driver's.
        container: what lists and reads topics of bags of this kind.

    Raises:
        TopicMissing: the topic is not in the bag.
        WrongMessageType: the topic holds no positions or no torques.
        JointNamesDiffer: the messages name no joints.
        BagTruncated: nothing is readable.
    """
    topics = {name: found.type for name, found in container.list_topics(path).items()}
    driver = driver_of(robot)
    if JOINT_STATE not in topics.values() and (pair := _kinova_pair(topics, topic)):
        return _read_kinova_pair(path, robot, *pair, container)
    chosen = driver.choose_topic(topics, topic, robot, path.name)
    apart = robot.driver.effort_topic if robot.driver else None
    if apart is not None and topics.get(apart) not in (JOINT_STATE, MULTI_ARRAY):
        found = f"is {topics[apart]}" if apart in topics else "is not there"
        text = f"the topic of the torques, {apart}, {found}; {JOINT_STATE} or {MULTI_ARRAY} is needed"
        raise WrongMessageType(text, where=path.name, fix="correct `effort_topic:` under `driver:` in the robot file")
    groups, findings = container.read_topics(path, [chosen] if apart is None else [chosen, apart])
    log = _of_robot(groups.get(chosen, []), robot, chosen)
    if apart is not None:
        log = _with_effort(log, groups.get(apart, []), robot, apart)
    for key in ("position", "effort"):
        if key in log.extra["absent"]:
            raise WrongMessageType(f"{chosen} has no {key} in any of its {len(log)} messages", where=path.name)
    if log.extra["clock"] == "arrival":
        findings = (*findings, _arrival(chosen))
    return replace(log, source=path, findings=findings)


def _with_effort(log: Log, groups: Sequence[Log], robot: Robot, topic: str) -> Log:
    """Return a log with the torques of another topic, each position with the torque at its time.

    Raises:
        WrongMessageType: the topic has other joints, or no time in common with the positions.
    """
    if not groups:
        raise WrongMessageType(f"{topic} has no messages", where=topic)
    one = next((group for group in groups if set(robot.log_names) <= set(group.names)), groups[0])
    torque = one.q if "effort" in one.extra["absent"] else one.tau
    joints = list(one.names) or [*robot.log_names[: one.n]]
    if torque.shape[1] < robot.n or not set(joints) <= {*log.names, *one.names}:
        raise WrongMessageType(f"{topic} has {torque.shape[1]} torques, {robot.name} has {robot.n} joints", where=topic)
    # Unit: both clocks count from their own first message; stamps of headers only compare with each other.
    both = log.extra["clock"] == one.extra["clock"]
    first = (
        (one.extra["start_ns"] - log.extra["start_ns"])
        if both
        else (one.extra["arrival_ns"][0] - log.extra["arrival_ns"][0])
    )
    clock = one.t + first * 1e-9
    shared = (log.t >= clock[0]) & (log.t <= clock[-1])
    if not shared.any():
        raise WrongMessageType(f"{log.topic} and {topic} share no time", where=topic)
    tau = np.full((int(shared.sum()), log.n), np.nan)
    for k, name in enumerate(log.names):
        if name in joints:
            tau[:, k] = np.interp(log.t[shared], clock, torque[:, joints.index(name)])
    extra = {**log.extra, "absent": tuple(key for key in log.extra["absent"] if key != "effort")}
    t, qd = log.t[shared], log.qd[shared] if log.qd is not None else None
    extra["start_ns"] += round(1e9 * float(t[0]))
    return replace(log, t=t - t[0], q=log.q[shared], tau=tau, qd=qd, extra=extra)


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


def _read_kinova_pair(path: Path, robot: Robot, angles: str, torques: str, container: Container) -> Log:
    """Read angles and torques from two topics; each angle gets the torque at its time of arrival."""
    groups, findings = container.read_topics(path, [angles, torques])
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
        t - t[0], q, tau, robot.log_names[:n], source=path, topic=angles,
        findings=(*findings, _arrival(f"{angles} and {torques}")), extra={"clock": "arrival"},
    )  # fmt: skip


def _arrival(topic: str) -> Finding:
    text = f"{topic} has no usable time stamps: the time of arrival in the bag is used, which jitters more"
    return Finding("W304", "warning", text)
