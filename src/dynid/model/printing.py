"""Show the regressor to a person: as LaTeX equations or as a NumPy function that depends on nothing else."""

from __future__ import annotations

from dynid.model.kinematics import geometry
from dynid.model.parameters import link_parameters
from dynid.model.program import ADD, MUL, NEG, SUB, input_of
from dynid.model.regressor import Model
from dynid.text import code

_SIGN = {ADD: "+", SUB: "-", MUL: "*"}
_LATEX = {"qd": r"\dot{q}", "qdd": r"\ddot{q}", "c": r"\cos\theta", "s": r"\sin\theta"}
_LATEX |= {"ca": r"\cos\alpha", "sa": r"\sin\alpha"}


def as_python(model: Model) -> str:
    """Return the text of a NumPy function for the rigid-body regressor."""
    program, robot = model.rigid, model.robot
    name = [*program.inputs, *(f"t{k}" for k in range(program.flops))]
    fixed = geometry(robot)
    lines = [
        f"# Regressor of {code(robot.name)}: tau = P(q, qd, qdd) gamma.",
        "# Columns: m mcx mcy mcz Ixx Ixy Ixz Iyy Iyz Izz Im of link 1, then of link 2, and so on.",
        "import numpy as np",
        "",
        "def regressor(q, qd, qdd):",
        f"    P = np.zeros(({program.shape[0]}, {program.shape[1]}) + np.shape(q[0]))",
    ]
    for entry in program.inputs:
        if entry in fixed:
            lines.append(f"    {entry} = {fixed[entry]!r}")
            continue
        kind, i = input_of(entry)
        offset = robot.joints[i].theta_offset
        angle = f"q[{i}]" if not offset else f"q[{i}] + {offset!r}"
        value = {"c": f"np.cos({angle})", "s": f"np.sin({angle})"}.get(kind, f"{kind}[{i}]")
        lines.append(f"    {entry} = {value}")
    for k in range(program.flops):
        op, a, b = int(program.op[k]), name[program.lhs[k]], name[program.rhs[k]]
        lines.append(f"    t{k} = -{a}" if op == NEG else f"    t{k} = {a} {_SIGN[op]} {b}")
    for row, col, slot in zip(program.rows, program.cols, program.outputs, strict=True):
        lines.append(f"    P[{row}, {col}] = {name[slot]}")
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
