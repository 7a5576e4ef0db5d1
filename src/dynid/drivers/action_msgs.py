"""Messages of the FollowJointTrajectory action, made at run time: neither actionlib nor control_msgs has to be there.

Source: actionlib_msgs, control_msgs and trajectory_msgs of ROS 1; the checksums are compared when two nodes connect.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from dynid.drivers.ros import import_ros

GOAL = "control_msgs/FollowJointTrajectoryActionGoal"
RESULT = "control_msgs/FollowJointTrajectoryActionResult"
STATUS = "actionlib_msgs/GoalStatusArray"
CANCEL = "actionlib_msgs/GoalID"

#: States of a goal by the numbers of actionlib_msgs/GoalStatus.
STATES = (
    "pending", "active", "preempted", "succeeded", "aborted", "rejected", "preempting", "recalling", "recalled", "lost",
)  # fmt: skip
ACTIVE, PREEMPTED, SUCCEEDED, ABORTED, REJECTED, RECALLED, LOST = 1, 2, 3, 4, 5, 8, 9
#: A goal that has come to one of these moves nothing any more.
ENDED = (PREEMPTED, SUCCEEDED, ABORTED, REJECTED, RECALLED, LOST)

_NUMBERS = "".join(f"uint8 {name.upper()}={k}\n" for k, name in enumerate(STATES))
_ERRORS = (
    "SUCCESSFUL", "INVALID_GOAL", "INVALID_JOINTS", "OLD_HEADER_TIMESTAMP", "PATH_TOLERANCE_VIOLATED",
    "GOAL_TOLERANCE_VIOLATED",
)  # fmt: skip
_CODES = "".join(f"int32 {name}={-k}\n" for k, name in enumerate(_ERRORS))
_TEXTS = {
    "std_msgs/Header": "uint32 seq\ntime stamp\nstring frame_id\n",
    CANCEL: "time stamp\nstring id\n",
    "actionlib_msgs/GoalStatus": f"GoalID goal_id\nuint8 status\n{_NUMBERS}string text\n",
    "trajectory_msgs/JointTrajectoryPoint": (
        "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\n"
        "duration time_from_start\n"
    ),
    "trajectory_msgs/JointTrajectory": "Header header\nstring[] joint_names\nJointTrajectoryPoint[] points\n",
    "control_msgs/JointTolerance": "string name\nfloat64 position\nfloat64 velocity\nfloat64 acceleration\n",
    "control_msgs/FollowJointTrajectoryGoal": (
        "trajectory_msgs/JointTrajectory trajectory\nJointTolerance[] path_tolerance\nJointTolerance[] goal_tolerance\n"
        "duration goal_time_tolerance\n"
    ),
    "control_msgs/FollowJointTrajectoryResult": (f"int32 error_code\n{_CODES}string error_string\n"),
    GOAL: "Header header\nactionlib_msgs/GoalID goal_id\nFollowJointTrajectoryGoal goal\n",
    RESULT: "Header header\nactionlib_msgs/GoalStatus status\nFollowJointTrajectoryResult result\n",
    STATUS: "Header header\nGoalStatus[] status_list\n",
}


@cache
def _generated() -> dict[str, Any]:
    """Return all classes by name."""
    generate = import_ros("genpy.dynamic").generate_dynamic
    line = "=" * 80
    parts = "".join(f"{line}\nMSG: {kind}\n{text}" for kind, text in _TEXTS.items())
    found: dict[str, Any] = {}
    for kind in (GOAL, RESULT, STATUS, CANCEL):
        found |= generate(kind, _TEXTS[kind] + parts)
    return found


def action_message(kind: str) -> Any:  # noqa: ANN401 - a generated class
    """Return the class of a message, such as ``GOAL`` or ``"trajectory_msgs/JointTrajectoryPoint"``."""
    return _generated()[kind]
