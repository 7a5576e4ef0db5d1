"""Gains of the drives, N m per A, from logs of motor currents.

Currents follow i_j = h_j W_j theta with h_j = 1 / gain_j: each joint's rows share the inertial parameters with other
joints, so the ratios of the gains are in any exciting log. Their common size is not: it takes a gain that is known, or
a second log with a load of known mass. Currents stay on the left, so their noise biases nothing.

Source: Gautier, Briot 2014, "Global identification of joint drive gains and dynamic parameters of robots" (the idea of
a known load); here solved by Gauss-Newton on triangular factors, friction free in each log.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import RankDeficient, WrongUsage
from dynid.estimation import tuning
from dynid.estimation.covariance import hac_covariance
from dynid.estimation.payload import friction, last_link
from dynid.estimation.rows import Rows, joined
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]


@dataclass(frozen=True)
class Load:
    """What is known about the body on the last link in the second log.

    Attributes:
        stack: the second log.
        body: K_n phi, the change of the base parameters by what is known of the body, (p,).
        free: their change by each of its unknown parameters, and by friction, which may have changed since, (p, k).
    """

    stack: Stack
    body: Floats
    free: Floats


@dataclass(frozen=True)
class Gains:
    """Gains of all drives.

    Attributes:
        gain: (n,) [N m per A]; only their ratios, with geometric mean 1, when ``relative``.
        std_error: (n,); of those that were known what was said about them.
        relative: whether nothing told their common size.
    """

    gain: Floats
    std_error: Floats
    relative: bool


@dataclass(frozen=True)
class _GainProblem:
    """Unknowns x: base parameters, friction and free parameters of the loaded log, log h of unknown gains."""

    stacks: tuple[Stack, ...]
    body: Floats
    extra: Floats
    unknown: Ints

    @property
    def p(self) -> int:
        return len(self.body)

    def theta(self, x: Floats, log: int) -> Floats:
        """Return the base parameters of a log, (p,)."""
        return x[: self.p] + (
            self.body + self.extra @ x[self.p : self.p + self.extra.shape[1]] if log else 0.0
        )

    def jacobian(self, W: Floats, h: float, joint: int, x: Floats, log: int) -> Floats:
        """Return the derivative of h W theta by x for rows of one joint, (N, P)."""
        J = np.zeros((len(W), len(x)))
        J[:, : self.p] = h * W
        if log:
            J[:, self.p : self.p + self.extra.shape[1]] = h * (W @ self.extra)
        place = np.flatnonzero(self.unknown == joint)
        if len(place):
            J[:, len(x) - len(self.unknown) + place[0]] = h * (W @ self.theta(x, log))
        return J


def find_gains(
    stack: Stack, known: Floats, load: Load | None = None, scale_error: float = 0.0
) -> Gains:
    """Find the unknown gains, all positive.

    Args:
        stack: rows whose torques are currents [A].
        known: gains that are known, NaN where not, (n,) [N m per A].
        load: a second log with a load of known mass.
        scale_error: standard deviation of the known gains as a share, common to all: the others follow their size.

    Raises:
        RankDeficient: the logs do not determine the gains.
    """
    unknown = np.flatnonzero(np.isnan(known))
    relative = load is None and len(unknown) == len(known)
    p = len(stack.names)
    if load is None:
        problem = _GainProblem((stack,), np.zeros(p), np.zeros((p, 0)), unknown)
    else:
        problem = _GainProblem((stack, load.stack), load.body, load.free, unknown)
    x, sigma = _solve(problem, _first_guess(problem, known), known)
    h = _inverse_gains(problem, x, known)
    variance = _variances(problem, x, h, sigma, relative)
    gain, error = 1.0 / h, np.zeros(len(h))
    error[unknown] = gain[unknown] * np.sqrt(variance)
    if relative:
        size = float(np.exp(np.mean(np.log(gain))))
        gain, error = gain / size, error / size
    if len(unknown) < len(known):
        error = np.hypot(error, scale_error * gain)
    return Gains(gain, error, relative)


def known_load(base: BaseModel, stack: Stack, mass: float | None) -> Load:
    """Return a log with a load, and what is known about the load: its mass, or else the robot file's tool.

    Args:
        base: model and base parameters.
        stack: the log with the load.
        mass: mass of the load [kg]; its centre and inertia are then found with the gains. None for the tool.

    Raises:
        WrongUsage: nothing is known about the load.
    """
    K, tool = base.reduction.K[:, last_link(base)], base.robot.tool
    rubbing = np.eye(len(K))[:, friction(base)]
    if mass is not None:
        return Load(stack, K[:, 0] * mass, np.hstack([rubbing, K[:, 1:]]))
    if tool is None:
        raise WrongUsage(
            "--loaded needs the mass of the load",
            fix="--load-mass KG, or `tool:` in the robot file",
        )
    return Load(stack, K @ tool.parameters(), rubbing)


def _inverse_gains(problem: _GainProblem, x: Floats, known: Floats) -> Floats:
    h = 1.0 / known
    h[problem.unknown] = np.exp(x[len(x) - len(problem.unknown) :])
    return h


def _first_guess(problem: _GainProblem, known: Floats) -> Floats:
    """Solve W theta - gain i = 0 linearly for everything at once; noise makes the gains a little small."""
    n, size = len(known), problem.p + problem.extra.shape[1]
    rows, right = [], []
    for log, stack in enumerate(problem.stacks):
        factors = stack.whole[0]
        for j in range(n):
            A, current = factors[j][:, :-1], factors[j][:, -1]
            scale = 1.0 / max(float(np.linalg.norm(current)), np.finfo(float).tiny)
            block = np.zeros((len(A), size + n))
            block[:, : problem.p] = A
            if log:
                block[:, problem.p : size] = A @ problem.extra
            place = np.isnan(known[j])
            block[:, size + j] = -current if place else 0.0
            rows.append(scale * block)
            right.append(
                scale * ((0.0 if place else known[j]) * current - log * (A @ problem.body))
            )
    M, b = np.vstack(rows), np.concatenate(right)
    length = np.linalg.norm(M, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    if np.any(b):
        x = np.linalg.lstsq(M / length, b, rcond=tuning.GAINS_RANK)[0] / length
    else:
        # Why the currents' columns stay as they are: each has length 1, so no gain is preferred over another.
        x = np.linalg.svd(M / length)[2][-1] / length
    gains = x[size:] * np.sign(np.sum(x[size:]) or 1.0)
    middle = float(np.median(np.abs(gains[problem.unknown]))) or 1.0
    safe = np.where(gains > 1e-3 * middle, gains, middle)
    return np.concatenate(
        [x[:size] * np.sign(np.sum(x[size:]) or 1.0), -np.log(safe[problem.unknown])]
    )


def _solve(problem: _GainProblem, x: Floats, known: Floats) -> tuple[Floats, Floats]:
    """Return the unknowns and each joint's noise [A], by Gauss-Newton with weights from the residuals."""
    count = len(problem.unknown)
    for step in range(tuning.GAINS_ROUNDS):
        h = _inverse_gains(problem, x, known)
        rows, right, squares, number = [], [], np.zeros(len(h)), np.zeros(len(h))
        for log, stack in enumerate(problem.stacks):
            factors, counts = stack.whole
            for j, R in enumerate(factors):
                residual = R[:, -1] - h[j] * (R[:, :-1] @ problem.theta(x, log))
                rows.append(problem.jacobian(R[:, :-1], h[j], j, x, log))
                right.append(residual)
                squares[j] += residual @ residual
                number[j] += counts[j]
        sigma = np.sqrt(np.maximum(squares / np.maximum(number, 1), 1e-30))
        weights = np.tile(1.0 / sigma, len(problem.stacks))
        J = np.vstack([w * part for w, part in zip(weights, rows, strict=True)])
        e = np.concatenate([w * part for w, part in zip(weights, right, strict=True)])
        length = np.linalg.norm(J, axis=0)
        length = np.where(length > 0.0, length, 1.0)
        change = np.linalg.lstsq(J / length, e, rcond=tuning.GAINS_RANK)[0] / length
        largest = float(np.abs(change[len(x) - count :]).max(initial=0.0))
        x = x + change * min(1.0, tuning.GAINS_LONGEST_STEP / max(largest, 1e-12))
        if step and largest < tuning.GAINS_SETTLED:
            break
    return x, sigma


