"""The friction columns that the robot file asks for, joint by joint, and those of coupled motors."""

from __future__ import annotations

import numpy as np

from dynid.model.effects.coulomb import coulomb_column
from dynid.model.effects.interface import Column, Floats, State
from dynid.model.effects.offset import offset_column
from dynid.model.effects.viscous import viscous_column
from dynid.model.prime_field import FieldState, Residues, product, residue, typed
from dynid.robot import Robot


def joint_columns(robot: Robot) -> list[Column]:
    """Return the friction columns of every joint in the order of the joints."""
    columns = []
    for j, joint in enumerate(robot.joints):
        effort, length = ("N m", "rad") if joint.revolute else ("N", "m")
        for kind in joint.friction:
            if kind == "viscous":
                columns.append(viscous_column(j, f"{effort} s/{length}"))
            elif kind == "coulomb":
                columns.append(coulomb_column(j, robot.coulomb_shape, effort))
            else:
                columns.append(offset_column(j, effort))
    return columns


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
        if np.count_nonzero(share) < 2:
            continue
        rows = tuple(np.flatnonzero(share).tolist())
        columns += [
            _spread(robot, name, unit, k, share, rows)
            for name, unit in (("Imc", "kg m^2"), ("fvc", "N m s/rad"), ("fcc", "N m"))
        ]
    return columns


def _spread(robot: Robot, name: str, unit: str, motor: int, share: Floats, rows: tuple[int, ...]) -> Column:
    shape = robot.coulomb_shape

    def evaluate(state: State) -> list[Floats]:
        speed = state.qd @ share
        if name == "Imc":
            signal = state.qdd @ share
        elif name == "fvc":
            signal = speed
        else:
            limit = shape.velocity[motor]
            signal = (
                np.tanh(speed / limit)
                if shape.shape == "smooth"
                else np.where(np.abs(speed) >= limit, np.sign(speed), 0.0)
            )
        return [share[j] * signal for j in rows]

    def exact(state: FieldState) -> list[Residues]:
        weights = _exact_share(robot, motor)
        signal = product(state.qdd if name == "Imc" else state.qd, weights)
        return [product(signal[:, None], weights[None, j]) for j in rows]

    return Column(f"{name}{motor + 1}", unit, rows, evaluate, None if name == "fcc" else exact)


def _exact_share(robot: Robot, motor: int) -> Residues:
    """Return a motor's row of the coupling, divided by its own entry, in the prime field."""
    row = [typed(x) for x in robot.coupling.matrix[motor]] if robot.coupling else []
    return np.array([residue(x / row[motor] if row[motor] else x) for x in row], dtype=np.uint64)
