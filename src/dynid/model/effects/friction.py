"""Friction: the columns that the robot file asks for (Paper Eq. 7), and effects beyond one constant and one slope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from dynid.model import tuning
from dynid.model.effects.interface import ArmMotion, Effect, Floats, Joints, Shape
from dynid.model.effects.position import wave_shapes, waves
from dynid.model.parameters import Parameter, numbered
from dynid.robot import FRICTION_PARAMETERS, Coulomb, Robot


# ---------------------------------------------------------------- friction of the robot file
def coulomb_sign(qd: Floats, shape: Coulomb, joint: int) -> Floats:
    """Return the sign of a joint's velocity as the robot file wants it.

    Args:
        qd: velocity of the joint, (B,) [rad/s or m/s].
        shape: shape of the sign.
        joint: the joint, 0-based.

    Returns:
        Between -1 and 1, (B,).

    Source: Paper Eq. 7 with its inequality turned round: friction acts where the speed is at least the limit.
    """
    limit = shape.velocity[joint]
    if shape.shape == "smooth":
        return np.tanh(qd / limit)
    return np.where(np.abs(qd) >= limit, np.sign(qd), 0.0)


def sign_of(motion: ArmMotion, joint: int) -> Floats:
    """Return the Coulomb sign of one joint (0-based), (N,)."""
    if motion.coulomb_sign.size:
        return motion.coulomb_sign[:, joint]
    return coulomb_sign(motion.qd[:, joint], motion.robot.coulomb_shape, joint)


def friction_parameters(robot: Robot) -> tuple[Parameter, ...]:
    """Return the friction that the robot file asks for, joint by joint, and what coupled motors add (Paper Eq. 7).

    A motor that turns with the sum of two joints' speeds puts its torque on both: its columns are those of that speed,
    spread by the transposed coupling.
    """
    found = []
    for j, joint in enumerate(robot.joints, start=1):
        slope = f"{joint.torque_unit} s/{'rad' if joint.revolute else 'm'}"
        for kind in joint.friction:
            found.append(
                numbered(
                    FRICTION_PARAMETERS[kind], j, slope if kind == "viscous" else joint.torque_unit
                )
            )
    for k, row in enumerate(np.array(robot.coupling.matrix) if robot.coupling else ()):
        share = row / row[k] if row[k] else row
        if np.count_nonzero(share) > 1:
            units = {"Imc": "kg m^2", "fvc": "N m s/rad", "fcc": "N m"}
            found += [
                replace(numbered(kind, k + 1, unit), share=tuple(share.tolist()))
                for kind, unit in units.items()
            ]
    return tuple(found)


def friction_rows(parameter: Parameter) -> tuple[int, ...]:
    """Return the joints that friction or a coupled motor acts on, 0-based."""
    return (
        tuple(np.flatnonzero(parameter.share).tolist())
        if parameter.share
        else (parameter.number - 1,)
    )


def friction_entries(parameter: Parameter, robot: Robot, qd: Floats, qdd: Floats) -> list[Floats]:
    """Return the entries of a friction column in its rows, each (N,) [N m or N per unit of the parameter]."""
    if parameter.kind == FRICTION_PARAMETERS["offset"]:
        return [np.ones(len(qd))]
    motion = qdd if parameter.kind == "Imc" else qd
    signal = (
        motion @ np.array(parameter.share) if parameter.share else motion[:, parameter.number - 1]
    )
    if parameter.kind in ("fc", "fcc"):
        signal = coulomb_sign(signal, robot.coulomb_shape, parameter.number - 1)
    return [share * signal for share in parameter.share if share] if parameter.share else [signal]


def add_friction_gradient(
    parameter: Parameter,
    robot: Robot,
    qd: Floats,
    weights: Sequence[Floats],
    by_qd: Floats,
    by_qdd: Floats,
) -> None:
    """Add the gradient of sum(weights * entries) of a friction column by velocity and acceleration, each (N, n).

    Args:
        parameter: the column.
        robot: the arm.
        qd: velocities, (N, n).
        weights: for each row of the column, (N,).
        by_qd: gradient by the velocities, changed.
        by_qdd: gradient by the accelerations, changed.
    """
    own, target = parameter.number - 1, by_qdd if parameter.kind == "Imc" else by_qd
    share = np.array(parameter.share) if parameter.share else np.eye(len(robot.joints))[own]
    slope = share[share != 0] @ np.array(weights)
    if parameter.kind in ("fc", "fcc"):
        shape = robot.coulomb_shape
        # A threshold has no slope.
        steepness = 1.0 / shape.velocity[own] if shape.shape == "smooth" else 0.0
        slope = slope * steepness * (1 - np.tanh(qd @ share / shape.velocity[own]) ** 2)
    if parameter.kind != FRICTION_PARAMETERS["offset"]:
        target += slope[:, None] * share


# ---------------------------------------------------------------- effects
class ViscousFriction(Effect):
    """Viscous friction."""

    name = "viscous"
    title = "viscous friction"
    equation = "fv qd"
    signature = "in proportion to the joint's own speed"
    separate = "several speeds, both ways"
    family = "viscous"
    units: ClassVar[dict[str, str]] = {"fv": "N m s/rad"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return motion.qd[:, joints[0]][None, None]


class CoulombFriction(Effect):
    """Coulomb friction."""

    name = "coulomb"
    title = "Coulomb friction"
    equation = "fc sign(qd)"
    signature = "a step at each reversal, the same size both ways"
    separate = "several reversals at different speeds"
    family = "friction curve"
    units: ClassVar[dict[str, str]] = {"fc": "N m"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return sign_of(motion, joints[0])[None, None]


class AsymmetricViscous(Effect):
    """Viscous friction that differs with the direction."""

    name = "asymmetric_viscous"
    title = "viscous friction that differs with the direction"
    equation = "a |qd|"
    signature = (
        "grows with speed, with the same sign both ways: largest where the joint is fast, "
        "small where it is slow"
    )
    separate = "drive the same path forwards and backwards"
    family = "viscous"
    units: ClassVar[dict[str, str]] = {"a": "N m s/rad"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return np.abs(motion.qd[:, joints[0]])[None, None]


class Stribeck(Effect):
    """Stribeck friction."""

    name = "stribeck"
    title = "Stribeck friction"
    equation = "a exp(-(|qd| / vs)^d) sign(qd), a > 0"
    signature = "a hump at low speed on both sides of each reversal that is gone at high speed"
    separate = "sweeps at constant speed over two decades, down to a tenth of vs"
    family = "friction curve"
    positive = True
    shape_units: ClassVar[dict[str, str]] = {"vs": "rad/s", "d": ""}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"vs": ("times", 1.25), "d": ("times", 1.3)}
    simple: ClassVar[dict[str, float]] = {"d": 1.0}
    shapes: ClassVar[tuple[dict[str, float], ...]] = tuple(
        {"vs": vs, "d": d} for vs in (0.014, 0.022, 0.036, 0.06, 0.1, 0.16) for d in (0.7, 1.0, 2.0)
    )
    units: ClassVar[dict[str, str]] = {"a": "N m"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        speed = np.abs(motion.qd[:, joints[0]])
        with np.errstate(over="ignore"):
            hump = np.exp(-((speed / shape["vs"]) ** shape["d"]))
        return (hump * sign_of(motion, joints[0]))[None, None]


class NonlinearViscous(Effect):
    """Friction that is not linear in speed."""

    name = "nonlinear_viscous"
    title = "friction that is not linear in speed"
    equation = "a sign(qd) |qd|^p"
    signature = "the residual bends with speed: one sign at middle speeds, the other at the highest"
    separate = "move the joint at least five times faster than the bend"
    family = "friction curve"
    shape_units: ClassVar[dict[str, str]] = {"p": ""}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"p": ("times", 1.1)}
    nulls: ClassVar[dict[str, float]] = {"p": 1.0}
    shapes: ClassVar[tuple[dict[str, float], ...]] = tuple(
        {"p": p} for p in (0.3, 0.5, 0.7, 1.3, 1.6, 2.0, 2.5, 3.0)
    )
    units: ClassVar[dict[str, str]] = {"a": "N m (s/rad)^p"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        speed = motion.qd[:, joints[0]]
        return (np.sign(speed) * np.abs(speed) ** shape["p"])[None, None]


class LoadFriction(Effect):
    """Friction that grows with the load."""

    name = "load_friction"
    title = "friction that grows with the load"
    equation = "a |tau_rb| sign(qd), a > 0"
    signature = (
        "Coulomb-like, but larger where the joint carries more: high at high load, low at low load"
    )
    separate = "the same motion with and without a payload"
    family = "load"
    positive = True
    needs_model = True
    units: ClassVar[dict[str, str]] = {"a": ""}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return (np.abs(motion.rigid[:, joints[0]]) * sign_of(motion, joints[0]))[None, None]


class WarmupFriction(Effect):
    """Friction that falls while the drive warms up."""

    name = "warmup_friction"
    title = "friction that falls while the drive warms up"
    equation = "exp(-t / tw) (a1 sign(qd) + a2 qd)"
    signature = "friction is larger in the first minutes than later"
    separate = "repeat the same motion cold and warm"
    family = "time"
    shape_units: ClassVar[dict[str, str]] = {"tw": "s"}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"tw": ("times", 1.4)}
    shapes: ClassVar[tuple[dict[str, float], ...]] = tuple(
        {"tw": tw} for tw in (12.0, 25.0, 50.0, 100.0, 250.0)
    )
    units: ClassVar[dict[str, str]] = {"a1": "N m", "a2": "N m s/rad"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        cold = np.exp(-motion.t / shape["tw"])
        return np.array([cold * sign_of(motion, joints[0]), cold * motion.qd[:, joints[0]]])[
            :, None
        ]


class PositionFriction(Effect):
    """Friction that varies with the position."""

    name = "position_friction"
    title = "friction that varies with the position"
    equation = "(a cos(h q) + b sin(h q)) sign(qd)"
    signature = "friction differs between places of the joint's travel, both ways alike"
    separate = "cross the whole travel both ways at one slow speed"
    family = "position"
    shape_units: ClassVar[dict[str, str]] = {"h": "1/rad"}
    # Why not whole waves a turn alone: wheels in the gear turn at other rates, and few joints turn all round.
    shapes: ClassVar[tuple[dict[str, float], ...]] = tuple(
        {"h": h} for h in (0.5, 1.0, 1.5, 2.0, 2.5)
    )
    steps: ClassVar[dict[str, tuple[str, float]]] = {"h": ("plus", 0.25)}
    units: ClassVar[dict[str, str]] = {"a": "N m", "b": "N m"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        angle, sign = shape["h"] * motion.q[:, joints[0]], sign_of(motion, joints[0])
        return np.array([np.cos(angle) * sign, np.sin(angle) * sign])[:, None]


class GearFriction(Effect):
    """Friction that varies with the turn of a gear's wheel."""

    name = "gear_friction"
    title = "friction that varies with the turn of a gear's wheel"
    equation = "(a cos(k q) + b sin(k q)) sign(qd)"
    signature = "a wave over the joint's position that changes its sign with the direction"
    separate = (
        "a slow, even motion over several waves, both ways: a ripple keeps its sign, this does not"
    )
    family = "position"
    trials = tuning.WAVES_THAT_MAY_FIT
    shape_units: ClassVar[dict[str, str]] = {"k": "1/rad"}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"k": ("plus", 0.2)}
    units: ClassVar[dict[str, str]] = {"a": "N m", "b": "N m"}

    def grid(self, motion: ArmMotion, joints: Joints) -> list[dict[str, float]]:
        """Return the shapes that are tried."""
        return wave_shapes(
            motion, joints[0], tuning.FRICTION_WAVE_SPACING_RAD, tuning.FASTEST_FRICTION_WAVE
        )

    def tried(self, motion: ArmMotion, joints: Joints, shapes: Sequence[Shape]) -> list[Floats]:
        """Return the columns of several shapes."""
        sign = sign_of(motion, joints[0])
        return [(wave * sign)[:, None] for wave in waves(motion.q[:, joints[0]], shapes)]

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return self.tried(motion, joints, [shape])[0]