def _linearised(problem: _GainProblem, x: Floats, h: Floats) -> Rows:
    """Return the rows of all logs about a solution, for the covariance."""
    found = []
    for log, stack in enumerate(problem.stacks):
        rows, theta = stack.rows, problem.theta(x, log)
        each = [problem.jacobian(rows.W[:, j], h_j, j, x, log) for j, h_j in enumerate(h)]
        J = np.stack(each, axis=1)
        found.append(replace(rows, columns=(J,), tau=rows.tau - h * (rows.W @ theta) + J @ x))
    return joined(found)


def _variances(
    problem: _GainProblem, x: Floats, h: Floats, sigma: Floats, relative: bool
) -> Floats:
    """Return the variance of log h, allowing for coloured residuals, of each unknown gain, (count,)."""
    rows = _linearised(problem, x, h)
    J = (rows.W * (rows.use / sigma)[:, :, None]).reshape(-1, len(x))
    information = J.T @ J
    length = np.sqrt(np.diagonal(information))
    length = np.where(length > 0.0, length, 1.0)
    values, axes = np.linalg.eigh(information / np.outer(length, length))
    kept = values > tuning.GAINS_RANK * values[-1]
    count = len(problem.unknown)
    lost = np.abs(axes[len(x) - count :, ~kept]).max(axis=1, initial=0.0) > 1e-3
    if lost.any() and not relative:
        joints = ", ".join(problem.stacks[0].joints[k] for k in problem.unknown[lost])
        raise RankDeficient(
            f"these logs do not determine the gain of {joints}",
            fix="move more joints at once and faster, or use a heavier load",
        )
    columns = axes[:, kept] / length[:, None]
    reduced = replace(rows, columns=(rows.W @ columns,), tau=rows.residual(x))
    inner = hac_covariance(reduced, np.zeros(columns.shape[1]), sigma)
    spread = columns[len(x) - count :]
    if relative:
        spread = spread - spread.mean(axis=0)
    return np.asarray(np.maximum(np.sum((spread @ inner) * spread, axis=1), 0.0))
