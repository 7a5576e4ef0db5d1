"""Effects of inertia, gravity and elasticity, most of which several joints feel at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from dynid.model import tuning
from dynid.model.effects.interface import ArmMotion, Effect, Floats, Joints, Shape
from dynid.robot import LINK_PARAMETERS

Ints = NDArray[np.int64]

#: Smallest step of a difference [rad/N m]: a hundredth of the softest gear.
STEP = 1e-6
#: Turns of the load that are looked at together.
TOGETHER = 1024

UNITS = ("kg", *("kg m",) * 3, *("kg m^2",) * 6)


class MotorInertia(Effect):
    """Rotor inertia."""

    name = "motor_inertia"
    title = "rotor inertia"
    equation = "Im qdd"
    signature = (
        "in proportion to the joint's own acceleration; strongest at reversals of a fast joint"
    )
    separate = "fast reversals; on the first joints it cannot be told from the link's own inertia"
    positive = True
    units: ClassVar[dict[str, str]] = {"Im": "kg m^2"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return motion.qdd[:, joints[0]][None, None]


@dataclass(frozen=True)
class JointElasticity(Effect):
    """Elastic joint with the encoder on the motor's side.

    Attributes:
        at: compliance at which its column is exact; 0 for the slope there [rad/N m].
    """

    at: float = 0.0

    name = "joint_elasticity"
    title = "elastic joint with the encoder on the motor's side"
    equation = "tau_rb(q - tau_j / K e_j) - tau_rb(q), 1/K > 0"
    signature = "at high frequency and where the torque changes fast; in several joints at once"
    separate = "fast reversals under load"
    positive = True
    needs_model = True
    units: ClassVar[dict[str, str]] = {"compliance": "rad/N m"}

    def rows(self, joints: Joints, n: int) -> tuple[int, ...]:
        """Return all joints: the whole arm's torque changes."""
        return tuple(range(n))

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        j, step = joints[0], self.at if self.at > STEP else STEP
        there = self._bent(motion, j, step, motion.rigid)
        for _ in range(tuning.BEND_ITERATIONS if self.at > STEP else 0):
            there = self._bent(motion, j, step, there)
        return ((there - motion.rigid) / step).T[None]

    @staticmethod
    def _bent(motion: ArmMotion, joint: int, compliance: float, torques: Floats) -> Floats:
        """Return rigid-body torques, (N, n) [N m], where torques, (N, n), bend a joint."""
        bend = motion.smooth(torques[:, joint])
        speed, moved = np.gradient(bend, motion.t), []
        for x, shift in (
            (motion.q, bend),
            (motion.qd, speed),
            (motion.qdd, np.gradient(speed, motion.t)),
        ):
            y = x.copy()
            y[:, joint] -= compliance * shift
            moved.append(y)
        return motion.reference.rigid(*moved)

    def at_size(self, sizes: Shape) -> JointElasticity:
        """Return the effect with a column that is exact at a compliance."""
        return JointElasticity(float(sizes["compliance"]))


class Backlash(Effect):
    """Backlash of a gear with the encoder on the motor's side."""

    name = "backlash"
    title = "backlash of a gear with the encoder on the motor's side"
    equation = "-a tau_rb while the link crosses the gap 2 b on its own, then the jolt that it lands with; a near 1"
    signature = (
        "wherever the load of the joint changes its sign: no torque for a moment, then a "
        "jolt, in several joints"
    )
    separate = "let the load change its sign often, slowly and fast; elasticity follows the torque's size instead"
    positive = True
    needs_model = True
    family = "gear"
    shape_units: ClassVar[dict[str, str]] = {"b": "rad"}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"b": ("times", 1.5)}
    shapes: ClassVar[tuple[dict[str, float], ...]] = tuple(
        {"b": b} for b in (2.5e-4, 5e-4, 1e-3, 2e-3, 4e-3, 8e-3)
    )
    units: ClassVar[dict[str, str]] = {"a": ""}

    def rows(self, joints: Joints, n: int) -> tuple[int, ...]:
        """Return all joints: the whole arm's torque changes."""
        return tuple(range(n))

    def tried(self, motion: ArmMotion, joints: Joints, shapes: Sequence[Shape]) -> list[Floats]:
        """Return the columns of several shapes."""
        j = joints[0]
        pushed = motion.qdd.copy()
        pushed[:, j] += 1.0
        inertia = motion.reference.rigid(motion.q, motion.qd, pushed) - motion.rigid
        own = inertia[:, j]
        push = np.where(own > 0, motion.rigid[:, j] / np.where(own > 0, own, 1.0), 0.0)
        return [
            (inertia.T * one)[None]
            for one in crossings(motion.t, push, [2 * shape["b"] for shape in shapes])
        ]

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return self.tried(motion, joints, [shape])[0]


