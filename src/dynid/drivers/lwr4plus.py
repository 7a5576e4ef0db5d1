"""The KUKA LWR4+ over FRI: several drivers publish the same names with different meanings, one moves it.

Source: CentroEPiaggio/kuka-lwr, epfl-lasa/kuka-lwr-ros, kuka-isir/rtt_lwr, RCPRG/lwr_hardware.
"""

from __future__ import annotations

import time

from dynid.drivers.joint_trajectory import JointTrajectoryPort
from dynid.drivers.ros import import_ros


class Lwr4PlusPort(JointTrajectoryPort):
    """LWR4+ in joint position control; it is stopped through the driver's emergency_stop topic."""

    stop_words = "emergency_stop is connected (a topic gives no answer)"

    @property
    def stop_topic(self) -> str:
        """Topic of the software stop."""
        return f"{self.namespace}/emergency_stop"

    def endpoints(self) -> list[str]:
        """Return the controller's topic and that of the software stop."""
        return [*super().endpoints(), f"topic {self.stop_topic}"]

    def ready(self) -> None:
        """Connect to the controller and to the stop, and release a stop that is still pressed."""
        super().ready()
        self._stop = self.connected(self.stop_topic, import_ros("std_msgs.msg").Bool)
        self._stop.publish(False)
        time.sleep(0.1)

    def stop(self) -> str:
        """Press the software stop: the controllers are reset and the arm holds until it is released."""
        self.require_listener(self._stop)
        for _ in range(3):
            self._stop.publish(True)
            time.sleep(0.02)
        # Why: a topic is not answered; that the connection outlived three messages is all that can be known.
        self.require_listener(self._stop)
        release = f"rostopic pub -1 {self.stop_topic} std_msgs/Bool false"
        return f"emergency_stop is pressed; release it with: {release}"
