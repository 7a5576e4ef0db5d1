"""The set of possible arms (pseudo-inertias, bounds, signs), and least squares inside it.

    f(x) = 1/2 |R x - r|^2 + g.x - sum_i gamma_i logdet P_i(x) - sum_k mu_k log(G x - h)_k

Newton's method minimises f, which is convex and self-concordant. Where the squares outweigh the logarithms at the
start, all but the squares get a weight that falls to 1: from f itself, steps would crawl along the boundary.

Source: Wensing, Kim, Slotine 2018, "Linear matrix inequalities for physically consistent inertial parameter
identification" (the pseudo-inertia); Boyd, Vandenberghe 2004, sections 9.6 and 11 (the path of weights).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

import numpy as np

from dynid.arrays import Floats, Ints
from dynid.estimation import tuning
from dynid.estimation.factor import of_unit_diagonal
from dynid.model.parameters import (
    Parameter,
    body_columns,
    columns_of,
    inertia_of,
    second_moments,
)
from dynid.robot import Known

# ---------------------------------------------------------------- the set
#: Parameters that no real drive has with a minus sign: rotor inertia, viscous and Coulomb friction.
NONNEGATIVE = ("Im", "fv", "fc")


@cache
def basis() -> Floats:
    """Return E with P = sum_k parameter_k * E_k, (10, 4, 4), pure numbers."""
    E, (i, j) = np.zeros((10, 4, 4)), np.triu_indices(3)
    E[0, 3, 3] = 1.0
    E[range(1, 4), range(3), 3] = E[range(1, 4), 3, range(3)] = 1.0
    E[range(4, 10), i, j] = E[range(4, 10), j, i] = 1.0
    E[4:, :3, :3] = second_moments(E[4:, :3, :3])
    E.setflags(write=False)
    return E


def pseudo_inertia(bodies: Floats) -> Floats:
    """Map body parameters to pseudo-inertias P = [[tr(I)/2 - I, mc], [mc^T, m]].

    Args:
        bodies: m, mc, Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the frame origin, (..., 10) [kg, kg m, kg m^2].

    Returns:
        P, (..., 4, 4): the second moment of the mass distribution in homogeneous coordinates.
    """
    return (bodies @ basis().reshape(10, 16)).reshape(*bodies.shape[:-1], 4, 4)


def body_parameters(P: Floats) -> Floats:
    """Map pseudo-inertias back to body parameters, (..., 4, 4) -> (..., 10) [kg, kg m, kg m^2]."""
    inertia = inertia_of(P[..., :3, :3])
    i, j = np.triu_indices(3)
    return np.concatenate([P[..., 3:, 3], P[..., :3, 3], inertia[..., i, j]], axis=-1)


def smallest_eigenvalues(bodies: Floats) -> Floats:
    """Return the smallest eigenvalue of the pseudo-inertia of bodies (..., 10), (...,); negative: no such body."""
    return np.asarray(np.linalg.eigvalsh(pseudo_inertia(bodies))[..., 0])


@dataclass(frozen=True)
class PhysicalConstraints:
    """The set of physical parameter vectors and the prior inside it.

    Attributes:
        parameters: what each column stands for, (c).
        bodies: columns of the ten parameters of each link, (L, 10).
        prior: what is known before measuring, (c,); zero where nothing is.
        G: rows of the bounds G x >= h, (k, c); those of the positive parameters come first.
        h: right side of the bounds, (k,).
        pools: columns of the parameters of each kind in ``NONNEGATIVE``.
        ratings: what the joints' parameters of one kind are thought to be in proportion to, (c,).
        spread: standard deviation of parameters whose prior is zero, (c,); infinite elsewhere.
    """

    parameters: tuple[Parameter, ...]
    bodies: Ints
    prior: Floats
    G: Floats
    h: Floats
    pools: tuple[Ints, ...]
    ratings: Floats
    spread: Floats

    @property
    def positive(self) -> Ints:
        """Columns of the parameters that are positive numbers, (k,)."""
        return np.concatenate(self.pools)

    @property
    def prior_pseudo_inertia(self) -> Floats:
        """P of the prior's links, (L, 4, 4)."""
        return pseudo_inertia(self.prior[self.bodies])

    def slack(self, x: Floats) -> Floats:
        """Return how far parameters x, (c,) in their units, keep the bounds, (k,); negative: broken."""
        return self.G @ x - self.h


def make_constraints(
    parameters: Sequence[Parameter],
    prior: Floats,
    known: Known = Known(),  # noqa: B008 - frozen
    ratings: Mapping[str, float] = MappingProxyType({}),
) -> PhysicalConstraints:
    """Collect what is known about the arm besides the measurement.

    Args:
        parameters: what each column stands for, (c).
        prior: prior parameters, (c,), each in its unit; the bodies in it must be consistent.
        known: bounds of masses and centres of mass; those of links without parameters are left out.
        ratings: by parameter, what those of one kind are thought to be in proportion to; equal where nothing is said.
    """
    bodies, every = body_columns(parameters), np.eye(len(parameters))
    pools = tuple(columns_of(parameters, kind) for kind in NONNEGATIVE)
    masses = {link: every[columns[0]] for link, columns in bodies.items()}
    sums = [(masses[link], ends) for link, ends in known.link_mass if link in masses]
    if known.total_mass is not None and masses:
        sums.append((np.sum([*masses.values()], axis=0), known.total_mass))
    rows = [(row, 0.0) for columns in pools for row in every[columns]]
    for row, (low, high) in sums:
        rows += [(row, low), (-row, -high)]
    boxes = [(every[bodies[link][:4]], ends) for link, ends in known.com_box if link in bodies]
    for (mass, *moments), corners in boxes:
        for moment, low, high in zip(moments, *corners, strict=True):
            rows += [(moment - low * mass, 0.0), (high * mass - moment, 0.0)]
    # Why of fc: an offset is the part of the friction that does not change its sign.
    rated = [f"fc{p.number}" if p.kind == "fo" else p.name for p in parameters]
    return PhysicalConstraints(
        parameters=tuple(parameters),
        bodies=np.array(list(bodies.values()), dtype=np.intp).reshape(-1, 10),
        prior=np.asarray(prior, dtype=float),
        G=np.array([row for row, _ in rows]).reshape(-1, len(parameters)),
        h=np.array([least for _, least in rows]),
        pools=pools,
        ratings=np.array([ratings.get(name, 1.0) for name in rated]),
        spread=np.full(len(parameters), np.inf),
    )


