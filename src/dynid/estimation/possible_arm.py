"""The possible arm that explains the torques best: fitted near a prior, for all links that a real arm could have.

What the data determine is kept within its uncertainty, the rest is taken from the prior, and every number says which it
is. Reads whitened least squares ``R x ~ r`` (or base parameters with covariance) and the set of possible arms; writes
parameters of bodies that exist. The divergence from the prior is entropic (Lee,
Wensing, Park 2020, "Geometric robot dynamic identification"):

    1/2 |R x - r|^2 + gamma * sum_i [-logdet P_i + tr(P0_i^-1 P_i)].

Alone it forbids what it has not foreseen: a body ten times as large as its prior costs as much as 60 independent
contradicting measurements, and default cylinders are wrong by factors of 10 to 500 in single directions. So the prior
of a body is a matrix-F distribution, the entropic one with a scale that is itself uncertain (Mulder, Pericchi 2018):

    gamma * sum_i [-logdet P_i + 1/s logdet((1 - s) B_i + s P_i)],     0 < s < 1.

It has its mode at B_i and the same shape near it; far from it the price is linear in the logarithm on either side. The
second term is concave, so the tangent P0_i = (1 - s) B_i + s P_i at the present P_i bounds it from above: entropic fits
whose prior follows half-way solve it (majorisation). Curvatures are those along geodesics of the cone of bodies, where
the price is convex; in P itself they vanish or explode at its edge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.arrays import Floats
from dynid.errors import NotPhysical
from dynid.estimation import tuning
from dynid.estimation.factor import of_unit_diagonal
from dynid.estimation.possible_set import (
    NONNEGATIVE,
    Objective,
    PhysicalConstraints,
    basis,
    body_parameters,
    make_constraints,
    minimise,
    pseudo_inertia,
    smallest_eigenvalues,
)
from dynid.model.base_model import BaseModel
from dynid.model.parameters import (
    body_of,
    columns_of,
    cylinder_body,
    cylinders_of,
    link_cylinders,
    second_moments,
)
from dynid.model.regressor import prior_vector
from dynid.robot import Body, Robot

# ---------------------------------------------------------------- how far a link may be from the prior's body
#: Second moment of a body along an axis, as a share of all of it, below which the body has no width there, and the same
#: as a share of all of it about the frame's origin: what rounding leaves of a point.
THIN, ROUNDED = 1e-6, 1e-12


def with_bodies(constraints: PhysicalConstraints, P: Floats) -> PhysicalConstraints:
    """Return the constraints with other prior bodies, pseudo-inertias (L, 4, 4)."""
    prior = constraints.prior.copy()
    prior[constraints.bodies] = body_parameters(P)
    return replace(constraints, prior=prior)


def rounded(constraints: PhysicalConstraints) -> PhysicalConstraints:
    """Return the constraints with every prior body a little like the mean one, the mass of all links the same.

    Args:
        constraints: those whose prior is made of default cylinders.
    """
    P, share = constraints.prior_pseudo_inertia, tuning.BALL_SHARE
    mass = P[:, 3:, 3:]
    point = P[:, :, 3:] / mass
    about_centre = P / mass - point @ point.swapaxes(1, 2)
    ball = np.diag([1.0, 1.0, 1.0, 0.0]) * np.mean(np.trace(about_centre, axis1=1, axis2=2)) / 3
    ball = ball + point @ point.swapaxes(1, 2)
    return with_bodies(constraints, (P + share * np.mean(mass) * ball) / (1.0 + share))


def widened(given: Floats, cylinder: Body, light: float) -> Floats:
    """Return the parameters of a prior body, (10,), with a width where it has none: a point mass, a thin rod, no mass.

    Mass and centre are often known where an inertia is not. Such a body is spread as its link's cylinder is, beside
    what is given; a mass alone becomes that cylinder, and a link without mass a light one.

    Args:
        given: parameters of the body that somebody gave.
        cylinder: of the link, of 1 kg.
        light: mass of a link that was given none [kg].
    """
    mass, shape = given[0], cylinder.parameters()
    if not mass:
        return given + light * shape
    if not given[1:].any():
        return np.asarray(mass * shape)
    about_origin = 0.5 * given[[4, 7, 9]].sum()
    own = np.linalg.eigvalsh(second_moments(body_of(given).tensor))
    if abs(own[0]) > THIN * own.sum() + ROUNDED * about_origin:
        return given
    return given + mass * np.append(np.zeros(4), cylinder.inertia_com)


def followed(constraints: PhysicalConstraints, x: Floats) -> PhysicalConstraints:
    """Return the constraints with the prior (1 - s) B + s P of each link, for parameters x, (c,).

    Its entropic divergence bounds the price of the bodies from above.
    """
    B, P = constraints.prior_pseudo_inertia, pseudo_inertia(x[constraints.bodies])
    return with_bodies(constraints, (1.0 - tuning.PRIOR_FOLLOWED) * B + tuning.PRIOR_FOLLOWED * P)


def likeliest_size(bound: PhysicalConstraints, x: Floats) -> float:
    """Return the factor on all prior bodies that makes the bodies in x, (c,), likelier; 1 at its fixed point.

    Args:
        bound: the constraints with the prior ``followed`` there.
        x: parameters, (c,).
    """
    P = pseudo_inertia(x[bound.bodies])
    share = np.einsum("lab,lba->l", np.linalg.inv(bound.prior_pseudo_inertia), P) / 4
    return float(np.mean(share)) if len(share) else 1.0


def curvature(constraints: PhysicalConstraints, x: Floats) -> Floats:
    """Return the curvature of the price of each link along geodesics, (L, 10, 10), in its ten parameters.

    Args:
        constraints: with the prior's bodies B.
        x: all parameters, (c,).
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
    bent = np.einsum("lkab,la,lb,lmab->lkm", changes, weight, weight, changes, optimize=True)
    return tuning.PRIOR_WEIGHT * bent


