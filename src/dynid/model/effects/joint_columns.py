"""The friction columns that the robot file asks for, joint by joint, and those of coupled motors (Paper Eq. 7)."""

from __future__ import annotations

import numpy as np

from dynid.model.effects.interface import Column, Floats, State, coulomb_sign
from dynid.model.parameters import numbered
from dynid.model.prime_field import FieldState, Residues, decimal_fraction, product, residue
from dynid.robot import FRICTION_PARAMETERS, Coulomb, Robot


def joint_columns(robot: Robot) -> list[Column]:
    """Return the friction columns of every joint in the order of the joints."""
    columns = []
    for j, joint in enumerate(robot.joints):
        unit = joint.torque_unit
        for kind in joint.friction:
            if kind == "viscous":
                columns.append(_viscous(j, f"{unit} s/{'rad' if joint.revolute else 'm'}"))
            elif kind == "coulomb":
                columns.append(_coulomb(j, unit, robot.coulomb_shape))
            else:
                columns.append(_offset(j, unit))
    return columns


def _viscous(joint: int, unit: str) -> Column:
    """Return the column of fv for one joint (0-based)."""

    def add_gradient(state: State, weights: list[Floats], gradient: State) -> None:
        gradient.qd[:, joint] += weights[0]

    parameter = numbered(FRICTION_PARAMETERS["viscous"], joint + 1, unit)
    return Column(
        parameter, (joint,), lambda s: [s.qd[:, joint]], exact=lambda s: [s.qd[:, joint]], add_gradient=add_gradient
    )


def _coulomb(joint: int, unit: str, shape: Coulomb) -> Column:
    """Return the column of fc for one joint (0-based)."""

    def add_gradient(state: State, weights: list[Floats], gradient: State) -> None:
        # The paper's steps have no slope.
        if shape.shape == "smooth":
            slope = (1 - np.tanh(state.qd[:, joint] / shape.velocity[joint]) ** 2) / shape.velocity[joint]
            gradient.qd[:, joint] += weights[0] * slope

    parameter = numbered(FRICTION_PARAMETERS["coulomb"], joint + 1, unit)
    return Column(
        parameter, (joint,), lambda s: [coulomb_sign(s.qd[:, joint], shape, joint)], add_gradient=add_gradient
    )


def _offset(joint: int, unit: str) -> Column:
    """Return the column of fo for one joint (0-based)."""
    return Column(
        numbered(FRICTION_PARAMETERS["offset"], joint + 1, unit),
        (joint,),
        lambda s: [np.ones(len(s.q))],
        exact=lambda s: [np.ones(len(s.q), dtype=np.uint64)],
        add_gradient=lambda *_: None,
    )


def coupled_motor_columns(robot: Robot) -> list[Column]:
    """Return rotor inertia and friction of the motors that drive several joints.

    A motor that turns with the sum of two joints' speeds puts its torque on both; its columns are the joint columns of
    that motor speed, spread by the transposed coupling.
    """
    if robot.coupling is None:
        return []
    columns = []
    matrix = np.array(robot.coupling.matrix)
    for k, row in enumerate(matrix):
        share = row / row[k] if row[k] else row
        if np.count_nonzero(share) > 1:
            units = (("Imc", "kg m^2"), ("fvc", "N m s/rad"), ("fcc", "N m"))
            columns += [_spread(robot, kind, unit, k, share) for kind, unit in units]
    return columns


def _spread(robot: Robot, kind: str, unit: str, motor: int, share: Floats) -> Column:
    rows = tuple(np.flatnonzero(share).tolist())

    def evaluate(state: State) -> list[Floats]:
        if kind == "Imc":
            signal = state.qdd @ share
        else:
            speed = state.qd @ share
            signal = speed if kind == "fvc" else coulomb_sign(speed, robot.coulomb_shape, motor)
        return [share[j] * signal for j in rows]

    def exact(state: FieldState) -> list[Residues]:
        weights = _exact_share(robot, motor)
        signal = product(state.qdd if kind == "Imc" else state.qd, weights)
        return [product(signal[:, None], weights[None, j]) for j in rows]

    return Column(numbered(kind, motor + 1, unit), rows, evaluate, None if kind == "fcc" else exact)


def _exact_share(robot: Robot, motor: int) -> Residues:
    """Return a motor's row of the coupling, divided by its own entry, in the prime field."""
    row = [decimal_fraction(x) for x in robot.coupling.matrix[motor]] if robot.coupling else []
    return np.array([residue(x / row[motor] if row[motor] else x) for x in row], dtype=np.uint64)
