"""The Kinova Gen2 driver (kinova-ros).

Source: Kinovarobotics/kinova-ros noetic-devel, kinova_driver/src.
"""

from __future__ import annotations

from typing import ClassVar

from dynid.drivers.interface import Driver


class KinovaGen2(Driver):
    """Jaco2, Mico2 and j2s7s300 through kinova-ros.

    The velocity is the firmware's value doubled by the driver and wrapped after doubling; it is not used unless asked
    for. Finger joints share the message with the arm. Topics of type kinova_msgs carry degrees and no time stamp.
    """

    kind: ClassVar[str] = "kinova_gen2"
    default_topics: ClassVar[tuple[str, ...]] = ("out/joint_state", "out/joint_states")
    velocity_trusted: ClassVar[bool] = False
    velocity_note: ClassVar[str] = "the Kinova driver doubles and wraps it"
    rate_fix: ClassVar[str] = (
        "relaunch: roslaunch kinova_bringup kinova_robot.launch feedback_publish_rate:=0.01 "
        "(an interval in s; USB reaches about 40-60 Hz, Ethernet 100 Hz)"
    )
    gravity_fix: ClassVar[str] = (
        "set the driver parameter publish_torque_with_gravity_compensation to false, "
        "or say `torque: {source: gravity_free}` in the robot file"
    )

    def ignores(self, name: str) -> bool:
        """Return whether the column is a finger."""
        return "finger" in name

    def type_note(self, kind: str) -> str:
        """Return what is wrong with the driver's own messages."""
        return (
            " (degrees, no time stamp)"
            if kind == "kinova_msgs/JointAngles"
            else " (no positions, no time stamp)"
            if kind.startswith("kinova_msgs/")
            else ""
        )
