"""How an arm is commanded, stopped and asked while it moves: one port per driver behind one interface."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from dynid.arrays import Floats
from dynid.drivers.joint_state import Columns
from dynid.drivers.ros import Node, within
from dynid.errors import DynidError, ServiceMissing, TopicSilent
from dynid.robot import Robot

#: A service of a driver on the same network answers in milliseconds; a stop may not take longer [s].
SERVICE_PATIENCE = 1.5
#: A subscriber of the command topic is connected within this time [s].
CONNECT_PATIENCE = 3.0
#: The first command of a stream leaves this long after it begins [s].
RUN_UP = 0.05
#: How often a waiting thread looks [s].
LOOK = 0.005


def wait_until(done: Callable[[], Any], patience: float, late: DynidError) -> None:
    """Wait until something is done, and raise ``late`` after so long [s]."""
    end = time.monotonic() + patience
    while not done():
        if time.monotonic() > end:
            raise late
        time.sleep(LOOK)


@dataclass(frozen=True)
class Target:
    """Where the arm shall be now, in DH quantities.

    Attributes:
        q: (n,) [rad or m].
        qd: (n,) [rad/s or m/s].
        qdd: (n,) [rad/s^2 or m/s^2].
    """

    q: Floats
    qd: Floats
    qdd: Floats


class CommandPort(ABC):
    """A driver that can be commanded.

    Args:
        node: this process in the graph.
        robot: the arm.
        state_topic: topic of its joint states.
        command_topic: topic it is commanded on; the driver's own when None.

    Attributes:
        rate: rate at which it wants to be commanded [Hz].
        lead: how far ahead of now a target is meant [s].
        slotted: whether it plays one command in each period, in whatever rhythm they come.
        stop_words: how it is stopped and what is known about that before the motion, for a message.
    """

    rate: ClassVar[float] = 100.0
    lead: ClassVar[float] = 0.0
    slotted: ClassVar[bool] = False
    stop_words: ClassVar[str]

    def __init__(
        self, node: Node, robot: Robot, state_topic: str, command_topic: str | None = None
    ) -> None:
        self.node, self.robot, self.state_topic = node, robot, state_topic
        self.command_topic = command_topic or self.default_command_topic()
        self.columns = Columns(robot)
        self.publisher: Any = None

    @property
    def namespace(self) -> str:
        """Namespace that the driver's topics share: that of its joint states."""
        return self.state_topic.rsplit("/", 1)[0]

    @abstractmethod
    def default_command_topic(self) -> str:
        """Return the topic that the driver is commanded on."""

    @abstractmethod
    def command_type(self) -> Any:  # noqa: ANN401 - a generated class
        """Return the class of the command messages."""

    @abstractmethod
    def message(self, target: Target, measured: Floats) -> Any:  # noqa: ANN401
        """Return the one command of this period; None where there is none.

        Args:
            target: where the arm shall be ``lead`` seconds from now.
            measured: where it was last seen, (n,) [rad or m].
        """

    @abstractmethod
    def stop(self) -> str:
        """Stop the arm and return what the driver answered.

        Raises:
            ServiceMissing: the driver did not answer.
        """

    def parameters(self) -> dict[str, Any]:
        """Return what the driver's parameters say about the numbers it publishes."""
        values = self.node.parameter(self.namespace) if self.namespace else {}
        return values if isinstance(values, dict) else {}

    def gravity_removed(self) -> bool | None:
        """Return whether the driver says that its torques lack gravity; None when it does not say."""
        return None

    def ready(self) -> None:
        """Make sure that the driver listens and can be stopped, before anything moves.

        Raises:
            TopicSilent: nobody listens to the commands.
            ServiceMissing: the stop does not answer.
        """
        no_answer = TopicSilent(
            f"nobody listens to {self.command_topic}",
            where=self.command_topic,
            why="commands would go nowhere",
            fix="is the driver's controller for that topic running?",
        )
        # Why: without a queue a command leaves when it is published, or not at all; none waits for the next.
        self.publisher = self.connected(self.command_topic, self.command_type(), no_answer, None)

    def endpoints(self) -> list[str]:
        """Return what the driver must have to be moved and stopped: ``topic`` or ``service``, and its name."""
        return [f"topic {self.command_topic}"]

    def missing(self) -> list[str]:
        """Return which of them the master does not know; nothing is sent."""
        _, subscribed, offered = self.node.ask("getSystemState")
        known = {f"topic {name}" for name, _ in subscribed} | {f"service {x}" for x, _ in offered}
        return [each for each in self.endpoints() if each not in known]

    def connected(
        self,
        topic: str,
        kind: Any,  # noqa: ANN401
        failure: DynidError | None = None,
        queue_size: int | None = 10,
    ) -> Any:  # noqa: ANN401
        """Return a publisher that somebody listens to.

        Args:
            topic: where it publishes.
            kind: class of its messages.
            failure: raised where nobody does; ``ServiceMissing`` when None.
            queue_size: of the publisher.
        """
        publisher = self.node.rospy.Publisher(topic, kind, queue_size=queue_size, tcp_nodelay=True)
        late = failure or ServiceMissing(f"nobody listens to {topic}", where=topic)
        wait_until(publisher.get_num_connections, CONNECT_PATIENCE, late)
        return publisher

    def require_listener(self, publisher: Any) -> None:  # noqa: ANN401
        """Raise when nobody listens any more to what stops the arm.

        Raises:
            ServiceMissing: the connection is gone.
        """
        if publisher.get_num_connections() == 0:
            topic = publisher.resolved_name
            raise ServiceMissing(f"nobody listens to {topic} any more", where=topic)

    def send(self, target: Target, measured: Floats) -> Any:  # noqa: ANN401
        """Publish the command of this period and return it; ``measured`` is the last seen pose, (n,) [rad or m]."""
        message = self.message(target, measured)
        if message is not None:
            self.publisher.publish(message)
        return message

    def begin(self, at: Callable[[float], Target], duration: float) -> tuple[float, Any]:
        """Send what the driver has to know of the whole motion.

        Args:
            at: the motion as a function of time.
            duration: its length [s].

        Returns:
            When the motion starts on the monotonic clock, and the message; None where every period has its command.
        """
        return time.monotonic() + RUN_UP, None

    def finish(self) -> None:
        """Wait until the driver says that the motion is over, where it says so."""
        return

    def at_rest(self, q: Floats) -> Any:  # noqa: ANN401
        """Publish a command that keeps the arm at rest at ``q``, (n,) [rad or m], and return it."""
        zero = np.zeros(self.robot.n)
        return self.send(Target(q, zero, zero), q)

    def zero_torques(self) -> None:
        """Zero the torque sensors where the arm stands.

        Raises:
            ServiceMissing: this driver cannot.
        """
        raise ServiceMissing(
            f"{type(self).__name__} has no service that zeroes torque sensors",
            fix="zero them by hand",
        )

    def call(self, proxy: Any, *request: Any) -> Any:  # noqa: ANN401
        """Call a service within a limit."""
        rospy, name = self.node.rospy, proxy.resolved_name
        try:
            return within(SERVICE_PATIENCE, lambda: proxy(*request))
        except (rospy.ServiceException, OSError, rospy.ROSException) as error:
            raise ServiceMissing(f"{name} did not answer ({error})", where=name) from error
