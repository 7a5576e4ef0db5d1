"""Inverse dynamics of one state at a time, as a controller asks for it: a Python function of plain numbers.

Array operations on a single sample take a thousand times as long as its additions and products. The straight-line
program of the regressor, which is checked when it is read, is written as Python once per result, with the parameters
folded in; nothing but numbers and the names of its inputs gets into that text.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.residual_model import ModelError
from dynid.model.base_model import BaseModel
from dynid.model.kinematics import geometry
from dynid.model.program import FOLD, NEG, Program
from dynid.model.regressor import Model, prior_vector
from dynid.robot import Robot

Floats = NDArray[np.float64]
#: Returns the torques of positions, velocities and accelerations of all joints.
OneState = Callable[[list[float], list[float], list[float]], list[float]]

#: How an input of the program is made of the state; the index of the joint and an angle stand in the braces.
_INPUTS = {
    "c": "cos(q[{0}]+{1})",
    "s": "sin(q[{0}]+{1})",
    "q": "q[{0}]",
    "qd": "qd[{0}]",
    "qdd": "qdd[{0}]",
}


def one_state(base: BaseModel, theta: Floats, error: ModelError | None) -> OneState | None:
    """Return the inverse dynamics of single states; None where torques depend on more, or motors are coupled.

    Args:
        base: model and base parameters.
        theta: base parameters, (p,), each in its unit.
        error: the residual model whose mean is part of the torque; None without.
    """
    model, n = base.model, base.robot.n
    if model.added or base.robot.coupling is not None:
        return None
    # Why parameters of each joint: the residual model is orthogonal to the parameters joint by joint.
    own = np.tile(theta, (n, 1))
    loads = np.zeros((0, len(theta)))
    if error is not None:
        own += error.mean_by_rows[1]
        loads = error.reference[None]
    rigid, friction = _spread(model, base, own)
    rigid += _known(model)
    rigid_load, friction_load = (
        _spread(model, base, np.tile(loads, (n, 1))) if len(loads) else (None, None)
    )
    wanted = np.flatnonzero(
        rigid.any(axis=0) | (False if rigid_load is None else rigid_load.any(axis=0))
    )
    text = _Text()
    _write_signs(text, base.robot)
    entries = text.program(model.rigid.restricted(wanted), base.robot)
    torques = [text.total(entries[j], rigid[j, wanted], friction[j], j) for j in range(n)]
    if error is not None and rigid_load is not None and friction_load is not None:
        for j in range(n):
            load = text.total(entries[j], rigid_load[j, wanted], friction_load[j], j)
            torques[j] += "+" + _residual(error, j, load)
    lines = ["def torques(q, qd, qdd):", *text.lines, f" return [{', '.join(torques)}]"]
    space = {"cos": math.cos, "sin": math.sin, "exp": math.exp, "tanh": math.tanh}
    exec("\n".join(lines), space)
    made: OneState = space["torques"]  # type: ignore[assignment]
    return made


def _spread(model: Model, base: BaseModel, theta: Floats) -> tuple[Floats, Floats]:
    """Return the rigid-body columns' values at each joint, (n, 11 n), and those of fv, fc and fo, (n, 3)."""
    rigid, friction = np.zeros((len(theta), 11 * len(theta))), np.zeros((len(theta), 3))
    for k, column in enumerate(base.reduction.base):
        if column < len(model.link_columns):
            rigid[:, model.link_columns[column]] = theta[:, k]
        else:
            parameter = model.parameters[column]
            friction[parameter.number - 1, ("fv", "fc", "fo").index(parameter.kind)] = theta[
                parameter.number - 1, k
            ]
    return rigid, friction


def _known(model: Model) -> Floats:
    """Return the values of links that keep their prior, (11 n,)."""
    found, robot = np.zeros(11 * model.robot.n), model.robot
    others = tuple(k for k in range(1, robot.n + 1) if k not in robot.identified_links)
    if others:
        bare = tuple(replace(joint, friction=(), motor_inertia=False) for joint in robot.joints)
        rest = Model(replace(robot, links=others, joints=bare), model.rigid)
        found[rest.link_columns] = prior_vector(rest)
    return found


def _write_signs(text: _Text, robot: Robot) -> None:
    shape = robot.coulomb_shape
    for j, limit in enumerate(shape.velocity):
        smooth, stepped = (
            f"tanh(qd[{j}]/{limit!r})",
            f"((qd[{j}]>0)-(qd[{j}]<0) if abs(qd[{j}])>={limit!r} else 0.0)",
        )
        moves = "coulomb" in robot.joints[j].friction
        text.lines.append(
            f" sign{j}={(smooth if shape.shape == 'smooth' else stepped) if moves else '0.0'}"
        )


def _residual(error: ModelError, j: int, load: str) -> str:
    """Return the mean torque of the residual model at a joint: the columns of ``error_columns.shapes_of``."""
    weight = (error.mean[j] / error.scale[j]).tolist()
    sines = [
        f"{name}({m}*q[{j}])"
        for m in range(1, tuning.POSITION_HARMONICS + 1)
        for name in ("sin", "cos")
    ]
    speed = f"abs(qd[{j}])/{float(error.speed[j])!r}"
    rubbing = [
        *sines[: 2 * tuning.FRICTION_HARMONICS],
        *(f"exp({speed}/{-least!r})" for least in tuning.FRICTION_SPEEDS),
        f"abs({load})",
    ]
    alone, signed = (
        _sum(w, x) for w, x in ((weight[: len(sines)], sines), (weight[len(sines) :], rubbing))
    )
    return f"{alone}+sign{j}*({signed})"


def _sum(weights: list[float], terms: list[str]) -> str:
    return (
        "+".join(
            f"{weight!r}*{term}" for weight, term in zip(weights, terms, strict=True) if weight
        )
        or "0.0"
    )


class _Text:
    """Lines of the function that is written."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def program(self, program: Program, robot: Robot) -> list[list[tuple[int, str]]]:
        """Write a program with the geometry folded in; return column and name of each entry, joint by joint."""
        fixed, slots = geometry(robot), list[float | str]()
        for name in program.inputs:
            kind = name.rstrip("0123456789")
            if name not in fixed:
                j = int(name[len(kind) :]) - 1
                self.lines.append(
                    f" {name}={_INPUTS[kind].format(j, float(robot.joints[j].theta_offset))}"
                )
            slots.append(float(fixed[name]) if name in fixed else name)
        slots += map(float, program.constants)
        for k, (op, left, right) in enumerate(
            zip(program.op, program.lhs, program.rhs, strict=True)
        ):
            a, b = slots[left], 0.0 if op == NEG else slots[right]
            if isinstance(a, float) and isinstance(b, float):
                slots.append(FOLD[int(op)](a, b))
                continue
            self.lines.append(f" x{k}=-{a}" if op == NEG else f" x{k}={a}{'+-*'[op]}{b}")
            slots.append(f"x{k}")
        found: list[list[tuple[int, str]]] = [[] for _ in range(program.shape[0])]
        for row, column, slot in zip(program.rows, program.cols, program.outputs, strict=True):
            found[row].append((int(column), str(slots[slot])))
        return found

    def total(
        self, entries: list[tuple[int, str]], values: Floats, friction: Floats, j: int
    ) -> str:
        """Return the torque of a joint from its entries and the values of their columns."""
        body = _sum([float(values[column]) for column, _ in entries], [name for _, name in entries])
        return f"{body}+{_sum(friction.tolist(), [f'qd[{j}]', f'sign{j}', '1.0'])}"