def crossings(t: Floats, push: Floats, gaps: Sequence[float]) -> list[Floats]:
    """Return the acceleration that a link has relative to its motor while it crosses a gap, (N,) each [rad/s^2].

    A link that is held by one flank is left alone when its load changes the sign, falls behind by as much as the load
    would accelerate it, and is caught by the other flank without a bounce.

    Args:
        t: times, (N,) [s].
        push: the load over the inertia that it accelerates, (N,) [rad/s^2].
        gaps: widths, G of them [rad].
    """
    turns = np.flatnonzero(np.diff(np.sign(push)) != 0) + 1
    step = np.diff(t, append=2 * t[-1] - t[-2])
    found, free = [np.zeros_like(push) for _ in gaps], [0] * len(gaps)
    # Why in parts: so many turns times as many samples are 3 MB, however long the motion is.
    for part in np.array_split(turns, max(1, -(-len(turns) // TOGETHER))):
        for g, (lands, speed) in enumerate(zip(*_landings(push, step, part, gaps), strict=True)):
            for k, land, fast in zip(part.tolist(), lands.tolist(), speed.tolist(), strict=True):
                if k >= free[g] and land < min(tuning.LONGEST_FLIGHT_SAMPLES, len(push) - k):
                    end = free[g] = k + land
                    found[g][k:end] = -push[k:end]
                    found[g][end] = fast / step[end] - push[end]
    return found


def _landings(
    push: Floats, step: Floats, turns: Ints, gaps: Sequence[float]
) -> tuple[Ints, Floats]:
    """Return after how many samples from each turn of the load a link has crossed each gap, and how fast, (G, T)."""
    rows = turns[:, None] + np.arange(tuning.LONGEST_FLIGHT_SAMPLES)
    lasts = np.where(rows < len(push), step[np.minimum(rows, len(push) - 1)], 0.0)
    speed = np.cumsum(push[np.minimum(rows, len(push) - 1)] * lasts, axis=1)
    way = np.maximum.accumulate(np.abs(np.cumsum(speed * lasts, axis=1)), axis=1)
    lands = np.array([np.sum(way < gap, axis=1) for gap in gaps])
    return lands, np.take_along_axis(
        speed, np.minimum(lands, tuning.LONGEST_FLIGHT_SAMPLES - 1).T, axis=1
    ).T


class BaseTilt(Effect):
    """Base that is not level."""

    name = "base_tilt"
    title = "base that is not level"
    equation = "x tau_g(ex) + y tau_g(ey), and c cos(q1) + s sin(q1) on joint 1"
    signature = "the first joint feels gravity; the others a small turn of it"
    separate = "turn the first joint through its whole travel with the arm stretched out"
    scope = "arm"
    needs_model = True
    family = "statics"
    units: ClassVar[dict[str, str]] = {"x": "rad", "y": "rad", "c": "N m", "s": "N m"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        columns = np.zeros((4, motion.n, len(motion)))
        for axis in (0, 1):
            columns[axis] = motion.reference.gravity_tilt(motion.q, axis).T
        columns[2, 0], columns[3, 0] = np.cos(motion.q[:, 0]), np.sin(motion.q[:, 0])
        return columns


class ToolForce(Effect):
    """Constant force on the tool (a hose, a cable)."""

    name = "tool_force"
    title = "constant force on the tool (a hose, a cable)"
    equation = "-J^T f, f constant in the world"
    signature = "wrist and elbow together, with the pattern of a force at the tip"
    separate = "turn the wrist in many directions at each pose"
    scope = "arm"
    family = "statics"
    units: ClassVar[dict[str, str]] = {"x": "N", "y": "N", "z": "N"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return np.array([motion.reference.tip_force(motion.q, axis).T for axis in range(3)])


class Payload(Effect):
    """Payload that the model does not know."""

    name = "payload"
    title = "payload that the model does not know"
    equation = "ten parameters of the last link, the first `form` of them"
    signature = "joint 2 and 4 first, in proportion to gravity"
    separate = "nothing is needed: a payload shows at once"
    scope = "arm"
    uses = ("frozen",)
    shape_units: ClassVar[dict[str, str]] = {"form": ""}
    family = "statics"
    shapes: ClassVar[tuple[dict[str, float], ...]] = tuple(
        {"form": form} for form in (1.0, 4.0, 10.0)
    )

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return dict(list(zip(LINK_PARAMETERS, UNITS, strict=False))[: round(shape["form"])])

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return motion.reference.tip_columns(motion.q, motion.qd, motion.qdd)[
            : round(shape["form"])
        ].transpose(0, 2, 1)
