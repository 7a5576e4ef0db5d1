"""One distribution of the parameters: those that predictions use, their covariance, how far torques will be off.

From an estimate and the prior: the physically possible set, as heavy as the data say; then the model error, where the
evidence wants it, and the set again with it. ``parameter_posterior`` gives the same of a result, new or from its file,
as one value that loads and planned motions ask. Source: Lee, Wensing, Park 2020 for the prior; Laplace's approximation
for the covariance; docs/explanation/estimators.md for what was tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.least_squares import (
    Fit,
    merge,
    relative_error,
    solve,
    symmetric_root,
    weighted,
)
from dynid.estimation.possible_arm import (
    PhysicalParameters,
    constraints_of,
    curvature,
    fit_sized,
    require_possible_prior,
    with_changes,
    with_open_sizes,
    with_wider_errors,
)
from dynid.estimation.possible_set import PhysicalConstraints
from dynid.estimation.recordings import changes, disagreement, parts_of
from dynid.estimation.residual_model import (
    GROUP_NAMES,
    ModelError,
    Whitened,
    best_size,
    evidence_gain,
    exciting_speed,
    joints_apart,
    model_error,
    random_states,
    torque_variance,
    whitened_rows,
)
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel, prior_base_parameters
from dynid.robot import Known

if TYPE_CHECKING:
    from dynid.estimation.result import Identification

Floats = NDArray[np.float64]


#: Estimators that give spikes little weight.
ROBUST = ("irls", "iv")
#: Errors of noise-free torques, which are rounding [%].
NOISE_FREE = 1e-6
#: Sizes of the groups without any model error.
NONE = np.full(len(GROUP_NAMES), tuning.RESIDUAL_NOTHING)


#: Makes an estimate of a stack, as that of all rows was made.
Refit: TypeAlias = Callable[[Stack], Fit]


@dataclass(frozen=True)
class Posterior:
    """The physically possible set with everything that is known about it.

    Attributes:
        physical: the set, all parameters of the model.
        theta: its base parameters, (p,).
        covariance: theirs, (p, p).
        alone: base parameters of the set that fits best without any model error, (p,).
        error: the model error, None where the evidence wants none or it was not asked for.
        told: what the rows say of the base parameters: information, (p, p).
        noise: sigma of each joint that they were divided by, (n,) [N m or N].
        changes: A with A A^T what the covariance holds because other recordings differ from these, (p, k).
    """

    physical: PhysicalParameters
    theta: Floats
    covariance: Floats
    alone: Floats
    error: ModelError | None
    told: Floats
    noise: Floats
    changes: Floats


def physical_posterior(
    base: BaseModel,
    estimate: Fit,
    stack: Stack,
    *,
    refit: Refit,
    residual_model: bool | None,
    like: ModelError | None = None,
    size: Floats | None = None,
) -> Posterior:
    """Find the physically possible parameters that data and prior agree on best, and the model error beside them.

    Args:
        base: model and base parameters.
        estimate: base parameters from the data.
        stack: the rows that it was made from.
        refit: makes such an estimate of the rows of some joints, where the others contradict these.
        residual_model: look for model error or not; None where the evidence wants it.
        like: model error whose sizes and free joints are taken; nothing is asked about the errors then.
        size: sizes of the groups of columns where they are known already.

    Raises:
        NotPhysical: the prior of the robot file is itself not physical.
    """
    found, estimate = _as_rows_say(
        base, estimate, stack, refit, residual_model=residual_model, like=like, size=size
    )
    if like is not None or stack.earlier is not None or not stack.logs:
        return found
    K, fit = base.reduction.K, found.physical
    share = np.diagonal(found.covariance) / np.maximum(np.diagonal(prior_covariance(base)), 1e-300)
    robust = estimate.theta if estimate.method in ROBUST else None
    parts = parts_of(stack, found.theta, found.error, found.noise, fit.inflation, robust)
    less = disagreement(parts, found.covariance, found.error, share < tuning.TOLD_SHARE)
    told = K.T @ found.told @ K
    fit = with_wider_errors(with_open_sizes(fit, told, constraints_of(base)), told, less)
    changed = changes(parts, base, found.theta)
    fit = with_changes(fit, np.linalg.pinv(K) @ changed)
    return replace(found, physical=fit, covariance=K @ fit.covariance @ K.T, changes=changed)


def _as_rows_say(
    base: BaseModel,
    estimate: Fit,
    stack: Stack,
    refit: Refit,
    *,
    residual_model: bool | None,
    like: ModelError | None,
    size: Floats | None,
) -> tuple[Posterior, Fit]:
    """Return what ``physical_posterior`` does, with errors as if the rows told all, and the estimate it is made of."""
    K = base.reduction.K
    worth = estimate.inflation
    A = estimate.whitened[:-1, :-1] / np.sqrt(worth)
    fit, constraints = fit_sized(A @ K, A @ estimate.theta, constraints_of(base))
    alone = K @ fit.x
    found = _posterior(K, fit, alone, worth, A.T @ A, estimate.noise)
    if residual_model is False or stack.earlier is not None or not stack.logs:
        return found, estimate
    rows = _rows_of(base, stack, estimate, alone, np.zeros(base.robot.n))
    arm, large = Arm(fit, constraints, fit.hessian - K.T @ (A.T @ A) @ K), 0.0
    if like is not None:
        for joint in like.free:
            rows = rows.freed(joint)
    elif contradicts(*(relative_error(stack.whole[0], theta) for theta in (alone, estimate.theta))):
        rows, large = _with_large_torques(base, rows, arm)
    if np.any(rows.free):
        arm = _arm_of(base, rows, NONE, arm)
    rows, size, arm, estimate = _with_joints_apart(
        base, stack, rows, arm, size, like, estimate, refit
    )
    if np.any(rows.apart):
        left, _ = rows.eliminated(NONE)
        without, _ = _fitted(left, K, arm.constraints, arm.fit)
        alone = K @ without.x
        found = _posterior(
            K, without, alone, rows.inflation, left[:-1, :-1].T @ left[:-1, :-1], rows.noise
        )
    gain = evidence_gain(rows, K, arm.fit.x, arm.held, size)
    if residual_model is None and gain < tuning.RESIDUAL_EVIDENCE:
        if not (np.any(rows.apart) or np.any(rows.free)):
            return found, estimate
        size = NONE
    left, heads = rows.eliminated(size)
    fit, _ = _fitted(left, K, arm.constraints, arm.fit)
    found = _posterior(K, fit, alone, rows.inflation, left[:-1, :-1].T @ left[:-1, :-1], rows.noise)
    error = model_error(rows, size, gain + large, heads, found.theta, stack.whole[1])
    return replace(found, error=error), estimate


def _rows_of(
    base: BaseModel, stack: Stack, estimate: Fit, reference: Floats, apart: Floats
) -> Whitened:
    """Return the rows of all joints, of which an estimate is the one of the joints that are not apart.

    Args:
        base: model and base parameters.
        stack: the stacked logs.
        estimate: of the joints that are not apart.
        reference: base parameters that give the torque of the load, (p,).
        apart: lambda of each joint, (n,).
    """
    robust = estimate.theta if estimate.method in ROBUST else None
    worth, spread = estimate.inflation, prior_covariance(base)
    rows = whitened_rows(stack, base, reference, estimate.noise, worth, spread, robust)
    return replace(rows, apart=apart).centred(estimate.theta)


@dataclass(frozen=True)
class Arm:
    """A possible arm that some rows ask for.

    Attributes:
        fit: its parameters.
        constraints: with the sizes of bodies, friction and rotors as prior.
        held: Hessian of the prior there, (c, c).
    """

    fit: PhysicalParameters
    constraints: PhysicalConstraints
    held: Floats


def _arm_of(base: BaseModel, rows: Whitened, size: Floats, near: Arm) -> Arm:
    """Return the possible arm that rows ask for, for sizes of the groups, beginning near another one.

    From the prior's own sizes: what no arm can make has made the bodies of the other one heavier.
    """
    K = base.reduction.K
    left, _ = rows.eliminated(size)
    R = left[:-1, :-1] @ K
    fit, constraints = _fitted(left, K, constraints_of(base), near.fit)
    return Arm(fit, constraints, fit.hessian - R.T @ R)


def _with_joints_apart(
    base: BaseModel,
    stack: Stack,
    rows: Whitened,
    arm: Arm,
    given: Floats | None,
    like: ModelError | None,
    estimate: Fit,
    refit: Refit,
) -> tuple[Whitened, Floats, Arm, Fit]:
    """Find the sizes of the groups of columns, and the joints whose torques contradict those of the others.

    The columns come first: where friction or a cable is what a joint has beyond the model, it contradicts nobody.

    Args:
        base: model and base parameters.
        stack: the stacked logs.
        rows: rows of all joints.
        arm: the arm that they ask for.
        given: sizes that are known already.
        like: model error whose sizes and joints apart are taken.
        estimate: of all joints.
        refit: makes such an estimate of some joints.

    Returns:
        The rows, the sizes, the arm that the other joints ask for, and their estimate.
    """
    K, given = base.reduction.K, given if like is None else like.size
    # Why without what somebody knows about the arm: torques that contradict that do not contradict each other.
    robot = replace(base.robot, known=Known())
    free = replace(base, model=replace(base.model, robot=robot))
    there, noise = arm if robot == base.robot else _arm_of(free, rows, NONE, arm), rows.noise

    def sized(rows: Whitened, arm: Arm) -> Floats:
        return best_size(rows, K, arm.fit.x, arm.held) if given is None else given

    for _ in range(tuning.APART_ROUNDS):
        size = sized(rows, there)
        apart = (
            joints_apart(rows, K, there.fit.x, there.held, size)[0] if like is None else like.apart
        )
        if np.array_equal(apart, rows.apart):
            break
        rows = rows.set_apart(apart, noise * _share_of_noise(stack, apart))
        there = _arm_of(free, rows, size, there)
    if np.any(rows.apart):
        rows, estimate, there = _without_those_apart(free, stack, rows, refit)
        size = sized(rows, there)
        apart, _ = joints_apart(rows, K, there.fit.x, there.held, size, known=True)
        rows = replace(rows, apart=apart)
        there = _arm_of(free, rows, size, there)
        size = sized(rows, there)
    if robot == base.robot:
        return rows, size, there, estimate
    arm = _arm_of(base, rows, size, arm) if np.any(rows.apart) else arm
    return rows, sized(rows, arm), arm, estimate


def _without_those_apart(
    base: BaseModel, stack: Stack, rows: Whitened, refit: Refit
) -> tuple[Whitened, Fit, Arm]:
    """Return rows that were made anew from an estimate of the joints that are not apart, this estimate and its arm.

    Beside joints that contradict them the others look noisy, coloured and full of spikes, and what is no spike of
    theirs gets the weight of one. The arm is not sought near the one of all joints: what these asked for together may
    have driven a kind of parameter to zero, from where no pooled size leads back.
    """
    apart = rows.apart > 0.0
    estimate = refit(stack.without(np.flatnonzero(apart)))
    estimate = replace(estimate, noise=np.where(apart, rows.noise, estimate.noise))
    K, A = base.reduction.K, estimate.whitened[:-1, :-1] / np.sqrt(estimate.inflation)
    fit, constraints = fit_sized(A @ K, A @ estimate.theta, constraints_of(base))
    found = _rows_of(base, stack, estimate, K @ fit.x, rows.apart)
    for joint in np.flatnonzero(np.any(rows.free > 0.0, axis=1)):
        found = found.freed(int(joint))
    return found, estimate, Arm(fit, constraints, fit.hessian - K.T @ (A.T @ A) @ K)


def _share_of_noise(stack: Stack, apart: Floats) -> Floats:
    """Return what joints leave when those apart have no say, over what they leave in a fit of all, at most 1, (n,).

    Joints that contradict the others make these look noisy, so that they would get little weight.
    """
    factors, counts = stack.whole
    left, others = stack.first_fit.noise, apart == 0.0
    alone = left.copy()
    if np.any(others):
        alone[others] = weighted(factors[others], counts[others]).noise
    for j in np.flatnonzero(~others):
        own = np.count_nonzero(factors[j, :, :-1].any(axis=0))
        alone[j] = np.sqrt(solve(factors[j]).residual / max(1, counts[j] - own))
    return np.asarray(np.clip(alone / left, tuning.NOISE_SHARE_LEAST, 1.0))


def contradicts(misfit: float, best: float) -> bool:
    """Return whether a torque error is so much larger than that of the plain estimate that something is missing [%]."""
    return misfit > tuning.CONTRADICTION * best and misfit - best > NOISE_FREE


def _with_large_torques(base: BaseModel, rows: Whitened, arm: Arm) -> tuple[Whitened, float]:
    """Let joints have a large torque of their position, one after the other, while the evidence gains by it.

    Args:
        base: model and base parameters.
        rows: rows of all joints.
        arm: the arm that they ask for.

    Returns:
        The rows with free columns, and the gain of the log evidence by them.
    """
    K, constraints, given, gain, fit = base.reduction.K, constraints_of(base), rows, 0.0, arm.fit

    def cost(rows: Whitened) -> tuple[float, PhysicalParameters]:
        left, heads = rows.eliminated(NONE)
        found, _ = _fitted(left, K, constraints, fit)
        return found.objective + 0.5 * left[-1, -1] ** 2 + rows.log_volume(NONE, heads), found

    best, fit = cost(rows)
    for _ in range(tuning.LARGE_TORQUE_JOINTS):
        joints = np.flatnonzero(~rows.free.any(axis=1) & rows.factors.any(axis=(1, 2)))
        tried = [(*cost(other), other) for other in (rows.freed(int(j)) for j in joints)]
        least, found, other = min(tried, key=lambda each: each[0], default=(best, fit, rows))
        if best - least < tuning.LARGE_TORQUE_EVIDENCE:
            break
        rows, fit, best, gain = other, found, least, gain + best - least
    # Why: a scaled or partial torque asks for a torque of the position as well, but for more beside it.
    if gain and gain > joints_apart(given, K, arm.fit.x, arm.held, NONE)[1]:
        return rows, gain
    return given, 0.0


def _fitted(
    left: Floats, K: Floats, constraints: PhysicalConstraints, near: PhysicalParameters
) -> tuple[PhysicalParameters, PhysicalConstraints]:
    """Return the physical set that rows [W tau] without model error ask for, (m, p + 1), beginning near another one."""
    return fit_sized(left[:-1, :-1] @ K, left[:-1, -1], constraints, near=near.x)


def _posterior(
    K: Floats, fit: PhysicalParameters, alone: Floats, worth: float, told: Floats, noise: Floats
) -> Posterior:
    fit = replace(fit, inflation=worth)
    return Posterior(
        fit, K @ fit.x, K @ fit.covariance @ K.T, alone, None, told, noise, np.zeros((len(K), 0))
    )


# ---------------------------------------------------------------- what a set is worth
@dataclass(frozen=True)
class ExpectedError:
    """How far predicted torques will be off.

    Attributes:
        fitted_percent: expected relative error on another recording of the fitted motion [%].
        exciting_percent: the same on an exciting motion inside the arm's limits [%].
        noise: expected rms of what no parameter explains, per joint, (n,) [N m or N].
    """

    fitted_percent: float
    exciting_percent: float
    noise: Floats

    def facts(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {
            "fitted_motion_percent": self.fitted_percent,
            "exciting_motion_percent": self.exciting_percent,
            "noise_nm": self.noise.tolist(),
        }

    @classmethod
    def of(cls, facts: dict[str, Any] | None) -> ExpectedError | None:
        """Return what ``facts`` gave."""
        if facts is None:
            return None
        noise = np.array(facts["noise_nm"])
        return cls(
            float(facts["fitted_motion_percent"]), float(facts["exciting_motion_percent"]), noise
        )


def expected_error(
    base: BaseModel,
    stack: Stack,
    theta: Floats,
    covariance: Floats,
    error: ModelError | None,
    rms: Floats,
    changes: Floats | None = None,
) -> ExpectedError:
    """Return how far the torques of a set will be off, on the fitted motion and on an exciting one.

    Args:
        base: model and base parameters.
        stack: the fitted rows.
        theta: base parameters, (p,).
        covariance: theirs, (p, p).
        error: the model error, None without.
        rms: residual of each joint on the fitted rows, (n,) [N m or N].
        changes: A with A A^T what of the covariance is no doubt about these recordings, (p, k); None for nothing.
    """
    factors, counts = stack.whole
    root = symmetric_root(covariance)
    count = np.maximum(counts, 1)
    rows = factors[:, :, :-1]
    doubt = rows @ root if error is None else [error.spread(j, W, root) for j, W in enumerate(rows)]
    spread = np.array([np.sum(each**2) for each in doubt]) / count
    other = (
        np.zeros(len(spread))
        if changes is None
        else np.sum((rows @ changes) ** 2, axis=(1, 2)) / count
    )
    if error is not None:
        other = np.where(error.apart == 0.0, other, 0.0)
    size = np.sum(factors[:, :, -1] ** 2, axis=1) / count
    # Why: a fit takes from the residuals what it cannot take from those of another recording.
    noise = np.sqrt(rms**2 + np.maximum(spread - other, 0.0)) * (
        1.0 if error is None else tuning.UNSEEN_RESIDUAL
    )
    q, qd, qdd = exciting_states(base)
    W = base.observer.dense(q, qd, qdd)
    tau, shapes = W @ theta, None if error is None else error.shapes_at(q, qd, base.observer)
    variance = torque_variance(W, covariance, error, shapes)
    if error is not None and shapes is not None:
        tau = tau + error.torque(W, shapes)
    return ExpectedError(
        _percent(np.sum(noise**2 + spread), np.sum(size)),
        _percent(np.sum(np.mean(variance, axis=0) + noise**2), np.sum(np.mean(tau**2, axis=0))),
        noise,
    )


def uncertainty(base: BaseModel, covariance: Floats, reference: Floats) -> float:
    """Return the torque error on an exciting motion that uncertain parameters cost [%], whatever the base columns are.

    Args:
        base: model and base parameters.
        covariance: of the parameters, (p, p).
        reference: possible parameters, whose torques on that motion are 100 %, (p,).
    """
    W = base.observer.dense(*exciting_states(base, tuning.FEW_STATES))
    return _percent(np.sum((W @ symmetric_root(covariance)) ** 2), np.sum((W @ reference) ** 2))


def exciting_states(
    base: BaseModel, count: int = tuning.RANDOM_STATES
) -> tuple[Floats, Floats, Floats]:
    """Return positions, velocities and accelerations of an exciting motion inside the limits, (count, n) each."""
    speed = exciting_speed(base.robot)
    q, qd, _ = random_states(base.robot, speed, count, seed=1)
    fastest = 2 * np.pi * tuning.EXCITING_FREQUENCY * speed
    return q, qd, np.random.default_rng(2).normal(size=q.shape) * fastest


def _percent(error: float, torque: float) -> float:
    return float(100.0 * np.sqrt(error / torque)) if torque > 0.0 else 0.0


# ---------------------------------------------------------------- the posterior of a result
#: Variance, relative to the largest in columns of equal size, below which the inverse would be of rounding.
ROUNDING = 1e-13


@dataclass(frozen=True)
class ParameterPosterior:
    """What a result knows; p base parameters, n joints.

    Attributes:
        theta: mean of the base parameters, (p,).
        information: inverse of their covariance, zero along what nothing tells, (p, p).
        by_joint: information of each joint's rows, (n, p, p).
        error: the residual model for these parameters; None without.
        noise: of a row, whitened with which rows are worth one independent row each, (n,) [N m or N].
        rate: how many rows a second has [Hz]; 0 where that is not known.
    """

    theta: Floats
    information: Floats
    by_joint: Floats
    error: ModelError | None
    noise: Floats
    rate: float

    def sample_noise(self, rate: float) -> Floats:
        """Return the white noise of samples at a rate [Hz] that tell as much as the rows did, (n,) [N m or N]."""
        return self.noise * np.sqrt(rate / self.rate) if self.rate > 0.0 else self.noise

    def root(self) -> Floats:
        """Return R with R^T R the information, (p, p); parameters that it does not know have columns of zeros."""
        return symmetric_root(self.information).T


def parameter_posterior(found: Identification) -> ParameterPosterior:
    """Return what a result knows about its parameters.

    Args:
        found: a result; of the plain set nothing but its rows is known.
    """
    n, p = len(found.noise), len(found.theta)
    factors = found.factors if found.factors.size else np.zeros((n, p + 1, p + 1))
    A = merge(factors, 1.0 / found.noise)[:-1, :-1]
    if found.in_force == "physical" or not found.factors.size:
        worth, information = found.physical.inflation, _inverse(found.covariance)
    else:
        # Why not the inverse of the covariance: that is estimated from few independent samples, and where it happens
        # to be too small its inverse would trust the log most.
        worth = max(float(np.sum((A @ found.covariance) * A)) / max(1, found.rank), 1e-300)
        information = np.asarray(A.T @ A) / worth
    noise = found.noise * np.sqrt(worth)
    rows = factors[:, :, :-1] / noise[:, None, None]
    by_joint = rows.swapaxes(1, 2) @ rows
    return ParameterPosterior(
        found.theta, information, by_joint, found.model_error, noise, _rate(found)
    )


def _rate(found: Identification) -> float:
    """Return how many rows of a second were fitted [Hz]."""
    if found.stack is not None and found.stack.logs:
        return float(found.stack.logs[0].filter.kept_rate)
    return float(found.header.get("kept_rate_hz") or 0.0)


def _inverse(covariance: Floats) -> Floats:
    """Return the inverse of a covariance, (p, p); variances below rounding count as rounding."""
    scale = np.sqrt(np.maximum(np.diagonal(covariance), 1e-300))
    values, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(
        (axes / np.maximum(values, ROUNDING * values[-1])) @ axes.T / np.outer(scale, scale)
    )


def prior_information(base: BaseModel) -> Floats:
    """Return what is known of the base parameters before anything is measured, the inverse of their covariance, (p, p).

    Args:
        base: model and base parameters.

    Raises:
        NotPhysical: a body of the prior cannot exist.
    """
    return _inverse(prior_covariance(base))


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
    q, qd, qdd = exciting_states(base)
    W = base.observer.dense(q, qd, qdd)
    theta = prior_base_parameters(base.model, base.reduction, unknown=0.0)
    torque = np.sqrt(np.mean((W @ theta) ** 2, axis=0))
    torque = np.maximum(torque, max(tuning.LEAST_TORQUE * float(torque.max()), 1e-6))
    covariance = np.zeros((K.shape[1], K.shape[1]))
    others = np.delete(np.arange(K.shape[1]), constraints.bodies)
    columns = base.model.observer(others).dense(q, qd, qdd)
    size = np.sqrt(np.mean(columns**2, axis=0)) / torque[:, None]
    covariance[others, others] = 1.0 / np.maximum(size.max(axis=0, initial=0.0), 1e-9) ** 2
    bodies = constraints.bodies
    bent = np.linalg.inv(tuning.PRIOR_COUNTED * curvature(constraints, constraints.prior))
    covariance[bodies[:, :, None], bodies[:, None]] = bent
    return np.asarray(K @ covariance @ K.T)
