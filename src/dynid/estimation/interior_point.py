"""Damped primal-dual Newton method for least squares with log-determinant and logarithm terms.

    f(y) = 1/2 |R y - r|^2 + g.x - sum_i gamma_i logdet P_i(x) - sum_k mu_k log(G x - h)_k,   x = T y

At the minimum each P_i has a multiplier Z_i with P_i Z_i = gamma_i 1 (each bound one with slack * z = mu). The method
solves these conditions together, in the scaling of Nesterov and Todd; primal steps alone would crawl along the
boundary where the squares outweigh the logarithms. The certificate is the Newton decrement of f itself.

Source: Boyd, Vandenberghe 2004, sections 9.6 and 11; Nesterov, Todd 1998 for the scaling.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.physical_constraints import basis, pseudo_inertia

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Objective:
    """The function to minimise; see the module's head.

    Attributes:
        R: rows of the least squares, (rows, d).
        r: right side, (rows,).
        bodies: positions in x of the ten parameters of each link, (L, 10).
        gamma: weight of each link's log-determinant, (L,); positive.
        linear: g, (c,).
        G: rows of the bounds, (k, c).
        h: right side of the bounds, (k,).
        mu: weight of each bound's logarithm, (k,); positive.
        T: x = T y, (c, d); None for the identity.
    """

    R: Floats
    r: Floats
    bodies: NDArray[np.int64]
    gamma: Floats
    linear: Floats
    G: Floats
    h: Floats
    mu: Floats
    T: Floats | None = None

    def to_x(self, y: Floats) -> Floats:
        """Return x = T y, (d,) -> (c,)."""
        return y if self.T is None else self.T @ y

    def value(self, y: Floats) -> float:
        """Return f(y) of y, (d,), a pure number; infinite outside the set."""
        x = self.to_x(y)
        P, slack = pseudo_inertia(x[self.bodies]), self.G @ x - self.h
        if np.any(slack <= 0.0) or np.any(np.linalg.eigvalsh(P) <= 0.0):
            return float("inf")
        residual = self.R @ y - self.r
        barrier = self.gamma @ np.linalg.slogdet(P)[1] + self.mu @ np.log(slack)
        return float(0.5 * residual @ residual + self.linear @ x - barrier)


@dataclass(frozen=True)
class Minimum:
    """Where the method stopped and how good that is.

    Attributes:
        y: the minimiser, (d,).
        decrement: Newton decrement of f at y.
        gap: bound on f(y) minus the smallest f; infinite where the decrement is too large for a bound.
        steps: Newton steps.
        hessian: of f at y, (d, d).
        logs: the part of it that comes from the logarithms, in x, (c, c).
        Z: multipliers of the pseudo-inertias, (L, 4, 4).
        z: multipliers of the bounds, (k,).
    """

    y: Floats
    decrement: float
    gap: float
    steps: int
    hessian: Floats
    logs: Floats
    Z: Floats
    z: Floats


def minimise(objective: Objective, start: Floats | Minimum | Point) -> Minimum:
    """Minimise the objective from an interior point.

    Args:
        objective: the function.
        start: a point where f is finite, (d,), or where the method came to with a similar objective.

    Returns:
        The minimum with its certificate.
    """
    here, steps = approach(objective, start)
    return _certify(objective, objective.R.T @ objective.R, here, steps)


def approach(
    objective: Objective, start: Floats | Minimum | Point, tolerance: float = tuning.INTERIOR_TOLERANCE
) -> tuple[Point, int]:
    """Come near the minimum, without a certificate.

    Args:
        objective: the function.
        start: a point where f is finite, (d,), or where the method came to with a similar objective.
        tolerance: relative error of the optimality conditions at which the method stops.

    Returns:
        Where it stopped, and the number of Newton steps.
    """
    RtR = objective.R.T @ objective.R
    here = _cold(objective, start) if isinstance(start, np.ndarray) else _warm(objective, start)
    steps, step = 0, 0.0
    while steps < tuning.INTERIOR_STEPS and not (step == 1.0 and here.error(objective) < tolerance):
        try:
            after, step = _step(objective, RtR, here)
            np.linalg.cholesky(after.P)
        except np.linalg.LinAlgError:  # at the limit of double precision: the certificate says how good that is
            break
        here, steps = after, steps + 1
    return here, steps


@dataclass(frozen=True)
class Point:
    """A primal-dual point: y, pseudo-inertias (L, 4, 4), slack of the bounds (k,), and their multipliers Z and z."""

    y: Floats
    P: Floats
    slack: Floats
    Z: Floats
    z: Floats

    def error(self, objective: Objective) -> float:
        """Return the relative error of the optimality conditions."""
        matrices = self.P @ self.Z / objective.gamma[:, None, None] - np.eye(4)
        return float(
            max(np.abs(matrices).max(initial=0.0), np.abs(self.slack * self.z / objective.mu - 1).max(initial=0))
        )

    def complementarity(self) -> float:
        """Return the sum of what is zero in the limit: each matrix and slack times its multiplier."""
        return float(np.sum(self.P * self.Z)) + float(self.slack @ self.z)


def _primal(objective: Objective, y: Floats) -> tuple[Floats, Floats]:
    x = objective.to_x(y)
    return pseudo_inertia(x[objective.bodies]), objective.G @ x - objective.h


def _cold(objective: Objective, y: Floats) -> Point:
    P, slack = _primal(objective, y)
    residual = objective.R @ y - objective.r
    # Why: multipliers of the size of the force that they have to hold start near the central path.
    pressure = float(residual @ residual) / (4 * len(P) + len(slack))
    gamma, mu = np.maximum(objective.gamma, pressure), np.maximum(objective.mu, pressure)
    return Point(np.array(y, dtype=float), P, slack, gamma[:, None, None] * np.linalg.inv(P), mu / slack)


def _warm(objective: Objective, minimum: Minimum | Point) -> Point:
    return Point(minimum.y, *_primal(objective, minimum.y), minimum.Z, minimum.z)


def _step(objective: Objective, RtR: Floats, here: Point) -> tuple[Point, float]:
    """Take one Newton step, aiming straight at the optimum or, where that is blocked, back to the central path."""
    back, v, inverse = _nesterov_todd(here)
    ratio = here.z / here.slack
    hessian = RtR + _in_y(objective, _curvature(objective, back, ratio))
    gradients = (
        _gradient(objective, here.y, inverse, here.slack),
        _barrier_gradient(objective, inverse, here.slack, np.ones_like(objective.gamma), np.ones_like(objective.mu)),
    )
    # Why two directions at once: the step towards a point of the central path is affine in that point's weight.
    straight, centring = -solve_scaled(hessian, np.stack(gradients, axis=1)).T

    def towards(aim: float) -> tuple[float, tuple[Floats, ...]]:
        dy = straight + aim * centring
        dx = objective.to_x(dy)
        ds = objective.G @ dx
        # In scaled coordinates P and Z are the same diagonal matrix, v.
        dP = back @ pseudo_inertia(dx[objective.bodies]) @ back.swapaxes(-1, -2)
        dZ = _diagonal((objective.gamma + aim)[:, None] / v - v) - dP
        dz = (objective.mu + aim) / here.slack - here.z - ratio * ds
        root = 1.0 / np.sqrt(v)
        relative = np.concatenate([dP, dZ]) * np.tile(root[:, :, None] * root[:, None, :], (2, 1, 1))
        fall = min(
            float(np.linalg.eigvalsh(relative).min(initial=0.0)),
            float(np.concatenate([ds / here.slack, dz / here.z]).min(initial=0.0)),
        )
        return min(1.0, tuning.INTERIOR_REACH / -fall if fall < 0.0 else 1.0), (dy, dZ, dz)

    weights = 4 * float(objective.gamma.sum()) + float(objective.mu.sum())
    excess = (here.complementarity() - weights) / (4 * len(here.Z) + len(here.z))
    step, (dy, dZ, dz) = towards(0.0)
    if step < tuning.INTERIOR_REACH and excess > 0.0:
        step, (dy, dZ, dz) = towards(excess * (1.0 - step))
    y = here.y + step * dy
    Z = here.Z + step * back.swapaxes(-1, -2) @ dZ @ back
    return Point(y, *_primal(objective, y), 0.5 * (Z + Z.swapaxes(-1, -2)), here.z + step * dz), step


def _certify(objective: Objective, RtR: Floats, here: Point, steps: int) -> Minimum:
    back = np.linalg.inv(np.linalg.cholesky(here.P))
    gradient = _gradient(objective, here.y, back.swapaxes(-1, -2) @ back, here.slack)
    logs = _curvature(objective, objective.gamma[:, None, None] ** 0.25 * back, objective.mu / here.slack**2)
    hessian = RtR + _in_y(objective, logs)
    decrement = max(float(gradient @ solve_scaled(hessian, gradient)), 0.0) ** 0.5
    # f over its smallest weight is self-concordant, which turns the decrement into a bound.
    weakest = float(min(objective.gamma.min(initial=np.inf), objective.mu.min(initial=np.inf)))
    gap = weakest * _gap_bound(decrement / weakest**0.5)
    return Minimum(here.y, decrement, gap, steps, hessian, logs, here.Z, here.z)


def _barrier_gradient(objective: Objective, inverse: Floats, slack: Floats, gamma: Floats, mu: Floats) -> Floats:
    gradient = -objective.G.T @ (mu / slack)
    gradient[objective.bodies] -= gamma[:, None] * (inverse.reshape(-1, 16) @ basis().reshape(10, 16).T)
    return gradient if objective.T is None else objective.T.T @ gradient


def _gradient(objective: Objective, y: Floats, inverse: Floats, slack: Floats) -> Floats:
    linear = objective.linear if objective.T is None else objective.T.T @ objective.linear
    squares = objective.R.T @ (objective.R @ y - objective.r)
    return squares + linear + _barrier_gradient(objective, inverse, slack, objective.gamma, objective.mu)


def _curvature(objective: Objective, back: Floats, ratio: Floats) -> Floats:
    """Return the Hessian of the logarithms in x, with back^T back in place of P^-1 and ratio of 1/slack^2."""
    scaled = (back[:, None] @ basis() @ back[:, None].swapaxes(-1, -2)).reshape(-1, 10, 16)
    curvature = objective.G.T @ (ratio[:, None] * objective.G)
    curvature[objective.bodies[:, :, None], objective.bodies[:, None, :]] += scaled @ scaled.swapaxes(-1, -2)
    return curvature


def _in_y(objective: Objective, hessian: Floats) -> Floats:
    return hessian if objective.T is None else objective.T.T @ hessian @ objective.T


def _nesterov_todd(here: Point) -> tuple[Floats, Floats, Floats]:
    """Return B and v with B P B^T = B^-T Z B^-1 = diag(v), and the inverse of P."""
    lower = np.linalg.cholesky(here.P)
    value, vector = np.linalg.eigh(lower.swapaxes(-1, -2) @ here.Z @ lower)
    if value.min(initial=1.0) <= 0.0:
        raise np.linalg.LinAlgError
    outwards = np.linalg.inv(lower)
    back = value[:, :, None] ** 0.25 * (vector.swapaxes(-1, -2) @ outwards)
    return back, np.sqrt(value), outwards.swapaxes(-1, -2) @ outwards


def _diagonal(v: Floats) -> Floats:
    return v[:, :, None] * np.eye(4)


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


def _gap_bound(decrement: float) -> float:
    """Return -d - log(1 - d), the self-concordant bound on f minus its smallest value."""
    return float(-decrement - np.log1p(-decrement)) if decrement < 1.0 else float("inf")
