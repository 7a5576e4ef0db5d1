"""The base model as plain statements in a programming language: what the C, Python and MATLAB exporters share.

Geometry is folded into numbers; gravity is multiplied by a switch ``g``, so that one regressor serves gravity (no
motion), mass matrix (unit accelerations, no gravity) and Coriolis terms (velocities, no gravity).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.errors import WrongUsage
from dynid.exporters.interface import Source
from dynid.model.kernels import geometry
from dynid.model.program import ADD, MUL, NEG, SUB, Program
from dynid.robot import Robot

_SIGN = {ADD: "+", SUB: "-", MUL: "*"}


@dataclass(frozen=True)
class Dialect:
    """How a language writes things; ``i``, ``row`` and ``col`` count from ``first``.

    Attributes:
        declare: a new variable, with {name} and {value}.
        store: an entry of the regressor, with {row}, {col}, {flat} and {value}.
        item: an element of a vector, with {array} and {i}.
        call: a function of one number, with {function} and {x}.
        threshold: Coulomb sign that is zero below a limit, with {x} and {limit}.
        first: number of a vector's first element.
    """

    declare: str
    store: str
    item: str
    call: str
    threshold: str
    first: int


@dataclass(frozen=True)
class BaseCode:
    """Statements for the base regressor.

    Attributes:
        inertial: statements that store what moves masses and rotors.
        friction: statements that store the rest.
        names: base parameters in the order of the columns.
        moving: how many of the columns are inertial; they come first.
    """

    inertial: tuple[str, ...]
    friction: tuple[str, ...]
    names: tuple[str, ...]
    moving: int


def base_code(source: Source, dialect: Dialect) -> BaseCode:
    """Return the base regressor of a source as statements."""
    model, reduction = source.base.model, source.base.reduction
    links = len(model.link_columns)
    rigid = reduction.base < links
    program = model.rigid.restricted(model.link_columns[reduction.base[rigid]])
    inertial = _statements(program, model.robot, dialect, len(reduction.base))
    friction: list[str] = []
    for col in np.flatnonzero(~rigid):
        column = model.extra[reduction.base[col] - links]
        target = inertial if column.name.startswith("Imc") else friction
        for row, value in _entries(column.name, model.robot, dialect):
            target.append(_stored(dialect, row, int(col), len(reduction.base), value))
    return BaseCode(tuple(inertial), tuple(friction), reduction.base_names, int(rigid.sum()))


def _stored(dialect: Dialect, row: int, col: int, width: int, value: str) -> str:
    return dialect.store.format(row=row + dialect.first, col=col + dialect.first, flat=row * width + col, value=value)


def _statements(program: Program, robot: Robot, dialect: Dialect, width: int) -> list[str]:
    """Return the program with everything that does not move computed beforehand."""
    fixed = geometry(robot)
    lines: list[str] = []
    value: list[float | str] = []
    for name in program.inputs:
        if name in fixed and name[0] != "g":
            value.append(fixed[name])
            continue
        value.append(name)
        lines.append(dialect.declare.format(name=name, value=_input(name, robot, dialect, fixed)))
    value += [float(constant) for constant in program.constants]
    for k in range(program.flops):
        op, a, b = int(program.op[k]), value[program.lhs[k]], value[program.rhs[k]]
        if isinstance(a, float) and (op == NEG or isinstance(b, float)):
            value.append(_folded(op, a, b if isinstance(b, float) else 0.0))
            continue
        value.append(f"t{k}")
        text = f"-{_written(a)}" if op == NEG else f"{_written(a)} {_SIGN[op]} {_written(b)}"
        lines.append(dialect.declare.format(name=f"t{k}", value=text))
    entries = zip(program.rows.tolist(), program.cols.tolist(), program.outputs.tolist(), strict=True)
    return lines + [_stored(dialect, row, col, width, _written(value[slot])) for row, col, slot in entries]


def _folded(op: int, a: float, b: float) -> float:
    return {ADD: a + b, SUB: a - b, MUL: a * b, NEG: -a}[op]


def _written(value: float | str) -> str:
    if isinstance(value, str):
        return value
    return repr(value) if value >= 0 else f"({value!r})"


def _input(name: str, robot: Robot, dialect: Dialect, fixed: dict[str, float]) -> str:
    """Return an input that moves, or gravity behind its switch."""
    if name in fixed:
        return f"g * {_written(fixed[name])}"
    kind = name.rstrip("0123456789")
    i = int(name[len(kind) :]) - 1
    if kind not in ("c", "s"):
        return dialect.item.format(array=kind, i=i + dialect.first)
    offset = robot.joints[i].theta_offset
    angle = dialect.item.format(array="q", i=i + dialect.first) + (f" + {_written(offset)}" if offset else "")
    return dialect.call.format(function={"c": "cos", "s": "sin"}[kind], x=angle)


def _entries(name: str, robot: Robot, dialect: Dialect) -> list[tuple[int, str]]:
    """Return rows and values of a friction or coupled-motor column."""
    kind = name.rstrip("0123456789")
    j = int(name[len(kind) :]) - 1
    speed = dialect.item.format(array="qd", i=j + dialect.first)
    if kind == "fv":
        return [(j, speed)]
    if kind == "fo":
        return [(j, "1.0")]
    if kind == "fc":
        return [(j, _coulomb(robot, j, speed, dialect))]
    if kind in ("Imc", "fvc", "fcc") and robot.coupling is not None:
        row = np.array(robot.coupling.matrix)[j]
        share = row / row[j] if row[j] else row
        array = "qdd" if kind == "Imc" else "qd"
        each = [
            f"{_written(float(share[k]))} * {dialect.item.format(array=array, i=k + dialect.first)}"
            for k in np.flatnonzero(share)
        ]
        total = f"({' + '.join(each)})"
        signal = _coulomb(robot, j, total, dialect) if kind == "fcc" else total
        return [(int(k), f"{_written(float(share[k]))} * {signal}") for k in np.flatnonzero(share)]
    raise WrongUsage(
        f"the effect behind parameter {name} cannot be written as code",
        fix="export another format, or without the effect",
    )


def _coulomb(robot: Robot, joint: int, speed: str, dialect: Dialect) -> str:
    shape = robot.coulomb_shape
    limit = _written(shape.velocity[joint])
    if shape.shape == "smooth":
        return dialect.call.format(function="tanh", x=f"{speed} / {limit}")
    return dialect.threshold.format(x=speed, limit=limit)
