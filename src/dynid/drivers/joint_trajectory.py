"""Commanding through a JointTrajectory controller: one point a period, a short moment ahead, never a queue.

This is how the LWR4+ is moved in position mode through ros_control, and any arm with a joint_trajectory_controller.
Source: CentroEPiaggio/kuka-lwr, single_lwr_robot/config/controllers.yaml and lwr_hw/src/lwr_hw_fri_node.cpp.
"""

from __future__ import annotations

from typing import Any

from dynid.arrays import Floats
from dynid.drivers.command_port import CommandPort, Target
from dynid.drivers.joint_state import Columns
from dynid.drivers.ros import import_ros


class JointTrajectoryPort(CommandPort):
    """Any driver with a JointTrajectory topic next to its joint states."""

    #: The controller interpolates to a point so far ahead, as a command may be late before the run is stopped: the way
    #: never ends in between [s].
    lead = 0.1
    stop_words = "an empty trajectory holds the arm (a topic gives no answer)"

    def default_command_topic(self) -> str:
        """Return the controller's command topic in the namespace of the joint states."""
        return f"{self.namespace}/joint_trajectory_controller/command"

    def command_type(self) -> Any:  # noqa: ANN401
        """Return trajectory_msgs/JointTrajectory."""
        return import_ros("trajectory_msgs.msg").JointTrajectory

    def message(self, target: Target, measured: Floats) -> Any:  # noqa: ANN401
        """Return a trajectory of one point; joints by name, all fields of full length.

        Why: a point without velocities is indexed unchecked by some drivers.
        """
        message = self.command_type()()
        message.joint_names = list(self.columns.names)
        message.points = [point_of(self.columns, target, self.lead)]
        return message

    def stop(self) -> str:
        """Send an empty trajectory, which makes the controller hold where it is."""
        empty = self.command_type()()
        empty.joint_names = list(self.columns.names)
        self.require_listener(self.publisher)
        self.publisher.publish(empty)
        return "empty trajectory sent"


def point_of(columns: Columns, target: Target, seconds: float) -> Any:  # noqa: ANN401
    """Return a point of a trajectory, so many seconds after its start, in the driver's columns."""
    point = import_ros("trajectory_msgs.msg").JointTrajectoryPoint()
    point.positions = columns.positions(target.q).tolist()
    point.velocities = columns.velocities(target.qd).tolist()
    point.accelerations = columns.velocities(target.qdd).tolist()
    point.time_from_start = import_ros("genpy").Duration.from_sec(seconds)
    return point