# ---------------------------------------------------------------- the best-fitting arm
@dataclass(frozen=True)
class PhysicalParameters:
    """A physically possible value for each of the c parameters of a model.

    Attributes:
        names: parameter names, (c,).
        x: their values, (c,), in their units.
        objective: misfit plus divergence from the prior.
        covariance: posterior covariance of the values (Laplace's approximation), (c, c).
        information: of the rows about the values, (c, c).
        prior: curvature of what the prior says there, (c, c).
        inflation: how many rows are worth one independent row.
    """

    names: tuple[str, ...]
    x: Floats
    objective: float
    covariance: Floats
    information: Floats
    prior: Floats
    inflation: float = 1.0

    @property
    def std_error(self) -> Floats:
        """Posterior standard deviation, data and prior together, (c,)."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))

    @property
    def data_share(self) -> Floats:
        """How much of each value comes from the data, 0 (prior) to 1, (c,)."""
        after, before = np.diagonal(self.covariance), np.diagonal(inverse(self.prior))
        return 1.0 - np.clip(after / np.where(before > 0.0, before, np.inf), 0.0, 1.0)

    @property
    def origin(self) -> dict[str, str]:
        """Where each value comes from by parameter name: ``"data"`` or ``"prior"``."""
        words = (
            "data" if share >= tuning.FROM_DATA_SHARE else "prior" for share in self.data_share
        )
        return dict(zip(self.names, words, strict=True))


# ---------------------------------------------------------------- of a robot
def constraints_of(base: BaseModel) -> PhysicalConstraints:
    """Return the robot's prior and what is known about it, for all parameters of the model."""
    constraints = make_constraints(
        base.model.parameters,
        prior_vector(base.model),
        base.robot.known,
        drive_ratings(base.robot),
    )
    if not len(constraints.bodies):
        return constraints
    # Why: bodies that somebody gave are meant; cylinders that nobody gave are as short as a DH offset may be.
    if not (base.robot.prior and base.robot.prior.links):
        return rounded(constraints)
    radius, prior = cylinders_of(base.robot).radius, constraints.prior.copy()
    light = tuning.BALL_SHARE * float(np.mean(prior[constraints.bodies[:, 0]]))
    cylinders = [cylinder_body(ends, radius, 1.0) for ends in link_cylinders(base.robot)]
    for columns in constraints.bodies:
        cylinder = cylinders[constraints.parameters[columns[0]].number - 1]
        prior[columns] = widened(prior[columns], cylinder, light)
    return replace(constraints, prior=prior)


def drive_ratings(robot: Robot) -> dict[str, float]:
    """Return what friction and rotors of the joints are in proportion to; empty behind joint sensors.

    Coulomb friction and rotor inertia go with the rated torque, viscous friction with rated torque over speed. When
    all rotors were taken as equal, one of 0.35 kg m^2 came out near 0.04, the mean of its arm's six.
    """
    torque, velocity = (robot.limits(quantity, np.nan) for quantity in ("torque", "velocity"))
    if robot.torque.source != "motor_torque" or np.isnan(torque + velocity).any():
        return {}
    rated = {"fc": torque, "fv": torque / velocity, "Im": torque}
    return {f"{kind}{k + 1}": x[k] for kind, x in rated.items() for k in range(robot.n)}


