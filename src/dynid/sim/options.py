"""What may be wanted of a simulated driver, declared once for the command line, notebooks and the reference."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dynid.options import LEAST, Options, option


@dataclass(frozen=True)
class SimDriverOptions(Options):
    """What is simulated, and how well it measures."""

    rate: float = option(100.0, "Rate of the joint states [Hz].", bounds=(1, 1000))
    topic: str | None = option(None, "Topic of the joint states (default: the robot file's).")
    master: str | None = option(None, "Address of the ROS master (default: ROS_MASTER_URI).")
    pose: str | None = option(
        None,
        "Where the arm stands: at the start of a trajectory, or at DH positions [rad or m].",
        metavar="TRAJECTORY|Q1,Q2,...",
    )
    truth: Path | None = option(
        None,
        "Truth file of the simulated arm (default: the one that ships for the robot).",
        kind="input",
    )
    torque_noise: float | None = option(
        None,
        "Standard deviation of all torques [N m] (default: the truth file's).",
        bounds=(0, None),
    )
    torque_step: float = option(0.0, "Resolution of the torques [N m].", bounds=(0, None))
    torque_offset: float = option(0.0, "Offset of all torque sensors until they are zeroed [N m].")
    position_step: float | None = option(
        None,
        "Resolution of the encoders [rad] (default: the truth file's).",
        bounds=(0, None),
    )
    latency: float = option(0.0, "Time from sampling to publishing [s].", bounds=(0, 1))
    jitter: float = option(0.0, "Standard deviation added to the latency [s].", bounds=(0, 1))
    drop: float = option(0.0, "Share of the messages that are lost.", bounds=(0, 1))
    skew: float = option(
        0.0,
        "How much later than the position torque and velocity are polled [s] (Kinova).",
        bounds=(0, 1),
    )
    duration: float | None = option(
        None,
        "Length of the simulation [s] (default: until Ctrl-C).",
        bounds=(LEAST, None),
    )
    seed: int = option(0, "Seed of all noise.")
