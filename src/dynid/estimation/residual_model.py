"""What a rigid body with its friction cannot say, as random effects: columns per joint whose sizes the data choose.

    tau_j = W_j theta + Z_j b_j + e_j,     b_jk ~ N(0, lambda_g sigma_j^2)

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
from functools import reduce
from itertools import accumulate
from operator import add

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.factor import Factor, triangle
from dynid.estimation.least_squares import symmetric_root
from dynid.estimation.rows import at_rows
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel
from dynid.model.regressor import Observer
from dynid.robot import Robot
from dynid.signals.conditioned_log import ConditionedLog, Segment

Floats = NDArray[np.float64]


# ---------------------------------------------------------------- columns
#: Group of each column: 0 position, 1 friction, 2 load.
GROUPS = np.repeat(
    [0, 1, 2],
    [2 * tuning.POSITION_HARMONICS, 2 * tuning.FRICTION_HARMONICS + len(tuning.FRICTION_SPEEDS), 1],
)


def shapes_of(q: Floats, qd: Floats, sign: Floats, speed: Floats) -> Floats:
    """Return the columns of each joint, (N, n, k); the last one, of the load, lacks its torque.

    Args:
        q: positions, (N, n) [rad or m].
        qd: velocities, (N, n) [rad/s or m/s].
        sign: Coulomb signs of the velocities, (N, n).
        speed: rms speed of each joint in the fitted motion, (n,) [rad/s or m/s].
    """
    return _shapes(q, qd, sign, speed).transpose(2, 0, 1)


def _shapes(q: Floats, qd: Floats, sign: Floats, speed: Floats) -> Floats:
    """Return the columns as ``shapes_of`` does, (n, k, N)."""
    q, share, sign = (np.ascontiguousarray(x.T) for x in (q, np.abs(qd) / speed, sign))
    # Why products and not a sine of each multiple: they take a tenth of its time.
    turns = list(accumulate([np.exp(1j * q)] * tuning.POSITION_HARMONICS, np.multiply))
    waves = [wave for turn in turns for wave in (turn.imag, turn.real)]
    slow = [np.exp(share / -least) for least in tuning.FRICTION_SPEEDS]
    friction = [sign * x for x in (*waves[: 2 * tuning.FRICTION_HARMONICS], *slow)]
    return np.stack([*waves, *friction, sign], axis=1)


def loaded(shapes: Floats, torque: Floats) -> Floats:
    """Return columns (M, n, k) with the one of the load times the size of a torque, (M, n)."""
    D = shapes.copy()
    D[:, :, -1] *= np.abs(torque)
    return D


def shapes_in(log: ConditionedLog, observer: Observer, speed: Floats) -> Floats:
    """Return the columns of ``shapes_of`` at the rows of a log and under their filter, (M, n, k)."""

    def shapes(part: Segment) -> Floats:
        sign = part.coulomb_sign if part.coulomb_sign.size else observer.coulomb_sign(part.qd)
        return _shapes(part.q, part.qd, sign, speed).reshape(-1, len(part))

    return at_rows(log, shapes).reshape(-1, len(speed), len(GROUPS))


def rms_speed(logs: Iterable[ConditionedLog], n: int) -> Floats:
    """Return the rms speed of each joint, never quite zero, (n,) [rad/s or m/s]."""
    squares, count = np.zeros(n), 0
    for log in logs:
        for segment in log.segments:
            squares += np.sum(segment.qd**2, axis=0)
            count += len(segment)
    return np.maximum(np.sqrt(squares / max(1, count)), 1e-3)


def folded(
    stack: Stack, speed: Floats, reference: Floats, noise: Floats, robust: Floats | None
) -> Floats:
    """Return triangular factors of [D W tau] per joint, weighted like the estimate, (n, k + p + 1, k + p + 1).

    Args:
        stack: the rows.
        speed: rms speed of each joint, (n,) [rad/s or m/s].
        reference: base parameters that give the torque of the load, (p,).
        noise: sigma of each joint, (n,) [N m or N].
        robust: estimate from which residuals are spikes, (p,); None where it gave them their whole weight.
    """
    rows, weight = stack.rows, None
    if robust is not None:
        left = np.abs(rows.tau - rows.torque(robust)) / noise
        weight = tuning.RESIDUAL_FAR / np.maximum(left, tuning.RESIDUAL_FAR)
    shapes = stack.along(lambda log: shapes_in(log, stack.observer, speed))
    D = loaded(shapes, rows.torque(reference))
    return replace(rows, W=np.concatenate([D, rows.W], axis=2)).factors(weight)


# ---------------------------------------------------------------- random effects
#: Columns by which a joint may have a large torque of its position that no possible arm has, and their variances over
#: that of the joint's torque: springs and counterbalances are smooth, so that higher harmonics are small.
FREE = np.flatnonzero(GROUPS == 0)
FREE_SIZE = np.repeat(np.arange(1.0, tuning.POSITION_HARMONICS + 1), 2) ** -4.0
#: Names of the groups, for people.
GROUP_NAMES = ("position", "friction", "load")
#: Relative change of the logarithms of the sizes at which their slopes count as none.
SETTLED = 1e-12
#: Sizes of the groups without any model error.
NONE = np.full(len(GROUP_NAMES), tuning.RESIDUAL_NOTHING)
#: Change of the log evidence that tells nothing: a size without which it falls by less is none.
UNTOLD = 1e-4
#: Pivot of a Cholesky factor, of a matrix with a diagonal of ones, below which rounding has a say in its inverse.
SINGULAR = 1e-5


@dataclass(frozen=True)
class ModelError:
    """Random columns of each joint with their posterior; n joints, k columns, p parameters.

    Attributes:
        speed: rms speed of each joint in the fitted motion, (n,) [rad/s or m/s].
        reference: base parameters whose torque the column of the load scales with, (p,).
        scale: rms of each column in the fitted rows, (n, k).
        projection: B, the part of each column of unit rms that parameters describe over the workspace, (n, p, k).
        mean: posterior mean of b, (n, k) [N m or N].
        root: M_j with M_j M_j^T the covariance of b_j for known parameters, (n, k, k) [N m or N].
        slope: change of the mean of b_j by the parameters, (n, k, p).
        size: lambda of each group.
        rms: rms torque of each group, and of all together, on the fitted rows, (n, 4) [N m or N].
        evidence: gain of the log evidence by the model error.
        apart: how far the parameters of each joint's own may be from those of the arm, lambda_j; 0 of joints that
            agree with the others, (n,).
        own: what these parameters of a joint's own differ by, d, (n, p).
        own_root: M_j with M_j M_j^T the covariance of d for known parameters, (n, p, p).
        own_slope: change of d by the parameters, (n, p, p).
    """

    speed: Floats
    reference: Floats
    scale: Floats
    projection: Floats
    mean: Floats
    root: Floats
    slope: Floats
    size: Floats
    rms: Floats
    evidence: float
    apart: Floats
    own: Floats
    own_root: Floats
    own_slope: Floats

    @property
    def free(self) -> NDArray[np.intp]:
        """Numbers of the joints with a large torque of the position that no possible arm has."""
        return np.flatnonzero(~self.projection[:, :, FREE].any(axis=(1, 2)))

    def shapes_at(self, q: Floats, qd: Floats, observer: Observer) -> Floats:
        """Return ``shapes_of`` a motion without any filter, (N, n) each [rad or m, rad/s or m/s], (N, n, k)."""
        return shapes_of(q, qd, observer.coulomb_sign(qd), self.speed)

    def columns(self, W: Floats, shapes: Floats) -> Floats:
        """Return Z for a base regressor, (M, n, p), and the shapes there, (M, n, k)."""
        D = loaded(shapes, W @ self.reference)
        described = np.einsum("mjp,jpk->mjk", W, self.projection, optimize=True)
        return np.asarray(D / self.scale - described)

    def torque(self, W: Floats, shapes: Floats) -> Floats:
        """Return the mean torque of the model error for a base regressor and the shapes there, (M, n) [N m or N]."""
        D, (by_column, by_parameter) = loaded(shapes, W @ self.reference), self.mean_by_rows
        return np.asarray(
            np.einsum("mjk,jk->mj", D, by_column) + np.einsum("mjp,jp->mj", W, by_parameter)
        )

    @property
    def joints_apart(self) -> NDArray[np.intp]:
        """Numbers of the joints whose torques contradict those of the others."""
        return np.flatnonzero(self.apart)

    @property
    def mean_by_rows(self) -> tuple[Floats, Floats]:
        """The mean torque as a combination of D, (n, k), and of W, (n, p)."""
        return self.mean / self.scale, self.own - np.einsum(
            "jpk,jk->jp", self.projection, self.mean
        )

    def spread(self, j: int, W: Floats, root: Floats) -> Floats:
        """Return how far a joint's own parameters let its torques be off, by rows of W, (M, r).

        Args:
            j: number of the joint.
            W: its rows, (M, p), each with what its columns of the model error do by the parameters.
            root: of the covariance of the arm's parameters, (p, q).
        """
        if not self.apart[j]:
            return np.asarray(W @ root)
        return np.hstack([(W + W @ self.own_slope[j]) @ root, W @ self.own_root[j]])


def torque_variance(
    W: Floats, covariance: Floats, error: ModelError | None, shapes: Floats | None
) -> Floats:
    """Return the variance of predicted torques, noise not included, (M, n) [N^2 m^2 or N^2].

    Args:
        W: base regressor, (M, n, p).
        covariance: of the parameters, (p, p).
        error: the model error; None without.
        shapes: its columns there, (M, n, k).
    """
    root = symmetric_root(covariance)
    if error is None or shapes is None:
        return np.stack([np.sum((each @ root) ** 2, axis=1) for each in W.swapaxes(0, 1)], axis=1)
    found, Z = np.empty(W.shape[:2]), error.columns(W, shapes)
    for j in range(W.shape[1]):
        spread = error.spread(j, W[:, j] + Z[:, j] @ error.slope[j], root)
        found[:, j] = np.sum(spread**2, axis=1) + np.sum((Z[:, j] @ error.root[j]) ** 2, axis=1)
    return found


# ---------------------------------------------------------------- states
def exciting_speed(robot: Robot) -> Floats:
    """Return the rms speed of an exciting motion inside the limits, (n,) [rad/s or m/s]."""
    limits = [(joint.limits.velocity, joint.revolute) for joint in robot.joints]
    return np.array(
        [tuning.EXCITING_SPEED * v if v else tuning.FREE_SPEED[turns] for v, turns in limits]
    )


def random_states(
    robot: Robot, speed: Floats, count: int = tuning.RANDOM_STATES, seed: int = 0
) -> tuple[Floats, Floats, Floats]:
    """Return positions inside the limits with velocities and accelerations of the order of a motion, (count, n) each.

    Args:
        robot: the arm.
        speed: rms speed of each joint, (n,) [rad/s or m/s].
        count: number of states.
        seed: of the random draws.
    """
    rng = np.random.default_rng(seed)
    reach = [tuning.FREE_REACH[joint.revolute] for joint in robot.joints]
    limits = [j.limits.position or (-r, r) for j, r in zip(robot.joints, reach, strict=True)]
    low, high = np.array(limits, dtype=float).T
    q = rng.uniform(low, high, (count, robot.n))
    qd = rng.uniform(-2.0, 2.0, q.shape) * speed
    return q, qd, rng.uniform(-4.0, 4.0, q.shape) * speed


# ---------------------------------------------------------------- fit
@dataclass(frozen=True)
class Whitened:
    """Rows [Z W tau] of each joint as triangular factors, divided by noise and by what coloured residuals are worth.

    Attributes:
        factors: per joint, (n, k + p + 1, k + p + 1).
        noise: sigma of each joint, (n,) [N m or N].
        inflation: how many rows are worth one independent row.
        speed: rms speed of each joint, (n,) [rad/s or m/s].
        reference: base parameters, (p,).
        scale: rms of each column, (n, k).
        projection: B, (n, p, k).
        free: variance of the factors of columns that are free, in units of sigma^2, zero for all others, (n, k).
        apart: lambda of each joint: how far its own parameters may be from those of the arm, (n,).
        spread: L with L L^T = C, which lambda multiplies, (p, p).
    """

    factors: Floats
    noise: Floats
    inflation: float
    speed: Floats
    reference: Floats
    scale: Floats
    projection: Floats
    free: Floats
    apart: Floats
    spread: Floats

    def freed(self, joint: int) -> Whitened:
        """Return rows in which the columns of the position of one joint may be large and overlap with the parameters.

        Where a spring or a counterbalance is missing in the model, what the parameters can say of it asks for
        impossible links, so it must not be left to them.

        Args:
            joint: its number.
        """
        k, F, change = self.k, self.factors.copy(), np.eye(self.factors.shape[1])
        change[k:-1, FREE] = self.projection[joint][:, FREE]
        F[joint] = triangle(F[joint] @ change)
        projection, free = self.projection.copy(), self.free.copy()
        projection[joint][:, FREE] = 0.0
        torque = float(np.sum(F[joint][:, -1] ** 2)) / float(np.sum(F[joint][:, 0] ** 2))
        free[joint, FREE] = FREE_SIZE * torque / self.noise[joint] ** 2
        return replace(self, factors=F, projection=projection, free=free)

    def deviations(self, size: Floats) -> Floats:
        """Return the standard deviation of the factor of each column, (n, k) [N m or N], for sizes of the groups."""
        return np.sqrt(np.where(self.free > 0.0, self.free, size[GROUPS])) * self.noise[:, None]

    def centred(self, theta: Floats) -> Whitened:
        """Return rows of which theta is the estimate where there is no model error, (p,).

        Instruments find other parameters than least squares of the same rows; the model error must not undo that.
        """
        factors, others = self.factors.copy(), self.apart == 0.0
        factors[others] = centred(factors[others], self.k, theta)
        return replace(self, factors=factors)

    @property
    def k(self) -> int:
        """Number of columns per joint."""
        return int(self.scale.shape[1])

    def by_joint(self, size: Floats) -> list[tuple[Factor, Factor]]:
        """Return what each joint says of its parameters, and of its columns beside them, for sizes of the groups."""
        blocks = {"columns": self.k, "arm": self.factors.shape[2] - self.k - 1}
        return [
            Factor(F, blocks).prior("columns", sd).without("columns")
            for F, sd in zip(self.factors, self.deviations(size), strict=True)
        ]

    def of_arm(self, size: Floats) -> Factor:
        """Return what the rows say of the parameters of the arm, (p,), as a triangle, for sizes of the groups."""
        found = [
            next(left.released("arm", self.spread, [float(apart)]))[0] if apart else left
            for apart, (left, _) in zip(self.apart, self.by_joint(size), strict=True)
        ]
        total = reduce(add, found)
        return replace(total, rows=triangle(total.rows))


def whitened_rows(
    stack: Stack,
    base: BaseModel,
    reference: Floats,
    noise: Floats,
    inflation: float,
    prior_covariance: Floats,
    robust: Floats | None = None,
) -> Whitened:
    """Fold the rows of a stack with the columns of the model error into triangular factors; walks over the rows once.

    Reversals and spikes weigh as little as in the estimate: columns that say how friction depends on the speed would
    explain them with a friction that the arm does not have.

    Args:
        stack: the stacked logs.
        base: model and base parameters.
        reference: base parameters that give the torque of the load, (p,).
        noise: sigma of each joint, (n,) [N m or N].
        inflation: how many rows are worth one independent row.
        prior_covariance: of the base parameters before anything is measured, (p, p), in products of their units.
        robust: estimate from which residuals are spikes, (p,); None where it gave them their whole weight.
    """
    speed = rms_speed(stack.logs, len(stack.joints))
    factors = folded(stack, speed, reference, noise, robust)
    counts = np.maximum(stack.whole[1], 1)
    scale = np.linalg.norm(factors[:, :, : len(GROUPS)], axis=1) / np.sqrt(counts)[:, None]
    scale = np.where(scale > 1e-9, scale, 1.0)  # a joint without rows has no columns of unit size
    projection = _projection(base, stack.observer, speed, reference, scale)
    weight = 1.0 / (noise * np.sqrt(inflation))
    factors = _changed(factors, scale, projection) * weight[:, None, None]
    spread = symmetric_root(prior_covariance)
    none = np.zeros_like(scale), np.zeros(len(noise))
    return Whitened(factors, noise, inflation, speed, reference, scale, projection, *none, spread)


def centred(factors: Floats, k: int, theta: Floats) -> Floats:
    """Return factors [Z W tau] of which theta is the least-squares solution without Z, (n, m, k + p + 1)."""
    F = factors.copy()
    W, tau = F[:, :, k:-1].reshape(-1, len(theta)), F[:, :, -1].ravel()
    length = np.linalg.norm(W, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    found = np.linalg.lstsq(W / length, tau, rcond=1e-13)[0] / length
    F[:, :, -1] += F[:, :, k:-1] @ (theta - found)
    return F


def rows_under(
    stack: Stack, error: ModelError, whiten: Floats, noise: Floats, robust: Floats | None
) -> Floats:
    """Return factors [Z W tau] of each joint of any stack for a residual model found elsewhere, (n, m, k + p + 1).

    Args:
        stack: the stacked logs.
        error: the residual model.
        whiten: what rows are divided by, so that each counts as an independent one, (n,) [N m or N].
        noise: sigma of each joint, (n,) [N m or N].
        robust: estimate from which residuals are spikes, (p,); None where it gave them their whole weight.
    """
    factors = folded(stack, error.speed, error.reference, noise, robust)
    return _changed(factors, error.scale, error.projection) / whiten[:, None, None]


def squares(stack: Stack, theta: Floats, error: ModelError | None) -> Floats:
    """Return the sum of squared residuals of each joint on any rows, (n,) [N^2 m^2 or N^2].

    Args:
        stack: the rows.
        theta: base parameters, (p,).
        error: the model error whose mean is part of the prediction; None without.
    """
    if error is None:
        return np.asarray(np.sum((stack.whole[0] @ np.append(theta, -1.0)) ** 2, axis=1))
    left = np.where(stack.rows.use, residuals(stack, theta, error), 0.0)
    return np.asarray(np.sum(left**2, axis=0))


def residuals(stack: Stack, theta: Floats, error: ModelError | None) -> Floats:
    """Return what parameters, (p,), and the mean of a model error leave of all rows, (M, n) [N m or N]."""
    left = stack.rows.tau - stack.rows.torque(theta)
    if error is None:
        return left
    shapes = stack.along(lambda log: shapes_in(log, stack.observer, error.speed))
    return left - error.torque(stack.rows.W, shapes)


def _changed(factors: Floats, scale: Floats, projection: Floats) -> Floats:
    """Return factors of [Z W tau] from those of [D W tau]: Z is linear in D and W, so no row is looked at again."""
    found, k = np.empty_like(factors), scale.shape[1]
    for j, F in enumerate(factors):
        change = np.eye(F.shape[1])
        change[:k, :k] = np.diag(1.0 / scale[j])
        change[k:-1, :k] = -projection[j]
        found[j] = triangle(F @ change)
    return found


def _projection(
    base: BaseModel, observer: Observer, speed: Floats, reference: Floats, scale: Floats
) -> Floats:
    """Regress the columns on the parameters over random states inside the limits, (n, p, k).

    Their speeds are at least those of an exciting motion: what a joint that crawls leaves to the columns would grow
    with the speed of another motion without bounds.
    """
    q, qd, qdd = random_states(base.robot, np.maximum(speed, exciting_speed(base.robot)))
    W = observer.dense(q, qd, qdd)
    D = loaded(shapes_of(q, qd, observer.coulomb_sign(qd), speed), W @ reference)
    found = np.zeros((W.shape[1], W.shape[2], D.shape[2]))
    for j in range(W.shape[1]):
        seen = np.any(W[:, j] != 0.0, axis=0)
        found[j, seen] = np.linalg.lstsq(W[:, j, seen], D[:, j] / scale[j], rcond=1e-8)[0]
    return found


# ---------------------------------------------------------------- sizes, and joints that contradict the others
@dataclass(frozen=True)
class NormalPrior:
    """What is known of all parameters before anything is measured, as a normal distribution near a possible arm.

    Attributes:
        K: base parameters as combinations of all parameters, (p, c).
        x: all parameters, where it is approximated, (c,).
        hessian: of the price of the prior there, (c, c).
    """

    K: Floats
    x: Floats
    hessian: Floats

    @property
    def theta(self) -> Floats:
        """Base parameters, (p,)."""
        return self.K @ self.x

    def evidence(self, S: Floats) -> tuple[float, Floats, Floats]:
        """Return the log evidence of rows with the parameters integrated out, up to a constant, and their posterior.

        Args:
            S: [W tau]^T [W tau] of all rows, (p + 1, p + 1).

        Returns:
            The evidence; the base parameters, (p,); the root of their covariance, (p, c).
        """
        Sw, St, theta = S[:-1, :-1], S[:-1, -1], self.theta
        gradient = self.K.T @ (St - Sw @ theta)
        rest = float(S[-1, -1]) - 2.0 * float(theta @ St) + float(theta @ Sw @ theta)
        H = self.K.T @ Sw @ self.K + self.hessian
        scale = 1.0 / np.sqrt(np.maximum(np.diagonal(H), 1e-300))
        root, volume = _inverse_root(scale[:, None] * H * scale)
        weights = root.T @ (scale * gradient)
        evidence = -0.5 * (rest - float(weights @ weights)) + volume + float(np.sum(np.log(scale)))
        root = self.K @ (scale[:, None] * root)
        return evidence, theta + root @ weights, root


def log_evidence(rows: Whitened, prior: NormalPrior, size: Floats) -> tuple[float, Floats]:
    """Return the log evidence of sizes, up to a constant, and its slopes by their logarithms, (groups,).

    The columns and the parameters are integrated out; joints that are apart have no say. The slope is that of the
    expected log density of the columns' factors (Fisher's identity): half of the squares that the data expect of a
    group, in units of its size, beyond their number.

    Args:
        rows: rows of all joints.
        prior: of the parameters.
        size: lambda of each group, (groups,).
    """
    joints, sd = np.flatnonzero(rows.apart == 0.0), rows.deviations(size)
    each = rows.by_joint(size)
    total = sum(each[j][0].rows.T @ each[j][0].rows for j in joints)
    evidence, theta, root = prior.evidence(np.asarray(total))
    slope = np.zeros(len(size))
    for j in joints:
        left, columns = each[j][0], each[j][1].conditional
        evidence += left.volume
        squares = (columns.mean + columns.slope @ theta) ** 2
        for part in (columns.slope @ root, columns.root):
            squares += np.sum(part**2, axis=1)
        expected = np.where(rows.free[j] > 0.0, 0.0, squares / sd[j] ** 2 - 1.0)
        slope += 0.5 * np.bincount(GROUPS, expected, minlength=len(size))
    return evidence, slope


def best_size(rows: Whitened, prior: NormalPrior) -> Floats:
    """Return the sizes of the groups that make the data most likely, (groups,)."""
    from scipy.optimize import minimize, root  # here: their import takes as long as the search

    low, high = np.log([NONE, tuning.RESIDUAL_LARGEST])

    def negative(logs: Floats) -> tuple[float, Floats]:
        evidence, slope = log_evidence(rows, prior, np.exp(logs))
        return -evidence, -slope

    found = [
        minimize(
            negative,
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=np.c_[low, high],
        )
        for start in np.log(tuning.RESIDUAL_BEGIN)
    ]
    best = min(found, key=lambda each: each.fun)
    logs = best.x
    for k in range(len(logs)):
        without = np.where(np.arange(len(logs)) == k, low, logs)
        logs = without if negative(without)[0] <= best.fun + UNTOLD else logs
    inside = (logs > low) & (logs < high)

    def slopes(part: Floats) -> Floats:
        there = logs.copy()
        there[inside] = part
        return np.asarray(negative(there)[1][inside])

    # The evidence is flat beyond its rounding; where its slopes vanish is the same on every machine.
    if inside.any():
        level = root(slopes, logs[inside], tol=SETTLED).x
        if np.linalg.norm(slopes(level)) < np.linalg.norm(slopes(logs[inside])):
            logs[inside] = level
    return np.asarray(np.exp(logs))


def joints_apart(
    rows: Whitened, prior: NormalPrior, size: Floats, *, known: bool = False
) -> tuple[Floats, float]:
    """Return the lambda of each joint, 0 of those that agree with the others, (n,), and what the log evidence gains.

    One joint after the other is let apart, taken back or given another size, whatever makes the data most likely. What
    was apart before stays so: the prior is approximated where the others put the arm, and from there another one that
    agrees with all of them may seem near, which no possible arm is.

    Args:
        rows: rows of all joints.
        prior: of the parameters.
        size: lambda of each group of columns, (groups,).
        known: whether it is known which joints are apart, and only their sizes are asked for.
    """
    left, sizes = [each[0] for each in rows.by_joint(size)], np.append(0.0, tuning.APART_SIZES)
    whole = [[each for each, _ in one.released("arm", rows.spread, sizes)] for one in left]
    S = np.array([[one.rows.T @ one.rows for one in some] for some in whole])
    volume = np.array([[one.volume for one in some] for some in whole])
    told = rows.spread.T @ S[:, 0, :-1, :-1] @ rows.spread
    if np.linalg.norm(told, 2, axis=(1, 2)).max(initial=0.0) > tuning.APART_TOLD:
        return rows.apart, 0.0
    joints = np.arange(len(left))
    before = rows.apart > 0.0

    def worth(place: NDArray[np.intp]) -> float:
        if np.all(place):  # the last one has nobody left to contradict
            return -np.inf
        found = prior.evidence(S[joints, place].sum(axis=0))[0] + volume[joints, place].sum()
        return float(found) - tuning.APART_EVIDENCE * np.count_nonzero(place)

    place = np.searchsorted(sizes, rows.apart)
    none, best = worth(np.zeros_like(place)), worth(place)
    while True:
        others = [
            np.where(joints == j, k, place)
            for j in (np.flatnonzero(before) if known else joints)
            for k in range(int(before[j]), len(sizes))
        ]
        worths = [worth(other) for other in others]
        first = int(np.argmax(worths))
        if not worths[first] > best + tuning.APART_SETTLED:
            return sizes[place], best - none
        best, place = worths[first], others[first]


def _inverse_root(H: Floats) -> tuple[Floats, float]:
    """Return B with B B^T = H^-1, (c, c), and the logarithm of its determinant, of H with a diagonal of ones."""
    try:
        lower = np.linalg.cholesky(H)
        if np.min(np.diagonal(lower)) > SINGULAR:
            return np.asarray(np.linalg.inv(lower).T), -float(np.sum(np.log(np.diagonal(lower))))
    except np.linalg.LinAlgError:
        pass
    # Why eigenvalues, which take ten times as long: noise-free rows make H singular in double precision.
    value, vector = np.linalg.eigh(H)
    value = np.maximum(value, 1e-14)
    return np.asarray(vector / np.sqrt(value)), -0.5 * float(np.sum(np.log(value)))


def model_error(
    rows: Whitened, size: Floats, evidence: float, theta: Floats, counts: NDArray[np.int64]
) -> ModelError:
    """Return the model error that belongs to parameters.

    Args:
        rows: rows of all joints.
        size: lambda of each group.
        evidence: gain of the log evidence.
        theta: base parameters, (p,).
        counts: number of rows of each joint, (n,).
    """
    k, n, p = rows.k, len(counts), len(theta)
    own, own_root, own_slope = np.zeros((n, p)), np.zeros((n, p, p)), np.zeros((n, p, p))
    each = rows.by_joint(size)
    for j in np.flatnonzero(rows.apart):
        _, found = next(each[j][0].released("arm", rows.spread, [float(rows.apart[j])]))
        own[j] = found.mean + found.slope @ theta
        own_root[j], own_slope[j] = found.root, found.slope
    root, slope, mean = (
        np.array([getattr(columns.conditional, name) for _, columns in each])
        for name in ("root", "slope", "mean")
    )
    mean = mean + np.einsum("jkp,jp->jk", slope, theta + own)
    parts = np.stack([*(np.where(g == GROUPS, mean, 0.0) for g in range(len(size))), mean], axis=2)
    torque = np.linalg.norm(rows.factors[:, :, :k] @ parts, axis=1)
    rms = torque * (rows.noise * np.sqrt(rows.inflation / np.maximum(counts, 1)))[:, None]
    return ModelError(
        rows.speed,
        rows.reference,
        rows.scale,
        rows.projection,
        mean,
        root,
        slope,
        size,
        rms,
        evidence,
        rows.apart,
        own,
        own_root,
        own_slope,
    )
