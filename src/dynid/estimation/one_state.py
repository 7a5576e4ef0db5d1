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


def _sum(weights: Iterable[float], terms: Iterable[str]) -> str:
    pairs = zip(weights, terms, strict=True)
    return " + ".join(f"{number(weight)} * {term}" for weight, term in pairs if weight) or "0.0"


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
    # Why values of each joint: the residual model is orthogonal to the parameters joint by joint.
    values, loads = np.zeros((2, n, model.size))
    values[:, own] = theta if error is None else theta + error.mean_by_rows[1]
    loads[:, own] = 0.0 if error is None else error.reference
    wanted = np.flatnonzero((values + abs(loads))[:, :size].any(axis=0))
    program = model.rigid.restricted(model.link_columns[wanted])
    variables, text = statements(program, robot)
    signs = [
        coulomb(robot, j, f"qd[{j}]") if "coulomb" in joint.friction else "0.0"
        for j, joint in enumerate(robot.joints)
    ]
    variables += [(f"sign{j}", sign) for j, sign in enumerate(signs)]

    def torque(values: Floats, j: int) -> str:
        """Return the torque of a joint for values of its columns, (columns,)."""
        mine = program.rows == j
        rubs = [k for k, p in enumerate(model.friction) if p.number == j + 1]
        spelled = {"fv": f"qd[{j}]", "fc": f"sign{j}", "fo": "1.0"}
        columns = [*wanted[program.cols[mine]], *(size + k for k in rubs)]
        terms = [text[slot] for slot in program.outputs[mine]]
        terms += [spelled[model.friction[k].kind] for k in rubs]
        return _sum(values[columns].tolist(), terms)

    torques = [torque(values[j], j) for j in range(n)]
    if error is not None:
        for j, weights in enumerate(error.mean_by_rows[0].tolist()):
            shapes = shape_texts(j, error.speed[j], f"sign{j}", torque(loads[j], j))
            torques[j] += f" + {_sum(weights, shapes)}"
    lines = [f" {name} = {value}" for name, value in variables]
    lines = ["def torques(q, qd, qdd):", *lines, f" return [{', '.join(torques)}]"]
    space: dict[str, Any] = {name: getattr(math, name) for name in ("cos", "sin", "exp", "tanh")}
    space["sign"] = lambda x: (x > 0) - (x < 0)
    exec("\n".join(lines), space)
    made: OneState = space["torques"]
    return made
