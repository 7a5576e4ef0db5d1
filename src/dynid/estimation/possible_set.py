"""The set of possible arms (pseudo-inertias, bounds, signs), and least squares inside it.

    f(x) = 1/2 |R x - r|^2 + g.x - sum_i gamma_i logdet P_i(x) - sum_k mu_k log(G x - h)_k

A damped primal-dual Newton method minimises f. At the minimum each P_i has a multiplier Z_i with P_i Z_i = gamma_i 1
(each bound one with slack * z = mu). The method solves these conditions together, in the scaling of Nesterov and Todd;
primal steps alone would crawl along the boundary where the squares outweigh the logarithms.

Source: Wensing, Kim, Slotine 2018, "Linear matrix inequalities for physically consistent inertial parameter
identification" (the pseudo-inertia); Boyd, Vandenberghe 2004, sections 9.6 and 11; Nesterov, Todd 1998 (the scaling).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.model.parameters import Parameter, body_columns, columns_of, inertia_of

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]


# ---------------------------------------------------------------- the set
#: Parameters that no real drive has with a minus sign: rotor inertia, viscous and Coulomb friction.
NONNEGATIVE = ("Im", "fv", "fc")


@cache
def basis() -> Floats:
    """Return E with P = sum_k parameter_k * E_k, (10, 4, 4), pure numbers."""
    E = np.zeros((10, 4, 4))
    E[0, 3, 3] = 1.0
    for axis in range(3):
        E[1 + axis, axis, 3] = E[1 + axis, 3, axis] = 1.0
    for k, (i, j) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
        if i == j:
            E[4 + k, :3, :3] = 0.5 * np.eye(3)
            E[4 + k, i, i] = -0.5
        else:
            E[4 + k, i, j] = E[4 + k, j, i] = -1.0
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
        G: rows of the bounds G x >= h, (k, c).
        h: right side of the bounds, (k,).
        labels: one sentence for each bound, (k).
        pools: columns of the positive parameters of one kind that have no prior, as many arrays as kinds.
        ratings: what the joints' parameters of one kind are thought to be in proportion to, (c,).
        spread: standard deviation of parameters whose prior is zero, (c,); infinite elsewhere.
    """

    parameters: tuple[Parameter, ...]
    bodies: Ints
    prior: Floats
    G: Floats
    h: Floats
    labels: tuple[str, ...]
    pools: tuple[Ints, ...]
    ratings: Floats
    spread: Floats

    @property
    def offsets(self) -> Ints:
        """Columns of friction offsets, (k,)."""
        return columns_of(self.parameters, "fo")

    @property
    def prior_pseudo_inertia(self) -> Floats:
        """P of the prior's links, (L, 4, 4)."""
        return pseudo_inertia(self.prior[self.bodies])

    def slack(self, x: Floats) -> Floats:
        """Return how far parameters x, (c,) in their units, keep the bounds, (k,); negative: broken."""
        return np.asarray(self.G @ x - self.h)


