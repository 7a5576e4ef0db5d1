"""The body fixed to the last link, from a log with it and a result without it.

A body phi on the last link changes the base parameters by K_n phi, where K_n are the columns of that link in
``Reduction.K``. Both estimates are uncertain, so the change is known with the sum of their covariances. Friction may
have changed since (load, warmth), so it is taken from the loaded log alone. Docs: docs/explanation/consistency.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding, WrongUsage
from dynid.estimation.least_squares import merge
from dynid.estimation.physical_constraints import basis, make_constraints, pseudo_inertia
from dynid.estimation.physical_parameters import DEFAULT_GAMMA, fit_physical
from dynid.estimation.result import Identification
from dynid.model.base_model import BaseModel
from dynid.model.parameters import BODY_PARAMETERS, body_columns, numbered
from dynid.model.prior import body_of
from dynid.robot import Body

Floats = NDArray[np.float64]

#: Density of the ball that stands for a load's inertia before measuring [kg/m^3]: between plastic and steel.
DENSITY = 2000.0
#: Mass of that ball when the data say nothing or less than nothing [kg].
LEAST_MASS = 0.05
#: Singular value, relative to the largest, below which a direction counts as unknown.
UNKNOWN = 1e-10
#: Kinds of parameters that are friction.
FRICTION = ("fv", "fc", "fo", "fvc", "fcc")
#: Misfit over its expectation from which on something else than a load has changed.
MISFIT = 4.0


@dataclass(frozen=True)
class IdentifiedPayload:
    """A body in the frame of the last link.

    Attributes:
        body: mass, centre of mass, inertia about it.
        std_error: of mass [kg], centre of mass [m] and inertia xx, xy, xz, yy, yz, zz [kg m^2], (10,).
        misfit: how much worse the change of the base parameters is explained by a body than its errors allow; 1 is
            as expected. Errors are widened by its root.
    """

    body: Body
    std_error: Floats
    misfit: float

    def facts(self) -> dict[str, Any]:
        """Return the body for JSON."""
        keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        errors = self.std_error.tolist()
        return {
            "mass_kg": self.body.mass,
            "com_m": list(self.body.com),
            "inertia_com_kg_m2": dict(zip(keys, self.body.inertia_com, strict=True)),
            "std_error": {
                "mass_kg": errors[0],
                "com_m": errors[1:4],
                "inertia_com_kg_m2": dict(zip(keys, errors[4:], strict=True)),
            },
            "misfit": self.misfit,
        }

    def findings(self) -> list[Finding]:
        """Say when a body on the last link does not explain what has changed."""
        if self.misfit < MISFIT:
            return []
        text = (
            f"a body on the last link explains the change badly (reduced chi-square {self.misfit:.1f}): "
            "is it fixed to the last link, and is everything else as before?"
        )
        return [Finding("W411", "warning", text, {"misfit": self.misfit})]


def find_payload(loaded: Identification, unloaded: Identification) -> IdentifiedPayload:
    """Return the body that the loaded arm has in addition.

    Args:
        loaded: identified from a log with the body.
        unloaded: identified without it, with the same base parameters.

    Raises:
        WrongUsage: the results are of different arms, or the last link is not identified.
    """
    if loaded.names != unloaded.names:
        raise WrongUsage(
            f"{unloaded.label} has other base parameters than this log's model",
            fix="identify both with the same robot file",
        )
    K = unloaded.reduction.K[:, last_link(unloaded.base)]
    if not unloaded.factors.size:
        raise WrongUsage(
            f"{unloaded.label} holds no triangular factors",
            fix="identify the unloaded log again",
        )
    information = of_change(_information(unloaded), _information(loaded), friction(unloaded.base))
    covariance = unloaded.plain_covariance + loaded.plain_covariance
    body = fitted_body(K, loaded.plain - unloaded.plain, information, covariance)
    return _with_scale(body, loaded.robot.torque.scale_error)


def _with_scale(found: IdentifiedPayload, scale_error: float) -> IdentifiedPayload:
    """Widen mass and inertia by what nobody knows of the torque's scale; the centre of mass does not depend on it."""
    scaled = np.array([found.body.mass, 0.0, 0.0, 0.0, *found.body.inertia_com])
    return replace(found, std_error=np.hypot(found.std_error, scale_error * scaled))


def _information(found: Identification) -> Floats:
    """Return what a log says about its base parameters, as smooth as its rows and as certain as its covariance.

    Why not the inverse of the covariance: that is estimated from few independent samples, and where it happens to be
    too small its inverse would trust the log most.
    """
    A = merge(found.factors, 1.0 / found.noise)[:-1, :-1]
    inflation = float(np.sum((A @ found.plain_covariance) * A)) / max(1, found.rank)
    return np.asarray(A.T @ A) / max(inflation, 1e-300)


