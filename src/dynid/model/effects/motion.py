"""What the torque of an effect may depend on: an interval of motion in order of time, and the current model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from dynid.arrays import Floats
from dynid.robot import Robot

#: Where an effect sits: one joint (0-based), a joint and the one that it is driven by, or () for the whole arm.
Joints = tuple[int, ...]
Shape = Mapping[str, float]
#: Shapes that are tried.
Shapes = list[dict[str, float]]


class ReferenceTorques(Protocol):
    """The current model of the arm, for effects that scale with its torques."""

    def rigid(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return rigid-body torques, (N, n) [N m or N]."""

    def total(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return rigid-body and friction torques, (N, n) [N m or N]."""

    def gravity_tilt(self, q: Floats, towards: Floats) -> Floats:
        """Return the change of torque by a turn of gravity towards a level axis, (3,), (N, n) [N m/rad]."""

    def tip_columns(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return the columns of the ten parameters of the last link, (10, N, n) [N m or N per unit of each]."""


@dataclass(frozen=True)
class ArmMotion:
    """An interval of motion in order of time, and the current model.

    Attributes:
        t: time since the recording began, (N,) [s].
        q: positions, (N, n) [rad or m].
        qd: velocities, (N, n) [rad/s or m/s].
        qdd: accelerations, (N, n) [rad/s^2 or m/s^2].
        robot: the arm.
        reference: the current model.
        smooth: a low-pass filter for columns that differentiate the model's torque; (N,) -> (N,).
        coulomb_sign: Coulomb signs under the filter of the torques, (N, n); empty where they are made from ``qd``.
    """

    t: Floats
    q: Floats
    qd: Floats
    qdd: Floats
    robot: Robot
    reference: ReferenceTorques
    smooth: Callable[[Floats], Floats]
    coulomb_sign: Floats = field(default_factory=lambda: np.zeros((0, 0)))

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.t)

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.q.shape[1])

    @cached_property
    def rigid(self) -> Floats:
        """Rigid-body torques of the current model, (N, n) [N m or N]."""
        return self.reference.rigid(self.q, self.qd, self.qdd)

    @cached_property
    def total(self) -> Floats:
        """Rigid-body and friction torques of the current model, (N, n) [N m or N]."""
        return self.reference.total(self.q, self.qd, self.qdd)
