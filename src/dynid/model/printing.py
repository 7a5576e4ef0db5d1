"""Show the regressor to a person: as LaTeX equations or as a NumPy function that depends on nothing else."""

from __future__ import annotations

from dynid.model.parameters import link_parameters
from dynid.model.program import ADD, MUL, NEG, SUB, Program, bound, input_of
from dynid.model.regressor import Model
from dynid.robot import Robot
from dynid.text import code

_SIGN = {ADD: "+", SUB: "-", MUL: "*"}
_LATEX = {"qd": r"\dot{q}", "qdd": r"\ddot{q}", "c": r"\cos\theta", "s": r"\sin\theta"}
_LATEX |= {"ca": r"\cos\alpha", "sa": r"\sin\alpha"}


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
    ]
    return "\n".join([*lines, "    return P"])


def as_latex(model: Model) -> str:
    """Return the operations and the entries of P as LaTeX."""
    program = model.rigid
    name = [*map(_latex, program.inputs), *(f"t_{{{k}}}" for k in range(program.flops))]
    columns = [parameter.name for parameter in link_parameters(model.robot)]
    lines = []
    operations = zip(program.op.tolist(), program.lhs, program.rhs, strict=True)
    for result, (op, lhs, rhs) in zip(name[program.first :], operations, strict=True):
        a, b = name[lhs], name[rhs]
        sign = r"\," if op == MUL else _SIGN.get(op)
        lines.append(rf"{result} &= {f'{a} {sign} {b}' if sign else f'-{a}'} \\")
    for row, col, slot in zip(program.rows, program.cols, program.outputs, strict=True):
        lines.append(rf"P_{{{row + 1},\,{columns[col]}}} &= {name[slot]} \\")
    return "\n".join([r"\begin{align*}", *lines, r"\end{align*}"])


def _latex(entry: str) -> str:
    r"""Return an input in LaTeX: ``\dot{q}_{3}`` for ``qd3``."""
    if entry[0] == "g":
        return f"g_{entry[1]}"
    kind, joint = input_of(entry)
    return f"{_LATEX.get(kind, kind)}_{{{joint + 1}}}"
