"""What a rigid body with its friction cannot say, as random effects: columns per joint whose sizes the data choose.

    tau_j = W_j (theta + d_j) + Z_j b_j + e_j,     b_jk ~ N(0, lambda_g sigma_j^2)

The columns D of a joint are sines of its position (angle offsets, springs, cable forces), its Coulomb sign times sines
of the position and times shapes of the speed (friction that depends on both), and its Coulomb sign times the torque
that the parameters ask for (friction of the load). All are bounded, so that they say little where nothing was seen.
Z = D - W B, where B is the regression of D on W over the workspace: theta stays what describes the arm best on any
motion, and b what is left on the motion that was recorded. The sizes lambda of the three groups maximise the evidence;
without any evidence for them there is no model error.

b is eliminated by one QR per joint, so that a fit of theta costs what it costs without it.
docs/explanation/estimators.md says what was tried.

A joint whose torque is scaled, reversed or only a part of all torque fits its own rows as well as any other, so that no
weight tells it; but it contradicts the other joints about the links that they move together. Such a joint is apart: it
has parameters theta + d of its own, d ~ N(0, lambda_j C) with the covariance C that links are known with beforehand,
and with a large lambda_j it has no say in theta. The evidence decides which joints are.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import accumulate
from operator import add

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Floats, Ints
from dynid.estimation import tuning
from dynid.estimation.factor import Conditional, Factor, of_unit_diagonal, triangle
from dynid.estimation.least_squares import Fit, merge, solve, symmetric_root
from dynid.estimation.possible_arm import (
    PhysicalParameters,
    constraints_of,
    exciting_states,
    fit_pooled,
    prior_covariance,
)
from dynid.estimation.rows import at_rows
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel
from dynid.model.regressor import Observer
from dynid.signals.conditioned_log import ConditionedLog, Segment

# ---------------------------------------------------------------- columns
#: Group of each column: 0 position, 1 friction, 2 load.
GROUPS = np.repeat(
    [0, 1, 2],
    [2 * tuning.POSITION_HARMONICS, 2 * tuning.FRICTION_HARMONICS + len(tuning.FRICTION_SPEEDS), 1],
)
#: Number of columns of a joint.
SIZE = len(GROUPS)
#: Names of the groups, for people.
GROUP_NAMES = ("position", "friction", "load")
#: Columns by which a joint may have a large torque of its position that no possible arm has, and their variances over
#: that of the joint's torque: springs and counterbalances are smooth, so that higher harmonics are small.
FREE = np.flatnonzero(GROUPS == 0)
FREE_SIZE = np.repeat(np.arange(1.0, tuning.POSITION_HARMONICS + 1), 2) ** -4.0


def shapes_of(q: Floats, qd: Floats, sign: Floats, speed: Floats) -> Floats:
    """Return the columns of each joint, (N, n, k); the last one, of the load, lacks its torque.

    Args:
        q: positions, (N, n) [rad or m].
        qd: velocities, (N, n) [rad/s or m/s].
        sign: Coulomb signs of the velocities, (N, n).
        speed: rms speed of each joint in the fitted motion, (n,) [rad/s or m/s].
    """
    q, share, sign = (np.ascontiguousarray(x.T) for x in (q, np.abs(qd) / speed, sign))
    # Why products and not a sine of each multiple: they take a tenth of its time.
    turns = list(accumulate([np.exp(1j * q)] * tuning.POSITION_HARMONICS, np.multiply))
    waves = [wave for turn in turns for wave in (turn.imag, turn.real)]
    slow = [np.exp(share / -least) for least in tuning.FRICTION_SPEEDS]
    friction = [sign * x for x in (*waves[: 2 * tuning.FRICTION_HARMONICS], *slow)]
    return np.stack([*waves, *friction, sign], axis=1).transpose(2, 0, 1)


def shapes_in(
    log: ConditionedLog, observer: Observer, speed: Floats, t: Floats | None = None
) -> Floats:
    """Return the columns of ``shapes_of`` under the filter of the rows of a log, at those of times t, (M, n, k)."""

    def shapes(part: Segment) -> Floats:
        sign = part.coulomb_sign if part.coulomb_sign.size else observer.coulomb_sign(part.qd)
        columns = shapes_of(part.q, part.qd, sign, speed)
        return columns.transpose(1, 2, 0).reshape(-1, len(part))

    return at_rows(log, shapes, t).reshape(-1, len(speed), SIZE)


def _loaded(shapes: Floats, torque: Floats) -> Floats:
    """Return columns (M, n, k) with the one of the load times the size of a torque, (M, n)."""
    D = shapes.copy()
    D[:, :, -1] *= np.abs(torque)
    return D


def _rms_speed(logs: Iterable[ConditionedLog]) -> Floats:
    """Return the rms speed of each joint, never quite zero, (n,) [rad/s or m/s]."""
    qd = np.concatenate([part.qd for log in logs for part in log.segments])
    return np.maximum(np.sqrt(np.mean(qd**2, axis=0)), 1e-3)


@dataclass(frozen=True)
class Columns:
    """The columns Z = D / scale - W B of each joint; n joints, k columns, p parameters.

    Attributes:
        speed: rms speed of each joint in the fitted motion, (n,) [rad/s or m/s].
        reference: base parameters whose torque the column of the load scales with, (p,).
        scale: rms of each column in the fitted rows, (n, k).
        projection: B, the part of each column of unit rms that parameters describe over the workspace, (n, p, k).
    """

    speed: Floats
    reference: Floats
    scale: Floats
    projection: Floats

    @property
    def free(self) -> Ints:
        """Numbers of the joints with a large torque of the position that no possible arm has."""
        return np.flatnonzero(~self.projection[:, :, FREE].any(axis=(1, 2)))

    def shapes_at(self, q: Floats, qd: Floats, observer: Observer) -> Floats:
        """Return ``shapes_of`` a motion without any filter, (N, n) each [rad or m, rad/s or m/s], (N, n, k)."""
        return shapes_of(q, qd, observer.coulomb_sign(qd), self.speed)

    def columns(self, W: Floats, shapes: Floats) -> Floats:
        """Return [Z W] for a base regressor, (M, n, p), and the shapes there, (M, n, k); (M, n, k + p)."""
        Z = _loaded(shapes, W @ self.reference) / self.scale
        Z -= np.einsum("mjp,jpk->mjk", W, self.projection, optimize=True)
        return np.concatenate([Z, W], axis=2)

    def factors(self, stack: Stack, noise: Floats, robust: Floats | None) -> Floats:
        """Return triangular factors of [D W tau] per joint, weighted like the estimate, (n, k + p + 1, k + p + 1).

        Args:
            stack: the rows, of any logs.
            noise: sigma of each joint, (n,) [N m or N].
            robust: estimate from which residuals are spikes, (p,); None where it gave them their whole weight.
        """
        rows, weight = stack.rows, None
        if robust is not None:
            left = np.abs(rows.tau - rows.torque(robust)) / noise
            weight = tuning.RESIDUAL_FAR / np.maximum(left, tuning.RESIDUAL_FAR)
        shapes = stack.along(lambda log, t: shapes_in(log, stack.observer, self.speed, t))
        return rows.factors(weight, _loaded(shapes, rows.torque(self.reference)))

    def changed(self, factors: Floats) -> Floats:
        """Return factors of [Z W tau] from those of [D W tau]: Z is linear in D and W."""
        change = np.tile(np.eye(factors.shape[-1]), (len(factors), 1, 1))
        change[:, range(SIZE), range(SIZE)] = 1.0 / self.scale
        change[:, SIZE:-1, :SIZE] = -self.projection
        return np.array([triangle(each) for each in factors @ change])


# ---------------------------------------------------------------- the residual model
@dataclass(frozen=True)
class ModelError(Columns):
    """Random columns of each joint, and the parameters of its own of a joint apart, with their posterior.

    Attributes:
        mean: posterior mean of the factors (b, d) of [Z W], (n, k + p) [N m or N; units of the parameters]; d is zero
            where a joint agrees with the others.
        root: M_j with M_j M_j^T their covariance for known parameters, (n, k + p, k + p).
        slope: change of their mean by the parameters, (n, k + p, p).
        size: lambda of each group.
        rms: rms torque of each group, and of all together, on the fitted rows, (n, 4) [N m or N].
        evidence: gain of the log evidence by the model error.
        apart: how far the parameters of each joint's own may be from those of the arm, lambda_j; 0 of joints that
            agree with the others, (n,).
    """

    mean: Floats
    root: Floats
    slope: Floats
    size: Floats
    rms: Floats
    evidence: float
    apart: Floats

    @property
    def joints_apart(self) -> Ints:
        """Numbers of the joints whose torques contradict those of the others."""
        return np.flatnonzero(self.apart)

    @property
    def own(self) -> Floats:
        """What the parameters of a joint's own differ by, (n, p)."""
        return self.mean[:, SIZE:]

    @property
    def mean_by_rows(self) -> tuple[Floats, Floats]:
        """The mean torque as a combination of D, (n, k), and of W, (n, p)."""
        b = self.mean[:, :SIZE]
        return b / self.scale, self.own - np.einsum("jpk,jk->jp", self.projection, b)

    def torque(self, W: Floats, shapes: Floats) -> Floats:
        """Return the mean torque of the model error for a base regressor and the shapes there, (M, n) [N m or N]."""
        D, (by_column, by_parameter) = _loaded(shapes, W @ self.reference), self.mean_by_rows
        return np.einsum("mjk,jk->mj", D, by_column) + np.einsum("mjp,jp->mj", W, by_parameter)


