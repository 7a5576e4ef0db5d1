"""How far a real link may be from the prior's body: as far as the data say, at a price that grows with the logarithm.

The entropic divergence gamma (-logdet P + tr(P0^-1 P)) forbids what it has not foreseen: a body ten times as large as
its prior costs as much as 60 independent contradicting measurements, and default cylinders are wrong by factors of 10
to 500 in single directions. Estimates are then drawn far from the truth, with small error bars. Here the prior is a
matrix-F distribution, the entropic one with a scale that is itself uncertain:

    gamma * sum_i [-logdet P_i + 1/s logdet((1 - s) B_i + s P_i)],     0 < s < 1.

It has its mode at B_i and the same shape near it; far from it the price is linear in the logarithm on either side. The
second term is concave, so the tangent P0_i = (1 - s) B_i + s P_i at the present P_i bounds it from above: entropic fits
whose prior follows half-way solve it (majorisation). Curvatures are those along geodesics of the cone of bodies, where
the price is convex; in P itself they vanish or explode at its edge.

Source: Mulder, Pericchi 2018, "The matrix-F prior for estimating and testing covariance matrices".
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.physical_constraints import PhysicalConstraints, basis, body_parameters, pseudo_inertia

Floats = NDArray[np.float64]

#: Second moment of a body along an axis, as a share of all of it, below which the body has no width there, and the same
#: as a share of all of it about the frame's origin: what rounding leaves of a point.
THIN, ROUNDED = 1e-6, 1e-12


def rounded(constraints: PhysicalConstraints) -> PhysicalConstraints:
    """Return the constraints with every prior body a little like the mean one, the mass of all links the same.

    Args:
        constraints: those whose prior is made of default cylinders.
    """
    P = constraints.prior_pseudo_inertia
    if not len(P):
        return constraints
    mass = P[:, 3, 3]
    com = P[:, :3, 3] / mass[:, None]
    extent = np.trace(P[:, :3, :3], axis1=1, axis2=2) / mass - np.sum(com**2, axis=1)
    ball = np.zeros_like(P)
    ball[:, :3, :3] = np.eye(3) * float(np.mean(extent)) / 3
    point = np.hstack([com, np.ones((len(P), 1))])
    ball += point[:, :, None] * point[:, None, :]
    prior = constraints.prior.copy()
    prior[constraints.bodies] = body_parameters(
        (P + tuning.BALL_SHARE * np.mean(mass) * ball) / (1.0 + tuning.BALL_SHARE)
    )
    return replace(constraints, prior=prior)


def widened(constraints: PhysicalConstraints, shapes: Floats) -> PhysicalConstraints:
    """Return the constraints with a width for prior bodies that have none: point masses, thin rods, links without mass.

    Mass and centre are often known where an inertia is not. Such a body is spread as its link's cylinder is, beside
    what is given; a mass alone becomes that cylinder, and a link without mass a light one.

    Args:
        constraints: those whose prior is made of given bodies.
        shapes: pseudo-inertias of the links' cylinders, each for 1 kg, (L, 4, 4).
    """
    P = constraints.prior_pseudo_inertia.copy()
    if not len(P):
        return constraints
    mass, about_origin = P[:, 3, 3].copy(), P[:, :3, :3]
    com = P[:, :3, 3] / np.where(mass > 0.0, mass, 1.0)[:, None]
    own = about_origin - mass[:, None, None] * com[:, :, None] * com[:, None, :]
    least, every, whole = np.linalg.eigvalsh(own)[:, 0], *(np.trace(x, axis1=1, axis2=2) for x in (own, about_origin))
    thin = np.abs(least) <= THIN * every + ROUNDED * whole
    middle = shapes[:, :3, 3]
    P[thin, :3, :3] += (mass[:, None, None] * (shapes[:, :3, :3] - middle[:, :, None] * middle[:, None, :]))[thin]
    light, alone = mass == 0.0, (mass > 0.0) & (whole == 0.0)
    P[light] += tuning.BALL_SHARE * np.mean(mass) * shapes[light]
    P[alone] = mass[alone, None, None] * shapes[alone]
    prior = constraints.prior.copy()
    prior[constraints.bodies[thin | light]] = body_parameters(P[thin | light])
    return replace(constraints, prior=prior)


def followed(constraints: PhysicalConstraints, x: Floats) -> Floats:
    """Return (1 - s) B + s P of each link, (L, 4, 4), for parameters x, (c,)."""
    P = pseudo_inertia(x[constraints.bodies])
    return np.asarray((1.0 - tuning.PRIOR_FOLLOWED) * constraints.prior_pseudo_inertia + tuning.PRIOR_FOLLOWED * P)


def likeliest_size(constraints: PhysicalConstraints, x: Floats) -> float:
    """Return the factor on all prior bodies that makes the bodies in x, (c,), likelier; 1 at its fixed point."""
    P = pseudo_inertia(x[constraints.bodies])
    share = np.einsum("lab,lba->l", np.linalg.inv(followed(constraints, x)), P) / 4
    return float(np.mean(share)) if len(share) else 1.0


def curvature(constraints: PhysicalConstraints, x: Floats, gamma: float) -> Floats:
    """Return the curvature of the price of each link along geodesics, (L, 10, 10), in its ten parameters.

    Args:
        constraints: with the prior's bodies B.
        x: all parameters, (c,).
        gamma: weight of the prior.
    """
    whiten = np.linalg.inv(np.linalg.cholesky(constraints.prior_pseudo_inertia))
    P = pseudo_inertia(x[constraints.bodies])
    size, turn = np.linalg.eigh(whiten @ P @ whiten.swapaxes(-1, -2))
    # Why: the smallest of a body at the edge of the cone is rounding.
    size = np.maximum(size, np.finfo(float).eps * size[:, -1:])
    frame = turn.swapaxes(-1, -2) @ whiten
    weight = np.sqrt(1.0 - tuning.PRIOR_FOLLOWED) / (
        np.sqrt(size) * (1.0 - tuning.PRIOR_FOLLOWED + tuning.PRIOR_FOLLOWED * size)
    )
    changes = frame[:, None] @ basis() @ frame[:, None].swapaxes(-1, -2)
    return np.asarray(gamma * np.einsum("lkab,la,lb,lmab->lkm", changes, weight, weight, changes, optimize=True))
