"""The ROS side of a simulated arm: the topics, types, names, units and quirks of one driver each.

Source: kinova-ros for the Gen2; CentroEPiaggio/kuka-lwr (ros_control over FRI) for the LWR4+.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, cast

import numpy as np

from dynid.arrays import Floats
from dynid.drivers.follow_joint_trajectory import (
    ACTIVE,
    CANCEL,
    GOAL,
    PREEMPTED,
    RESULT,
    STATUS,
    SUCCEEDED,
    action_message,
)
from dynid.drivers.joint_state import Columns
from dynid.drivers.kinova_gen2 import GRAVITY, kinova_message, kinova_service
from dynid.drivers.ros import Node, import_ros
from dynid.sim import tuning
from dynid.sim.driver_loop import DriverLoop, Measured
from dynid.sim.follow import Point


class SimulatedDriver(ABC):
    """A driver as other nodes see it.

    Args:
        node: this process in the graph.
        loop: the simulation.
        topic: topic of the joint states.
    """

    def __init__(self, node: Node, loop: DriverLoop, topic: str) -> None:
        self.node, self.loop, self.topic = node, loop, topic
        self.robot, self.follower = loop.robot, cast(Any, loop.follower)
        self.columns = Columns(self.robot)
        self._state = import_ros("sensor_msgs.msg").JointState
        self._began = time.time_ns()
        self._publisher = self.publisher(topic, self._state)
        self.connect()

    @abstractmethod
    def connect(self) -> None:
        """Listen to what commands the arm."""

    def publisher(self, topic: str, kind: Any) -> Any:  # noqa: ANN401
        """Return a publisher that never blocks the physics."""
        return self.node.rospy.Publisher(topic, kind, queue_size=1000, tcp_nodelay=True)

    def subscribe(self, topic: str, kind: Any, callback: Any) -> None:  # noqa: ANN401
        """Listen to commands."""
        self.node.rospy.Subscriber(topic, kind, callback, queue_size=None, tcp_nodelay=True)

    def publish(self, measured: Measured) -> None:
        """Publish one sample."""
        self._publisher.publish(self.state(measured))

    @abstractmethod
    def state(self, measured: Measured) -> Any:  # noqa: ANN401
        """Return the joint state of a sample."""

    def _joint_state(self, names: Sequence[str], elapsed: float, *values: Floats) -> Any:  # noqa: ANN401
        """Return the message of positions, velocities and efforts at a time since the start [s]."""
        message, stamp = self._state(), self._began + round(elapsed * 1e9)
        message.header.stamp.secs, message.header.stamp.nsecs = divmod(stamp, 10**9)
        message.name = list(names)
        # Unit: both arms send 32-bit numbers.
        message.position, message.velocity, message.effort = (
            part.astype(np.float32).astype(float).tolist() for part in values
        )
        return message

    def _driver_values(self, measured: Measured) -> tuple[Floats, Floats, Floats]:
        of = self.columns
        return of.positions(measured.q), of.velocities(measured.qd), of.efforts(measured.tau)


class SimulatedKinova(SimulatedDriver):
    """kinova-ros: 13 names, velocities in deg/s, stop and start as services."""

    FINGERS = ("finger_1", "finger_2", "finger_3", "finger_tip_1", "finger_tip_2", "finger_tip_3")

    def connect(self) -> None:
        """Listen to velocities, and offer the services."""
        self.namespace = self.topic.split("/out/")[0]
        prefix = self.columns.names[0].removesuffix("1")
        self._names = [*self.columns.names, *(prefix + finger for finger in self.FINGERS)]
        rospy = self.node.rospy
        rospy.set_param(f"{self.namespace}/{GRAVITY}", False)
        velocity = kinova_message("JointVelocity")
        self.subscribe(f"{self.namespace}/in/joint_velocity", velocity, self._velocity)
        services: dict[str, tuple[Any, ...]] = {
            "start": ("Start", self.follower.start, "Arm started"),
            "stop": ("Stop", self.follower.stop, "Arm stopped"),
            "set_zero_torques": ("ZeroTorques", self.loop.zero_torques),
            "set_torque_control_mode": ("SetTorqueControlMode", lambda: None),
        }
        for name, what in services.items():
            answer, kind = partial(self._serve, *what), kinova_service(what[0])
            rospy.Service(f"{self.namespace}/in/{name}", kind, answer)

    def state(self, measured: Measured) -> Any:  # noqa: ANN401
        """Return the joint state with fingers; its stamp is wall time, taken before torques are polled."""
        fingers = np.zeros(len(self.FINGERS))
        q, qd, tau = self._driver_values(measured)
        values = (np.concatenate([part, fingers]) for part in (q, doubled(qd), tau))
        return self._joint_state(self._names, measured.elapsed, *values)

    def _velocity(self, command: Any) -> None:  # noqa: ANN401
        values = np.array([getattr(command, f"joint{i}") for i in range(1, self.robot.n + 1)])
        self.follower.push(np.radians(values) * self.columns.sign)

    def _serve(self, kind: str, do: Callable[[], None], *said: Any) -> Any:  # noqa: ANN401
        """Do what a service is for; the request is the last argument."""
        do()
        return kinova_service(kind)._response_class(*said[:-1])


def doubled(qd: Floats) -> Floats:
    """Return velocities, (n,) [rad/s], as kinova-ros publishes them: doubled, then wrapped above 180 deg/s."""
    degrees = 2 * np.degrees(qd)
    return np.radians(np.where(degrees > 180, degrees - 360, degrees))


class SimulatedController(SimulatedDriver):
    """Any driver with joint states and a joint_trajectory_controller."""

    def connect(self) -> None:
        """Listen to trajectories."""
        self.namespace = self.topic.rsplit("/", 1)[0]
        kind = import_ros("trajectory_msgs.msg").JointTrajectory
        commands = f"{self.namespace}/joint_trajectory_controller/command"
        self.subscribe(commands, kind, self._trajectory)

    def state(self, measured: Measured) -> Any:  # noqa: ANN401
        """Return the joint state in chain order with wall time."""
        values = self._driver_values(measured)
        return self._joint_state(self.columns.names, measured.elapsed, *values)

    def points(self, trajectory: Any) -> list[Point]:  # noqa: ANN401
        """Return DH position and velocity of each point, (n,) each, and its time from the start [s]."""
        where = [trajectory.joint_names.index(name) for name in self.columns.names]
        return [
            (
                self.columns.positions_dh(np.array(point.positions)[where]),
                self.columns.velocities_dh(np.array(point.velocities)[where]),
                point.time_from_start.to_sec(),
            )
            for point in trajectory.points
        ]

    def _trajectory(self, command: Any) -> None:  # noqa: ANN401
        if command.points:
            self.follower.push(self.points(command)[-1])
        else:
            self.follower.hold()


class SimulatedActionServer(SimulatedController):
    """The same with the controller's FollowJointTrajectory action, which takes one goal at a time."""

    #: Status messages [Hz], as actionlib's server publishes them.
    STATUS_RATE = 5.0

    def connect(self) -> None:
        """Listen to goals too."""
        super().connect()
        base = f"{self.namespace}/joint_trajectory_controller/follow_joint_trajectory"
        self._goal: Any = None
        self._last_status = -1.0
        # Why: goals come in threads of their own, while the physics looks whether they are reached.
        self._turn = threading.RLock()
        self._statuses = self.publisher(f"{base}/status", action_message(STATUS))
        self._results = self.publisher(f"{base}/result", action_message(RESULT))
        self.subscribe(f"{base}/goal", action_message(GOAL), self._begin)
        self.subscribe(f"{base}/cancel", action_message(CANCEL), self._cancel)

    def publish(self, measured: Measured) -> None:
        """Publish the joint state, and how the goal stands."""
        super().publish(measured)
        with self._turn:
            if self._goal is not None:
                self._look()
            if measured.elapsed - self._last_status >= 1 / self.STATUS_RATE:
                self._last_status = measured.elapsed
                self._publish_status(ACTIVE)

    def _look(self) -> None:
        """See how the goal stands."""
        if not self.follower.following:
            self._end(SUCCEEDED, "")

    def _begin(self, goal: Any) -> None:  # noqa: ANN401
        points = self.points(goal.goal.trajectory)
        with self._turn:
            if self._goal is not None:
                self._end(PREEMPTED, "another goal came")
            self._goal = goal.goal_id
            self.follower.play(points)
            self._publish_status(ACTIVE)

    def _cancel(self, cancel: Any) -> None:  # noqa: ANN401
        with self._turn:
            if self._goal is None or cancel.id not in ("", self._goal.id):
                return
            self.follower.hold()
            self._end(PREEMPTED, "cancelled")

    def _end(self, state: int, text: str) -> None:
        result = action_message(RESULT)()
        result.status.goal_id, result.status.status, result.status.text = self._goal, state, text
        self._publish_status(state, text)
        self._results.publish(result)
        self._goal = None

    def _publish_status(self, state: int, text: str = "") -> None:
        message = action_message(STATUS)()
        if self._goal is not None:
            status = action_message("actionlib_msgs/GoalStatus")()
            status.goal_id, status.status, status.text = self._goal, state, text
            message.status_list = [status]
        self._statuses.publish(message)


