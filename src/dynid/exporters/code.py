"""The base model as source code in C, Python and MATLAB: one set of statements, one template a language.

Geometry is folded into numbers. Expressions are made of numbers and of names of this module only, in NumPy's spelling
with elements ``q[0]``; a language replaces what it spells otherwise. Names from files stand in comments, escaped.
"""

from __future__ import annotations

import ctypes
import re
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from subprocess import run
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.estimation.one_state import coulomb, shape_texts
from dynid.estimation.residual_model import ModelError
from dynid.exporters.formulas import (
    columns_of,
    phrase,
    why_not_code,
    without_torque,
    written,
)
from dynid.exporters.full_model import numbers
from dynid.exporters.interface import Format, IdentifiedArm, Loaded, motion_of
from dynid.model.parameters import Parameter
from dynid.model.printing import number, statements
from dynid.robot import LINK_PARAMETERS, Robot
from dynid.text import code, identifier, printable, xml_comment

#: An entry of the regressor: row, column and value.
Entry = tuple[int, int, str]

#: How each language spells an expression.
SPELLED: dict[str, Callable[[str], str]] = {
    "c": lambda text: text.replace("abs(", "fabs(").replace("sign(", "dynid_sign("),
    "python": lambda text: re.sub(r"\[(\d+)\]", r"[..., \1]", text),
    "matlab": lambda text: re.sub(
        r"\[(\d+)\]", lambda match: f"({int(match[1]) + 1})", text.replace("pow(", "power(")
    ),
}
#: A compiler has this long [s]. Evidence: cc takes 0.8 s for the LWR4+ with its residual model.
PATIENCE_S = 60.0


