"""What a torque effect is: columns of the regressor, an equation, a signature, and the shapes that are tried.

An effect is evaluated on a whole ``ArmMotion``: it may need the order of the samples, the time or the model's own
torque. The friction of the robot file, which one sample is enough for, is in ``friction``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from dynid.robot import Robot

Floats = NDArray[np.float64]
#: Where an effect sits: one joint (0-based), a joint and the one that it is driven by, or () for the whole arm.
Joints = tuple[int, ...]
Shape = Mapping[str, float]


class ReferenceTorques(Protocol):
    """The current model of the arm, for effects that scale with its torques."""

    def rigid(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return rigid-body torques, (N, n) [N m or N]."""

    def total(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return rigid-body and friction torques, (N, n) [N m or N]."""

    def gravity_tilt(self, q: Floats, axis: int) -> Floats:
        """Return the change of torque by a turn of gravity towards an axis of frame 0, (N, n) [N m/rad]."""

    def tip_force(self, q: Floats, axis: int) -> Floats:
        """Return the torques that hold a unit force along an axis of frame 0 at the tip, -J^T e, (N, n) [m or 1]."""

    def tip_columns(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return the columns of the ten parameters of the last link, (10, N, n) [N m or N per unit of each]."""


@dataclass(frozen=True)
class ArmMotion:
    """A stretch of motion in order of time, and the current model.

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


class Effect(ABC):
    """One effect of the catalogue.

    Attributes:
        name: identifier, the contract of files and JSON.
        title: name for people.
        equation: torque that it adds at joint j.
        signature: how it shows in the residual, for people.
        separate: the motion that tells it from what looks like it.
        family: effects that describe the same physics on one joint.
        scope: ``"joint"``, ``"pair"`` (joint and the other one it depends on) or ``"arm"``.
        uses: ``"refit"`` when no re-identification can absorb it, ``"frozen"`` when it can be a change of the arm,
            ``"arm"`` when only links that no arm has absorb it.
        positive: whether its only amplitude must be positive.
        needs_model: whether its columns change with the model.
        units: unit of each amplitude, a parameter that enters linearly, where they do not depend on the shape.
        shape_units: unit of each shape parameter.
        shapes: the shapes that are tried, where they do not depend on the motion.
        steps: how a shape parameter is refined: ``"times"`` or ``"plus"``, and the first step.
        trials: so many times more often than another it fits by accident: a frequency that is free.
        nulls: value of a shape parameter at which the effect is part of the model; 0 of a ``"times"`` one not listed.
        simple: value that a shape parameter is held at where the logs do not determine it.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    equation: ClassVar[str]
    signature: ClassVar[str]
    separate: ClassVar[str]
    family: ClassVar[str] = ""
    scope: ClassVar[str] = "joint"
    uses: ClassVar[tuple[str, ...]] = ("refit", "frozen")
    positive: ClassVar[bool] = False
    needs_model: ClassVar[bool] = False
    units: ClassVar[dict[str, str]] = {}
    shape_units: ClassVar[dict[str, str]] = {}
    shapes: ClassVar[tuple[dict[str, float], ...]] = ({},)
    steps: ClassVar[dict[str, tuple[str, float]]] = {}
    trials: ClassVar[int] = 1
    nulls: ClassVar[dict[str, float]] = {}
    simple: ClassVar[dict[str, float]] = {}

    def candidate_joints(self, n: int) -> list[Joints]:
        """Return where it may sit on an arm of n joints."""
        return [(j,) for j in range(n)] if self.scope == "joint" else [()]

    def rows(self, joints: Joints, n: int) -> tuple[int, ...]:
        """Return the joints whose torque it changes."""
        return joints[:1] if joints else tuple(range(n))

    def grid(self, motion: ArmMotion, joints: Joints) -> list[dict[str, float]]:
        """Return the shapes that are tried; one empty shape when it is linear."""
        return [dict(shape) for shape in self.shapes]

    def tried(self, motion: ArmMotion, joints: Joints, shapes: Sequence[Shape]) -> list[Floats]:
        """Return the columns of several shapes, each (amplitudes, rows, N) [N m or N per unit]."""
        return [self.columns(motion, joints, shape) for shape in shapes]

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return dict(self.units)

    def at_size(self, sizes: Shape) -> Effect:
        """Return the effect with columns that are exact at one size, by name of its parameters; itself where all are.

        A torque that is not in proportion to its amplitude is, near a size, that of the size times amplitude over size.
        """
        return self

    @abstractmethod
    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N) [N m or N per unit]."""
