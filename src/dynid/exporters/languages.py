"""C, Python and MATLAB: how each spells the base model, and how a written file is run to prove it."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from dynid.exporters import closed_forms
from dynid.exporters.code import Language, source_code
from dynid.exporters.interface import Format, IdentifiedArm, Loaded
from dynid.model.base_model import model_torques
from dynid.model.effects.interface import ArmMotion, ReferenceTorques
from dynid.text import identifier

Floats = NDArray[np.float64]

C = Language(
    template="c.txt",
    declare="    const double {name} = {value};",
    store="    Y[{flat}] = {value};",
    item="{array}[{i}]",
    call="{function}({x})",
    threshold="(fabs({x}) >= {limit} ? (({x}) > 0 ? 1.0 : -1.0) : 0.0)",
    first=0,
    comment=" *   ",
    value="    {value} /* {name} */",
    between=",\n",
    torque="    tau[{i}] = {value};",
    absolute="fabs",
    add=(
        "    {\n        double rest[DYNID_N];\n        int i;\n        residual(q, qd, Y, rest);\n"
        "        for (i = 0; i < DYNID_N; i++) tau[i] += rest[i];\n    }\n",
        "",
    ),
    power="pow({x}, {p})",
    plain_sign="(double)(({x} > 0) - ({x} < 0))",
    loads="    double tau[DYNID_N], total[DYNID_N];\n    loads(Y, {rigid}, tau);\n    loads(Y, {plain}, total);\n"
    "    (void)tau; (void)total;",
)
PYTHON = Language(
    template="python.txt",
    declare="    {name} = {value}",
    store="    Y[..., {row}, {col}] = {value}",
    item="{array}[..., {i}]",
    call="np.{function}({x})",
    threshold="(np.abs({x}) >= {limit}) * np.sign({x})",
    first=0,
    comment="    ",
    value="    {value},  # {name}",
    between="\n",
    torque="    tau[..., {i}] = {value}",
    absolute="abs",
    add=(
        "    Y = regressor(q, qd, qdd)\n    return Y @ theta + _residual(q, qd, Y)\n",
        "    return regressor(q, qd, qdd) @ theta\n",
    ),
    power="({x}) ** {p}",
    plain_sign="np.sign({x})",
    loads="    tau, total = Y[..., :{rigid}] @ THETA[:{rigid}], Y[..., :{plain}] @ THETA[:{plain}]",
)
MATLAB = Language(
    template="matlab.txt",
    declare="    {name} = {value};",
    store="    Y({row}, {col}) = {value};",
    item="{array}({i})",
    call="{function}({x})",
    threshold="(abs({x}) >= {limit}) * sign({x})",
    first=1,
    comment="%   ",
    value="        {value} % {name}",
    between="\n",
    torque="    tau({i}) = {value};",
    absolute="abs",
    add=(" + residual(q, qd, Y)", ""),
    power="({x}) ^ {p}",
    plain_sign="sign({x})",
    loads="    tau = Y(:, 1:{rigid}) * theta(1:{rigid});\n    total = Y(:, 1:{plain}) * theta(1:{plain});",
)


#: A compiler or Octave has this long [s]. Evidence: cc takes 0.8 s for the LWR4+ with its residual model.
PATIENCE_S = 60.0
#: Time between two states that effects are compared on [s].
STEP_S = 0.01


def _ours(arm: IdentifiedArm, q: Floats, qd: Floats, qdd: Floats) -> Floats:
    observer, error = arm.base.model.observer(arm.base.reduction.base), arm.predicted_error
    W = observer.dense(q, qd, qdd)
    names = arm.base.reduction.base_names
    held = {
        column.parameter.name
        for added in arm.base.model.added
        if not closed_forms.why_not_code(added)
        for column in added.columns
    }
    reference = model_torques(arm.base.model, arm.base.reduction, arm.theta)
    for name, row, entry in effect_entries(arm, reference, q, qd, qdd):
        if name in held:
            W[:, row, names.index(name)] = entry
    tau: Floats = W @ arm.theta
    return tau if error is None else tau + error.torque_of(q, qd, observer.coulomb_sign(qd), W)


def effect_entries(
    arm: IdentifiedArm, reference: ReferenceTorques, q: Floats, qd: Floats, qdd: Floats
) -> Iterator[tuple[str, int, Floats]]:
    """Yield parameter, joint and entries, (N,), of effects that are torques, along states STEP_S apart."""
    t = STEP_S * np.arange(len(q), dtype=np.float64)
    motion = ArmMotion(t, q, qd, qdd, arm.robot, reference, lambda x: x)
    for added in arm.base.model.added:
        if added.effect.name in closed_forms.REASONS:
            continue
        entries = iter(added.evaluate(motion))
        for column in added.columns:
            for row in column.rows:
                yield column.parameter.name, row, next(entries)


def _leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    return closed_forms.without_code(arm.base.model.added, arm.robot)


# ---------------------------------------------------------------- C
def compiled(path: Path, compiler: str = "cc") -> ctypes.CDLL:
    """Compile a C file to a shared library beside it and load it.

    Raises:
        OSError: the compiler made nothing, or programs may not be run from that folder.
        subprocess.SubprocessError: it failed, or took too long.
    """
    path = path.resolve()
    library = path.with_suffix(".so")
    words = [compiler, "-O1", "-std=c99", "-shared", "-fPIC", str(path), "-o", str(library), "-lm"]
    subprocess.run(words, cwd=path.parent, capture_output=True, check=True, timeout=PATIENCE_S)
    return ctypes.CDLL(str(library))


def pointer(row: Floats) -> object:
    """Return the address of a contiguous array."""
    return row.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def _loaded_c(path: Path, arm: IdentifiedArm) -> Iterator[Loaded]:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return
    library = compiled(path, compiler)

    def theirs(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        tau = np.empty_like(q)
        for k in range(len(q)):
            library.dynid_inverse_dynamics(
                *(pointer(row[k]) for row in (q, qd, qdd)), pointer(tau[k])
            )
        return tau

    what = f"all, {arm.robot.n} joints"
    yield Loaded(Path(compiler).name, what, theirs, lambda *state: _ours(arm, *state))


# ---------------------------------------------------------------- Python
def imported(path: Path) -> ModuleType:
    """Return a module from its file, without a cache beside it."""
    module = ModuleType("dynid_exported")
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), module.__dict__)
    return module


def _loaded_python(path: Path, arm: IdentifiedArm) -> Iterator[Loaded]:
    module = imported(path)
    yield Loaded("NumPy", "all", module.inverse_dynamics, lambda *state: _ours(arm, *state))


# ---------------------------------------------------------------- MATLAB
def _matlab_leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    name = identifier(arm.file_stem)
    place = (
        ()
        if name == arm.file_stem
        else (f"the file must be called {name}.m to be found by MATLAB",)
    )
    return (*_leaves_out(arm), *place)


def _loaded_octave(path: Path, arm: IdentifiedArm) -> Iterator[Loaded]:
    octave = shutil.which("octave-cli")
    if octave is None:
        return
    name = identifier(arm.file_stem)

    def theirs(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        return run_octave(octave, path, name, q, qd, qdd)

    yield Loaded("Octave", "all", theirs, lambda *state: _ours(arm, *state))


def run_octave(octave: str, path: Path, name: str, q: Floats, qd: Floats, qdd: Floats) -> Floats:
    """Return the torques (N, n) [N m or N] of a function file in Octave.

    Args:
        octave: the program.
        path: the function file.
        name: the function.
        q: positions, (N, n) [rad or m].
        qd: velocities, (N, n) [rad/s or m/s].
        qdd: accelerations, (N, n) [rad/s^2 or m/s^2].
    """
    with TemporaryDirectory() as folder:
        shutil.copy(path, Path(folder) / f"{name}.m")
        np.savetxt(Path(folder) / "states.txt", np.hstack([q, qd, qdd]))
        n = q.shape[1]
        script = (
            f"s = load('states.txt'); t = zeros(size(s, 1), {n}); "
            f"for k = 1:size(s, 1) r = reshape(s(k, :), {n}, 3); "
            f"t(k, :) = {name}('inverse_dynamics', r(:, 1), r(:, 2), r(:, 3)); end; "
            "save('-ascii', '-double', 'tau.txt', 't');"
        )
        words = [octave, "--norc", "--quiet", "--eval", script]
        subprocess.run(words, cwd=folder, capture_output=True, check=True, timeout=PATIENCE_S)
        return np.loadtxt(Path(folder) / "tau.txt", ndmin=2)


C_FORMAT = Format(
    "c",
    ".c",
    partial(source_code, language=C),
    _leaves_out,
    _loaded_c,
    needs_bodies=False,
    tolerance=1e-12,
)
PYTHON_FORMAT = Format(
    "python",
    ".py",
    partial(source_code, language=PYTHON),
    _leaves_out,
    _loaded_python,
    needs_bodies=False,
    tolerance=1e-12,
)
MATLAB_FORMAT = Format(
    "matlab",
    ".m",
    partial(source_code, language=MATLAB),
    _matlab_leaves_out,
    _loaded_octave,
    needs_bodies=False,
    tolerance=1e-12,
)