def rendered(template: str, spelled: Callable[[str], str] = str, /, **facts: Any) -> str:  # noqa: ANN401
    """Return a file of ``templates/`` with facts put in; ``|spelled`` is a filter for expressions there."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=template.endswith(".xml"),
    )
    environment.filters |= {
        "spelled": spelled,
        "code": code,
        "name": identifier,
        "ascii": ascii,
        "row": numbers,
        "xml": printable,
        "comment": lambda x: Markup(xml_comment(x)),
    }
    environment.globals |= {"zip": zip, "code": code}
    return environment.get_template(template).render(facts)


def source_code(arm: IdentifiedArm, language: str) -> str:
    """Return the base model of an arm as a file of source code."""
    model, reduction, error = arm.base.model, arm.base.reduction, arm.predicted_error
    moving, inertial = _inertial(arm)
    friction = list[Entry]()
    for place, column in enumerate(reduction.base):
        if len(model.link_columns) <= column < model.size_without_effects:
            parameter = model.parameters[column]
            target = inertial if parameter.kind == "Imc" else friction
            target += [(row, place, value) for row, value in _friction(arm.robot, parameter)]
    columns = [
        column for added in model.added if not why_not_code(added) for column in columns_of(added)
    ]
    return rendered(
        f"{language}.txt",
        SPELLED[language],
        arm=arm,
        n=arm.robot.n,
        p=len(arm.theta),
        names=tuple(map(code, reduction.base_names)),
        theta=arm.theta.tolist(),
        moving=moving,
        inertial=inertial,
        friction=friction,
        effects=[
            (column.joint, reduction.base_names.index(column.name), written(column.node, arm.robot))
            for column in columns
        ],
        loads=any(column.signals & {"tau", "total"} for column in columns),
        rigid=int(np.sum(reduction.base < len(model.link_columns))),
        plain=int(np.sum(reduction.base < model.size_without_effects)),
        residual=None if error is None else _residual(arm, error),
    )


def _inertial(arm: IdentifiedArm) -> tuple[list[tuple[str, str]], list[Entry]]:
    """Return variables with their values, in order, and the entries of bodies and rotors that are made of them."""
    model, robot = arm.base.model, arm.robot
    places: dict[int, list[int]] = {}
    for place, k in enumerate(arm.base.reduction.base):
        parameter = model.parameters[k]
        if k < len(model.link_columns):
            places.setdefault(int(model.link_columns[k]), []).append(place)
        elif parameter.kind == "payload":
            # It has the columns of the last link, some of which are base parameters too.
            number_of = LINK_PARAMETERS.index(parameter.name.split("_")[1])
            places.setdefault(11 * (robot.n - 1) + number_of, []).append(place)
    program = model.rigid.restricted(np.array(list(places), dtype=np.intp))
    variables, text = statements(program, robot)
    entries = zip(program.rows.tolist(), program.cols, program.outputs, strict=True)
    into = list(places.values())
    return variables, [(row, to, text[slot]) for row, col, slot in entries for to in into[col]]


def _friction(robot: Robot, parameter: Parameter) -> list[tuple[int, str]]:
    """Return rows and values of the column of friction, or of a motor that drives several joints."""
    kind, joint, share = parameter.kind, parameter.number - 1, parameter.share
    signal = f"qd[{joint}]"
    if share:
        array = "qdd" if kind == "Imc" else "qd"
        parts = (f"{number(x)} * {array}[{k}]" for k, x in enumerate(share) if x)
        signal = f"({' + '.join(parts)})"
    value = "1.0" if kind == "fo" else signal
    if kind in ("fc", "fcc"):
        value = f"({coulomb(robot, joint, signal)})"
    if not share:
        return [(joint, value)]
    return [(k, f"{number(x)} * {value}") for k, x in enumerate(share) if x]


def _residual(arm: IdentifiedArm, error: ModelError) -> dict[str, Any]:
    """Return the mean of the residual model: reference parameters, sums of shapes, and shifts of the parameters.

        tau_j = sum_k a_jk shape_k(q_j, qd_j) + a_j |Y_j reference| sign_j - Y_j shift_j

    Shapes are those of ``dynid.estimation.residual_model``, in their order.
    """
    by_column, by_parameter = error.mean_by_rows
    moved = {p.number - 1 for p in arm.base.model.parameters if p.kind == "fc"}
    sums = []
    for j, factors in enumerate(by_column.tolist()):
        sign = f"({coulomb(arm.robot, j, f'qd[{j}]') if j in moved else '0.0'})"
        shapes = shape_texts(j, error.speed[j], sign, f"load[{j}]")
        sums.append(
            " + ".join(f"{number(a)} * {shape}" for a, shape in zip(factors, shapes, strict=True))
        )
    return {"reference": error.reference.tolist(), "sums": sums, "shift": (-by_parameter).tolist()}


# ---------------------------------------------------------------- loading it again
def _loaded(arm: IdentifiedArm, engine: str, theirs: Any) -> Loaded:  # noqa: ANN401
    error = arm.predicted_error
    gone = {name for each in arm.base.model.added if why_not_code(each) for name in each.names}
    held = np.array([name not in gone for name in arm.base.names])

    def ours(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        W = arm.base.observer.along(motion_of(arm, q, qd, qdd)) * held
        tau: Floats = W @ arm.theta
        if error is None:
            return tau
        return tau + error.torque(W, error.shapes_at(q, qd, arm.base.observer))

    return Loaded(engine, "all", theirs, ours)


def compiled(text: str, compiler: str = "cc") -> ctypes.CDLL:
    """Compile C to a shared library and load it.

    Raises:
        OSError: the compiler made nothing, or programs may not be run from the folder of temporary files.
        subprocess.SubprocessError: it failed, or took too long.
    """
    with TemporaryDirectory() as folder:
        library = Path(folder) / "arm.so"
        words = f"{compiler} -O1 -std=c99 -shared -fPIC -x c - -o {library} -lm".split()
        run(words, input=text.encode(), capture_output=True, check=True, timeout=PATIENCE_S)
        return ctypes.CDLL(str(library))


def pointer(row: Floats) -> object:
    """Return the address of a contiguous array."""
    return row.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def _in_c(text: str, arm: IdentifiedArm) -> Loaded | None:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return None
    library = compiled(text, compiler)

    def theirs(*states: Floats) -> Floats:
        tau = np.empty_like(states[0])
        for rows in zip(*states, tau, strict=True):
            library.dynid_inverse_dynamics(*map(pointer, rows))
        return tau

    return _loaded(arm, Path(compiler).name, theirs)._replace(what=f"all, {arm.robot.n} joints")


def imported(text: str) -> ModuleType:
    """Return a module from its text."""
    module = ModuleType("dynid_exported")
    exec(compile(text, "exported.py", "exec"), module.__dict__)
    return module


def _in_python(text: str, arm: IdentifiedArm) -> Loaded:
    return _loaded(arm, "NumPy", imported(text).inverse_dynamics)


def _leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    names, said = arm.robot.joint_names, without_torque(arm.robot)
    for added in arm.base.model.added:
        if not added.effect.left_out and (why := why_not_code(added)):
            said += (f"effect {phrase(added, names)}: {why}",)
    return said


def _matlab_leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    name = identifier(arm.file_stem)
    place = [f"the file must be called {name}.m to be found by MATLAB"] * (name != arm.file_stem)
    return (*_leaves_out(arm), *place)


def _format(
    name: str,
    suffix: str,
    loaded: Callable[[str, IdentifiedArm], Loaded | None],
    leaves_out: Callable[[IdentifiedArm], tuple[str, ...]] = _leaves_out,
) -> Format:
    text = partial(source_code, language=name)
    return Format(name, suffix, text, leaves_out, loaded, needs_bodies=False, tolerance=1e-12)


C = _format("c", ".c", _in_c)
PYTHON = _format("python", ".py", _in_python)
MATLAB = _format("matlab", ".m", lambda text, arm: None, _matlab_leaves_out)
