"""The KUKA LWR4+ over FRI: several drivers publish the same names with different meanings.

Source: CentroEPiaggio/kuka-lwr, epfl-lasa/kuka-lwr-ros, kuka-isir/rtt_lwr, RCPRG/lwr_hardware.
"""

from __future__ import annotations

from typing import ClassVar

from dynid.drivers.interface import Driver


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