# ---------------------------------------------------------------- fits
def fit_physical(R: Floats, r: Floats, constraints: PhysicalConstraints) -> tuple[Floats, float]:
    """Fit physical parameters with the entropic divergence from the prior as penalty.

    Args:
        R: whitened regressor or its triangular factor, (rows, c) [1 / unit of each parameter]; 1/2 chi-square must be
            right, so whiten with a HAC covariance where residuals are coloured.
        r: whitened torques, (rows,), pure numbers.
        constraints: bounds and prior.

    Returns:
        The unique minimiser, (c,), and the objective there.
    """
    objective = objective_of(R, r, constraints)
    x = minimise(objective, feasible_start(constraints))
    return x, objective.value(x)


def fit_pooled(
    R: Floats,
    r: Floats,
    constraints: PhysicalConstraints,
    near: Floats | None = None,
    *,
    sized: bool = False,
) -> tuple[PhysicalParameters, PhysicalConstraints]:
    """Fit like ``fit_physical``, and let joints lend each other the size of their friction and rotor inertia.

    Nobody knows these in advance, and in a short or slow log one joint's may vanish or explode. The penalty that draws
    each kind to a common size s of all joints (for their ratings), minimised over s as well, is
    gamma * n * log(arithmetic / geometric mean): no unit and no size is preferred, only equality. Offsets are normally
    distributed with the common size of the Coulomb friction, from which a joint that moves one way only cannot tell
    them. Good data override it. Bodies may be far from the prior's, see ``curvature``. And where it is asked for, the
    data say how heavy the prior's bodies are, all of them by one factor: default cylinders are a shape; nobody says
    that the arm is made of their stuff. The likeliest factor came out about 1 on arms of 15 kg and 30 to 800 on a heavy
    one, whose forces cylinders of a light arm would draw towards nothing.
    Source: empirical Bayes; solved by majorisation.

    Args:
        R: whitened regressor or its triangular factor, (rows, c) [1 / unit of each parameter].
        r: whitened torques, (rows,), pure numbers.
        constraints: bounds and prior.
        near: possible parameters of a similar fit, (c,), where the search begins.
        sized: whether the prior's bodies get the size that the data say.

    Returns:
        The fit, and the constraints with the sizes found as prior.
    """
    x = feasible_start(constraints) if near is None else near
    constraints = with_pooled_prior(constraints, x)
    bound = followed(constraints, x)
    for _ in range(tuning.POOLING_ROUNDS):
        x = minimise(objective_of(R, r, bound), x, tuning.POOLING_TOLERANCE)
        before, constraints = bound, with_pooled_prior(constraints, x)
        bound = followed(constraints, x)
        if not _settled(before, bound):
            continue
        size = likeliest_size(bound, x) if sized else 1.0
        if abs(np.log(size)) < tuning.SIZE_SETTLED:
            break
        constraints = with_bodies(constraints, size * constraints.prior_pseudo_inertia)
        bound = followed(constraints, x)
    objective = objective_of(R, r, bound)
    x = minimise(objective, x)
    return _fit(objective, x, R, constraints), constraints


def _settled(before: PhysicalConstraints, after: PhysicalConstraints) -> bool:
    """Return whether neither sizes nor bodies of the prior moved."""
    others = np.delete(np.arange(len(after.prior)), after.bodies)
    moved = np.linalg.inv(before.prior_pseudo_inertia) @ after.prior_pseudo_inertia - np.eye(4)
    return bool(
        np.allclose(after.prior[others], before.prior[others], rtol=tuning.POOLING_SETTLED)
        and np.einsum("lab,lba->l", moved, moved).max(initial=0.0) < tuning.POOLING_SETTLED**2
    )


def with_pooled_prior(constraints: PhysicalConstraints, x: Floats) -> PhysicalConstraints:
    """Return the constraints with the size of each kind in x, for its rating, as prior where there was none.

    The size is the mean, or with offsets what makes them and the Coulomb friction most likely together.

    Args:
        constraints: bounds and prior.
        x: parameters, (c,), each in its unit.

    Returns:
        Constraints in which friction and rotor inertia have a prior; pooled ones are updated by pooling again.
    """
    prior, spread = constraints.prior.copy(), constraints.spread.copy()
    share = x / constraints.ratings
    for kind, columns in zip(NONNEGATIVE, constraints.pools, strict=True):
        if len(columns) < 2:
            continue
        offsets = columns_of(constraints.parameters, "fo" if kind == "fc" else "")
        total, squares = float(np.sum(share[columns])), float(np.sum(share[offsets] ** 2))
        count = len(columns) + len(offsets)
        size = (total + np.sqrt(total**2 + 4 * count * squares)) / (2 * count)
        usual = size * constraints.ratings
        prior[columns], spread[offsets] = usual[columns], usual[offsets]
    return replace(constraints, prior=prior, spread=spread)