def make_constraints(
    parameters: Sequence[Parameter],
    prior: Floats,
    *,
    total_mass: tuple[float, float] | None = None,
    link_mass: Mapping[int, tuple[float, float]] | None = None,
    com_box: Mapping[int, tuple[Floats, Floats]] | None = None,
    nonnegative: Sequence[str] = NONNEGATIVE,
    ratings: Mapping[str, float] | None = None,
) -> PhysicalConstraints:
    """Collect what is known about the arm besides the measurement.

    Args:
        parameters: what each column stands for, (c).
        prior: prior parameters, (c,), each in its unit; the bodies in it must be consistent.
        total_mass: smallest and largest mass of all links in ``parameters`` [kg].
        link_mass: the same for single links, by link number.
        com_box: corners of the box that holds the centre of mass, in the link frame, by link number [m].
        nonnegative: kinds of the parameters that cannot be negative.
        ratings: by parameter, what those of one kind are thought to be in proportion to; equal where nothing is said.

    Returns:
        Bounds and prior together.
    """
    rows: list[tuple[dict[int, float], float, str]] = []
    for k, parameter in enumerate(parameters):
        if parameter.kind in nonnegative:
            rows.append(({k: 1.0}, 0.0, f"{parameter.name} >= 0"))
    bodies = body_columns(parameters)
    masses = {link: int(columns[0]) for link, columns in bodies.items()}
    if total_mass is not None:
        rows += _between(dict.fromkeys(masses.values(), 1.0), total_mass, "total mass [kg]")
    for link, bounds in (link_mass or {}).items():
        rows += _between({masses[link]: 1.0}, bounds, f"m{link} [kg]")
    for link, (low, high) in (com_box or {}).items():
        for axis, (a, b) in enumerate(zip(low, high, strict=True)):
            first, m, letter = int(bodies[link][1 + axis]), masses[link], "xyz"[axis]
            rows.append(({first: 1.0, m: -float(a)}, 0.0, f"c{letter}{link} >= {a:g} m"))
            rows.append(({first: -1.0, m: float(b)}, 0.0, f"c{letter}{link} <= {b:g} m"))
    G, h = np.zeros((len(rows), len(parameters))), np.array([row[1] for row in rows])
    for k, (terms, _, _) in enumerate(rows):
        G[k, list(terms)] = list(terms.values())
    labels, prior = tuple(row[2] for row in rows), np.asarray(prior, dtype=float)
    pools = tuple(
        found[prior[found] <= 0.0]
        for found in (columns_of(parameters, kind) for kind in nonnegative)
    )
    # Why of fc: an offset is the part of the friction that does not change its sign.
    rated = [f"fc{p.number}" if p.kind == "fo" else p.name for p in parameters]
    proportion = np.array([(ratings or {}).get(name, 1.0) for name in rated])
    nowhere = np.full(len(parameters), np.inf)
    links = np.array(list(bodies.values()), dtype=np.intp).reshape(-1, 10)
    return PhysicalConstraints(
        tuple(parameters), links, prior, G, h, labels, pools, proportion, nowhere
    )


def _between(
    terms: dict[int, float], bounds: tuple[float, float], what: str
) -> list[tuple[dict[int, float], float, str]]:
    low, high = bounds
    negative = {k: -value for k, value in terms.items()}
    return [(terms, low, f"{what} >= {low:g}"), (negative, -high, f"{what} <= {high:g}")]


# ---------------------------------------------------------------- least squares inside the set
@dataclass(frozen=True)
class Objective:
    """The function to minimise; see the module's head.

    Attributes:
        R: rows of the least squares, (rows, c).
        r: right side, (rows,).
        bodies: positions in x of the ten parameters of each link, (L, 10).
        gamma: weight of each link's log-determinant, (L,); positive.
        linear: g, (c,).
        G: rows of the bounds, (k, c).
        h: right side of the bounds, (k,).
        mu: weight of each bound's logarithm, (k,); positive.
    """

    R: Floats
    r: Floats
    bodies: NDArray[np.int64]
    gamma: Floats
    linear: Floats
    G: Floats
    h: Floats
    mu: Floats

    def value(self, x: Floats) -> float:
        """Return f(x) of x, (c,), a pure number; infinite outside the set."""
        P, slack = pseudo_inertia(x[self.bodies]), self.G @ x - self.h
        if np.any(slack <= 0.0) or np.any(np.linalg.eigvalsh(P) <= 0.0):
            return float("inf")
        residual = self.R @ x - self.r
        barrier = self.gamma @ np.linalg.slogdet(P)[1] + self.mu @ np.log(slack)
        return float(0.5 * residual @ residual + self.linear @ x - barrier)


#: Where the method is: x, (c,); multipliers of the pseudo-inertias, (L, 4, 4); multipliers of the bounds, (k,).
Point: TypeAlias = tuple[Floats, Floats, Floats]


