"""A driver about which nothing special is known: a JointState with the robot's joint names."""

from __future__ import annotations

from typing import ClassVar

from dynid.drivers.interface import Driver


class Generic(Driver):
    """Any node that publishes sensor_msgs/JointState."""

    kind: ClassVar[str] = "generic"
