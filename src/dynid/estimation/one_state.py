"""Inverse dynamics of one state at a time, as a controller asks for it: a Python function of plain numbers.

Array operations on a single sample take a thousand times as long as its additions and products. The straight-line
program of the regressor, which is checked when it is read, is written as Python once per result, with the parameters
folded in; nothing but numbers and the names of its inputs gets into that text. Exporters write the same statements.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.estimation import tuning
from dynid.estimation.residual_model import ModelError
from dynid.model.base_model import BaseModel
from dynid.model.printing import number, statements
from dynid.robot import Robot

#: Returns the torques of positions, velocities and accelerations of all joints.
OneState = Callable[[list[float], list[float], list[float]], list[float]]


# ---------------------------------------------------------------- spelling
def coulomb(robot: Robot, joint: int, speed: str) -> str:
    """Return the Coulomb sign of a joint, 0-based, as an expression."""
    shape = robot.coulomb_shape
    limit = number(shape.velocity[joint])
    if shape.shape == "smooth":
        return f"tanh({speed} / {limit})"
    return f"(abs({speed}) >= {limit}) * sign({speed})"


def shape_texts(joint: int, speed: float, sign: str, load: str) -> list[str]:
    """Return the columns of ``residual_model.shapes_of`` of a joint as expressions, with the torque of the load."""
    waves = [
        f"{function}({k}.0 * q[{joint}])"
        for k in range(1, tuning.POSITION_HARMONICS + 1)
        for function in ("sin", "cos")
    ]
    slow = [f"exp(-abs(qd[{joint}]) / {number(x * speed)})" for x in tuning.FRICTION_SPEEDS]
    rest = [*waves[: 2 * tuning.FRICTION_HARMONICS], *slow, f"abs({load})"]
    return [*waves, *(f"{sign} * {each}" for each in rest)]


def _sum(terms: Iterable[tuple[float, str]]) -> str:
    return " + ".join(f"{number(weight)} * {term}" for weight, term in terms if weight) or "0.0"


# ---------------------------------------------------------------- the function
def one_state(base: BaseModel, theta: Floats, error: ModelError | None) -> OneState | None:
    """Return the inverse dynamics of single states; None of a part of an arm, or where torques depend on more.

    Args:
        base: model and base parameters.
        theta: base parameters, (p,), each in its unit.
        error: the residual model whose mean is part of the torque; None without.
    """
    model, robot, n = base.model, base.robot, base.robot.n
    if model.added or robot.coupling is not None or len(robot.identified_links) < n:
        return None
    own, size = base.reduction.base, len(model.link_columns)
    program = model.rigid.restricted(model.link_columns[own[own < size]])
    variables, text = statements(program, robot)
    signs = [
        coulomb(robot, j, f"qd[{j}]") if "coulomb" in joint.friction else "0.0"
        for j, joint in enumerate(robot.joints)
    ]
    variables += [(f"sign{j}", sign) for j, sign in enumerate(signs)]
    spelled = {"fv": "qd[{}]", "fc": "sign{}", "fo": "1.0"}
    # Row, base column and text of each entry of the regressor.
    entries = [
        (row, k, text[slot])
        for row, k, slot in zip(program.rows, program.cols, program.outputs, strict=True)
    ]
    for k in np.flatnonzero(own >= size):
        rubs = model.parameters[own[k]]
        entries.append((rubs.number - 1, k, spelled[rubs.kind].format(rubs.number - 1)))

    def torque(theta: Floats, j: int) -> str:
        return _sum((theta[k], term) for row, k, term in entries if row == j)

    torques = [torque(theta, j) for j in range(n)]
    if error is not None:
        # Why of each joint: the residual model is orthogonal to the parameters joint by joint.
        for j, (by_column, by_parameter) in enumerate(zip(*error.mean_by_rows, strict=True)):
            load = torque(error.reference, j)
            shapes = shape_texts(j, error.speed[j], f"sign{j}", load)
            left = _sum(zip(by_column, shapes, strict=True))
            torques[j] = f"{torque(theta + by_parameter, j)} + {left}"
    lines = [f" {name} = {value}" for name, value in variables]
    lines = ["def torques(q, qd, qdd):", *lines, f" return [{', '.join(torques)}]"]
    space: dict[str, Any] = {name: getattr(math, name) for name in ("cos", "sin", "exp", "tanh")}
    space["sign"] = lambda x: (x > 0) - (x < 0)
    exec("\n".join(lines), space)
    made: OneState = space["torques"]
    return made