def minimise(
    objective: Objective, start: Floats | Point, tolerance: float = tuning.INTERIOR_TOLERANCE
) -> Point:
    """Minimise the objective from an interior point.

    Args:
        objective: the function.
        start: a point where f is finite, (c,), or where the method came to with a similar objective.
        tolerance: relative error of the optimality conditions at which the method stops.

    Returns:
        Where it stopped.
    """
    RtR = objective.R.T @ objective.R
    here = _cold(objective, start) if isinstance(start, np.ndarray) else start
    P, slack = _primal(objective, here[0])
    step = 0.0
    for _ in range(tuning.INTERIOR_STEPS):
        if step == 1.0 and _error(objective, here, P, slack) < tolerance:
            break
        try:
            after, step = _step(objective, RtR, here, P, slack)
            primal = _primal(objective, after[0])
            np.linalg.cholesky(primal[0])
        except np.linalg.LinAlgError:  # at the limit of double precision
            break
        here, (P, slack) = after, primal
    return here


def hessian_at(objective: Objective, x: Floats) -> tuple[Floats, Floats]:
    """Return the Hessian of f at a point (c,), (c, c), and the part of it from the logarithms, (c, c)."""
    P, slack = _primal(objective, x)
    back = np.linalg.inv(np.linalg.cholesky(P))
    logs = _curvature(
        objective, objective.gamma[:, None, None] ** 0.25 * back, objective.mu / slack**2
    )
    return objective.R.T @ objective.R + logs, logs


def _primal(objective: Objective, x: Floats) -> tuple[Floats, Floats]:
    """Return the pseudo-inertias at a point, (L, 4, 4), and how far the bounds are kept, (k,)."""
    return pseudo_inertia(x[objective.bodies]), objective.G @ x - objective.h


def _cold(objective: Objective, x: Floats) -> Point:
    P, slack = _primal(objective, x)
    residual = objective.R @ x - objective.r
    # Why: multipliers of the size of the force that they have to hold start near the central path.
    pressure = float(residual @ residual) / (4 * len(P) + len(slack))
    gamma, mu = np.maximum(objective.gamma, pressure), np.maximum(objective.mu, pressure)
    return np.array(x, dtype=float), gamma[:, None, None] * np.linalg.inv(P), mu / slack


def _error(objective: Objective, here: Point, P: Floats, slack: Floats) -> float:
    """Return the relative error of the optimality conditions."""
    _, Z, z = here
    matrices = P @ Z / objective.gamma[:, None, None] - np.eye(4)
    return float(
        max(np.abs(matrices).max(initial=0.0), np.abs(slack * z / objective.mu - 1).max(initial=0))
    )