def require_possible_prior(constraints: PhysicalConstraints) -> None:
    """Raise unless every link's body of the prior can exist.

    Raises:
        NotPhysical: names the link that is furthest from it.
    """
    eigenvalues = smallest_eigenvalues(constraints.prior[constraints.bodies])
    if np.any(eigenvalues <= 0.0):
        worst = constraints.parameters[constraints.bodies[int(np.argmin(eigenvalues)), 0]].number
        raise NotPhysical(
            f"the prior of link {worst} is not a physically consistent body",
            fix="in the robot file each principal moment of inertia_com is at most the sum of the other two",
        )


def feasible_start(constraints: PhysicalConstraints) -> Floats:
    """Return a parameter vector strictly inside all bounds, near the prior, (c,), each in its unit.

    Args:
        constraints: bounds and prior.

    Returns:
        Where the solvers start.

    Raises:
        NotPhysical: the prior's bodies or the bounds contradict each other.
    """
    require_possible_prior(constraints)
    x, positive = constraints.prior.copy(), constraints.positive
    x[positive[x[positive] <= 0.0]] = 1.0
    return x if np.all(constraints.slack(x) > 0.0) else _move_inside(constraints, x)


def _move_inside(constraints: PhysicalConstraints, x: Floats) -> Floats:
    """Shift all bounds outwards until x is inside, then bring the shift below zero."""
    c, k = len(x), len(constraints.h)
    size = np.abs(constraints.G) @ np.abs(x) + np.abs(constraints.h) + 1e-9
    G = np.vstack([np.hstack([constraints.G, size[:, None]]), np.append(np.zeros(c), 1.0)])
    h = np.append(constraints.h, -1.0)
    y = np.append(x, 1.0 + max(0.0, float((-constraints.slack(x) / size).max())))
    # Why a weak penalty on the distance from x: without data nothing else keeps friction and rotor inertia small.
    R, weights = np.eye(c, c + 1) / (1.0 + np.abs(x))[:, None], np.ones(k + 1)
    base = objective_of(R, R @ y, constraints, 1.0)
    for weight in (1e2, 1e4, 1e6, 1e8):
        y = minimise(replace(base, linear=np.append(base.linear, weight), G=G, h=h, mu=weights), y)
        if np.all(constraints.slack(y[:-1]) > 0.0):
            return y[:-1]
    raise NotPhysical(
        "the known facts about the arm contradict each other: no masses and centres of mass keep all of them",
        fix="widen or drop a bound of the total mass, of a link's mass or of a centre of mass",
    )


def objective_of(
    R: Floats, r: Floats, constraints: PhysicalConstraints, gamma: float = tuning.PRIOR_WEIGHT
) -> Objective:
    """Return the squares, with rows that hold parameters near zero, and the entropic divergence from the prior."""
    c = len(constraints.prior)
    R = np.vstack(
        [R, np.eye(c, R.shape[1]) * tuning.PRIOR_WEIGHT**0.5 / constraints.spread[:, None]]
    )
    G, h, linear = constraints.G, constraints.h, np.zeros(c)
    inverse = np.linalg.inv(constraints.prior_pseudo_inertia)
    linear[constraints.bodies] = gamma * np.einsum("lab,kba->lk", inverse, basis())
    # A positive number with a prior gets the one-dimensional form of the same divergence: -log x + x / x0.
    positive, mu = constraints.positive, np.full(len(h), tuning.BOUND_WEIGHT)
    size = constraints.prior[positive]
    linear[positive] = np.divide(gamma, size, out=np.zeros_like(size), where=size > 0.0)
    mu[: len(size)] = np.where(size > 0.0, gamma, tuning.BOUND_WEIGHT)
    r = np.append(r, np.zeros(c))
    return Objective(R, r, constraints.bodies, gamma, linear, G, h, mu)