# ---------------------------------------------------------------- least squares inside the set
@dataclass(frozen=True)
class Objective:
    """The function to minimise; see the module's head.

    Attributes:
        R: rows of the least squares, (rows, c).
        r: right side, (rows,).
        bodies: positions in x of the ten parameters of each link, (L, 10).
        gamma: weight of each link's log-determinant; positive.
        linear: g, (c,).
        G: rows of the bounds, (k, c).
        h: right side of the bounds, (k,).
        mu: weight of each bound's logarithm, (k,); positive.
    """

    R: Floats
    r: Floats
    bodies: Ints
    gamma: float
    linear: Floats
    G: Floats
    h: Floats
    mu: Floats

    def value(self, x: Floats) -> float:
        """Return f(x) of x, (c,), inside the set, a pure number."""
        residual = self.R @ x - self.r
        barrier = self.gamma * np.linalg.slogdet(pseudo_inertia(x[self.bodies]))[1].sum()
        barrier += self.mu @ np.log(self.G @ x - self.h)
        return float(0.5 * residual @ residual + self.linear @ x - barrier)

    def relative(self, x: Floats) -> tuple[Floats, Floats]:
        """Return how a unit of each parameter changes bodies and slacks in units of themselves, (L, 10, 4, 4), (k, c).

        Raises:
            LinAlgError: x is outside the set.
        """
        slack = self.G @ x - self.h
        if np.any(slack <= 0.0):
            raise np.linalg.LinAlgError
        whiten = np.linalg.inv(np.linalg.cholesky(pseudo_inertia(x[self.bodies])))[:, None]
        return whiten @ basis() @ whiten.swapaxes(-1, -2), self.G / slack[:, None]

    def curvature(self, bodies: Floats, slacks: Floats) -> Floats:
        """Return the Hessian of the logarithms, (c, c), from relative changes."""
        hessian = slacks.T @ (self.mu[:, None] * slacks)
        flat = bodies.reshape(-1, 10, 16)
        places = self.bodies[:, :, None], self.bodies[:, None, :]
        hessian[places] += self.gamma * (flat @ flat.swapaxes(-1, -2))
        return hessian


def minimise(
    objective: Objective, x: Floats, tolerance: float = tuning.INTERIOR_TOLERANCE
) -> Floats:
    """Minimise the objective from an interior point.

    Args:
        objective: the function.
        x: a point inside the set, (c,).
        tolerance: how far above its minimum the objective may be where the method stops.

    Returns:
        Where it stopped, (c,).
    """
    RtR, weight, after = objective.R.T @ objective.R, 0.0, x
    for _ in range(tuning.INTERIOR_STEPS):
        try:
            bodies, slacks = objective.relative(after)
        except np.linalg.LinAlgError:  # at the limit of double precision
            break
        x, logs = after, objective.curvature(bodies, slacks)
        slope = objective.linear - slacks.T @ objective.mu
        slope[objective.bodies] -= objective.gamma * np.trace(bodies, axis1=2, axis2=3)
        squares = objective.R.T @ (objective.R @ x - objective.r)
        if not weight:
            weight = max(1.0, float((squares + slope) @ solve_scaled(RtR + logs, squares + slope)))
        gradient = squares + weight * slope
        step = -solve_scaled(RtR + weight * logs, gradient)
        excess = -0.5 * float(gradient @ step) / weight
        if weight == 1.0 and excess < tolerance:
            break
        changes = np.einsum("lkab,lk->lab", bodies, step[objective.bodies])
        fall = min(np.linalg.eigvalsh(changes).min(initial=0.0), (slacks @ step).min(initial=0.0))
        after = x + step * (min(1.0, tuning.INTERIOR_REACH / -fall) if fall < 0.0 else 1.0)
        weight = max(1.0, weight / 10.0) if excess < 0.5 else weight
    return x


def solve_scaled(H: Floats, b: Floats) -> Floats:
    """Solve H x = b, (d,), for a positive definite H whose diagonal spans many orders.

    Directions that H does not see at all, such as the difference of an effect that is given twice, stay where they are.
    """
    scaled, unit = of_unit_diagonal(H)
    scaled[np.diag_indices_from(scaled)] = 1.0
    try:
        return unit * np.linalg.solve(scaled, unit * b)
    except np.linalg.LinAlgError:
        return unit * np.linalg.lstsq(scaled, unit * b, rcond=None)[0]