def torque_variance(columns: Floats, covariance: Floats, error: ModelError | None) -> Floats:
    """Return the variance of predicted torques, noise not included, (M, n) [N^2 m^2 or N^2].

    Args:
        columns: base regressor W there, (M, n, p); [Z W], (M, n, k + p), beside a model error.
        covariance: of the parameters, (p, p).
        error: the model error; None without.
    """
    root, variance = symmetric_root(covariance), np.empty(columns.shape[:2])
    for j in range(columns.shape[1]):
        doubt = columns[:, j, -len(root) :] @ root
        if error is not None:
            arm = doubt + columns[:, j] @ (error.slope[j] @ root)
            doubt = np.hstack([arm, columns[:, j] @ error.root[j]])
        variance[:, j] = np.sum(doubt**2, axis=1)
    return variance


def residuals(stack: Stack, theta: Floats, error: ModelError | None) -> Floats:
    """Return what parameters, (p,), and the mean of a model error leave of all rows, (M, n) [N m or N]."""
    left = stack.rows.tau - stack.rows.torque(theta)
    if error is None:
        return left
    shapes = stack.along(lambda log, t: shapes_in(log, stack.observer, error.speed, t))
    return left - error.torque(stack.rows.W, shapes)


def squares(stack: Stack, theta: Floats, error: ModelError | None) -> Floats:
    """Return the sum of squared residuals of each joint on any rows, (n,) [N^2 m^2 or N^2]; as for ``residuals``."""
    if error is None:
        return np.sum((stack.factors @ np.append(theta, -1.0)) ** 2, axis=1)
    return np.sum(residuals(stack, theta, error) ** 2, axis=0, where=stack.rows.use)


