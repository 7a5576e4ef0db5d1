"""The base model as source code: one description of the statements, and a table of each language's spellings.

Geometry is folded into numbers; gravity is multiplied by a switch ``g``, so that one regressor serves gravity (no
motion), mass matrix (unit accelerations, no gravity) and Coriolis terms (velocities, no gravity). Statements are made
from numbers and from names of this module only; names that come from files stand in comments, escaped.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from string import Template

import numpy as np
from numpy.typing import NDArray

from dynid.errors import WrongUsage
from dynid.exporters import closed_forms, formula_code, residual_code
from dynid.exporters.interface import IdentifiedArm
from dynid.model.kinematics import geometry
from dynid.model.parameters import Parameter
from dynid.model.program import ADD, FOLD, MUL, NEG, SUB, Program
from dynid.robot import LINK_PARAMETERS, Robot
from dynid.text import code, identifier

Floats = NDArray[np.float64]

#: Where the templates are.
TEMPLATES = Path(__file__).parent / "templates"
_SIGN = {ADD: "+", SUB: "-", MUL: "*"}
#: Inputs of the program that move, and the array or the function of an array that they are.
_ARRAYS = ("q", "qd", "qdd")
_FUNCTIONS = {"c": "cos", "s": "sin"}


@dataclass(frozen=True)
class Language:
    """How a language spells the statements; ``i``, ``row`` and ``col`` count from ``first``.

    Attributes:
        template: file in ``templates/`` with the functions around the statements.
        declare: a new variable, with {name} and {value}.
        store: an entry of the regressor, with {row}, {col}, {flat} and {value}.
        item: an element of a vector, with {array} and {i}.
        call: a function of one number, with {function} and {x}.
        threshold: Coulomb sign that is zero below a limit, with {x} and {limit}.
        first: number of a vector's first element.
        comment: what stands before a line of the comment at the file's head.
        value: a base parameter in the vector of all, with {value} and the comment {name}.
        between: what stands between two of them.
        torque: a statement that stores a torque, with {i} and {value}.
        absolute: name of the absolute value.
        add: how the torques get those of the residual model, where there is one, and where there is none.
        power: a number to the power of another, with {x} and {p}.
        plain_sign: sign of a number, with {x}.
        loads: statements that sum torques of the bodies, and with friction, from the first {rigid} and {plain} columns.
    """

    template: str
    declare: str
    store: str
    item: str
    call: str
    threshold: str
    first: int
    comment: str
    value: str
    between: str
    torque: str
    absolute: str
    add: tuple[str, str]
    power: str
    plain_sign: str
    loads: str


def source_code(arm: IdentifiedArm, language: Language) -> str:
    """Return the base model of an arm as a file of source code."""
    writer = _Writer(language, arm.base.robot, len(arm.theta))
    inertial, friction, formulas = writer.statements(arm)
    names = [code(name) for name in arm.base.reduction.base_names]
    values = zip(names, arm.theta.tolist(), strict=True)
    with_residual, without = language.add
    return template(language.template).substitute(
        head=arm.head(code, whole=True),
        residual=writer.residual(arm),
        add=with_residual if arm.predicted_error is not None else without,
        file=code(arm.file_stem),
        name=identifier(arm.file_stem),
        table="\n".join(language.comment + line for line in parameter_lines(arm)),
        n=arm.robot.n,
        p=len(names),
        names=ascii(tuple(names)),
        values=language.between.join(
            language.value.format(value=repr(value), name=name) for name, value in values
        ),
        inertial="\n".join(inertial),
        friction="\n".join(friction),
        formulas="\n".join(formulas),
    )


def parameter_lines(arm: IdentifiedArm) -> list[str]:
    """Return one line of a comment per base parameter: value, how well it is known, what it is made of."""
    reduction = arm.base.reduction
    lines = []
    for row, (name, value, known) in enumerate(
        zip(reduction.base_names, arm.theta, arm.known, strict=True)
    ):
        terms = [f"{factor:+.6g} {code(term)}" for term, factor in reduction.terms(row).items()]
        formula = f"  = {' '.join(terms)}" if len(terms) > 1 else ""
        origin = (
            "not determined by the data"
            if known == "not determined"
            else f"from the data, known {code(known)}"
        )
        lines.append(f"{code(name):<7} {float(value): .6e}  {origin}{formula}")
    return lines


def _payload(arm: IdentifiedArm) -> tuple[list[int], list[int]]:
    """Return the last link's columns of a payload among all of the links, and their places among the base columns."""
    names, n = arm.base.reduction.base_names, arm.robot.n
    columns = [
        one
        for added in arm.base.model.added
        if added.effect.name == "payload"
        for one in added.columns
    ]
    kinds = [LINK_PARAMETERS.index(one.parameter.name.removeprefix("payload_")) for one in columns]
    places = [names.index(one.parameter.name) for one in columns]
    return [11 * (n - 1) + kind for kind in kinds], places