def last_link(base: BaseModel) -> NDArray[np.intp]:
    """Return the columns of the last link's ten parameters among all parameters, (10,).

    Raises:
        WrongUsage: the last link is not identified.
    """
    n = base.robot.n
    columns = body_columns(base.model.parameters).get(n)
    if columns is None:
        raise WrongUsage(f"link {n} is not among the identified ones", fix="`links: all` in the robot file")
    return columns


def friction(base: BaseModel) -> NDArray[np.bool_]:
    """Return which base parameters are the friction of joints or motors, (p,)."""
    kinds = [base.model.parameters[k].kind for k in base.reduction.base]
    return np.array([kind in FRICTION for kind in kinds])


def of_change(before: Floats, after: Floats, free: NDArray[np.bool_]) -> Floats:
    """Return the information about the change of parameters between two estimates, (p, p).

    Args:
        before: information of the first estimate, (p, p).
        after: of the second.
        free: parameters of which the first shall say nothing, (p,).
    """
    kept = ~free
    old = np.zeros_like(before)
    shared = before[np.ix_(kept, free)]
    old[np.ix_(kept, kept)] = before[np.ix_(kept, kept)] - shared @ _inverse(before[np.ix_(free, free)]) @ shared.T
    return np.asarray(after - after @ _inverse(old + after) @ after)


def _inverse(matrix: Floats) -> Floats:
    """Return the inverse of a symmetric matrix; directions that it leaves out stay out."""
    diagonal = np.diagonal(matrix)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    inner = np.linalg.pinv(scale[:, None] * matrix * scale, rcond=UNKNOWN, hermitian=True)
    return np.asarray(scale[:, None] * inner * scale)


def fitted_body(K: Floats, change: Floats, information: Floats, covariance: Floats) -> IdentifiedPayload:
    """Return the possible body that explains a change of base parameters best.

    Args:
        K: change of the base parameters by each of the ten parameters, (p, 10).
        change: of the base parameters, (p,), each in its unit.
        information: what the parts of the change are weighted by, (p, p), in inverse products of these units.
        covariance: covariance of the change, allowing for coloured residuals, (p, p).
    """
    diagonal = np.diagonal(information)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    values, axes = np.linalg.eigh(information / np.outer(scale, scale))
    root = (np.sqrt(np.maximum(values, 0.0)) * axes).T * scale
    R, r = root @ K, root @ change
    parameters = [numbered(kind, 1, "") for kind in BODY_PARAMETERS]
    constraints = make_constraints(parameters, _ball(np.linalg.lstsq(R, r, rcond=None)[0]).parameters())
    freedom = max(1, int(np.sum(values > UNKNOWN * values.max())) - len(parameters))
    misfit = 2 * fit_physical(R, r, constraints).cost / freedom
    wide = math.sqrt(max(1.0, misfit))
    x = fit_physical(R / wide, r / wide, constraints).x
    inverse = np.linalg.inv(pseudo_inertia(x))
    prior = DEFAULT_GAMMA * np.einsum("ab,kbc,cd,lda->kl", inverse, basis(), inverse, basis())
    bread = np.linalg.inv(R.T @ R / wide**2 + prior)
    gain = K.T @ information / wide**2
    # Why widened once more: what no body explains is no noise, and the covariance does not know of it.
    posterior = bread @ (wide**2 * gain @ covariance @ gain.T + prior) @ bread
    J = _shown_by(x)
    return IdentifiedPayload(body_of(x), np.sqrt(np.diagonal(J @ posterior @ J.T)), misfit)


def _ball(phi: Floats) -> Body:
    """Return a ball with the mass and centre of mass of a first estimate."""
    mass = max(float(phi[0]), LEAST_MASS)
    x, y, z = (phi[1:4] / mass if phi[0] > LEAST_MASS else np.zeros(3)).tolist()
    inertia = 0.4 * mass * (3 * mass / (4 * math.pi * DENSITY)) ** (2 / 3)
    return Body(mass, (x, y, z), (inertia, 0.0, 0.0, inertia, 0.0, inertia))


def _shown(x: Floats) -> Floats:
    body = body_of(x)
    return np.array([body.mass, *body.com, *body.inertia_com])


def _shown_by(x: Floats) -> Floats:
    """Return the derivative of mass, centre of mass and inertia about it by the ten parameters, (10, 10)."""
    J = np.zeros((10, 10))
    for k in range(10):
        h = np.zeros(10)
        h[k] = 1e-6 * max(abs(x[k]), 1e-3 * x[0])
        J[:, k] = (_shown(x + h) - _shown(x - h)) / (2 * h[k])
    return J
