"""Python: the identified model as one module that needs only NumPy, for many states at once."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from dynid.exporters.code import Dialect, base_code
from dynid.exporters.interface import Exporter, Source, Torques
from dynid.exporters.table import parameter_lines

DIALECT = Dialect(
    declare="    {name} = {value}",
    store="    Y[..., {row}, {col}] = {value}",
    item="{array}[..., {i}]",
    call="np.{function}({x})",
    threshold="(np.abs({x}) >= {limit}) * np.sign({x})",
    first=0,
)

_TEMPLATE = '''\
"""{head}

q, qd, qdd: joint positions, velocities, accelerations of the robot file's DH table, shape (..., {n}) [rad or m, s].
Base parameters; all values come from the data, except those marked as not determined.

{table}
"""

import numpy as np

N, P = {n}, {p}
NAMES = {names}
THETA = np.array([
{values}
])


def _inertial(q, qd, qdd, g):
    q, qd, qdd = (np.asarray(x, dtype=float) for x in (q, qd, qdd))
    Y = np.zeros(np.broadcast_shapes(q.shape, qd.shape, qdd.shape)[:-1] + (N, P))
{inertial}
    return Y


def _friction(qd, Y):
    qd = np.asarray(qd, dtype=float)
{friction}
    return Y


def regressor(q, qd, qdd):
    """Return the base regressor, (..., N, P): tau = Y theta."""
    return _friction(qd, _inertial(q, qd, qdd, 1.0))


def inverse_dynamics(q, qd, qdd, theta=THETA):
    """Return the torques of a motion, friction included, (..., N)."""
    return regressor(q, qd, qdd) @ theta


def gravity(q, theta=THETA):
    """Return the torques of gravity, (..., N)."""
    zero = np.zeros(N)
    return _inertial(q, zero, zero, 1.0) @ theta


def friction(qd, theta=THETA):
    """Return the torques of friction, (..., N)."""
    return _friction(qd, np.zeros(np.shape(qd)[:-1] + (N, P))) @ theta


def mass_matrix(q, theta=THETA):
    """Return the mass matrix with rotors, (..., N, N)."""
    zero = np.zeros(N)
    return np.stack([_inertial(q, zero, unit, 0.0) @ theta for unit in np.eye(N)], axis=-1)


def coriolis(q, qd, theta=THETA):
    """Return Coriolis and centrifugal torques, C(q, qd) qd, (..., N)."""
    return _inertial(q, qd, np.zeros(N), 0.0) @ theta


def coriolis_matrix(q, qd, theta=THETA):
    """Return C(q, qd) of the Christoffel symbols, (..., N, N): dM/dt - 2 C is skew-symmetric.

    Column j is the polar form of the quadratic Coriolis torques.
    """
    qd = np.asarray(qd, dtype=float)
    return np.stack([0.25 * (coriolis(q, qd + e, theta) - coriolis(q, qd - e, theta)) for e in np.eye(N)], axis=-1)
'''


class PythonExporter(Exporter):
    """One Python module."""

    suffix = ".py"
    help = "one module that needs only NumPy, vectorised over states"
    needs_bodies = False
    tolerance = 1e-12

    def text(self, source: Source) -> str:
        """Return the module."""
        code = base_code(source, DIALECT)
        return _TEMPLATE.format(
            head=source.made_from.replace("\\", "/").replace('"""', "'''"),
            n=source.base.robot.n,
            p=len(code.names),
            table="\n".join(f"    {line}" for line in parameter_lines(source)),
            names=repr(code.names),
            values="\n".join(
                f"    {float(value)!r},  # {name}" for name, value in zip(code.names, source.theta, strict=True)
            ),
            inertial="\n".join(code.inertial),
            friction="\n".join(code.friction),
        )

    def leaves_out(self, source: Source) -> tuple[str, ...]:
        """Return nothing: it is the whole base model."""
        return ()

    def loaded(self, path: Path, source: Source) -> Iterator[tuple[str, str, Torques, Torques]]:
        """Import the module that was just written."""
        observer = source.base.model.observer(source.base.reduction.base)
        yield "NumPy", "all", imported(path).inverse_dynamics, lambda *s: observer.torque(source.theta, *s)


def imported(path: Path) -> ModuleType:
    """Import a module from its file."""
    spec = importlib.util.spec_from_file_location("dynid_exported", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