# ---------------------------------------------------------------- rows in the parameters and the columns
@dataclass(frozen=True)
class JointRows:
    """Rows [D W tau] of each joint as triangular factors, divided by noise and by what coloured residuals are worth.

    Attributes:
        shaped: per joint, (n, k + p + 1, k + p + 1).
        noise: sigma of each joint, (n,) [N m or N].
        inflation: how many rows are worth one independent row.
        columns: what Z is.
        free: variance of the factors of columns that are free, in units of sigma^2, zero for all others, (n, k).
        apart: lambda of each joint: how far its own parameters may be from those of the arm, (n,).
        spread: L with L L^T = C, which lambda multiplies, (p, p).
        K: base parameters as combinations of all parameters, (p, c).
    """

    shaped: Floats
    noise: Floats
    inflation: float
    columns: Columns
    free: Floats
    apart: Floats
    spread: Floats
    K: Floats

    @classmethod
    def of(cls, stack: Stack, estimate: Fit, reference: Floats) -> JointRows:
        """Return the rows of a stack; an estimate solves them where there is no model error.

        Reversals and spikes weigh as little as in the estimate: columns that say how friction depends on the speed
        would explain them with a friction that the arm does not have.

        Args:
            stack: the stacked logs.
            estimate: of the base parameters.
            reference: base parameters that give the torque of the load, (p,).
        """
        n, p, noise = len(stack.joints), len(reference), estimate.noise
        columns = Columns(
            _rms_speed(stack.logs), reference, np.ones((n, SIZE)), np.zeros((n, p, SIZE))
        )
        factors = columns.factors(stack, noise, estimate.robust)
        rms = (
            np.linalg.norm(factors[:, :, :SIZE], axis=1)
            / np.sqrt(np.maximum(stack.counts, 1))[:, None]
        )
        columns = replace(columns, scale=np.where(rms > 1e-9, rms, 1.0))  # of joints with rows
        factors /= (noise * np.sqrt(estimate.inflation))[:, None, None]
        return cls(
            shaped=centred(factors, SIZE, estimate.theta),
            noise=noise,
            inflation=estimate.inflation,
            columns=replace(columns, projection=_projection(stack.base, columns)),
            free=np.zeros((n, SIZE)),
            apart=np.zeros(n),
            spread=symmetric_root(prior_covariance(stack.base)),
            K=stack.base.reduction.K,
        )

    @cached_property
    def factors(self) -> Floats:
        """Triangular factors of [Z W tau] per joint, (n, k + p + 1, k + p + 1)."""
        return self.columns.changed(self.shaped)

    def freed(self, joint: int) -> JointRows:
        """Return rows in which the columns of the position of one joint may be large and overlap with the parameters.

        Where a spring or a counterbalance is missing in the model, what the parameters can say of it asks for
        impossible links, so it must not be left to them.

        Args:
            joint: its number.
        """
        projection, free = self.columns.projection.copy(), self.free.copy()
        projection[joint][:, FREE] = 0.0
        columns = replace(self.columns, projection=projection)
        rows = replace(self, columns=columns)
        unit, torque = np.sum(rows.factors[joint][:, [0, -1]] ** 2, axis=0)
        free[joint, FREE] = FREE_SIZE * torque / unit / self.noise[joint] ** 2
        return replace(rows, free=free)

    def deviations(self, size: Floats) -> Floats:
        """Return the standard deviation of the factor of each column, (n, k) [N m or N], for sizes of the groups."""
        return np.sqrt(np.where(self.free > 0.0, self.free, size[GROUPS])) * self.noise[:, None]

    def parts(self, size: Floats, apart: Floats) -> list[tuple[Factor, Conditional]]:
        """Return the rows of each joint with its own unknowns integrated out, and these for given arm parameters.

        Its own are the factors b of its columns, in units of their prior deviation; and where the joint is fitted
        separately, how its parameters differ, d ~ N(0, lambda C), in units of lambda^1/2 L.

        Args:
            size: lambda of each group of columns.
            apart: lambda of each joint, (n,).
        """
        found = []
        for F, sd, far in zip(self.factors, self.deviations(size), apart.tolist(), strict=True):
            Z, W, right = F[:, :SIZE], F[:, SIZE:-1], F[:, -1]
            own = np.sqrt(far) * (W @ self.spread) if far else W[:, :0]
            beside = np.hstack([Z * sd, own])
            rows = Factor({"beside": beside, "arm": W}, right)
            arm, others = rows.prior("beside", np.ones(beside.shape[1])).without("beside")
            found.append((arm, others.conditional))
        return found

    def of_arm(self, size: Floats) -> Factor:
        """Return what the rows say of the parameters of the arm, (p,), for sizes of the groups."""
        return reduce(add, [arm for arm, _ in self.parts(size, self.apart)])

    def residual(
        self, size: Floats, evidence: float, theta: Floats, counts: NDArray[np.int64]
    ) -> ModelError:
        """Return the model error that belongs to parameters.

        Args:
            size: lambda of each group.
            evidence: gain of the log evidence.
            theta: base parameters, (p,).
            counts: number of rows of each joint, (n,).
        """
        n, k, p = len(counts), SIZE, len(theta)
        mean, slope = np.zeros((n, k + p)), np.zeros((n, k + p, p))
        root, worth = np.zeros((2, n, k + p, k + p))
        worth[:, range(k), range(k)] = self.deviations(size)
        worth[:, k:, k:] = np.sqrt(self.apart)[:, None, None] * self.spread
        for j, (_, beside) in enumerate(self.parts(size, self.apart)):
            own = worth[j, :, : len(beside.mean)]
            slope[j], root[j, :, : own.shape[1]] = own @ beside.slope, own @ beside.root
            mean[j] = own @ beside.mean + slope[j] @ theta
        groups = np.column_stack([GROUPS[:, None] == range(len(size)), np.ones(k)])
        torque = np.linalg.norm(self.factors[:, :, :k] @ (mean[:, :k, None] * groups), axis=1)
        rms = torque * (self.noise * np.sqrt(self.inflation / np.maximum(counts, 1)))[:, None]
        return ModelError(
            **vars(self.columns),
            mean=mean,
            root=root,
            slope=slope,
            size=size,
            rms=rms,
            evidence=evidence,
            apart=self.apart,
        )


