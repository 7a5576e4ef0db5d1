"""Torques that depend on one joint's position: ripple, springs and cables, stops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from dynid.model import tuning
from dynid.model.effects.interface import ArmMotion, Effect, Floats, Joints, Shape

#: Evenly spaced shapes from which turning one wave into the next is worth its rounding.
MANY = 8


def wave_shapes(
    motion: ArmMotion,
    joint: int,
    spacing: float = tuning.WAVE_SPACING_RAD,
    highest: float = tuning.FASTEST_WAVE,
) -> list[dict[str, float]]:
    """Return the frequencies of waves over one joint's position that its travel tells apart.

    Args:
        motion: the motion.
        joint: 0-based joint.
        spacing: phase over the travel between neighbours [rad].
        highest: fastest wave [1/rad].
    """
    travel = float(np.ptp(motion.q[:, joint]))
    if travel < tuning.STILL_JOINT_RAD:
        return []
    return [
        {"k": float(k)}
        for k in np.arange(tuning.SLOWEST_WAVE_PHASE_RAD / travel, highest, spacing / travel)
    ]


def waves(q: Floats, shapes: Sequence[Shape]) -> list[Floats]:
    """Return cos(k q) and sin(k q) of several shapes, each (2, N); of evenly spaced ones each turns the one before."""
    k = np.array([shape["k"] for shape in shapes])
    steps = np.diff(k)
    # Why not always: of what is not evenly spaced each needs its own, and of few each is more exact.
    if len(k) < MANY or not np.allclose(steps, steps[0], rtol=1e-9, atol=0.0):
        return [np.array([np.cos(one * q), np.sin(one * q)]) for one in k]
    wave, turn = np.exp(1j * k[0] * q), np.exp(1j * (k[1] - k[0]) * q)
    found = []
    for _ in k:
        found.append(np.stack([wave.real, wave.imag]))
        wave = wave * turn
    return found


class TorqueRipple(Effect):
    """Torque ripple (cogging, gear, sensor)."""

    name = "torque_ripple"
    title = "torque ripple (cogging, gear, sensor)"
    equation = "a cos(k q) + b sin(k q)"
    signature = "a wave over the joint's position, faster in time when the joint is faster"
    separate = "a slow, even motion over several waves"
    shape_units: ClassVar[dict[str, str]] = {"k": "1/rad"}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"k": ("plus", 0.1)}
    units: ClassVar[dict[str, str]] = {"a": "N m", "b": "N m"}

    trials = tuning.WAVES_THAT_MAY_FIT

    def grid(self, motion: ArmMotion, joints: Joints) -> list[dict[str, float]]:
        """Return the shapes that are tried."""
        return wave_shapes(motion, joints[0])

    def tried(self, motion: ArmMotion, joints: Joints, shapes: Sequence[Shape]) -> list[Floats]:
        """Return the columns of several shapes."""
        return [wave[:, None] for wave in waves(motion.q[:, joints[0]], shapes)]

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return self.tried(motion, joints, [shape])[0]


class Spring(Effect):
    """Spring or cable torque."""

    name = "spring"
    title = "spring or cable torque"
    equation = "k1 q (+ k2 q^2 + k3 q^3) + c"
    signature = "rises over the joint's travel: one sign at one end, the other at the other end"
    separate = "dwell at both ends of the travel"
    family = "position torque"
    shape_units: ClassVar[dict[str, str]] = {"order": "", "constant": ""}

    def grid(self, motion: ArmMotion, joints: Joints) -> list[dict[str, float]]:
        """Return the shapes that are tried; the constant only where the joint has no offset of its own."""
        constant = 0.0 if "offset" in motion.robot.joints[joints[0]].friction else 1.0
        return [{"order": 1.0, "constant": constant}, {"order": 3.0, "constant": constant}]

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        powers = range(1, round(shape["order"]) + 1)
        found = {f"k{i}": f"N m/rad^{i}" if i > 1 else "N m/rad" for i in powers}
        return found | ({"c": "N m"} if shape["constant"] else {})

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        q = motion.q[:, joints[0]]
        powers = [q**i for i in range(1, round(shape["order"]) + 1)]
        return np.array([*powers, *([np.ones_like(q)] if shape["constant"] else [])])[:, None]


class Counterbalance(Effect):
    """Counterbalance of an axis, by a spring or a cylinder."""

    name = "counterbalance"
    title = "counterbalance (spring or cylinder)"
    equation = "a sin(q) + b cos(q)"
    signature = (
        "one wave over a whole turn of the joint, wherever the other joints are; carries "
        "weight that no link has"
    )
    separate = "turn the joint through its whole travel with the arm folded and stretched, which changes gravity alone"
    uses = ("arm",)
    family = "position torque"
    units: ClassVar[dict[str, str]] = {"a": "N m", "b": "N m"}

    def grid(self, motion: ArmMotion, joints: Joints) -> list[dict[str, float]]:
        """Return the shapes that are tried: none where the joint does not turn."""
        return [{}] if motion.robot.joints[joints[0]].revolute else []

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        q = motion.q[:, joints[0]]
        return np.array([np.sin(q), np.cos(q)])[:, None]


class EndStop(Effect):
    """One-sided stop or cable that snags."""

    name = "end_stop"
    title = "one-sided stop or cable that snags"
    equation = "a max(0, side (q - q1))"
    signature = "only at one end of the joint's travel, the same both ways"
    separate = "pass q1 often and from both sides"
    family = "position torque"
    shape_units: ClassVar[dict[str, str]] = {"side": "", "q1": "rad"}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"q1": ("plus", 0.1)}
    units: ClassVar[dict[str, str]] = {"a": "N m/rad"}

    def grid(self, motion: ArmMotion, joints: Joints) -> list[dict[str, float]]:
        """Return the shapes that are tried."""
        points = np.quantile(motion.q[:, joints[0]], np.linspace(0.15, 0.85, 9))
        return [{"side": side, "q1": float(q1)} for side in (-1.0, 1.0) for q1 in points]

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return np.maximum(0.0, shape["side"] * (motion.q[:, joints[0]] - shape["q1"]))[None, None]
