"""The KUKA LWR4+ over FRI: several drivers publish the same names with different meanings, one moves it.

Source: CentroEPiaggio/kuka-lwr, epfl-lasa/kuka-lwr-ros, kuka-isir/rtt_lwr, RCPRG/lwr_hardware.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, ClassVar

from dynid.drivers.command_port import CommandPort
from dynid.drivers.interface import Driver
from dynid.drivers.joint_trajectory import JointTrajectoryPort
from dynid.drivers.ros import Node, import_ros
from dynid.errors import ServiceMissing, TopicSilent

if TYPE_CHECKING:
    from dynid.robot import Robot


class Lwr4Plus(Driver):
    """LWR4+ through any of its ROS drivers.

    FRI sends no velocity: every driver differentiates, two of them with a lag of four cycles. Two drivers put the
    estimated *external* torque into ``effort``, which is near zero in free motion. ros_control publishes the joints in
    alphabetical order, so the elbow e1 comes last although it is the third joint.
    """

    kind: ClassVar[str] = "lwr4plus"
    default_topics: ClassVar[tuple[str, ...]] = ("lwr/joint_states", "joint_states")
    velocity_trusted: ClassVar[bool] = False
    velocity_note: ClassVar[str] = "FRI sends none; the driver differentiates with a lag"
    gravity_fix: ClassVar[str] = (
        "log the measured torque (FRI msrJntTrq; port JointTorqueAct of rtt_lwr), not the estimated external one, "
        "or say `torque: {source: gravity_free}` in the robot file"
    )

    def open_port(
        self, node: Node, robot: Robot, state_topic: str, command_topic: str | None = None, *, moving: bool = True
    ) -> CommandPort:
        """Return the port of the position controller."""
        return Lwr4PlusPort(node, robot, state_topic, command_topic)


class Lwr4PlusPort(JointTrajectoryPort):
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