class PreslidingHysteresis(Effect):
    """Hysteresis before sliding (Dahl)."""

    name = "presliding_hysteresis"
    title = "hysteresis before sliding (Dahl)"
    equation = "a (z - sign(qd)), dz/dq = (1 - z sign(qd)) / delta, a > 0"
    signature = "friction builds up over the first millirads after each reversal instead of jumping"
    separate = "many small reversals, each a few delta long"
    positive = True
    shape_units: ClassVar[dict[str, str]] = {"delta": "rad"}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"delta": ("times", 1.4)}
    family = "friction curve"
    shapes: ClassVar[tuple[dict[str, float], ...]] = tuple(
        {"delta": float(delta)} for delta in np.geomspace(0.002, 0.2, 9)
    )
    units: ClassVar[dict[str, str]] = {"a": "N m"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        z = presliding(motion.q[:, joints[0]], shape["delta"])
        return (z - sign_of(motion, joints[0]))[None, None]


class JointCoupling(Effect):
    """Friction that a neighbouring joint drags along."""

    name = "joint_coupling"
    title = "friction that a neighbouring joint drags along"
    equation = "a qd_k + b sign(qd_k), k the neighbour"
    signature = "the residual of one joint follows the speed of the next one"
    separate = "move the two joints one after the other"
    scope = "pair"
    family = "cross"
    units: ClassVar[dict[str, str]] = {"a": "N m s/rad", "b": "N m"}

    def candidate_joints(self, n: int) -> list[Joints]:
        """Return every joint with each of its neighbours."""
        return [(j, k) for j in range(n) for k in (j - 1, j + 1) if 0 <= k < n]

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return np.array([motion.qd[:, joints[1]], sign_of(motion, joints[1])])[:, None]


class CoulombChange(Effect):
    """Changed Coulomb friction."""

    name = "coulomb_change"
    title = "changed Coulomb friction"
    equation = "c sign(qd)"
    signature = "a step at each reversal, on one joint"
    separate = "nothing is needed: it shows at every reversal"
    uses = ("frozen",)
    family = "friction curve"
    units: ClassVar[dict[str, str]] = {"c": "N m"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return sign_of(motion, joints[0])[None, None]


class ViscousChange(Effect):
    """Changed viscous friction."""

    name = "viscous_change"
    title = "changed viscous friction"
    equation = "v qd"
    signature = "in proportion to the speed of one joint"
    separate = "several speeds, both ways"
    uses = ("frozen",)
    family = "friction curve"
    units: ClassVar[dict[str, str]] = {"v": "N m s/rad"}

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return motion.qd[:, joints[0]][None, None]


def presliding(q: Floats, delta: float) -> Floats:
    """Return the bristle's state over a motion, exact in the position, (N,).

    Between reversals z = sigma + (z0 - sigma) exp(-|q - q0| / delta); it starts slack at 0.
    """
    step = np.diff(q, prepend=q[:1])
    direction = np.sign(step)
    turns = np.flatnonzero(np.diff(direction) != 0) + 1
    z = np.zeros_like(q)
    last, origin = 0.0, q[0]
    for run in np.split(np.arange(len(q)), turns):
        sigma = direction[run[0]]
        z[run] = (
            sigma + (last - sigma) * np.exp(-np.abs(q[run] - origin) / delta) if sigma else last
        )
        last, origin = z[run[-1]], q[run[-1]]
    return z
