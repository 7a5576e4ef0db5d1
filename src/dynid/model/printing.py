"""Show the regressor to a person: as LaTeX equations or as a NumPy function that depends on nothing else."""

from __future__ import annotations

import re

from dynid.model.parameters import link_parameters
from dynid.model.program import ADD, MUL, NEG, SUB, Program, bound, input_of
from dynid.model.regressor import Model
from dynid.robot import Robot
from dynid.text import code

_SIGN = {ADD: "+", SUB: "-", MUL: "*"}


def number(value: float) -> str:
    """Return a number with all its digits, in brackets where it is negative."""
    return repr(float(value)) if value >= 0 else f"({float(value)!r})"


def statements(program: Program, robot: Robot) -> tuple[list[tuple[str, str]], list[str]]:
    """Return variables with their values, in order, and the text of each slot of a program."""
    known, inputs, steps = bound(program, robot)
    text = ["" if value is None else number(value) for value in known]
    variables = []
    for slot, name in inputs:
        text[slot] = name
        kind, joint = input_of(name)
        offset = robot.joints[joint].theta_offset
        angle = f"q[{joint}]" + (f" + {number(offset)}" if offset else "")
        function = {"c": "cos", "s": "sin"}.get(kind)
        variables.append((name, f"{function}({angle})" if function else f"{kind}[{joint}]"))
    for op, a, b, out in steps:
        value = f"-{text[a]}" if op == NEG else f"{text[a]} {_SIGN[op]} {text[b]}"
        text[out] = f"t{out}"
        variables.append((text[out], value))
    return variables, text


def as_python(model: Model) -> str:
    """Return the text of a NumPy function for the rigid-body regressor."""
    program, robot = model.rigid, model.robot
    variables, text = statements(program, robot)
    entries = zip(program.rows, program.cols, program.outputs, strict=True)
    lines = [
        f"# Regressor of {code(robot.name)}: tau = P(q, qd, qdd) gamma.",
        "# Columns: m mcx mcy mcz Ixx Ixy Ixz Iyy Iyz Izz Im of link 1, then of link 2, and so on.",
        "import numpy as np",
        "from numpy import cos, sin",
        "",
        "def regressor(q, qd, qdd):",
        f"    P = np.zeros({program.shape} + np.shape(q[0]))",
        *(f"    {name} = {value}" for name, value in variables),
        *(f"    P[{row}, {col}] = {text[slot]}" for row, col, slot in entries),
        "    return P",
    ]
    return "\n".join(lines)


def as_latex(model: Model) -> str:
    """Return the operations with the numbers of the arm put in, and the entries of P, as LaTeX."""
    program, names = model.rigid, [parameter.name for parameter in link_parameters(model.robot)]
    lines, text = statements(program, model.robot)
    entries = zip(program.rows, program.cols, program.outputs, strict=True)
    lines += [(rf"P_{{{row + 1},{names[col]}}}", text[slot]) for row, col, slot in entries]
    rows = (rf"{name} &= {value} \\".replace("*", r"\,") for name, value in lines)
    # Why a brace behind a letter: c12 is the twelfth c.
    numbered = re.sub(r"\b([A-Za-z]+)(\d+)\b", r"\1_{\2}", "\n".join(rows))
    return "\n".join([r"\begin{align*}", numbered, r"\end{align*}"])
