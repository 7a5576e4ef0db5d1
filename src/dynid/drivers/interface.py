"""What is known of robot drivers: topics of joint states, which columns can be trusted, which port commands the arm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from dynid.drivers.command_port import CommandPort
from dynid.drivers.follow_joint_trajectory import FollowJointTrajectoryPort, choose_commands
from dynid.drivers.joint_trajectory import JointTrajectoryPort
from dynid.drivers.kinova_gen2 import KinovaGen2Port
from dynid.drivers.lwr4plus import Lwr4PlusPort
from dynid.drivers.ros import Node
from dynid.errors import TopicMissing, WrongMessageType
from dynid.robot import Robot
from dynid.text import shell

JOINT_STATE = "sensor_msgs/JointState"


class Driver:
    """Any node that publishes sensor_msgs/JointState; what is special of a known robot driver is a class of its own.

    Attributes:
        kind: its name in the robot file.
        port: what commands it; None where the controller that listens has to be found.
        default_topics: endings of the topics it publishes joint states on, the best first.
        velocity_trusted: whether the reported velocity is what the joint does.
        velocity_note: why not.
        rate_fix: how to make it publish faster.
        gravity_fix: how to make it publish the torque with gravity.
    """

    kind: ClassVar[str] = "generic"
    port: ClassVar[type[CommandPort] | None] = None
    default_topics: ClassVar[tuple[str, ...]] = ("joint_states", "joint_state")
    velocity_trusted: ClassVar[bool] = True
    velocity_note: ClassVar[str] = ""
    rate_fix: ClassVar[str] = "raise the driver's publishing rate"
    gravity_fix: ClassVar[str] = (
        "make the driver publish the measured torque, or say `torque: {source: gravity_free}` in the robot file"
    )

    def open_port(
        self,
        node: Node,
        robot: Robot,
        state_topic: str,
        command_topic: str | None = None,
        *,
        moving: bool = True,
    ) -> CommandPort:
        """Return the port through which the arm is commanded: the driver's, or that of the controller that listens.

        Args:
            node: this process in the ROS graph.
            robot: the arm.
            state_topic: topic of its joint states.
            command_topic: topic or action that it is commanded on; found when None.
            moving: whether it will be commanded.

        Raises:
            TopicMissing: several topics could be meant.
        """
        if self.port is not None:
            return self.port(node, robot, state_topic, command_topic)
        streamed = JointTrajectoryPort(node, robot, state_topic)
        if not moving:
            return streamed
        _, subscribed, _ = node.ask("getSystemState")
        types, heard = dict(node.ask("getTopicTypes")), {name for name, _ in subscribed}
        topic, goals = choose_commands(types, heard, command_topic, streamed.command_topic)
        return (FollowJointTrajectoryPort if goals else JointTrajectoryPort)(
            node, robot, state_topic, topic
        )

    def ignores(self, name: str) -> bool:
        """Return whether a column is known not to be a joint of the arm."""
        return False

    def choose_topic(
        self, topics: Mapping[str, str], asked: str | None, robot: Robot, bag: str
    ) -> str:
        """Return the topic to read.

        Args:
            topics: message type of every topic in the bag.
            asked: the topic that the user named, None to choose.
            robot: the robot, whose file may name a topic.
            bag: name of the bag, for messages.

        Raises:
            TopicMissing: the topic is not there, or several could be meant.
            WrongMessageType: the topic does not hold joint states.
        """
        wanted = asked or robot.columns.topic
        states = [name for name, kind in topics.items() if kind == JOINT_STATE]
        better = shell("--topic", states[0]) if states else "record the driver's joint state topic"
        if wanted is None:
            usual = [
                name for ending in self.default_topics for name in states if name.endswith(ending)
            ]
            if len(states) == 1 or len(set(usual)) == 1:
                return (usual or states)[0]
            text, fix = f"{bag} has no {JOINT_STATE} topic; it has {_listed(topics)}", better
            if states:
                text = f"{bag} has several joint state topics: {', '.join(states)}"
                fix = f"name one of them: {better}"
            raise TopicMissing(text, where=bag, fix=fix)
        if wanted not in topics:
            text = f"topic '{wanted}' is not in {bag}; it has {_listed(topics)}"
            fix = better if len(states) == 1 else "name one of them with --topic"
            raise TopicMissing(text, where=bag, fix=fix)
        if topics[wanted] != JOINT_STATE:
            instead = f"use {states[0]}" if states else f"{bag} has no {JOINT_STATE} topic"
            raise WrongMessageType(
                f"{wanted} is {topics[wanted]}{self.type_note(topics[wanted])}; {instead}",
                where=bag,
                fix=better,
            )
        return wanted

    def type_note(self, kind: str) -> str:
        """Return what is wrong with a message type, in brackets, or an empty text."""
        return ""


def _listed(topics: Mapping[str, str]) -> str:
    shown = [f"{name} ({kind.split('/')[-1]})" for name, kind in topics.items()]
    # Why: a bag of a complete robot has a hundred topics; only joint states are needed.
    shown.sort(key=lambda text: "JointState)" not in text)
    more = f" and {len(shown) - 8} more" if len(shown) > 8 else ""
    return (", ".join(shown[:8]) + more) if shown else "no messages"


class Lwr4Plus(Driver):
    """LWR4+ through any of its ROS drivers.

    FRI sends no velocity: every driver differentiates, two of them with a lag of four cycles. Two drivers put the
    estimated *external* torque into ``effort``, which is near zero in free motion. ros_control publishes the joints in
    alphabetical order, so the elbow e1 comes last although it is the third joint.
    """

    kind = "lwr4plus"
    port = Lwr4PlusPort
    default_topics = ("lwr/joint_states", "joint_states")
    velocity_trusted = False
    velocity_note = "FRI sends none; the driver differentiates with a lag"
    gravity_fix = (
        "log the measured torque (FRI msrJntTrq; port JointTorqueAct of rtt_lwr), not the estimated external one, "
        "or say `torque: {source: gravity_free}` in the robot file"
    )


class KinovaGen2(Driver):
    """Jaco2, Mico2 and j2s7s300 through kinova-ros.

    The velocity is the firmware's value doubled by the driver and wrapped after doubling; it is not used unless asked
    for. Finger joints share the message with the arm. Topics of type kinova_msgs carry degrees and no time stamp.
    """

    kind = "kinova_gen2"
    port = KinovaGen2Port
    default_topics = ("out/joint_state", "out/joint_states")
    velocity_trusted = False
    velocity_note = "the Kinova driver doubles and wraps it"
    rate_fix = (
        "relaunch: roslaunch kinova_bringup kinova_robot.launch feedback_publish_rate:=0.01 "
        "(an interval in s; USB reaches about 40-60 Hz, Ethernet 100 Hz)"
    )
    gravity_fix = (
        "set the driver parameter publish_torque_with_gravity_compensation to false, "
        "or say `torque: {source: gravity_free}` in the robot file"
    )

    def ignores(self, name: str) -> bool:
        """Return whether the column is a finger."""
        return "finger" in name

    def type_note(self, kind: str) -> str:
        """Return what is wrong with the driver's own messages."""
        if kind == "kinova_msgs/JointAngles":
            return " (degrees, no time stamp)"
        return " (no positions, no time stamp)" * kind.startswith("kinova_msgs/")


DRIVERS: dict[str, Driver] = {
    driver.kind: driver for driver in (KinovaGen2(), Lwr4Plus(), Driver())
}


def driver_of(robot: Robot) -> Driver:
    """Return the driver that the robot file names, the generic one when it names none."""
    return DRIVERS[robot.columns.kind]
