"""The drivers by the names that robot files use, with the one that nothing special is known of."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from dynid.drivers.command_port import CommandPort
from dynid.drivers.follow_joint_trajectory import FollowJointTrajectoryPort, choose_commands
from dynid.drivers.interface import Driver
from dynid.drivers.joint_trajectory import JointTrajectoryPort
from dynid.drivers.kinova_gen2 import KinovaGen2
from dynid.drivers.lwr4plus import Lwr4Plus
from dynid.drivers.ros import Node

if TYPE_CHECKING:
    from dynid.robot import Robot


class Generic(Driver):
    """Any node that publishes sensor_msgs/JointState."""

    kind: ClassVar[str] = "generic"

    def open_port(
        self, node: Node, robot: Robot, state_topic: str, command_topic: str | None = None, *, moving: bool = True
    ) -> CommandPort:
        """Return the port of the controller that listens: a stream of points, or the goal of an action."""
        streamed = JointTrajectoryPort(node, robot, state_topic)
        if not moving:
            return streamed
        _, subscribed, _ = node.master().getSystemState()
        types, heard = dict(node.master().getTopicTypes()), {name for name, _ in subscribed}
        topic, goals = choose_commands(types, heard, command_topic, streamed.command_topic)
        return (FollowJointTrajectoryPort if goals else JointTrajectoryPort)(node, robot, state_topic, topic)


DRIVERS: dict[str, Driver] = {driver.kind: driver for driver in (KinovaGen2(), Lwr4Plus(), Generic())}


def driver_of(robot: Robot) -> Driver:
    """Return the driver that the robot file names, the generic one when it names none."""
    return DRIVERS[robot.driver.kind if robot.driver else "generic"]