def template(name: str) -> Template:
    """Return a file of ``templates/``."""
    return Template((TEMPLATES / name).read_text(encoding="utf-8"))


class _Writer:
    """Writes statements in one language.

    Args:
        language: the language.
        robot: the arm whose geometry is folded in.
        width: number of columns of the regressor.
    """

    def __init__(self, language: Language, robot: Robot, width: int) -> None:
        self.language, self.robot, self.width = language, robot, width

    def statements(self, arm: IdentifiedArm) -> tuple[list[str], list[str], list[str]]:
        """Return the statements of the regressor: what moves masses and rotors, friction, effects."""
        model, base = arm.base.model, arm.base.reduction.base
        links = len(model.link_columns)
        rigid = base < links
        tip, places = _payload(arm)
        wanted = [
            *zip(
                model.link_columns[base[rigid]].tolist(),
                np.flatnonzero(rigid).tolist(),
                strict=True,
            )
        ]
        # A payload has the columns of the last link, some of which are base parameters too.
        wanted += zip(tip, places, strict=True)
        columns = list(dict.fromkeys(column for column, _ in wanted))
        where = [[place for column, place in wanted if column == one] for one in columns]
        inertial = self._program(model.rigid.restricted(np.array(columns, dtype=np.intp)), where)
        friction: list[str] = []
        for col in np.flatnonzero(~rigid & (base < model.plain_size)):
            parameter = model.parameters[base[col]]
            target = inertial if parameter.kind == "Imc" else friction
            target += [
                self._stored(row, int(col), value) for row, value in self._entries(parameter)
            ]
        return inertial, friction, self._effects(arm)

    def _effects(self, arm: IdentifiedArm) -> list[str]:
        """Return the statements that store the columns of effects."""
        base, model = arm.base.reduction.base, arm.base.model
        places = {name: k for k, name in enumerate(arm.base.reduction.base_names)}
        spelling = formula_code.Spelling(
            item=self._item,
            sign=lambda joint: self._coulomb(joint, self._item("qd", joint)),
            call=lambda function, x: self.language.call.format(function=function, x=x),
            absolute=self.language.absolute,
            power=self.language.power,
            plain_sign=self.language.plain_sign,
        )
        columns = [
            column
            for added in model.added
            if not closed_forms.why_not_code(added)
            for column in closed_forms.columns_of(added) or ()
        ]
        lines = [
            self._stored(
                column.joint, places[column.name], formula_code.written(column.node, spelling)
            )
            for column in columns
        ]
        if any(closed_forms.heads(column.node) & {"tau", "total"} for column in columns):
            rigid = int(np.sum(base < len(model.link_columns)))
            plain = int(np.sum(base < model.plain_size))
            lines.insert(0, self.language.loads.format(rigid=rigid, plain=plain))
        return lines

    def residual(self, arm: IdentifiedArm) -> str:
        """Return the functions of the residual model; nothing where there is none."""
        error = arm.predicted_error
        if error is None:
            return ""
        language = self.language
        names = [code(name) for name in arm.base.reduction.base_names]
        moved = {
            parameter.number - 1
            for parameter in arm.base.model.parameters
            if parameter.kind == "fc"
        }
        spelling = residual_code.Spelling(
            position=lambda joint: self._item("q", joint),
            speed=lambda joint: self._item("qd", joint),
            sign=lambda joint: (
                self._coulomb(joint, self._item("qd", joint)) if joint in moved else "0.0"
            ),
            load=lambda joint: self._item("load", joint),
            store=lambda joint, value: language.torque.format(
                i=joint + language.first, value=value
            ),
            call=lambda function, x: language.call.format(function=function, x=x),
            absolute=language.absolute,
        )

        def values(numbers: Floats) -> str:
            every = zip(numbers.tolist(), names * (len(numbers) // len(names)), strict=True)
            return language.between.join(
                language.value.format(value=repr(value), name=name) for value, name in every
            )

        return template(language.template.replace(".txt", "_residual.txt")).substitute(
            n=arm.robot.n,
            p=len(names),
            reference=values(error.reference),
            shift=values(residual_code.shift(error).ravel()),
            statements="\n".join(residual_code.statements(error, spelling)),
        )

    def _program(self, program: Program, places: list[list[int]]) -> list[str]:
        """Return the program with everything that does not move computed beforehand, each column in its places."""
        fixed = geometry(self.robot)
        lines: list[str] = []
        slots: list[float | str] = []

        def declared(name: str, value: str) -> str:
            lines.append(self.language.declare.format(name=name, value=value))
            return name

        for name in program.inputs:
            if name not in fixed:
                slots.append(declared(name, self._input(name)))
            elif name[0] == "g":
                slots.append(declared(name, f"g * {_number(fixed[name])}"))
            else:
                slots.append(fixed[name])
        slots += [float(constant) for constant in program.constants]
        for k in range(program.flops):
            op, a, b = int(program.op[k]), slots[program.lhs[k]], slots[program.rhs[k]]
            if isinstance(a, float) and (op == NEG or isinstance(b, float)):
                slots.append(FOLD[op](a, b if isinstance(b, float) else 0.0))
            else:
                text = (
                    f"-{_written(a)}" if op == NEG else f"{_written(a)} {_SIGN[op]} {_written(b)}"
                )
                slots.append(declared(f"t{k}", text))
        entries = zip(
            program.rows.tolist(), program.cols.tolist(), program.outputs.tolist(), strict=True
        )
        return lines + [
            self._stored(row, place, _written(slots[slot]))
            for row, col, slot in entries
            for place in places[col]
        ]

    def _stored(self, row: int, col: int, value: str) -> str:
        first, flat = self.language.first, row * self.width + col
        return self.language.store.format(row=row + first, col=col + first, flat=flat, value=value)

    def _item(self, array: str, joint: int) -> str:
        return self.language.item.format(array=array, i=joint + self.language.first)

    def _input(self, name: str) -> str:
        """Return an input that moves: a position, velocity or acceleration, or cosine or sine of a joint angle."""
        kind, joint = _kind_and_joint(name)
        if kind in _ARRAYS:
            return self._item(kind, joint)
        offset = self.robot.joints[joint].theta_offset
        angle = self._item("q", joint) + (f" + {_number(offset)}" if offset else "")
        return self.language.call.format(function=_FUNCTIONS[kind], x=angle)

    def _entries(self, parameter: Parameter) -> list[tuple[int, str]]:
        """Return rows and values of a friction or coupled-motor column."""
        kind, joint = parameter.kind, parameter.number - 1
        speed = self._item("qd", joint)
        if kind == "fv":
            return [(joint, speed)]
        if kind == "fo":
            return [(joint, "1.0")]
        if kind == "fc":
            return [(joint, self._coulomb(joint, speed))]
        if kind in ("Imc", "fvc", "fcc") and self.robot.coupling is not None:
            return self._coupled(kind, joint, np.array(self.robot.coupling.matrix)[joint])
        raise WrongUsage(
            f"the effect behind parameter {parameter.name} cannot be written as code",
            fix="export another format, or without the effect",
        )

    def _coupled(self, kind: str, motor: int, row: Floats) -> list[tuple[int, str]]:
        """Return the column of a motor that drives several joints, whose speeds are mixed by a row of the coupling."""
        share = row / row[motor] if row[motor] else row
        array = "qdd" if kind == "Imc" else "qd"
        joints = np.flatnonzero(share).tolist()
        signal = f"({' + '.join(f'{_number(share[k])} * {self._item(array, k)}' for k in joints)})"
        if kind == "fcc":
            signal = self._coulomb(motor, signal)
        return [(k, f"{_number(share[k])} * {signal}") for k in joints]

    def _coulomb(self, joint: int, speed: str) -> str:
        shape = self.robot.coulomb_shape
        limit = _number(shape.velocity[joint])
        if shape.shape == "smooth":
            return self.language.call.format(function="tanh", x=f"{speed} / {limit}")
        return self.language.threshold.format(x=speed, limit=limit)


def _kind_and_joint(name: str) -> tuple[str, int]:
    """Split a name such as ``qd3`` into its kind and the index of its joint, from 0."""
    kind = name.rstrip("0123456789")
    return kind, int(name[len(kind) :] or 0) - 1


def _number(value: float) -> str:
    return repr(float(value)) if value >= 0 else f"({float(value)!r})"


def _written(value: float | str) -> str:
    return value if isinstance(value, str) else _number(value)