def centred(factors: Floats, k: int, theta: Floats) -> Floats:
    """Return factors [Z W tau] of which theta is the least-squares solution without Z, (n, m, k + p + 1).

    Instruments find other parameters than least squares of the same rows; the model error must not undo that.
    """
    F, solution = factors.copy(), solve(merge(factors[:, :, k:])).theta
    F[:, :, -1] += F[:, :, k:-1] @ (theta - solution)
    return F


def _projection(base: BaseModel, columns: Columns) -> Floats:
    """Regress the columns on the parameters over random states inside the limits, (n, p, k).

    Their speeds are at least those of an exciting motion: what a joint that crawls leaves to the columns would grow
    with the speed of another motion without bounds.
    """
    q, qd, qdd = exciting_states(base.robot, columns.speed)
    W = base.observer.dense(q, qd, qdd)
    D = _loaded(columns.shapes_at(q, qd, base.observer), W @ columns.reference) / columns.scale
    of_joints = zip(W.swapaxes(0, 1), D.swapaxes(0, 1), strict=True)
    return np.array([np.linalg.lstsq(*each, rcond=1e-8)[0] for each in of_joints])


# ---------------------------------------------------------------- an arm that rows ask for, and their evidence
#: Relative change of the logarithms of the sizes at which their slopes count as none.
SETTLED = 1e-12
#: Sizes of the groups without any model error.
NONE = np.full(len(GROUP_NAMES), tuning.RESIDUAL_NOTHING)
#: What is added to a matrix with a diagonal of ones before it is factored: a few times its rounding.
SINGULAR = 1e-13


