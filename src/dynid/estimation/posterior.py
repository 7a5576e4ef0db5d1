"""One distribution of the parameters: those that predictions use, their covariance, how far torques will be off.

From an estimate and the prior: the physically possible set, as heavy as the data say; then the model error, where the
evidence wants it, and the set again with it. ``information_of`` gives what a result, new or from its file, knows.
Source: Lee, Wensing, Park 2020 for the prior; Laplace's approximation for the covariance;
docs/explanation/estimators.md for what was tried.

A recording tells less than its rows seem to: its parts disagree, and other recordings will differ from it.
Residuals are coloured, and an estimate counts that as far as its covariance sees it: over a second or so. What the
model lacks lasts as long as the motion stays in one place, and what changes with time (warm gears, offsets of currents)
lasts longer. So the recording is cut into parts, and each part says by how much it would move the parameters; where
they move them further than independent rows would, rows are worth less. Source: Liang, Zeger 1986 (covariances from
clusters), averaged over the parameters, for a few parts alone tell little about each.

Offsets and the level of friction are known to differ from one recording to the next, which no part of one recording
shows. What wanders a little within the recording wanders further between two: the offset of each joint, as a share of
its Coulomb friction, and the level of its friction have a size that all joints share, and parts and recordings tell it
together. Source: random effects whose size has a half-t prior (Gelman 2006).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Floats, Mask
from dynid.estimation import tuning
from dynid.estimation.identified import ExpectedError, Identified
from dynid.estimation.least_squares import Fit, relative_error, symmetric_root
from dynid.estimation.possible_arm import (
    PhysicalParameters,
    constraints_of,
    exciting_states,
    inverse,
    prior_covariance,
    with_honest_errors,
)
from dynid.estimation.residual_model import (
    NONE,
    SIZE,
    JointRows,
    ModelError,
    arm_of,
    best_size,
    joints_apart,
    log_evidence,
    torque_variance,
)
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel
from dynid.robot import Known

#: Errors of noise-free torques, which are rounding [%].
NOISE_FREE = 1e-6


@dataclass(frozen=True)
class Posterior:
    """The physically possible set with everything that is known about it.

    Attributes:
        physical: the set, all parameters of the model.
        theta: its base parameters, (p,).
        covariance: theirs, (p, p).
        alone: base parameters of the set that fits best without any model error, (p,).
        error: the model error, None where the evidence wants none or it was not asked for.
        changes: A with A A^T what the covariance holds because other recordings differ from these, (p, k).
    """

    physical: PhysicalParameters
    theta: Floats
    covariance: Floats
    alone: Floats
    error: ModelError | None
    changes: Floats


def physical_posterior(
    estimate: Fit,
    stack: Stack,
    *,
    residual_model: bool | None,
    like: ModelError | None = None,
    size: Floats | None = None,
) -> Posterior:
    """Find the physically possible parameters that data and prior agree on best, and the model error beside them.

    Args:
        estimate: base parameters from the data.
        stack: the rows that it was made from.
        residual_model: look for model error or not; None where the evidence wants it.
        like: model error whose sizes and free joints are taken; nothing is asked about the errors then.
        size: sizes of the groups of columns where they are known already.

    Raises:
        NotPhysical: the prior of the robot file is itself not physical.
    """
    base, has_rows = stack.base, stack.earlier is None
    K, error, worth = base.reduction.K, None, estimate.inflation
    A = estimate.whitened[:-1, :-1] / np.sqrt(worth)
    arm = arm_of(base, np.column_stack([A, A @ estimate.theta]))
    alone = K @ arm.x
    if has_rows and residual_model is not False:
        size = size if like is None else like.size
        rows, large = JointRows.of(stack, estimate, alone), 0.0
        if like is not None:
            for joint in like.free:
                rows = rows.freed(joint)
        elif contradicts(*(relative_error(stack.factors, x) for x in (alone, estimate.theta))):
            rows, large = _with_large_torques(base, rows, arm)
        rows, size, arm_of_all = _with_joints_apart(base, rows, arm, size, like)
        released = rows.apart.any() or rows.free.any()
        with_it, without = (log_evidence(rows, arm_of_all, x)[0] for x in (size, NONE))
        gain = with_it - without
        wanted = residual_model or gain >= tuning.RESIDUAL_EVIDENCE
        if released or wanted:
            size = size if wanted else NONE
            if rows.apart.any():
                alone = K @ arm_of(base, rows.of_arm(NONE).rows, arm_of_all).x
            arm = arm_of(base, rows.of_arm(size).rows, arm_of_all)
            error = rows.residual(size, gain + large, K @ arm.x, stack.counts)
    theta, arm = K @ arm.x, replace(arm, inflation=worth)
    changes, covariance = np.zeros((len(K), 0)), K @ arm.covariance @ K.T
    if has_rows and like is None:
        share = np.diagonal(covariance) / np.maximum(np.diagonal(prior_covariance(base)), 1e-300)
        parts = Parts.of(stack, estimate, theta, error)
        less = parts.disagreement(covariance, error, share < tuning.TOLD_SHARE)
        changes = parts.changes(base, theta)
        of_all = np.linalg.pinv(K) @ changes
        arm = with_honest_errors(arm, constraints_of(base), less, of_all)
    return Posterior(arm, theta, K @ arm.covariance @ K.T, alone, error, changes)


def _with_joints_apart(
    base: BaseModel,
    rows: JointRows,
    arm: PhysicalParameters,
    sizes_known: Floats | None,
    like: ModelError | None,
) -> tuple[JointRows, Floats, PhysicalParameters]:
    """Find the sizes of the groups of columns, and the joints whose torques contradict those of the others.

    The columns come first: where friction or a cable is what a joint has beyond the model, it contradicts nobody.

    Args:
        base: model and base parameters.
        rows: rows of all joints.
        arm: the arm that they ask for.
        sizes_known: those that are known already, None to find them.
        like: model error whose joints apart are taken.

    Returns:
        The rows, the sizes, and the arm that the other joints ask for.
    """
    # Why without what somebody knows about the arm: torques that contradict that do not contradict each other.
    free = replace(base, model=replace(base.model, robot=replace(base.robot, known=Known())))
    if rows.free.any() or free.robot != base.robot:
        arm = arm_of(free, rows.of_arm(NONE).rows, arm)
    for _ in range(tuning.APART_ROUNDS):
        size = best_size(rows, arm) if sizes_known is None else sizes_known
        apart = joints_apart(rows, arm, size)[0] if like is None else like.apart
        if np.array_equal(apart, rows.apart):
            break
        rows = replace(rows, apart=apart)
        arm = arm_of(free, rows.of_arm(size).rows, arm)
    return rows, size, arm


def contradicts(misfit: float, best: float) -> bool:
    """Return whether a torque error is so much larger than that of the plain estimate that something is missing [%]."""
    return misfit > tuning.CONTRADICTION * best and misfit - best > NOISE_FREE


def _with_large_torques(
    base: BaseModel, rows: JointRows, arm: PhysicalParameters
) -> tuple[JointRows, float]:
    """Let joints have a large torque of their position, one after the other, while the evidence gains by it.

    Args:
        base: model and base parameters.
        rows: rows of all joints.
        arm: the arm that they ask for.

    Returns:
        The rows with free columns, and the gain of the log evidence by them.
    """
    rows_given, gain, first = rows, 0.0, arm

    def cost(rows: JointRows) -> tuple[float, PhysicalParameters, JointRows]:
        of_arm = rows.of_arm(NONE)
        candidate = arm_of(base, of_arm.rows, arm)
        return candidate.objective - of_arm.volume, candidate, rows

    best, arm, _ = cost(rows)
    for _ in range(tuning.LARGE_TORQUE_JOINTS):
        joints = np.flatnonzero(~rows.free.any(axis=1) & rows.factors.any(axis=(1, 2)))
        tried = [cost(rows.freed(int(j))) for j in joints]
        least, candidate, other = min(tried, key=lambda each: each[0], default=(best, arm, rows))
        if best - least < tuning.LARGE_TORQUE_EVIDENCE:
            break
        rows, arm, best, gain = other, candidate, least, gain + best - least
    # Why: a scaled or partial torque asks for a torque of the position as well, but for more beside it.
    if gain and gain > joints_apart(rows_given, first, NONE)[1]:
        return rows, gain
    return rows_given, 0.0


# ---------------------------------------------------------------- parts of recordings that disagree
@dataclass(frozen=True)
class Parts:
    """P parts of recordings, whitened; joints that are apart have no say.

    Attributes:
        log: number of the recording of each, (P,).
        grams: of [Z W residual] of each joint about the estimate, (P, n, k + p + 1, k + p + 1).
    """

    log: NDArray[np.int64]
    grams: Floats

    @classmethod
    def of(cls, stack: Stack, estimate: Fit, theta: Floats, error: ModelError | None) -> Parts:
        """Return the quarters of each recording.

        Args:
            stack: the fitted rows.
            estimate: of the base parameters, which says how many rows are worth one independent row.
            theta: possible base parameters, (p,).
            error: the residual model; None without.
        """
        rows, each = stack.rows, tuning.PARTS_OF_LOG
        part = each * rows.log + np.floor(each * rows.progress).astype(int)
        noise, robust, grams = estimate.noise, estimate.robust, []
        mean = np.tile(theta, (len(noise), 1))
        if error is not None:
            mean = np.hstack([error.mean[:, :SIZE], mean])
        for number in np.unique(part):
            of_part = stack.take(part == number)
            if error is None:
                F = of_part.factors
            else:
                F = error.changed(error.factors(of_part, noise, robust))
                F *= (error.apart == 0.0)[:, None, None]
            F = F / (noise * np.sqrt(estimate.inflation))[:, None, None]
            F[:, :, -1] -= np.einsum("jmk,jk->jm", F[:, :, :-1], mean)
            grams.append(F.swapaxes(1, 2) @ F)
        return cls(np.unique(part) // each, np.array(grams))

    def disagreement(self, covariance: Floats, error: ModelError | None, informed: Mask) -> float:
        """Return the variance between the estimates of parts over the one that their rows predict.

        Predicted is with rows held back, so it is at least 1 / ``HELD_BACK``. When the parameters move, the columns of
        the residual model follow them.

        Args:
            covariance: of the parameters, (p, p).
            error: the residual model; None without.
            informed: which parameters come from the rows, (p,).
        """
        p, n = len(covariance), self.grams.shape[1]
        k, slope, root = 0, np.zeros((n, 0, p)), np.zeros((n, 0, 0))
        if error is not None:
            k, slope, root = SIZE, error.slope, error.root
        T = np.concatenate([slope[:, :k], np.tile(np.eye(p), (n, 1, 1))], axis=1)
        weight = np.where(informed, 1.0 / np.diagonal(covariance), 0.0)
        ratios = [1.0 / tuning.HELD_BACK]
        for number in (np.arange(len(self.log)), self.log):
            member = number == np.unique(number)[:, None]
            if len(member) > 1 and informed.any():
                G = T.swapaxes(1, 2) @ np.tensordot(member, self.grams[:, :, :-1], axes=1)
                score, S = G[..., -1].sum(axis=1), (G[..., :-1] @ T).sum(axis=1)
                taken = G[..., :k] @ root[:, :k, :k]  # what columns may take of the information
                S_left = S - (taken @ taken.swapaxes(2, 3)).sum(axis=1) - S @ covariance @ S
                usual = np.diagonal(covariance @ S_left @ covariance, axis1=1, axis2=2)
                moved = float(np.sum((score @ covariance) ** 2 @ weight))
                ratios.append(moved / max(float(np.sum(usual @ weight)), 1e-300))
        return min(max(ratios), tuning.LARGEST_INFLATION)

    def changes(self, base: BaseModel, theta: Floats) -> Floats:
        """Return A with A A^T what other recordings will add to the covariance of the parameters, (p, 2 n).

        Args:
            base: model and base parameters.
            theta: base parameters, (p,).
        """
        count = len(np.unique(self.log))
        directions = _directions(base, theta)
        sizes = [np.sqrt(self._variance(each) / count) for each in directions]
        return np.concatenate([d * size for d, size in zip(directions, sizes, strict=True)], axis=1)

    def _variance(self, directions: Floats) -> float:
        """Return the variance by which the size of some directions, (p, n), differs between recordings.

        Each part says by how much the size of each joint's direction is another there, a, with a variance v. Within a
        recording these differ by s, and the means of recordings by ``CHANGE_BETWEEN`` times s; the result is from the
        posterior mean of s^2 on a grid, so that few parts leave it large.
        """
        p = len(directions)
        W = self.grams[:, :, -p - 1 : -1, -p - 1 :]
        along = np.einsum("pj,ljpq->ljq", directions, W)
        information = np.einsum("ljp,pj->lj", along[..., :-1], directions)
        sizes = np.geomspace(*tuning.CHANGE_SIZES, tuning.CHANGE_GRID)
        freedom = tuning.CHANGE_FREEDOM
        share = (sizes / tuning.CHANGE_PRIOR) ** 2 / freedom
        value = np.log(sizes) - 0.5 * (freedom + 1.0) * np.log1p(share)
        together = tuning.CHANGE_BETWEEN**2 * (self.log[:, None] == self.log)
        for j in np.flatnonzero(np.all(information > 0.0, axis=0) & (len(W) > 1)):
            v = 1.0 / information[:, j]
            a = along[:, j, -1] * v
            covariance = np.diag(v) + sizes[:, None, None] ** 2 * (np.eye(len(a)) + together)
            # Why without the mean: the estimate has taken it.
            weight = np.linalg.inv(covariance)
            total = weight.sum(axis=(1, 2))
            away = a - (weight.sum(axis=1) @ a / total)[:, None]
            squares = np.einsum("sl,slm,sm->s", away, weight, away)
            value -= 0.5 * (np.linalg.slogdet(covariance)[1] + np.log(total) + squares)
        chance = np.exp(value - value.max())
        return float(tuning.CHANGE_BETWEEN**2 * (chance @ sizes**2) / chance.sum())


def _directions(base: BaseModel, theta: Floats) -> tuple[Floats, Floats]:
    """Return how offsets, and levels of friction, change the parameters, (p, n) each: one column for each joint."""
    names, (offset, level) = np.array(base.names), np.zeros((2, len(theta), base.robot.n))
    for j in range(base.robot.n):
        friction = np.isin(names, (f"fc{j + 1}", f"fv{j + 1}"))
        level[friction, j] = theta[friction]
        offset[names == f"fo{j + 1}", j] = np.abs(theta[names == f"fc{j + 1}"]).sum()
    return offset, level


# ---------------------------------------------------------------- what a set is worth
def expected_error(stack: Stack, post: Posterior, rms: Floats) -> ExpectedError:
    """Return how far the torques of a set will be off, on the fitted motion and on an exciting one.

    Args:
        stack: the fitted rows.
        post: the parameters with their covariance, of which ``changes`` are no doubt about these recordings.
        rms: residual of each joint on the fitted rows, (n,) [N m or N].
    """
    error, base, count = post.error, stack.base, np.maximum(stack.counts, 1)
    factors, larger = stack.factors.swapaxes(0, 1), 1.0
    W = columns = factors[:, :, :-1]
    if error is not None:
        # Why: a fit takes from the residuals what it cannot take from those of another recording.
        larger, columns = tuning.UNSEEN_RESIDUAL, np.pad(W, ((0, 0), (0, 0), (SIZE, 0)))
    spread = np.sum(torque_variance(columns, post.covariance, error), axis=0) / count
    other = np.sum((W @ post.changes) ** 2, axis=(0, 2)) / count
    size = np.sum(factors[:, :, -1] ** 2, axis=0) / count
    noise = larger * np.sqrt(rms**2 + np.maximum(spread - other, 0.0))
    q, qd, qdd = exciting_states(base.robot)
    W = columns = base.observer.dense(q, qd, qdd)
    tau = W @ post.theta
    if error is not None:
        shapes = error.shapes_at(q, qd, base.observer)
        tau, columns = tau + error.torque(W, shapes), error.columns(W, shapes)
    variance = torque_variance(columns, post.covariance, error)
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
    W = base.observer.dense(*exciting_states(base.robot))
    return _percent(np.sum((W @ symmetric_root(covariance)) ** 2), np.sum((W @ reference) ** 2))


def _percent(error: float, torque: float) -> float:
    return float(100.0 * np.sqrt(error / torque)) if torque > 0.0 else 0.0


# ---------------------------------------------------------------- the posterior of a result
def information_of(result: Identified) -> tuple[Floats, Floats]:
    """Return what a result knows about its parameters; of the plain set nothing but its rows is known.

    Args:
        result: p base parameters, n joints.

    Returns:
        The inverse of their covariance, zero along what nothing tells, (p, p); the noise of a row, whitened with which
        rows are worth one independent row each, (n,) [N m or N].
    """
    if result.in_force == "physical":
        worth, information = result.physical.inflation, inverse(result.covariance)
    else:
        A = result.fit.whitened[:-1, :-1]
        # Why not the inverse of the covariance: that is estimated from few independent samples, and where it happens
        # to be too small its inverse would trust the log most.
        worth = max(float(np.sum((A @ result.covariance) * A)) / max(1, result.rank), 1e-300)
        information = A.T @ A / worth
    return information, result.noise * np.sqrt(worth)


def sample_noise(result: Identified, rate: float) -> Floats:
    """Return the white noise of samples at a rate [Hz] that tell as much as a result's rows, (n,) [N m or N]."""
    rows = float(result.header["kept_rate_hz"])
    return information_of(result)[1] * np.sqrt(rate / rows)


def prior_information(base: BaseModel) -> Floats:
    """Return what is known of the base parameters before anything is measured, the inverse of their covariance, (p, p).

    Raises:
        NotPhysical: a body of the prior cannot exist.
    """
    return inverse(prior_covariance(base))
