"""Physically possible parameters: the best-fitting ones near a prior, the nearest ones, and full sets from base ones.

Reads whitened least squares ``R x ~ r`` (or base parameters with covariance) and ``Physics``; writes parameters of
bodies that exist, with a certificate of optimality. Source: Lee, Wensing, Park 2020 for the entropic divergence

    1/2 |R x - r|^2 + gamma * sum_i [-logdet P_i + tr(P0_i^-1 P_i)].
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NotPhysical
from dynid.estimation.interior_point import Minimum, Objective, approach, minimise
from dynid.estimation.physical_constraints import Physics, basis, smallest_eigenvalues

Floats = NDArray[np.float64]

#: Weight of the divergence from the prior, in units of 1/2 chi^2. Within a few percent of the best in every regime
#: of docs/explanation/estimators.md, where cross-validation costs 0.5 s and was worse.
DEFAULT_GAMMA = 3.0
#: Weight of the logarithm of a bound that only has to hold: too small to bias anything.
BOUND_WEIGHT = 1e-5
#: Weight of all logarithms in the pure constraint.
NEAREST_WEIGHT = 1e-5
#: Rounds of pooling, relative change of the sizes at which it ends, and how exactly each round is solved.
POOLING_ROUNDS, POOLED, POOLING_TOLERANCE = 10, 0.03, 0.03
#: Share of a standard deviation within which base parameters are kept, on the way to "exactly".
COMPLETION_STEPS = (1.0, 1e-1, 1e-2, 1e-3, 1e-4)
#: A base parameter counts as reproduced when it is kept to this share of its standard deviation.
REPRODUCED = 1e-2


@dataclass(frozen=True)
class ConsistentFit:
    """A physical parameter vector with its certificate.

    Attributes:
        x: parameters, (c,).
        cost: 1/2 |R x - r|^2, the pull of offsets to zero with it.
        objective: cost plus divergence from the prior.
        gap: bound on how far ``objective`` is above the best possible one.
        steps: Newton steps.
        smallest_eigenvalue: of each link's pseudo-inertia, (L,); positive.
        touched: labels of the bounds that the data push against.
        data_share: how much of each parameter comes from the data, 0 (prior) to 1 (data), (c,).
        std_error: posterior standard deviation, data and prior together, (c,).
    """

    x: Floats
    cost: float
    objective: float
    gap: float
    steps: int
    smallest_eigenvalue: Floats
    touched: tuple[str, ...]
    data_share: Floats
    std_error: Floats


@dataclass(frozen=True)
class Completion:
    """Link parameters that reproduce base parameters, or the nearest that do not.

    Attributes:
        fit: the full set.
        miss: K x - beta, (p,).
        miss_sigma: the same in standard deviations, (p,).
        reproduced: False means that no consistent body reproduces these base parameters.
    """

    fit: ConsistentFit
    miss: Floats
    miss_sigma: Floats
    reproduced: bool


def fit_consistent(R: Floats, r: Floats, physics: Physics, gamma: float = DEFAULT_GAMMA) -> ConsistentFit:
    """Fit physical parameters with the entropic pull towards the prior.

    Args:
        R: whitened regressor or its triangular factor, (rows, c).
        r: whitened torques, (rows,).
        physics: bounds and prior.
        gamma: weight of the prior; 1/2 chi^2 must be honest, so whiten with a HAC covariance where residuals are
            coloured.

    Returns:
        The unique minimiser.
    """
    objective = _objective(R, r, physics, gamma, BOUND_WEIGHT)
    minimum = minimise(objective, interior_point(physics))
    return _report(objective, minimum, physics, BOUND_WEIGHT * int(_only_bounds(physics).sum()))


def fit_pooled(R: Floats, r: Floats, physics: Physics, gamma: float = DEFAULT_GAMMA) -> tuple[ConsistentFit, Physics]:
    """Fit like ``fit_consistent``, and let joints lend each other the size of their friction and rotor inertia.

    Nobody knows these in advance, and in a short or slow log one joint's may vanish or explode. The pull of each kind
    towards a common size s of all joints (for their ratings), minimised over s as well, is gamma * n * log(arithmetic /
    geometric mean): no unit and no size is preferred, only equality. Offsets are normally distributed with the common
    size of the Coulomb friction, from which a joint that moves one way only cannot tell them. Good data override it.
    Source: empirical Bayes; solved by majorisation.

    Args:
        R: whitened regressor or its triangular factor, (rows, c).
        r: whitened torques, (rows,).
        physics: bounds and prior.
        gamma: weight of the prior and of the pull.

    Returns:
        The fit, and the physics with the sizes found as prior, for ``complete``.
    """
    start = interior_point(physics)
    physics = pool(physics, start)
    objective = _objective(*_with_spread(R, r, physics, gamma), physics, gamma, BOUND_WEIGHT)
    here, steps = approach(objective, start, POOLING_TOLERANCE)
    for _ in range(POOLING_ROUNDS):
        before, physics = physics, pool(physics, here.y)
        if np.allclose(physics.prior, before.prior, rtol=POOLED):
            break
        objective = _objective(*_with_spread(R, r, physics, gamma), physics, gamma, BOUND_WEIGHT)
        here, more = approach(objective, here, POOLING_TOLERANCE)
        steps += more
    minimum = minimise(objective, here)
    minimum = replace(minimum, steps=steps + minimum.steps)
    return _report(objective, minimum, physics, BOUND_WEIGHT * int(_only_bounds(physics).sum())), physics


def pool(physics: Physics, x: Floats) -> Physics:
    """Return the physics with the size of each kind in x, for its rating, as prior of what is positive and had none.

    The size is the mean, or with offsets what makes them and the Coulomb friction most likely together.

    Args:
        physics: bounds and prior.
        x: parameters, (c,).

    Returns:
        Physics in which friction and rotor inertia have a prior; pooled ones are updated by pooling again.
    """
    prior, spread = physics.prior.copy(), physics.spread.copy()
    for columns in physics.pools:
        if len(columns) < 2:
            continue
        offsets = physics.offsets if physics.parameters[columns[0]].kind == "fc" else columns[:0]
        total = float(np.sum(x[columns] / physics.ratings[columns]))
        squares = float(np.sum((x[offsets] / physics.ratings[offsets]) ** 2))
        count = len(columns) + len(offsets)
        size = (total + np.sqrt(total**2 + 4 * count * squares)) / (2 * count)
        prior[columns], spread[offsets] = physics.ratings[columns] * size, physics.ratings[offsets] * size
    return replace(physics, prior=prior, spread=spread)


def _with_spread(R: Floats, r: Floats, physics: Physics, gamma: float) -> tuple[Floats, Floats]:
    """Return the rows with those that hold parameters near zero."""
    held = np.flatnonzero(np.isfinite(physics.spread))
    pull = np.eye(R.shape[1])[held] * (gamma**0.5 / physics.spread[held])[:, None]
    return np.vstack([R, pull]), np.append(r, np.zeros(len(held)))


def nearest_consistent(R: Floats, r: Floats, physics: Physics) -> ConsistentFit:
    """Fit physical parameters without a pull towards the prior: the constraint alone.

    Why not the default: on poor data the constraint does not rescue the fit, the prior does (held-out torque error
    78 % against 4 % in the study of docs/explanation/estimators.md). The prior still picks among equal fits.

    Args:
        R: whitened regressor or its triangular factor, (rows, c).
        r: whitened torques, (rows,).
        physics: bounds and prior.

    Returns:
        A minimiser; ``gap`` bounds 1/2 |R x - r|^2 above the smallest one, the tie-break of 1e-3 included.
    """
    objective = _objective(R, r, physics, NEAREST_WEIGHT, NEAREST_WEIGHT)
    minimum = minimise(objective, interior_point(physics))
    return _report(objective, minimum, physics, NEAREST_WEIGHT * (4 * len(physics.bodies) + len(physics.h)))


def complete(
    K: Floats, beta: Floats, covariance: Floats, physics: Physics, *, exact: bool, gamma: float = DEFAULT_GAMMA
) -> Completion:
    """Find link parameters behind base parameters; what the base parameters leave open comes from the prior.

    Args:
        K: base parameters as combinations of all parameters, beta = K x, (p, c), full row rank.
        beta: base parameters, (p,).
        covariance: their covariance, (p, p); HAC where residuals are coloured.
        physics: bounds and prior.
        exact: keep every base parameter; otherwise within its uncertainty, which improves a noisy beta.
        gamma: weight of the prior.

    Returns:
        The full set and what it misses of beta.
    """
    p, c = K.shape
    _, _, Vt = np.linalg.svd(K)
    # Why new coordinates (base parameters, rest): a stiff fit in x would drown the prior's 1e0 in rounding of 1e12.
    T = np.hstack([np.linalg.pinv(K), Vt[p:].T])
    sigma = np.sqrt(np.diagonal(covariance))
    whiten = np.linalg.inv(np.linalg.cholesky(covariance / np.outer(sigma, sigma))) / sigma
    x = interior_point(physics)
    minimum: Minimum | None = None
    worst, steps = np.inf, 0
    for tolerance in COMPLETION_STEPS if exact else COMPLETION_STEPS[:1]:
        R = np.hstack([whiten, np.zeros((p, c - p))]) / tolerance
        objective = replace(_objective(R, whiten @ beta / tolerance, physics, gamma, BOUND_WEIGHT), T=T)
        minimum = minimise(objective, minimum or np.concatenate([K @ x, Vt[p:] @ x]))
        steps, before, worst = steps + minimum.steps, worst, float(np.abs((minimum.y[:p] - beta) / sigma).max())
        # Why: where a body exists, ten times the stiffness leaves a hundredth of the miss; where none does, nothing.
        if worst < 1e-3 * REPRODUCED or worst > 0.5 * before:
            break
    assert minimum is not None
    fit = _report(objective, replace(minimum, steps=steps), physics, BOUND_WEIGHT * int(_only_bounds(physics).sum()))
    miss = K @ fit.x - beta
    return Completion(fit, miss, miss / sigma, worst <= REPRODUCED)


def interior_point(physics: Physics) -> Floats:
    """Return a parameter vector strictly inside all bounds, near the prior, (c,).

    Args:
        physics: bounds and prior.

    Returns:
        Where the solvers start.

    Raises:
        NotPhysical: the prior's bodies or the bounds contradict each other.
    """
    x = physics.prior.copy()
    eigenvalues = smallest_eigenvalues(x[physics.bodies])
    if np.any(eigenvalues <= 0.0):
        worst = physics.parameters[physics.bodies[int(np.argmin(eigenvalues)), 0]].number
        raise NotPhysical(
            f"the prior of link {worst} is no possible body", fix="correct the prior in the robot file: dynid check"
        )
    single = np.count_nonzero(physics.G, axis=1) == 1
    for row in physics.G[single & (physics.slack(x) <= 0.0)]:
        k = int(np.flatnonzero(row)[0])
        if k not in physics.bodies:
            x[k] = 1.0 / row[k]
    return x if np.all(physics.slack(x) > 0.0) else _move_inside(physics, x)


def _move_inside(physics: Physics, x: Floats) -> Floats:
    """Shift all bounds outwards until x is inside, then pull the shift below zero."""
    c, k = len(x), len(physics.h)
    size = np.abs(physics.G) @ np.abs(x) + np.abs(physics.h) + 1e-9
    G = np.vstack([np.hstack([physics.G, size[:, None]]), np.append(np.zeros(c), 1.0)])
    h = np.append(physics.h, -1.0)
    y = np.append(x, 1.0 + max(0.0, float((-physics.slack(x) / size).max())))
    # Why the weak pull to x: without data nothing else keeps friction and rotor inertia from growing for ever.
    R, weights = np.eye(c, c + 1) / (1.0 + np.abs(x))[:, None], np.ones(k + 1)
    base = _objective(R, R @ y, physics, 1.0, 1.0)
    for pull in (1e2, 1e4, 1e6, 1e8):
        y = minimise(replace(base, linear=np.append(base.linear, pull), G=G, h=h, mu=weights), y).y
        if np.all(physics.slack(y[:-1]) > 0.0):
            return np.asarray(y[:-1])
    broken = physics.labels[int(np.argmin(physics.slack(y[:-1]) / size))]
    raise NotPhysical(
        f"the known facts about the arm contradict each other: {broken} cannot hold with the others",
        fix="widen or drop one of the bounds",
    )


def _only_bounds(physics: Physics) -> NDArray[np.bool_]:
    """Return which bounds carry no prior value, (k,): all but those on a single parameter believed positive."""
    pulled = (np.count_nonzero(physics.G, axis=1) == 1) & (physics.h == 0.0) & (physics.G @ physics.prior > 0.0)
    return np.asarray(~pulled)


def _objective(R: Floats, r: Floats, physics: Physics, gamma: float, bound_weight: float) -> Objective:
    linear = np.zeros(len(physics.prior))
    inverse = np.linalg.inv(physics.prior_pseudo_inertia)
    linear[physics.bodies] = gamma * np.einsum("lab,kba->lk", inverse, basis())
    bound = _only_bounds(physics)
    # A positive number with a prior gets the one-dimensional form of the same divergence: -log x + x / x0.
    for row in physics.G[~bound]:
        linear += gamma * row / (row @ physics.prior)
    mu = np.where(bound, bound_weight, gamma)
    return Objective(R, r, physics.bodies, np.full(len(physics.bodies), float(gamma)), linear, physics.G, physics.h, mu)


def _report(objective: Objective, minimum: Minimum, physics: Physics, barrier_gap: float) -> ConsistentFit:
    x = objective.to_x(minimum.y)
    residual = objective.R @ minimum.y - objective.r
    # A bound's multiplier mu / slack, times its distance from the prior, says how much cost it holds back.
    slack = physics.slack(x)
    held = objective.mu * np.abs(physics.slack(interior_point(physics)) / slack)
    touched = tuple(label for label, cost in zip(physics.labels, held, strict=True) if cost > 1.0)
    after, before = _variances(minimum.hessian, objective.T), _variances(minimum.logs, None)
    share = np.where(before > 0.0, 1.0 - after / np.where(before > 0.0, before, 1.0), 1.0)
    return ConsistentFit(
        x=x,
        cost=float(0.5 * residual @ residual),
        objective=objective.value(minimum.y),
        gap=minimum.gap + barrier_gap,
        steps=minimum.steps,
        smallest_eigenvalue=smallest_eigenvalues(x[physics.bodies]),
        touched=touched,
        data_share=np.clip(share, 0.0, 1.0),
        std_error=np.sqrt(after),
    )


def _variances(H: Floats, T: Floats | None) -> Floats:
    """Return the diagonal of T H^-1 T^T, (c,); 0 for parameters that H does not see at all."""
    seen = np.diagonal(H) > 0.0
    scale = 1.0 / np.sqrt(np.diagonal(H)[seen])
    inverse = np.zeros_like(H)
    scaled = scale[:, None] * H[np.ix_(seen, seen)] * scale
    # Why a pseudo-inverse: noise-free rows next to a wide prior make the matrix singular in double precision.
    inverse[np.ix_(seen, seen)] = scale[:, None] * np.linalg.pinv(scaled, hermitian=True) * scale
    return np.asarray(np.maximum(np.diagonal(inverse) if T is None else np.sum((T @ inverse) * T, axis=1), 0.0))