def arm_of(
    base: BaseModel, rows: Floats, near: PhysicalParameters | None = None
) -> PhysicalParameters:
    """Return the possible arm that whitened rows [W tau] ask for, (m, p + 1), sought near another one.

    From the prior's own sizes: what no arm can make has made the bodies of the other one heavier.
    """
    R, begin = rows[:, :-1] @ base.reduction.K, None if near is None else near.x
    return fit_pooled(R, rows[:, -1], constraints_of(base), begin, sized=True)[0]


def evidence_of(arm: PhysicalParameters, K: Floats, S: Floats) -> tuple[float, Floats, Floats]:
    """Return the log evidence of rows with the parameters integrated out, up to a constant, and their posterior.

    Args:
        arm: where the prior is taken for a normal distribution.
        K: base parameters as combinations of all parameters, (p, c).
        S: [W tau]^T [W tau] of all rows, (p + 1, p + 1).

    Returns:
        The evidence; the base parameters, (p,); the root of their covariance, (p, c).
    """
    theta = K @ arm.x
    away = np.append(theta, -1.0)
    H, unit = of_unit_diagonal(K.T @ S[:-1, :-1] @ K + arm.prior)
    # Why a little more: noise-free rows make H singular in double precision.
    lower = np.linalg.cholesky(H + SINGULAR * np.eye(len(H)))
    root = K @ (unit[:, None] * np.linalg.inv(lower).T)
    weights = -root.T @ (S[:-1] @ away)
    volume = float(np.sum(np.log(unit / np.diagonal(lower))))
    return volume - 0.5 * float(away @ S @ away - weights @ weights), theta + root @ weights, root


