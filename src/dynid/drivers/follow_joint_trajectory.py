"""Commanding through a FollowJointTrajectory action: the whole motion is one goal, and a stop cancels it.

The controller plays the goal by itself. It is watched like a stream, but it does not end when dynid dies; only the
cancel, or the arm's own stop button, ends it. Messages are made at run time: neither actionlib nor control_msgs has to
be there. Source: actionlib_msgs, control_msgs and trajectory_msgs of ROS 1; checksums are compared when nodes connect.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Mapping
from functools import cache
from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.drivers.command_port import (
    CONNECT_PATIENCE,
    SERVICE_PATIENCE,
    CommandPort,
    Target,
    wait_until,
)
from dynid.drivers.joint_trajectory import point_of
from dynid.drivers.ros import import_ros, message_classes
from dynid.errors import GoalRefused, ServiceMissing, TopicMissing, TopicSilent
from dynid.text import shell

TRAJECTORY = "trajectory_msgs/JointTrajectory"
#: Points of a goal [Hz]: with accelerations, controllers put a quintic between two of them.
POINT_RATE = 50.0
#: A controller takes a goal of some minutes within this time [s], and says that it is there so long after its end.
ACCEPT_PATIENCE, FINISH_PATIENCE = 3.0, 5.0

GOAL = "control_msgs/FollowJointTrajectoryActionGoal"
RESULT = "control_msgs/FollowJointTrajectoryActionResult"
STATUS = "actionlib_msgs/GoalStatusArray"
CANCEL = "actionlib_msgs/GoalID"

#: States of a goal by the numbers of actionlib_msgs/GoalStatus.
STATES = (
    "pending",
    "active",
    "preempted",
    "succeeded",
    "aborted",
    "rejected",
    "preempting",
    "recalling",
    "recalled",
    "lost",
)
ACTIVE, PREEMPTED, SUCCEEDED, ABORTED, REJECTED, RECALLED, LOST = 1, 2, 3, 4, 5, 8, 9
#: A goal that has come to one of these moves nothing any more.
ENDED = (PREEMPTED, SUCCEEDED, ABORTED, REJECTED, RECALLED, LOST)

#: The definitions as ROS has them: the type, its fields and constants, an empty line.
MESSAGES = """\
std_msgs/Header
uint32 seq
time stamp
string frame_id

actionlib_msgs/GoalID
time stamp
string id

actionlib_msgs/GoalStatus
GoalID goal_id
uint8 status
uint8 PENDING=0
uint8 ACTIVE=1
uint8 PREEMPTED=2
uint8 SUCCEEDED=3
uint8 ABORTED=4
uint8 REJECTED=5
uint8 PREEMPTING=6
uint8 RECALLING=7
uint8 RECALLED=8
uint8 LOST=9
string text

trajectory_msgs/JointTrajectoryPoint
float64[] positions
float64[] velocities
float64[] accelerations
float64[] effort
duration time_from_start

trajectory_msgs/JointTrajectory
Header header
string[] joint_names
JointTrajectoryPoint[] points

control_msgs/JointTolerance
string name
float64 position
float64 velocity
float64 acceleration

control_msgs/FollowJointTrajectoryGoal
trajectory_msgs/JointTrajectory trajectory
JointTolerance[] path_tolerance
JointTolerance[] goal_tolerance
duration goal_time_tolerance

control_msgs/FollowJointTrajectoryResult
int32 error_code
int32 SUCCESSFUL=0
int32 INVALID_GOAL=-1
int32 INVALID_JOINTS=-2
int32 OLD_HEADER_TIMESTAMP=-3
int32 PATH_TOLERANCE_VIOLATED=-4
int32 GOAL_TOLERANCE_VIOLATED=-5
string error_string

control_msgs/FollowJointTrajectoryActionGoal
Header header
actionlib_msgs/GoalID goal_id
FollowJointTrajectoryGoal goal

control_msgs/FollowJointTrajectoryActionResult
Header header
actionlib_msgs/GoalStatus status
FollowJointTrajectoryResult result

