"""Commanding through a JointTrajectory controller: one point a period, a short moment ahead, never a queue.

This is how the LWR4+ is moved in position mode through ros_control, and any arm with a joint_trajectory_controller.
Source: CentroEPiaggio/kuka-lwr, single_lwr_robot/config/controllers.yaml and lwr_hw/src/lwr_hw_fri_node.cpp.
"""

from __future__ import annotations

import time
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from dynid.drivers.live import LivePort, Target
from dynid.drivers.ros import import_ros
from dynid.errors import ServiceMissing, TopicSilent

Floats = NDArray[np.float64]


class JointTrajectoryLive(LivePort):
    """Any driver with a JointTrajectory topic beside its joint states."""

    rate: ClassVar[float] = 100.0
    #: The controller interpolates to a point so far ahead, as a command may be late before the run is stopped: the way
    #: never ends in between [s].
    lead: ClassVar[float] = 0.1
    stop_words: ClassVar[str] = "an empty trajectory holds the arm (a topic gives no answer)"

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
        point = import_ros("trajectory_msgs.msg").JointTrajectoryPoint()
        point.positions = self.columns.positions(target.q).tolist()
        point.velocities = self.columns.velocities(target.qd).tolist()
        point.accelerations = self.columns.velocities(target.qdd).tolist()
        point.time_from_start = import_ros("genpy").Duration.from_sec(self.lead)
        found = self.command_type()()
        found.joint_names, found.points = list(self.columns.names), [point]
        return found

    def stop(self) -> str:
        """Send an empty trajectory, which makes the controller hold where it is."""
        empty = self.command_type()()
        empty.joint_names = list(self.columns.names)
        self._require_listener()
        self.publisher.publish(empty)
        return "empty trajectory sent"

    def _require_listener(self) -> None:
        if self.publisher.get_num_connections() == 0:
            raise ServiceMissing(f"nobody listens to {self.command_topic} any more", where=self.command_topic)


class Lwr4PlusLive(JointTrajectoryLive):
    """LWR4+ in joint position control; it is stopped through the driver's emergency_stop topic."""

    stop_words: ClassVar[str] = "emergency_stop is connected (a topic gives no answer)"

    @property
    def stop_topic(self) -> str:
        """Topic of the software stop."""
        return f"{self.namespace}/emergency_stop"

    def endpoints(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the controller's topic and that of the software stop."""
        return (self.command_topic, self.stop_topic), ()

    def ready(self) -> None:
        """Connect to the controller and to the stop, and release a stop that is still pressed."""
        super().ready()
        self._bool = import_ros("std_msgs.msg").Bool
        self._stop = self.node.rospy.Publisher(self.stop_topic, self._bool, queue_size=10, tcp_nodelay=True)
        try:
            self.wait_for_listener(self._stop, self.stop_topic)
        except TopicSilent as error:
            raise ServiceMissing(f"nobody listens to {self.stop_topic}", where=self.stop_topic) from error
        self._stop.publish(self._bool(False))
        time.sleep(0.1)

    def stop(self) -> str:
        """Press the software stop: the controllers are reset and the arm holds until it is released."""
        if self._stop.get_num_connections() == 0:
            raise ServiceMissing(f"nobody listens to {self.stop_topic} any more", where=self.stop_topic)
        for _ in range(3):
            self._stop.publish(self._bool(True))
            time.sleep(0.02)
        # Why: a topic is not answered; that the connection outlived three messages is all that can be known.
        if self._stop.get_num_connections() == 0:
            raise ServiceMissing(f"the driver's connection on {self.stop_topic} is gone", where=self.stop_topic)
        return "emergency_stop is pressed; release it with: rostopic pub -1 " + f"{self.stop_topic} std_msgs/Bool false"