def log_evidence(rows: JointRows, arm: PhysicalParameters, size: Floats) -> tuple[float, Floats]:
    """Return the log evidence of sizes, up to a constant, and its slopes by their logarithms, (groups,).

    The columns and the parameters are integrated out; joints that are apart have no say. The slope is that of the
    expected log density of the columns' factors (Fisher's identity): half of the squares that the data expect of a
    group, in units of its size, beyond their number.

    Args:
        rows: rows of all joints.
        arm: where the prior of the parameters is taken for a normal distribution.
        size: lambda of each group, (groups,).
    """
    joints, each = np.flatnonzero(rows.apart == 0.0), rows.parts(size, rows.apart)
    total = sum(each[j][0].rows.T @ each[j][0].rows for j in joints)
    evidence, theta, root = evidence_of(arm, rows.K, np.asarray(total))
    slope = np.zeros(len(size))
    for j in joints:
        own, columns = each[j]
        evidence += own.volume
        squares = (columns.mean + columns.slope @ theta) ** 2
        for part in (columns.slope @ root, columns.root):
            squares += np.sum(part**2, axis=1)
        expected = np.where(rows.free[j] > 0.0, 0.0, squares - 1.0)
        slope += 0.5 * np.bincount(GROUPS, expected, minlength=len(size))
    return evidence, slope


def best_size(rows: JointRows, arm: PhysicalParameters) -> Floats:
    """Return the sizes of the groups that make the data most likely, (groups,)."""
    from scipy.optimize import minimize, root  # here: its import takes as long as the search

    low, high = np.log([NONE, tuning.RESIDUAL_LARGEST])

    def negative(logs: Floats) -> tuple[float, Floats]:
        evidence, slope = log_evidence(rows, arm, np.exp(logs))
        return -evidence, -slope

    bounds = np.c_[low, high]
    searches = [
        minimize(negative, start, jac=True, method="L-BFGS-B", bounds=bounds)
        for start in np.log(tuning.RESIDUAL_BEGIN)
    ]
    logs = min(searches, key=lambda each: each.fun).x
    inside = (logs > low) & (logs < high)

    def slopes(there: Floats) -> Floats:
        return np.where(inside, negative(there)[1], there - logs)

    # The evidence is flat beyond its rounding; where its slopes vanish is the same on every machine.
    level = root(slopes, logs, tol=SETTLED).x
    better = np.linalg.norm(slopes(level)) < np.linalg.norm(slopes(logs))
    return np.exp(level if better else logs)


def joints_apart(rows: JointRows, arm: PhysicalParameters, size: Floats) -> tuple[Floats, float]:
    """Return the lambda of each joint, 0 of those that agree with the others, (n,), and what the log evidence gains.

    One joint after the other is let apart, taken back or given another size, whatever makes the data most likely. What
    was apart before stays so: the prior is approximated where the others put the arm, and from there another one that
    agrees with all of them may seem near, which no possible arm is.

    Args:
        rows: rows of all joints.
        arm: where the prior of the parameters is taken for a normal distribution.
        size: lambda of each group of columns, (groups,).
    """
    sizes = np.append(0.0, tuning.APART_SIZES)
    released = [rows.parts(size, np.full_like(rows.apart, each)) for each in sizes]
    S = np.array([[arm.rows.T @ arm.rows for arm, _ in each] for each in released])
    volume = np.array([[arm.volume for arm, _ in each] for each in released])
    narrowed = rows.spread.T @ S[0, :, :-1, :-1] @ rows.spread
    if np.linalg.norm(narrowed, 2, axis=(1, 2)).max(initial=0.0) > tuning.APART_TOLD:
        return rows.apart, 0.0
    joints, before = np.arange(len(rows.apart)), rows.apart > 0.0

    def worth(place: Ints) -> float:
        if np.all(place):  # the last one has nobody left to contradict
            return -np.inf
        evidence = evidence_of(arm, rows.K, S[place, joints].sum(axis=0))[0]
        evidence += float(volume[place, joints].sum())
        return evidence - tuning.APART_EVIDENCE * np.count_nonzero(place)

    place = np.searchsorted(sizes, rows.apart)
    none, best = worth(np.zeros_like(place)), worth(place)
    while True:
        others = [
            np.where(joints == j, k, place)
            for j in joints
            for k in range(int(before[j]), len(sizes))
        ]
        worths = [worth(other) for other in others]
        first = int(np.argmax(worths))
        if not worths[first] > best + tuning.APART_SETTLED:
            return sizes[place], best - none
        best, place = worths[first], others[first]
