"""C: the identified model without any dependency, for controllers."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.exporters.code import Dialect, base_code
from dynid.exporters.interface import Exporter, Source, Torques
from dynid.exporters.table import parameter_lines

Floats = NDArray[np.float64]

DIALECT = Dialect(
    declare="    const double {name} = {value};",
    store="    Y[{flat}] = {value};",
    item="{array}[{i}]",
    call="{function}({x})",
    threshold="(fabs({x}) >= {limit} ? (({x}) > 0 ? 1.0 : -1.0) : 0.0)",
    first=0,
)

_TEMPLATE = """\
/* {head}
 *
 * q, qd, qdd: joint positions, velocities, accelerations of the robot file's DH table [rad or m, s]; tau [N m or N].
 * Matrices are row-major. Functions keep no state and allocate nothing; compile with: cc -O2 -c {file} (link with -lm)
 * Base parameters; all values come from the data, except those marked as not determined.
{table}
 */
#include <math.h>
#include <string.h>

#define DYNID_N {n}   /* joints */
#define DYNID_P {p}   /* base parameters */

const double dynid_theta[DYNID_P] = {{
{values}
}};

static void inertial(const double *q, const double *qd, const double *qdd, double g, double *Y)
{{
    (void)q; (void)qd; (void)qdd; (void)g;
    memset(Y, 0, sizeof(double) * DYNID_N * DYNID_P);
{inertial}
}}

static void friction(const double *qd, double *Y)
{{
    (void)qd; (void)Y;
{friction}
}}

static void times_theta(const double *Y, double *tau)
{{
    int i, k;
    for (i = 0; i < DYNID_N; i++) {{
        double sum = 0.0;
        for (k = 0; k < DYNID_P; k++) sum += Y[i * DYNID_P + k] * dynid_theta[k];
        tau[i] = sum;
    }}
}}

/* Base regressor, N x P: tau = Y theta. */
void dynid_regressor(const double *q, const double *qd, const double *qdd, double *Y)
{{
    inertial(q, qd, qdd, 1.0, Y);
    friction(qd, Y);
}}

/* Torques of a motion, friction included. */
void dynid_inverse_dynamics(const double *q, const double *qd, const double *qdd, double *tau)
{{
    double Y[DYNID_N * DYNID_P];
    dynid_regressor(q, qd, qdd, Y);
    times_theta(Y, tau);
}}

/* Torques of gravity. */
void dynid_gravity(const double *q, double *tau)
{{
    const double zero[DYNID_N] = {{0}};
    double Y[DYNID_N * DYNID_P];
    inertial(q, zero, zero, 1.0, Y);
    times_theta(Y, tau);
}}

/* Torques of friction. */
void dynid_friction(const double *qd, double *tau)
{{
    double Y[DYNID_N * DYNID_P] = {{0}};
    friction(qd, Y);
    times_theta(Y, tau);
}}

/* Mass matrix with rotors, N x N. */
void dynid_mass_matrix(const double *q, double *M)
{{
    const double zero[DYNID_N] = {{0}};
    double Y[DYNID_N * DYNID_P], unit[DYNID_N], column[DYNID_N];
    int i, j;
    for (j = 0; j < DYNID_N; j++) {{
        memset(unit, 0, sizeof unit);
        unit[j] = 1.0;
        inertial(q, zero, unit, 0.0, Y);
        times_theta(Y, column);
        for (i = 0; i < DYNID_N; i++) M[i * DYNID_N + j] = column[i];
    }}
}}

/* Coriolis and centrifugal torques, C(q, qd) qd. */
void dynid_coriolis(const double *q, const double *qd, double *tau)
{{
    const double zero[DYNID_N] = {{0}};
    double Y[DYNID_N * DYNID_P];
    inertial(q, qd, zero, 0.0, Y);
    times_theta(Y, tau);
}}

/* Coriolis matrix of the Christoffel symbols, N x N: dM/dt - 2 C is skew-symmetric.
 * Column j is the polar form of the quadratic Coriolis torques c: (c(qd + e_j) - c(qd - e_j)) / 4. */
void dynid_coriolis_matrix(const double *q, const double *qd, double *C)
{{
    double speed[DYNID_N], plus[DYNID_N], minus[DYNID_N];
    int i, j;
    memcpy(speed, qd, sizeof speed);
    for (j = 0; j < DYNID_N; j++) {{
        speed[j] = qd[j] + 1.0;
        dynid_coriolis(q, speed, plus);
        speed[j] = qd[j] - 1.0;
        dynid_coriolis(q, speed, minus);
        speed[j] = qd[j];
        for (i = 0; i < DYNID_N; i++) C[i * DYNID_N + j] = 0.25 * (plus[i] - minus[i]);
    }}
}}
"""


class CExporter(Exporter):
    """One C file."""

    suffix = ".c"
    help = "controllers: inverse dynamics, regressor, gravity, mass matrix, Coriolis; no dependency"
    needs_bodies = False
    tolerance = 1e-12

    def text(self, source: Source) -> str:
        """Return the C file."""
        code = base_code(source, DIALECT)
        table = parameter_lines(source)
        return _TEMPLATE.format(
            head=source.made_from.replace("*/", "* /"),
            file=f"{source.base.robot.slug}.c",
            table="\n".join(f" *   {line}" for line in table),
            n=source.base.robot.n,
            p=len(code.names),
            values=",\n".join(
                f"    {float(value)!r} /* {name} */" for name, value in zip(code.names, source.theta, strict=True)
            ),
            inertial="\n".join(code.inertial),
            friction="\n".join(code.friction),
        )

    def leaves_out(self, source: Source) -> tuple[str, ...]:
        """Return nothing: it is the whole base model."""
        return ()

    def loaded(self, path: Path, source: Source) -> Iterator[tuple[str, str, Torques, Torques]]:
        """Compile and call it, where there is a compiler."""
        compiler = shutil.which("cc") or shutil.which("gcc")
        if compiler is None:
            return
        with tempfile.TemporaryDirectory() as folder:
            library = compiled(path, Path(folder), compiler)
            n = source.base.robot.n

            def theirs(q: Floats, qd: Floats, qdd: Floats) -> Floats:
                tau = np.empty_like(q)
                for k in range(len(q)):
                    library.dynid_inverse_dynamics(*(pointer(row[k]) for row in (q, qd, qdd)), pointer(tau[k]))
                return tau

            observer = source.base.model.observer(source.base.reduction.base)
            yield Path(compiler).name, f"all, {n} joints", theirs, lambda *s: observer.torque(source.theta, *s)


def compiled(path: Path, folder: Path, compiler: str) -> ctypes.CDLL:
    """Compile the C file to a shared library and load it."""
    library = folder / "model.so"
    words = [compiler, "-O1", "-std=c99", "-shared", "-fPIC", str(path), "-o", str(library), "-lm"]
    subprocess.run(words, check=True, capture_output=True)
    return ctypes.CDLL(str(library))


def pointer(row: Floats) -> object:
    """Return the address of a contiguous row."""
    return row.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
