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
Mask = NDArray[np.bool_]


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
    """Unknowns x: base parameters, friction and free parameters of the loaded log, log h of unknown gains.

    Attributes:
        rows: of all logs; the columns are those of the first q unknowns, and known torque. Torques are currents.
        known: gains, NaN where not, (n,).
    """

    rows: Rows
    known: Floats

    @property
    def q(self) -> int:
        return self.rows.size - 1

    @property
    def unknown(self) -> Ints:
        return np.flatnonzero(np.isnan(self.known))

    def inverse(self, x: Floats) -> Floats:
        """Return h, (n,)."""
        h = 1.0 / self.known
        h[self.unknown] = np.exp(x[self.q :])
        return h

    def linear(self, A: Floats, joint: int, x: Floats) -> tuple[Floats, Floats]:
        """Return the currents of a joint for rows (N, q + 1), (N,), and their derivative by x, (N, P)."""
        found = self.inverse(x)[joint] * A
        current = found @ np.append(x[: self.q], 1.0)
        return current, np.hstack([found[:, :-1], np.outer(current, self.unknown == joint)])


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
    relative = load is None and bool(np.isnan(known).all())
    p = len(stack.names)
    nothing = np.zeros((p, 1 if load is None else load.free.shape[1] + 1))
    logs = [(stack.rows, np.hstack([np.eye(p), nothing]))]
    if load is not None:
        logs.append((load.stack.rows, np.column_stack([np.eye(p), load.free, load.body])))
    rows = joined([replace(rows, W=rows.W @ change) for rows, change in logs])
    problem = _GainProblem(rows, known)
    x, sigma = _solve(problem)
    unknown, gain, error = problem.unknown, 1.0 / problem.inverse(x), np.zeros(len(known))
    variance, lost = _variances(problem, x, sigma, relative)
    if lost.any() and not relative:
        joints = ", ".join(stack.joints[k] for k in unknown[lost])
        raise RankDeficient(
            f"these logs do not determine the gain of {joints}",
            fix="move more joints at once and faster, or use a heavier load",
        )
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


def _solve(problem: _GainProblem) -> tuple[Floats, Floats]:
    """Return the unknowns and each joint's noise [A], by Gauss-Newton with weights from the residuals."""
    factors, counts = problem.rows.factors(), np.maximum(problem.rows.counts, 1)
    size = np.maximum(np.linalg.norm(factors[:, :, -1], axis=1), 1e-30)
    # All joints begin with torques of one size: that of those whose gain is known.
    told = np.delete(size * problem.known, problem.unknown)
    torque = float(np.median(told)) if len(told) else 1.0
    x = np.append(np.zeros(problem.q), np.log(size / torque)[problem.unknown])
    for step in range(tuning.GAINS_ROUNDS):
        found = [problem.linear(F[:, :-1], j, x) for j, F in enumerate(factors)]
        left = [F[:, -1] - fitted for F, (fitted, _) in zip(factors, found, strict=True)]
        sigma = np.maximum(np.linalg.norm(left, axis=1) / np.sqrt(counts), 1e-15)
        J = np.vstack([J / s for (_, J), s in zip(found, sigma, strict=True)])
        length = np.linalg.norm(J, axis=0)
        length = np.where(length > 0.0, length, 1.0)
        e = np.concatenate([e / s for e, s in zip(left, sigma, strict=True)])
        change = np.linalg.lstsq(J / length, e, rcond=tuning.GAINS_RANK)[0] / length
        largest = float(np.abs(change[problem.q :]).max(initial=0.0))
        x = x + change * min(1.0, tuning.GAINS_LONGEST_STEP / max(largest, 1e-12))
        if step > 1 and largest < tuning.GAINS_SETTLED:
            break
    return x, sigma


def _variances(
    problem: _GainProblem, x: Floats, sigma: Floats, relative: bool
) -> tuple[Floats, Mask]:
    """Return the variance of log h of each unknown gain, allowing for coloured residuals, and which are lost."""
    rows = problem.rows
    each = [problem.linear(rows.W[:, j], j, x) for j in range(len(sigma))]
    fitted, J = (np.stack(part, axis=1) for part in zip(*each, strict=True))
    W = (J * (rows.use / sigma)[:, :, None]).reshape(-1, len(x))
    information = W.T @ W
    length = np.sqrt(np.diagonal(information))
    length = np.where(length > 0.0, length, 1.0)
    values, axes = np.linalg.eigh(information / np.outer(length, length))
    kept = values > tuning.GAINS_RANK * values[-1]
    columns = axes[:, kept] / length[:, None]
    # What the solution leaves are the torques of the rows about it.
    rows = replace(rows, W=J @ columns, tau=rows.tau - fitted)
    inner = hac_covariance(rows, np.zeros(columns.shape[1]), sigma)
    spread = columns[problem.q :]
    if relative:
        spread = spread - spread.mean(axis=0)
    variance = np.maximum(np.sum((spread @ inner) * spread, axis=1), 0.0)
    return variance, np.abs(axes[problem.q :, ~kept]).max(axis=1, initial=0.0) > 1e-3
