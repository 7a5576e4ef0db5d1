"""One distribution of the parameters: the set in force, its covariance, and how far its torques will be off.

From an estimate and the prior: the physically possible set, as heavy as the data say; then the model error, where the
evidence wants it, and the set again with it. Source: Lee, Wensing, Park 2020 for the prior; Laplace's approximation
for the covariance; docs/explanation/estimators.md for what was tried.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.error_columns import shapes_of
from dynid.estimation.least_squares import Fit, relative_error, symmetric_root
from dynid.estimation.model_error import (
    GROUP_NAMES,
    ModelError,
    Whitened,
    best_size,
    evidence_gain,
    exciting_speed,
    model_error,
    orthogonal,
    random_states,
    whitened_rows,
)
from dynid.estimation.physical_constraints import PhysicalConstraints
from dynid.estimation.physical_parameters import PhysicalParameters, constraints_of, fit_sized
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel
from dynid.model.regressor import Observer

Floats = NDArray[np.float64]

#: Estimators that give spikes little weight.
ROBUST = ("irls", "iv", "idim-iv")
#: Errors of noise-free torques, which are rounding [%].
NOISE_FREE = 1e-6
#: Sizes of the groups without any model error.
NONE = np.full(len(GROUP_NAMES), tuning.RESIDUAL_NOTHING)


@dataclass(frozen=True)
class Posterior:
    """The physically possible set with everything that is known about it.

    Attributes:
        physical: the set, all parameters of the model.
        theta: its base parameters, (p,).
        covariance: theirs, (p, p).
        alone: base parameters of the set that fits best without any model error, (p,).
        error: the model error, None where the evidence wants none or it was not asked for.
    """

    physical: PhysicalParameters
    theta: Floats
    covariance: Floats
    alone: Floats
    error: ModelError | None


def physical_posterior(
    base: BaseModel,
    estimate: Fit,
    stack: Stack,
    *,
    residual_model: bool | None,
    like: ModelError | None = None,
    size: Floats | None = None,
) -> Posterior:
    """Find the physically possible parameters that data and prior agree on best, and the model error beside them.

    Args:
        base: model and base parameters.
        estimate: base parameters from the data.
        stack: the rows that it was made from.
        residual_model: look for model error or not; None where the evidence wants it.
        like: model error whose sizes and free joints are taken.
        size: sizes of the groups of columns where they are known already.

    Raises:
        NotPhysical: the prior of the robot file is itself not physical.
    """
    K = base.reduction.K
    worth = _inflation(estimate, stack)
    A = estimate.whitened[:-1, :-1] / np.sqrt(worth)
    R = A @ K
    fit, constraints = fit_sized(R, A @ estimate.theta, constraints_of(base))
    alone = K @ fit.x
    found = _posterior(K, fit, alone, worth)
    if residual_model is False or stack.earlier is not None or not stack.logs:
        return found
    robust = estimate.theta if estimate.method in ROBUST else None
    rows = whitened_rows(stack, base, alone, estimate.noise, worth, robust).centred(estimate.theta)
    large = 0.0
    if like is not None:
        for joint in like.free:
            rows = rows.freed(joint)
    elif contradicts(*(relative_error(stack.whole[0], theta) for theta in (alone, estimate.theta))):
        rows, large = _with_large_torques(base, rows, estimate.theta, fit)
    if np.any(rows.free):
        # Why from the prior's own sizes: impossible links made bodies heavier, which the torques no longer ask for.
        left, _ = rows.eliminated(NONE)
        fit, constraints = _fitted(left, K, constraints_of(base), fit)
        R = left[:-1, :-1] @ K
    held, size = fit.hessian - R.T @ R, size if like is None else like.size
    size = best_size(rows, K, fit.x, held) if size is None else size
    gain = evidence_gain(rows, K, fit.x, held, size)
    if residual_model is None and gain < tuning.RESIDUAL_EVIDENCE:
        if not np.any(rows.free):
            return found
        size = NONE
    left, heads = rows.eliminated(size)
    fit, _ = _fitted(left, K, constraints, fit)
    found = _posterior(K, fit, alone, worth)
    return replace(found, error=model_error(rows, size, gain + large, heads, found.theta, stack.whole[1]))


def contradicts(misfit: float, best: float) -> bool:
    """Return whether a torque error is so much larger than that of the plain estimate that something is missing [%]."""
    return misfit > tuning.CONTRADICTION * best and misfit - best > NOISE_FREE


def _with_large_torques(
    base: BaseModel, rows: Whitened, plain: Floats, fit: PhysicalParameters
) -> tuple[Whitened, float]:
    """Let joints have a large torque of their position, one after the other, until a possible arm explains the rest.

    Args:
        base: model and base parameters.
        rows: rows of all joints.
        plain: base parameters that come as near to the torques as any, (p,).
        fit: the physical set that contradicts them.

    Returns:
        The rows with free columns, and the gain of the log evidence by them.
    """
    K, constraints, total = base.reduction.K, constraints_of(base), 0.0
    left, heads = rows.eliminated(NONE)
    cost = fit.objective + 0.5 * left[-1, -1] ** 2 + rows.log_volume(NONE, heads)
    best = np.linalg.norm(rows.factors[:, :, rows.k :] @ np.append(plain, -1.0), axis=1)
    for _ in range(tuning.LARGE_TORQUE_JOINTS):
        growth = rows.misfit(heads, K @ fit.x) / np.maximum(best, 1e-12)
        suspects = [
            j
            for j in np.argsort(-growth)[: tuning.LARGE_TORQUE_TRIED]
            if growth[j] > tuning.CONTRADICTION and not rows.free[j].any()
        ]
        tried = []
        for joint in suspects:
            other = rows.freed(joint)
            left, after = other.eliminated(NONE)
            again, _ = _fitted(left, K, constraints, fit)
            price = again.objective + 0.5 * left[-1, -1] ** 2 + other.log_volume(NONE, after)
            tried.append((price, joint, other, after, again))
        if not tried:
            break
        price, _, other, after, again = min(tried, key=lambda each: each[:2])
        if cost - price < tuning.LARGE_TORQUE_EVIDENCE:
            break
        rows, heads, fit, cost, total = other, after, again, price, total + cost - price
    return rows, total


def _inflation(estimate: Fit, stack: Stack) -> float:
    """Return how many rows are worth one independent row, with what a short log cannot show about it."""
    filtered = any(log.filter.cutoff > 0.0 for log in stack.logs)
    return max(estimate.inflation, tuning.COLOURED_ROWS) if filtered else estimate.inflation


def _fitted(
    left: Floats, K: Floats, constraints: PhysicalConstraints, near: PhysicalParameters
) -> tuple[PhysicalParameters, PhysicalConstraints]:
    """Return the physical set that rows [W tau] without model error ask for, (m, p + 1), beginning near another one."""
    return fit_sized(left[:-1, :-1] @ K, left[:-1, -1], constraints, near=near.x)


def _posterior(K: Floats, fit: PhysicalParameters, alone: Floats, worth: float) -> Posterior:
    fit = replace(fit, inflation=worth)
    return Posterior(fit, K @ fit.x, K @ fit.covariance @ K.T, alone, None)


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
        return cls(float(facts["fitted_motion_percent"]), float(facts["exciting_motion_percent"]), noise)


def expected_error(
    base: BaseModel, stack: Stack, theta: Floats, covariance: Floats, error: ModelError | None, rms: Floats
) -> ExpectedError:
    """Return how far the torques of a set will be off, on the fitted motion and on an exciting one.

    Args:
        base: model and base parameters.
        stack: the fitted rows.
        theta: base parameters, (p,).
        covariance: theirs, (p, p).
        error: the model error, None without.
        rms: residual of each joint on the fitted rows, (n,) [N m or N].
    """
    factors, counts = stack.whole
    root = symmetric_root(covariance)
    count = np.maximum(counts, 1)
    spread = np.sum((factors[:, :, :-1] @ root) ** 2, axis=(1, 2)) / count
    size = np.sum(factors[:, :, -1] ** 2, axis=1) / count
    # Why: a fit takes from the residuals what it cannot take from those of another recording.
    noise = np.sqrt(rms**2 + spread) * (1.0 if error is None else tuning.UNSEEN_RESIDUAL)
    observer = stack.observer
    q, qd, qdd = exciting_states(base)
    W = observer.dense(q, qd, qdd)
    tau = W @ theta
    if error is None:
        variance = np.stack([np.sum((W[:, j] @ root) ** 2, axis=1) for j in range(W.shape[1])], axis=1)
    else:
        sign = observer.coulomb_sign(qd)
        Z = orthogonal(shapes_of(q, qd, sign, error.speed), W, error.reference, error.scale, error.projection)
        variance = error.variance(W, Z, covariance)
        tau = tau + np.einsum("mjk,jk->mj", Z, error.mean)
    return ExpectedError(
        _percent(np.sum(noise**2 + spread), np.sum(size)),
        _percent(np.sum(np.mean(variance, axis=0) + noise**2), np.sum(np.mean(tau**2, axis=0))),
        noise,
    )


def uncertainty(base: BaseModel, observer: Observer, covariance: Floats, reference: Floats) -> float:
    """Return the torque error on an exciting motion that uncertain parameters cost [%], whatever the base columns are.

    Args:
        base: model and base parameters.
        observer: evaluator of the base columns.
        covariance: of the parameters, (p, p).
        reference: possible parameters, whose torques on that motion are 100 %, (p,).
    """
    W = observer.dense(*exciting_states(base, tuning.FEW_STATES))
    return _percent(np.sum((W @ symmetric_root(covariance)) ** 2), np.sum((W @ reference) ** 2))


def exciting_states(base: BaseModel, count: int = tuning.RANDOM_STATES) -> tuple[Floats, Floats, Floats]:
    """Return positions, velocities and accelerations of an exciting motion inside the limits, (count, n) each."""
    speed = exciting_speed(base.robot)
    q, qd, _ = random_states(base.robot, speed, count, seed=1)
    return q, qd, np.random.default_rng(2).normal(size=q.shape) * 2 * np.pi * tuning.EXCITING_FREQUENCY * speed


def _percent(error: float, torque: float) -> float:
    return float(100.0 * np.sqrt(error / torque)) if torque > 0.0 else 0.0