class SimulatedLwr(SimulatedController):
    """LWR4+ through ros_control: alphabetical names, stamps of the monotonic clock, a differentiated velocity."""

    def connect(self) -> None:
        """Listen to the software stop too."""
        super().connect()
        self._began = time.monotonic_ns()
        self._order = np.argsort(self.columns.names)
        self._names = [self.columns.names[i] for i in self._order]
        self._before: tuple[float, Floats, Floats] | None = None
        kind = import_ros("std_msgs.msg").Bool
        self.subscribe(f"{self.namespace}/emergency_stop", kind, self._stop)

    def state(self, measured: Measured) -> Any:  # noqa: ANN401
        """Return the joint state as hardware_interface's std::map orders it."""
        q, _, tau = self._driver_values(measured)
        qd = self._differentiated(measured.elapsed, q)
        values = (each[self._order] for each in (q, qd, tau))
        return self._joint_state(self._names, measured.elapsed, *values)

    def _differentiated(self, elapsed: float, q: Floats) -> Floats:
        then, old, speed = self._before or (elapsed, q, np.zeros_like(q))
        if elapsed > then:
            speed = speed + tuning.FRI_SMOOTHING * ((q - old) / (elapsed - then) - speed)
        self._before = (elapsed, q, speed)
        return speed

    def _stop(self, pressed: Any) -> None:  # noqa: ANN401
        (self.follower.stop if pressed.data else self.follower.start)()


def simulated_driver(node: Node, loop: DriverLoop, topic: str) -> SimulatedDriver:
    """Return the simulation of the driver that the robot file names."""
    drivers = {"kinova_gen2": SimulatedKinova, "lwr4plus": SimulatedLwr}
    return drivers.get(loop.robot.columns.kind, SimulatedActionServer)(node, loop, topic)
