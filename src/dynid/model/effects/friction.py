"""Friction that the robot file asks for: columns for which one sample is enough (Paper Eq. 7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynid.arrays import Floats
from dynid.model.effects.motion import ArmMotion
from dynid.model.parameters import Parameter, numbered
from dynid.robot import FRICTION_PARAMETERS, Coulomb, Robot


# ---------------------------------------------------------------- friction of the robot file
def coulomb_sign(qd: Floats, shape: Coulomb, joint: int, step: float = 0.0) -> Floats:
    """Return the sign of a joint's velocity as its Coulomb friction has it.

    Args:
        qd: velocity of the joint, (B,) [rad/s or m/s].
        shape: shape of the sign.
        joint: the joint, 0-based.
        step: time from each velocity to the next [s]; 0 where they are no motion, and friction follows at once.

    Returns:
        Between -1 and 1, (B,).

    Source: Paper Eq. 7 with its inequality turned round: friction acts where the speed is at least the limit. With a
    distance z' = |qd| (sign - z) / distance, which is Dahl's law where the step is sharp.
    """
    limit, distance = shape.velocity[joint], step and shape.distance and shape.distance[joint]
    if distance:
        # Why the means: a sample holds what moved until then, half a step before and not after.
        qd = np.convolve(qd, [0.5, 0.5])[: len(qd)]
    sign = np.tanh(qd / limit)
    if shape.shape == "threshold":
        sign = np.where(np.abs(qd) >= limit, np.sign(qd), 0.0)
    return _following(sign, np.exp(-step * np.abs(qd) / distance)) if distance else sign


def _following(sign: Floats, kept: Floats) -> Floats:
    """Return z_k = kept_k z_(k - 1) + (1 - kept_k) sign_k, from zero on, (B,)."""
    z, back = (1.0 - kept) * sign, 1
    # Why doubled: each sample is a linear map, and those of twice as many samples are composed at once.
    while np.any(kept[back:] > 1e-6):
        z[back:] += kept[back:] * z[:-back]
        kept[back:] *= kept[:-back]
        back *= 2
    return z


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
    parameters = []
    for j, joint in enumerate(robot.joints, start=1):
        slope = f"{joint.torque_unit} s/{'rad' if joint.revolute else 'm'}"
        for kind in joint.friction:
            unit = slope if kind == "viscous" else joint.torque_unit
            parameters.append(numbered(FRICTION_PARAMETERS[kind], j, unit))
    for k, row in enumerate(np.array(robot.coupling.matrix) if robot.coupling else ()):
        share = row / row[k] if row[k] else row
        if np.count_nonzero(share) > 1:
            units = {"Imc": "kg m^2", "fvc": "N m s/rad", "fcc": "N m"}
            parameters += [
                replace(numbered(kind, k + 1, unit), share=tuple(share.tolist()))
                for kind, unit in units.items()
            ]
    return tuple(parameters)


def friction_rows(parameter: Parameter) -> tuple[int, ...]:
    """Return the joints that friction or a coupled motor acts on, 0-based."""
    return tuple(np.flatnonzero(parameter.share).tolist()) or (parameter.number - 1,)


def _share(parameter: Parameter, robot: Robot) -> Floats:
    """Return how much of a friction column each joint feels, (n,)."""
    return np.array(parameter.share or np.eye(robot.n)[parameter.number - 1])


def friction_entries(parameter: Parameter, robot: Robot, qd: Floats, qdd: Floats) -> list[Floats]:
    """Return the entries of a friction column in its rows, each (N,) [N m or N per unit of the parameter]."""
    if parameter.kind == FRICTION_PARAMETERS["offset"]:
        return [np.ones(len(qd))]
    share = _share(parameter, robot)
    signal = (qdd if parameter.kind == "Imc" else qd) @ share
    if parameter.kind in ("fc", "fcc"):
        signal = coulomb_sign(signal, robot.coulomb_shape, parameter.number - 1)
    return [each * signal for each in share if each]


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
    share = _share(parameter, robot)
    slope = share[share != 0] @ np.array(weights)
    if parameter.kind in ("fc", "fcc"):
        shape = robot.coulomb_shape
        # A threshold has no slope.
        steepness = 1.0 / shape.velocity[own] if shape.shape == "smooth" else 0.0
        slope = slope * steepness * (1 - np.tanh(qd @ share / shape.velocity[own]) ** 2)
    if parameter.kind != FRICTION_PARAMETERS["offset"]:
        target += slope[:, None] * share
