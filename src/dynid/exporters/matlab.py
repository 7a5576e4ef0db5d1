"""MATLAB and Octave: the identified model as one function file."""

from __future__ import annotations

import re
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
    declare="    {name} = {value};",
    store="    Y({row}, {col}) = {value};",
    item="{array}({i})",
    call="{function}({x})",
    threshold="(abs({x}) >= {limit}) * sign({x})",
    first=1,
)

_TEMPLATE = """\
function out = {name}(what, q, qd, qdd)
% {head}
%
% tau = {name}('inverse_dynamics', q, qd, qdd)     friction included
% Y   = {name}('regressor', q, qd, qdd)            tau = Y * theta
% tau = {name}('gravity', q)
% tau = {name}('friction', q, qd)
% M   = {name}('mass_matrix', q)                   rotors included
% tau = {name}('coriolis', q, qd)                  C(q, qd) * qd
% C   = {name}('coriolis_matrix', q, qd)           Christoffel symbols
% theta = {name}('theta')
%
% q, qd, qdd: joint positions, velocities, accelerations of the robot file's DH convention, {n} x 1 [rad or m, s].
% Base parameters; all values come from the data, except those marked as not determined.
{table}
    theta = [
{values}
    ];
    n = {n};
    zero = zeros(n, 1);
    switch what
        case 'inverse_dynamics'
            out = friction(qd, inertial(q, qd, qdd, 1)) * theta;
        case 'regressor'
            out = friction(qd, inertial(q, qd, qdd, 1));
        case 'gravity'
            out = inertial(q, zero, zero, 1) * theta;
        case 'friction'
            out = friction(qd, zeros(n, {p})) * theta;
        case 'mass_matrix'
            out = zeros(n, n);
            unit = eye(n);
            for j = 1:n
                out(:, j) = inertial(q, zero, unit(:, j), 0) * theta;
            end
        case 'coriolis'
            out = inertial(q, qd, zero, 0) * theta;
        case 'coriolis_matrix'
            out = zeros(n, n);
            unit = eye(n);
            for j = 1:n
                plus = inertial(q, qd(:) + unit(:, j), zero, 0) * theta;
                minus = inertial(q, qd(:) - unit(:, j), zero, 0) * theta;
                out(:, j) = (plus - minus) / 4;
            end
        case 'theta'
            out = theta;
        otherwise
            error('{name}: unknown request %s', what);
    end
end

function Y = inertial(q, qd, qdd, g)
    Y = zeros({n}, {p});
{inertial}
end

function Y = friction(qd, Y)
{friction}
end
"""


class MatlabExporter(Exporter):
    """One MATLAB function file."""

    suffix = ".m"
    help = "MATLAB and Octave: one function file"
    needs_bodies = False
    tolerance = 1e-12

    def text(self, source: Source) -> str:
        """Return the function file."""
        code = base_code(source, DIALECT)
        return _TEMPLATE.format(
            name=function_name(source.base.robot.slug),
            head=" ".join(source.made_from.split()),
            n=source.base.robot.n,
            p=len(code.names),
            table="\n".join(f"%   {line}" for line in parameter_lines(source)),
            values="\n".join(
                f"        {float(value)!r} % {name}" for name, value in zip(code.names, source.theta, strict=True)
            ),
            inertial="\n".join(code.inertial),
            friction="\n".join(code.friction),
        )

    def leaves_out(self, source: Source) -> tuple[str, ...]:
        """Return what a MATLAB file demands of its name."""
        name = function_name(source.base.robot.slug)
        return () if name == source.base.robot.slug else (f"the file must be called {name}.m to be found by MATLAB",)

    def loaded(self, path: Path, source: Source) -> Iterator[tuple[str, str, Torques, Torques]]:
        """Run it in Octave, where installed."""
        octave = shutil.which("octave-cli")
        if octave is None:
            return
        observer = source.base.model.observer(source.base.reduction.base)

        def theirs(q: Floats, qd: Floats, qdd: Floats) -> Floats:
            return run_octave(octave, path, function_name(source.base.robot.slug), q, qd, qdd)

        yield "Octave", "all", theirs, lambda *s: observer.torque(source.theta, *s)


def run_octave(octave: str, path: Path, name: str, q: Floats, qd: Floats, qdd: Floats) -> Floats:
    """Return the torques of a function file in Octave."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(path, Path(folder) / f"{name}.m")
        np.savetxt(Path(folder) / "states.txt", np.hstack([q, qd, qdd]))
        n = q.shape[1]
        script = (
            f"s = load('states.txt'); t = zeros(size(s, 1), {n}); "
            f"for k = 1:size(s, 1) r = reshape(s(k, :), {n}, 3); "
            f"t(k, :) = {name}('inverse_dynamics', r(:, 1), r(:, 2), r(:, 3)); end; "
            "save('-ascii', '-double', 'tau.txt', 't');"
        )
        subprocess.run([octave, "--norc", "--quiet", "--eval", script], cwd=folder, check=True, capture_output=True)
        return np.loadtxt(Path(folder) / "tau.txt", ndmin=2)


def function_name(slug: str) -> str:
    """Return a name that MATLAB accepts."""
    name = re.sub(r"\W", "_", slug)
    return name if name[:1].isalpha() else f"arm_{name}"