actionlib_msgs/GoalStatusArray
Header header
GoalStatus[] status_list
"""
_TEXTS = {
    kind: f"{text.strip()}\n"
    for kind, _, text in (message.partition("\n") for message in MESSAGES.split("\n\n"))
}


def choose_commands(
    types: Mapping[str, str], heard: Collection[str], asked: str | None, usual: str
) -> tuple[str, bool]:
    """Return the topic to command an arm on, and whether it takes goals of the action.

    Why: a stream of points is preferred, because the arm stops when it ends; many drivers have the action only.

    Args:
        types: message type of every topic.
        heard: topics somebody listens to.
        asked: the topic that the user named, None to choose.
        usual: where a joint_trajectory_controller next to the joint states listens.

    Raises:
        TopicMissing: several could be meant.
    """
    if asked is not None:
        goal = f"{asked.removesuffix('/goal')}/goal"
        return (goal, True) if types.get(goal) == GOAL else (asked, False)
    if usual in heard:
        return usual, False
    for kind in (GOAL, TRAJECTORY):
        topics = sorted(name for name in heard if types.get(name) == kind)
        if len(topics) > 1:
            raise TopicMissing(
                f"several topics take motions: {', '.join(topics)}",
                fix=f"name one of them: {shell('--command-topic', topics[0])}",
            )
        if topics:
            return topics[0], kind == GOAL
    return usual, False


class FollowJointTrajectoryPort(CommandPort):
    """Any driver with a FollowJointTrajectory action server."""

    stop_words = "a cancelled goal stops the arm (it can only be tried on a goal)"

    def __init__(self, *words: Any) -> None:  # noqa: ANN401
        super().__init__(*words)
        self._state, self._text, self._id = -1, "", ""
        self._alive = threading.Event()

    def default_command_topic(self) -> str:
        """Return the goal topic of a joint_trajectory_controller next to the joint states."""
        return f"{self.namespace}/joint_trajectory_controller/follow_joint_trajectory/goal"

    def _topic(self, name: str) -> str:
        return f"{self.command_topic.removesuffix('/goal')}/{name}"

    def command_type(self) -> Any:  # noqa: ANN401
        """Return control_msgs/FollowJointTrajectoryActionGoal."""
        return action_message(GOAL)

    def endpoints(self) -> list[str]:
        """Return the topics of goal and cancel."""
        return [*super().endpoints(), f"topic {self._topic('cancel')}"]

    def ready(self) -> None:
        """Connect to goal and cancel, and wait for the server's status, which it publishes without a goal too."""
        super().ready()
        heard = {"status": (STATUS, self._status), "result": (RESULT, self._result)}
        for name, (kind, callback) in heard.items():
            topic, kind = self._topic(name), action_message(kind)
            self.node.rospy.Subscriber(topic, kind, callback, tcp_nodelay=True)
        self._cancel = self.connected(self._topic("cancel"), action_message(CANCEL))
        if not self._alive.wait(CONNECT_PATIENCE):
            raise TopicSilent(
                f"{self._topic('status')} is silent for {CONNECT_PATIENCE:g} s",
                why="an action server publishes its status several times a second",
            )

    def message(self, target: Target, measured: Floats) -> Any:  # noqa: ANN401
        """Return nothing: the goal holds the whole motion.

        Raises:
            GoalRefused: the controller gave it up.
        """
        self._raise_refusal()

    def begin(self, at: Callable[[float], Target], duration: float) -> tuple[float, Any]:
        """Send the goal and wait until it is accepted; return when that was, and the goal.

        Raises:
            GoalRefused: it was rejected, or nobody answered.
        """
        goal = self._goal(at, duration)
        self._id = goal.goal_id.id
        self.publisher.publish(goal)
        late = f"{self.command_topic} did not accept the motion within {ACCEPT_PATIENCE:g} s"
        wait_until(lambda: self._state > 0, ACCEPT_PATIENCE, GoalRefused(late))
        self._raise_refusal()
        return time.monotonic(), goal

    def _goal(self, at: Callable[[float], Target], duration: float) -> Any:  # noqa: ANN401
        """Return the goal: joints by name, all fields of full length, no point at time 0 where the arm stands."""
        genpy = import_ros("genpy")
        count = max(1, int(np.ceil(duration * POINT_RATE)))
        goal = self.command_type()()
        goal.goal_id.stamp = genpy.Time(*divmod(time.time_ns(), 10**9))
        goal.goal_id.id = f"{self.node.rospy.get_name()}-{time.time_ns()}"
        goal.goal.trajectory.joint_names = list(self.columns.names)
        goal.goal.trajectory.points = [
            point_of(self.columns, at(when), when)
            for when in np.linspace(0.0, duration, count + 1)[1:].tolist()
        ]
        return goal

    def finish(self) -> None:
        """Wait until the controller says that the goal is reached.

        Raises:
            GoalRefused: it gave up, or does not say so.
        """
        late = f"the controller did not reach the end within {FINISH_PATIENCE:g} s after it"
        wait_until(lambda: self._state in ENDED, FINISH_PATIENCE, GoalRefused(late))
        self._raise_refusal()

    def stop(self) -> str:
        """Cancel the goal and wait until the controller confirms it."""
        if not self._id:
            return "no goal was sent"
        cancel = action_message(CANCEL)()
        cancel.id = self._id
        if self._cancel.get_num_connections():
            self._cancel.publish(cancel)
        where = self._topic("cancel")
        late = f"{where} did not confirm within {SERVICE_PATIENCE:g} s"
        wait_until(
            lambda: self._state in ENDED, SERVICE_PATIENCE, ServiceMissing(late, where=where)
        )
        return f"goal {STATES[self._state]}"

    def _raise_refusal(self) -> None:
        if self._state in ENDED and self._state != SUCCEEDED:
            reason = f"{STATES[self._state]}: {self._text}".removesuffix(": ")
            raise GoalRefused(f"the controller says that the motion is {reason}")

    def _status(self, statuses: Any) -> None:  # noqa: ANN401
        self._alive.set()
        for status in statuses.status_list:
            if status.goal_id.id == self._id:
                self._state, self._text = status.status, status.text or self._text

    def _result(self, result: Any) -> None:  # noqa: ANN401
        if result.status.goal_id.id == self._id:
            self._text = result.result.error_string or result.status.text
            self._state = result.status.status


@cache
def _generated() -> dict[str, Any]:
    """Return all classes by name."""
    line = "=" * 80
    parts = "".join(f"{line}\nMSG: {kind}\n{text}" for kind, text in _TEXTS.items())
    classes: dict[str, Any] = {}
    for kind in (GOAL, RESULT, STATUS, CANCEL):
        classes |= message_classes(kind, _TEXTS[kind] + parts)
    return classes


def action_message(kind: str) -> Any:  # noqa: ANN401 - a generated class
    """Return the class of a message, such as ``GOAL`` or ``"trajectory_msgs/JointTrajectoryPoint"``."""
    return _generated()[kind]
