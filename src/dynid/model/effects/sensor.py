"""What sensors make of torque and position: offsets, gains, drift, delay, cross-talk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Joints, Shape

#: Smallest step of a difference [rad].
STEP = 1e-5


class TorqueOffset(Effect):
    """Torque offset, or Coulomb friction that differs with the direction."""

    name = "torque_offset"
    title = "torque offset, or Coulomb friction that differs with the direction"
    equation = "c"
    signature = "constant, whatever the joint does"
    separate = (
        "a wide travel; a rest approached from both sides tells an offset from one-sided friction"
    )
    family = "position torque"
    units: ClassVar[dict[str, str]] = {"c": "N m"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return np.ones((1, 1, len(motion)))


class TorqueGain(Effect):
    """Gain error of one joint's torque sensor."""

    name = "torque_gain"
    title = "gain error of one joint's torque sensor"
    equation = "g tau"
    signature = "in proportion to the joint's own torque, and in the joints whose model shares its parameters"
    separate = "a known payload, or a second sensor; a gain common to all joints cannot be seen without one"
    needs_model = True
    units: ClassVar[dict[str, str]] = {"g": ""}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return motion.total[:, joints[0]][None, None]


class TorqueConstant(Effect):
    """Torque constant that changes with speed."""

    name = "torque_constant"
    title = "torque constant that changes with speed"
    equation = "c |qd| tau"
    signature = "in proportion to the joint's own torque where it is fast, nothing where it is slow"
    separate = "the same load carried slowly and fast, with and against gravity"
    needs_model = True
    family = "load"
    units: ClassVar[dict[str, str]] = {"c": "s/rad"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return (np.abs(motion.qd[:, joints[0]]) * motion.total[:, joints[0]])[None, None]


class TorqueDrift(Effect):
    """Drift of the torque sensor."""

    name = "torque_drift"
    title = "drift of the torque sensor"
    equation = "a tc (1 - exp(-t / tc)); a t for a long tc"
    signature = "the mean of the residual moves with time and with nothing else"
    separate = "repeat the same motion minutes apart"
    family = "time"
    shape_units: ClassVar[dict[str, str]] = {"tc": "s"}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"tc": ("times", 1.4)}
    simple: ClassVar[dict[str, float]] = {"tc": 1e6}
    shapes: ClassVar[tuple[dict[str, float], ...]] = tuple(
        {"tc": tc} for tc in (1e6, 10.0, 25.0, 60.0, 150.0)
    )
    units: ClassVar[dict[str, str]] = {"a": "N m/s"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return (shape["tc"] * -np.expm1(-motion.t / shape["tc"]))[None, None]


class TorqueCrosstalk(Effect):
    """Cross-talk from another joint's torque."""

    name = "torque_crosstalk"
    title = "cross-talk from another joint's torque"
    equation = "a tau_rb,k, k another joint"
    signature = "the residual of one joint follows the load of another"
    separate = "load one joint while the other rests"
    scope = "pair"
    family = "cross"
    needs_model = True
    units: ClassVar[dict[str, str]] = {"a": ""}

    def candidate_joints(self, n: int) -> list[Joints]:
        """Return every ordered pair of joints."""
        return [(j, k) for j in range(n) for k in range(n) if j != k]

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return motion.rigid[:, joints[1]][None, None]


class TorqueDelay(Effect):
    """Delay of the torque behind the position."""

    name = "torque_delay"
    title = "delay of the torque behind the position"
    equation = "-T d tau/dt, the logs are then shifted by T"
    signature = "in all joints alike, where the torque changes fast: reversals, high frequency"
    separate = "fast reversals; look for a filter in the driver"
    scope = "arm"
    needs_model = True
    units: ClassVar[dict[str, str]] = {"delay": "s"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return -np.gradient(motion.total, motion.t, axis=0).T[None]


@dataclass(frozen=True)
class EncoderOffset(Effect):
    """Encoder zero that is off.

    Attributes:
        at: offset at which its column is exact; 0 for the slope there [rad].
    """

    at: float = 0.0

    name = "encoder_offset"
    title = "encoder zero that is off"
    equation = "tau_rb(q - D e_j) - tau_rb(q)"
    signature = "in several joints at once, with the pattern of gravity turned by a small angle"
    separate = "static poses over the whole workspace"
    needs_model = True
    family = "statics"
    units: ClassVar[dict[str, str]] = {"offset": "rad"}

    def rows(self, joints: Joints, n: int) -> tuple[int, ...]:
        """Return all joints: the whole arm's torque changes."""
        return tuple(range(n))

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        moved, step = motion.q.copy(), self.at if abs(self.at) > STEP else STEP
        moved[:, joints[0]] -= step
        return ((motion.reference.rigid(moved, motion.qd, motion.qdd) - motion.rigid) / step).T[
            None
        ]

    def at_size(self, sizes: Shape) -> EncoderOffset:
        """Return the effect with a column that is exact at an offset."""
        return EncoderOffset(float(sizes["offset"]))