def _fit(
    objective: Objective, x: Floats, R: Floats, constraints: PhysicalConstraints
) -> PhysicalParameters:
    """Return the parameters at a minimum with their error bars; bodies may be far from the prior's.

    Args:
        objective: what they minimise.
        x: the parameters, (c,).
        R: whitened regressor, (rows, c).
        constraints: the set.
    """
    data, prior = R.T @ R, objective.curvature(*objective.relative(x))
    bodies = constraints.bodies
    prior[bodies[:, :, None], bodies[:, None]] = curvature(constraints, x)
    prior = tuning.PRIOR_COUNTED * (prior + objective.R.T @ objective.R - data)
    return PhysicalParameters(
        names=tuple(parameter.name for parameter in constraints.parameters),
        x=x,
        objective=objective.value(x),
        covariance=inverse(data + prior),
        information=data,
        prior=prior,
    )


def with_honest_errors(
    fit: PhysicalParameters, constraints: PhysicalConstraints, less: float, changes: Floats
) -> PhysicalParameters:
    """Return a fit whose error bars hold what its curvature does not know.

    Rows tell less than they seem to. Common sizes, of bodies and of each kind of friction, are only estimated: the
    prior draws them to one size, and a fit at the likeliest size knows how large they are together from nobody else. So
    the prior's curvature along their common size goes (Schur complement of the size). And other recordings differ.

    Args:
        fit: with error bars at the sizes that were found, as if rows told all.
        constraints: with the columns that share a size.
        less: over how many independent rows one is spread, on top of what the fit counts.
        changes: A with A A^T the covariance that other recordings add, (c, k).
    """
    open_ = fit.prior.copy()
    for columns in (constraints.bodies.ravel(), *constraints.pools):
        along = fit.prior[np.ix_(columns, columns)] @ fit.x[columns]
        curved = float(along @ fit.x[columns])
        if len(columns) > 1 and curved > 0.0:
            open_[np.ix_(columns, columns)] -= np.outer(along, along) / curved
    covariance = inverse(open_ + fit.information / less) + changes @ changes.T
    return replace(fit, covariance=covariance, inflation=fit.inflation * less)


def inverse(H: Floats) -> Floats:
    """Return H^-1, (c, c); 0 for parameters that H does not see at all."""
    scaled, unit = of_unit_diagonal(H)
    # Why a pseudo-inverse: noise-free rows next to a wide prior make the matrix singular in double precision.
    return np.asarray(unit[:, None] * np.linalg.pinv(scaled, hermitian=True) * unit)


# ---------------------------------------------------------------- before anything is measured
def exciting_states(robot: Robot, least: Floats | float = 0.0) -> tuple[Floats, Floats, Floats]:
    """Return positions, velocities and accelerations of an exciting motion inside the limits, (N, n) each.

    Args:
        robot: the arm.
        least: rms speed that each joint has at least, (n,) [rad/s or m/s].
    """
    limits = robot.limits("velocity", np.where(robot.turning, *tuning.FREE_SPEED))
    speed, rng = np.maximum(tuning.EXCITING_SPEED * limits, least), np.random.default_rng(0)
    low, high = robot.travel(*tuning.FREE_TRAVEL)
    q = rng.uniform(low, high, (tuning.RANDOM_STATES, robot.n))
    qd = rng.uniform(-2.0, 2.0, q.shape) * speed
    return q, qd, rng.uniform(-4.0, 4.0, q.shape) * speed


def prior_covariance(base: BaseModel) -> Floats:
    """Return the covariance of the base parameters before anything is measured, (p, p), in products of their units.

    Bodies are possible and resemble the prior's; nothing else of a joint (friction, rotor) needs more torque on an
    exciting motion than its bodies do.

    Args:
        base: model and base parameters.

    Raises:
        NotPhysical: a body of the prior cannot exist.
    """
    constraints, K = constraints_of(base), base.reduction.K
    require_possible_prior(constraints)
    states, bodies = exciting_states(base.robot), constraints.bodies
    theta = base.prior(unknown=0.0)
    torque = np.sqrt(np.mean((base.observer.dense(*states) @ theta) ** 2, axis=0))
    torque = np.maximum(torque, max(tuning.LEAST_TORQUE * float(torque.max()), 1e-6))
    covariance = np.zeros((K.shape[1], K.shape[1]))
    others = np.delete(np.arange(K.shape[1]), bodies)
    columns = base.model.observer(others).dense(*states)
    size = np.sqrt(np.mean(columns**2, axis=0)) / torque[:, None]
    covariance[others, others] = 1.0 / np.maximum(size.max(axis=0, initial=0.0), 1e-9) ** 2
    price = tuning.PRIOR_COUNTED * curvature(constraints, constraints.prior)
    covariance[bodies[:, :, None], bodies[:, None]] = np.linalg.inv(price)
    return K @ covariance @ K.T
