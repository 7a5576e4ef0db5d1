"""The Kinova Gen2 through kinova-ros: what it publishes, and joint velocities in deg/s at exactly 100 Hz.

The firmware plays one velocity every 10 ms from a queue of 2000: faster publishing would keep the arm moving after the
stream has ended, slower publishing moves it too slowly. Messages are made at run time: no catkin workspace is needed.
Source: Kinovarobotics/kinova-ros noetic-devel, kinova_driver/src, kinova_msgs/msg and kinova_msgs/srv.
"""

from __future__ import annotations

import contextlib
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.drivers.command_port import CommandPort, Target
from dynid.drivers.ros import import_ros, message_classes
from dynid.errors import ServiceMissing

#: Velocity streaming drifts; the position error is fed back so slowly that encoder noise does not shake the arm [1/s].
DRIFT_GAIN = 1.0
#: Velocities change by this share of the acceleration limit at most: they are rounded to 32 bits on the way.
SLEW_SHARE = 0.999
GRAVITY = "torque_parameters/publish_torque_with_gravity_compensation"
_SEVEN = "\n".join(f"float32 joint{i}" for i in range(1, 8)) + "\n"
_SERVICES = {
    "Stop": "---\nstring stop_result\n",
    "Start": "---\nstring start_result\n",
    "ZeroTorques": "---\n",
    "SetTorqueControlMode": "uint16 state\n---\n",
}


class KinovaGen2Port(CommandPort):
    """kinova-ros through ``in/joint_velocity``."""

    #: A velocity is held for a period, so it is that of the period's middle [s].
    lead = 0.005
    slotted = True
    stop_words = "in/stop was tried and works"
    _speed: Floats

    @property
    def namespace(self) -> str:
        """Namespace of the driver, such as ``/j2s7s300_driver``."""
        return self.state_topic.split("/out/")[0]

    def default_command_topic(self) -> str:
        """Return ``in/joint_velocity`` of the driver."""
        return f"{self.namespace}/in/joint_velocity"

    def command_type(self) -> Any:  # noqa: ANN401
        """Return kinova_msgs/JointVelocity."""
        return kinova_message("JointVelocity")

    def message(self, target: Target, measured: Floats) -> Any:  # noqa: ANN401
        """Return the velocity of this period, drift corrected, inside the joints' velocity and acceleration limits."""
        fastest, hardest = self.robot.limits("velocity"), self.robot.limits("acceleration")
        wanted = np.clip(target.qd + DRIFT_GAIN * (target.q - measured), -fastest, fastest)
        # Why: after a late period the plan has moved on by two; the arm gets there at the acceleration it can bear.
        step = SLEW_SHARE * hardest / self.rate
        self._speed = self._speed + np.clip(wanted - self._speed, -step, step)
        # Unit: degrees, whatever unit the joint states have.
        values = np.degrees(self._speed * self.columns.sign).tolist()
        return self.command_type()(*values, *[0.0] * (7 - len(values)))

    def endpoints(self) -> list[str]:
        """Return the velocity topic, and the services that stop and start."""
        services = [f"service {self.namespace}/in/{name}" for name in ("stop", "start")]
        return [*super().endpoints(), *services]

    def ready(self) -> None:
        """Connect, put the arm into position mode, and try the stop while it stands still.

        Why: a stop that was never tried is none; the connection it leaves open also outlives a master that dies.
        """
        super().ready()
        self._speed = np.zeros(self.robot.n)
        self._stop = self._proxy("Stop", "in/stop", persistent=True)
        self.stop()
        self.call(self._proxy("Start", "in/start"))
        # Why: the driver's callback returns no value, so a call that worked is often reported as failed.
        with contextlib.suppress(ServiceMissing):
            self.call(self._proxy("SetTorqueControlMode", "in/set_torque_control_mode"), 0)

    def stop(self) -> str:
        """Call ``in/stop``, which erases queued points and holds until ``in/start``."""
        return str(self.call(self._stop).stop_result)

    def gravity_removed(self) -> bool | None:
        """Return the driver's parameter publish_torque_with_gravity_compensation."""
        removed = self.node.parameter(f"{self.namespace}/{GRAVITY}")
        return None if removed is None else bool(removed)

    def zero_torques(self) -> None:
        """Call ``in/set_zero_torques``."""
        self.call(self._proxy("ZeroTorques", "in/set_zero_torques"))

    def _proxy(self, kind: str, name: str, *, persistent: bool = False) -> Any:  # noqa: ANN401
        return self.node.rospy.ServiceProxy(
            f"{self.namespace}/{name}", kinova_service(kind), persistent=persistent
        )


@cache
def kinova_message(name: str) -> Any:  # noqa: ANN401 - a generated class
    """Return the class of a message, such as ``"JointVelocity"``."""
    kind = f"kinova_msgs/{name}"
    return message_classes(kind, _SEVEN)[kind]


@cache
def kinova_service(name: str) -> Any:  # noqa: ANN401
    """Return the class of a service as rospy wants it: request and response classes and a checksum over both."""
    kind, text = f"kinova_msgs/{name}", _SERVICES[name]
    halves = {}
    for part, lines in zip(("Request", "Response"), text.split("---\n"), strict=True):
        halves[part] = message_classes(f"{kind}{part}", lines)[f"{kind}{part}"]
    genmsg = import_ros("genmsg")
    import_ros("genmsg.gentools")
    context = genmsg.msg_loader.MsgContext.create_default()
    spec = genmsg.msg_loader.load_srv_from_string(context, text, kind)
    return SimpleNamespace(
        _type=kind,
        _md5sum=genmsg.gentools.compute_md5(context, spec),
        _request_class=halves["Request"],
        _response_class=halves["Response"],
    )
