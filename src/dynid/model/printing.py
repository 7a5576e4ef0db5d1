"""Show the regressor to a person: as LaTeX equations or as a NumPy function that depends on nothing else."""

from __future__ import annotations

from dynid.model.kinematics import geometry
from dynid.model.parameters import link_parameters
from dynid.model.program import ADD, MUL, NEG, SUB, Program, input_of
from dynid.model.regressor import Model
from dynid.text import code

_SIGN = {ADD: "+", SUB: "-", MUL: "*"}


def _slots(program: Program) -> list[str]:
    return [
        *program.inputs,
        *(str(c) for c in program.constants),
        *(f"t{k}" for k in range(program.flops)),
    ]


def as_python(model: Model) -> str:
    """Return the text of a NumPy function for the rigid-body regressor."""
    program, robot = model.rigid, model.robot
    name, fixed = _slots(program), geometry(robot)
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
    """Return the named expressions and the entries of P as LaTeX."""
    from sympy import Symbol, latex

    from dynid.model.dynamics import derive

    _, recorder, entries = derive(model.robot)
    names = [parameter.name for parameter in link_parameters(model.robot)]
    nice: dict[Symbol, Symbol] = {}
    for i in range(1, model.robot.n + 1):
        nice |= {
            Symbol(f"qd{i}"): Symbol(rf"\dot{{q}}_{{{i}}}"),
            Symbol(f"qdd{i}"): Symbol(rf"\ddot{{q}}_{{{i}}}"),
        }
        nice |= {
            Symbol(f"{x}{i}"): Symbol(rf"\{y}_{{{i}}}")
            for x, y in (("c", "cos\\theta"), ("s", "sin\\theta"))
        }
        nice |= {
            Symbol(f"{x}a{i}"): Symbol(rf"\{y}\alpha_{{{i}}}")
            for x, y in (("c", "cos"), ("s", "sin"))
        }
    lines = [
        rf"{latex(symbol)} &= {latex(expression.xreplace(nice))} \\"
        for symbol, expression in recorder.assignments
    ]
    for (row, col), expression in sorted(entries.items()):
        lines.append(rf"P_{{{row + 1},\,{names[col]}}} &= {latex(expression.xreplace(nice))} \\")
    return "\n".join([r"\begin{align*}", *lines, r"\end{align*}"])