def _step(
    objective: Objective, RtR: Floats, here: Point, P: Floats, slack: Floats
) -> tuple[Point, float]:
    """Take one Newton step, aiming straight at the optimum or, where that is blocked, back to the central path."""
    x, Z, z = here
    back, v, inverse = _nesterov_todd(P, Z)
    ratio = z / slack
    hessian = RtR + _curvature(objective, back, ratio)
    gradients = (
        _gradient(objective, x, inverse, slack),
        _barrier_gradient(
            objective, inverse, slack, np.ones_like(objective.gamma), np.ones_like(objective.mu)
        ),
    )
    # Why two directions at once: the step towards a point of the central path is affine in that point's weight.
    straight, centring = -solve_scaled(hessian, np.stack(gradients, axis=1)).T

    def towards(aim: float) -> tuple[float, Point]:
        dx = straight + aim * centring
        ds = objective.G @ dx
        # In scaled coordinates P and Z are the same diagonal matrix, v.
        dP = back @ pseudo_inertia(dx[objective.bodies]) @ back.swapaxes(-1, -2)
        dZ = ((objective.gamma + aim)[:, None] / v - v)[:, :, None] * np.eye(4) - dP
        dz = (objective.mu + aim) / slack - z - ratio * ds
        root = 1.0 / np.sqrt(v)
        relative = np.concatenate([dP, dZ]) * np.tile(
            root[:, :, None] * root[:, None, :], (2, 1, 1)
        )
        fall = min(
            float(np.linalg.eigvalsh(relative).min(initial=0.0)),
            float(np.concatenate([ds / slack, dz / z]).min(initial=0.0)),
        )
        return min(1.0, tuning.INTERIOR_REACH / -fall if fall < 0.0 else 1.0), (dx, dZ, dz)

    weights = 4 * float(objective.gamma.sum()) + float(objective.mu.sum())
    # What is zero in the limit: each matrix and slack times its multiplier.
    excess = (float(np.sum(P * Z)) + float(slack @ z) - weights) / (4 * len(Z) + len(z))
    step, (dx, dZ, dz) = towards(0.0)
    if step < tuning.INTERIOR_REACH and excess > 0.0:
        step, (dx, dZ, dz) = towards(excess * (1.0 - step))
    Z = Z + step * back.swapaxes(-1, -2) @ dZ @ back
    return (x + step * dx, 0.5 * (Z + Z.swapaxes(-1, -2)), z + step * dz), step


def _barrier_gradient(
    objective: Objective, inverse: Floats, slack: Floats, gamma: Floats, mu: Floats
) -> Floats:
    gradient = -objective.G.T @ (mu / slack)
    gradient[objective.bodies] -= gamma[:, None] * (
        inverse.reshape(-1, 16) @ basis().reshape(10, 16).T
    )
    return gradient


def _gradient(objective: Objective, x: Floats, inverse: Floats, slack: Floats) -> Floats:
    squares = objective.R.T @ (objective.R @ x - objective.r)
    return (
        squares
        + objective.linear
        + _barrier_gradient(objective, inverse, slack, objective.gamma, objective.mu)
    )


def _curvature(objective: Objective, back: Floats, ratio: Floats) -> Floats:
    """Return the Hessian of the logarithms in x, with back^T back in place of P^-1 and ratio of 1/slack^2."""
    scaled = (back[:, None] @ basis() @ back[:, None].swapaxes(-1, -2)).reshape(-1, 10, 16)
    curvature = objective.G.T @ (ratio[:, None] * objective.G)
    curvature[objective.bodies[:, :, None], objective.bodies[:, None, :]] += (
        scaled @ scaled.swapaxes(-1, -2)
    )
    return curvature


def _nesterov_todd(P: Floats, Z: Floats) -> tuple[Floats, Floats, Floats]:
    """Return B and v with B P B^T = B^-T Z B^-1 = diag(v), and the inverse of P."""
    lower = np.linalg.cholesky(P)
    value, vector = np.linalg.eigh(lower.swapaxes(-1, -2) @ Z @ lower)
    if value.min(initial=1.0) <= 0.0:
        raise np.linalg.LinAlgError
    outwards = np.linalg.inv(lower)
    back = value[:, :, None] ** 0.25 * (vector.swapaxes(-1, -2) @ outwards)
    return back, np.sqrt(value), outwards.swapaxes(-1, -2) @ outwards


def solve_scaled(H: Floats, b: Floats) -> Floats:
    """Solve H x = b for a positive definite H whose diagonal spans many orders; b is (d,) or (d, k).

    Directions that H does not see at all, such as the difference of an effect that is given twice, stay where they are.
    """
    diagonal = np.diagonal(H)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = scale[:, None] * H * scale
    scaled[np.diag_indices_from(scaled)] = 1.0
    columns = scale if b.ndim == 1 else scale[:, None]
    try:
        return np.asarray(columns * np.linalg.solve(scaled, columns * b))
    except np.linalg.LinAlgError:
        return np.asarray(columns * np.linalg.lstsq(scaled, columns * b, rcond=None)[0])
