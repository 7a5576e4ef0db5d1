"""Commanding a Kinova Gen2: joint velocities in deg/s at exactly 100 Hz, with its stop, start and zeroing services.

The firmware plays one velocity every 10 ms from a queue of 2000: faster publishing would keep the arm moving after the
stream has ended, slower publishing moves it too slowly. Source: Kinovarobotics/kinova-ros, kinova_driver/src.
"""

from __future__ import annotations

import contextlib
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from dynid.drivers.kinova_msgs import message, service
from dynid.drivers.live import LivePort, Target
from dynid.errors import ServiceMissing

Floats = NDArray[np.float64]

#: Velocity streaming drifts; the position error is fed back so slowly that encoder noise does not shake the arm [1/s].
DRIFT_GAIN = 1.0
#: Velocities change by this share of the acceleration limit at most: they are rounded to 32 bits on the way.
SLEW_SHARE = 0.999
_GRAVITY = "torque_parameters/publish_torque_with_gravity_compensation"


class KinovaGen2Live(LivePort):
    """kinova-ros through ``in/joint_velocity``."""

    rate: ClassVar[float] = 100.0
    #: A velocity is held for a period, so it is that of the period's middle [s].
    lead: ClassVar[float] = 0.005
    slotted: ClassVar[bool] = True
    stop_words: ClassVar[str] = "in/stop was tried and works"
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
        return message("JointVelocity")

    def message(self, target: Target, measured: Floats) -> Any:  # noqa: ANN401
        """Return the velocity of this period, drift corrected, inside the joints' velocity and acceleration limits."""
        fastest, hardest = (
            np.array([getattr(joint.limits, key) or np.inf for joint in self.robot.joints])
            for key in ("velocity", "acceleration")
        )
        wanted = np.clip(target.qd + DRIFT_GAIN * (target.q - measured), -fastest, fastest)
        # Why: after a late period the plan has moved on by two; the arm gets there at the acceleration it can bear.
        step = SLEW_SHARE * hardest / self.rate
        speed = self._speed + np.clip(wanted - self._speed, -step, step)
        self._speed = speed
        values = self.columns.in_degrees(speed).tolist()
        return self.command_type()(*values, *[0.0] * (7 - len(values)))

    def endpoints(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the velocity topic, and the services that stop and start."""
        return (self.command_topic,), tuple(f"{self.namespace}/in/{name}" for name in ("stop", "start"))

    def ready(self) -> None:
        """Connect, put the arm into position mode, and try the stop while it stands still.

        Why: a stop that was never tried is none; the connection it leaves open also outlives a master that dies.
        """
        super().ready()
        self._speed = np.zeros(self.robot.n)
        self._stop = self._proxy("Stop", "in/stop", persistent=True)
        self.stop()
        self.call(self._proxy("Start", "in/start"), f"{self.namespace}/in/start")
        mode = self._proxy("SetTorqueControlMode", "in/set_torque_control_mode")
        # Why: the driver's callback returns no value, so a call that worked is often reported as failed.
        with contextlib.suppress(ServiceMissing):
            self.call(mode, f"{self.namespace}/in/set_torque_control_mode", 0)

    def stop(self) -> str:
        """Call ``in/stop``, which erases queued points and holds until ``in/start``."""
        return str(self.call(self._stop, f"{self.namespace}/in/stop").stop_result)

    def gravity_removed(self) -> bool | None:
        """Return the driver's parameter publish_torque_with_gravity_compensation."""
        name = f"{self.namespace}/{_GRAVITY}"
        master = self.node.master()
        return bool(master.getParam(name)) if master.hasParam(name) else None

    def zero_torques(self) -> None:
        """Call ``in/set_zero_torques``."""
        self.call(self._proxy("ZeroTorques", "in/set_zero_torques"), f"{self.namespace}/in/set_zero_torques")

    def _proxy(self, kind: str, name: str, *, persistent: bool = False) -> Any:  # noqa: ANN401
        return self.node.rospy.ServiceProxy(f"{self.namespace}/{name}", service(kind), persistent=persistent)
