"""Gains of the drives, N m per A, from logs of motor currents.

Currents follow i_j = h_j W_j theta with h_j = 1 / gain_j: each joint's rows share the inertial parameters with other
joints, so the ratios of the gains are in any exciting log. Their common size is not: it takes a gain that is known, or
a second log with a load of known mass. Currents stay on the left, so their noise biases nothing.

Source: Gautier, Briot 2014, "Global identification of joint drive gains and dynamic parameters of robots" (the idea of
a known load); here solved by Gauss-Newton on triangular factors, friction free in each log.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

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
    """Unknowns x: base parameters, friction and free parameters of the loaded log, log h of unknown gains.

    Attributes:
        stacks: the logs.
        changes: what their columns are combined to, (p, q + 1) each: those of the first q unknowns, and known torque.
        known: gains, NaN where not, (n,).
    """

    stacks: tuple[Stack, ...]
    changes: tuple[Floats, ...]
    known: Floats

    @property
    def q(self) -> int:
        return len(self.changes[0].T) - 1

    @property
    def unknown(self) -> Ints:
        return np.flatnonzero(np.isnan(self.known))

    @cached_property
    def factors(self) -> list[tuple[Floats, Floats]]:
        """Rows of all logs in the combined columns, (m, q + 1), and their currents, (m,), joint by joint."""
        wholes = [stack.whole[0] for stack in self.stacks]
        return [
            (
                np.vstack([R[j][:, :-1] @ T for R, T in zip(wholes, self.changes, strict=True)]),
                np.concatenate([R[j][:, -1] for R in wholes]),
            )
            for j in range(len(self.known))
        ]

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
    logs = [(stack, np.hstack([np.eye(p), nothing]))]
    if load is not None:
        logs.append((load.stack, np.column_stack([np.eye(p), load.free, load.body])))
    stacks, changes = zip(*logs, strict=True)
    problem = _GainProblem(stacks, changes, known)
    x, sigma = _solve(problem, _first_guess(problem))
    h, unknown = problem.inverse(x), problem.unknown
    variance = _variances(problem, x, sigma, relative)
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


def _first_guess(problem: _GainProblem) -> Floats:
    """Solve W theta - gain i = 0 linearly for everything at once; noise makes the gains a little small."""
    size, rows, right = problem.q, [], []
    for j, (A, current) in enumerate(problem.factors):
        scale = 1.0 / max(float(np.linalg.norm(current)), np.finfo(float).tiny)
        gain, own = np.nan_to_num(problem.known[j]), problem.unknown == j
        rows.append(scale * np.hstack([A[:, :-1], -np.outer(current, own)]))
        right.append(scale * (gain * current - A[:, -1]))
    M, b = np.vstack(rows), np.concatenate(right)
    length = np.linalg.norm(M, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    if np.any(b):
        x = np.linalg.lstsq(M / length, b, rcond=tuning.GAINS_RANK)[0] / length
    else:
        # Why the currents' columns stay as they are: each has length 1, so no gain is preferred over another.
        x = np.linalg.svd(M / length)[2][-1] / length
    x = x * np.sign(np.sum(x[size:]) or 1.0)
    gains = x[size:]
    middle = float(np.median(np.abs(gains))) or 1.0
    return np.append(x[:size], -np.log(np.where(gains > 1e-3 * middle, gains, middle)))


def _solve(problem: _GainProblem, x: Floats) -> tuple[Floats, Floats]:
    """Return the unknowns and each joint's noise [A], by Gauss-Newton with weights from the residuals."""
    counts = np.maximum(sum(stack.whole[1] for stack in problem.stacks), 1)
    for step in range(tuning.GAINS_ROUNDS):
        found = [problem.linear(A, j, x) for j, (A, _) in enumerate(problem.factors)]
        pairs = zip(problem.factors, found, strict=True)
        left = [current - fitted for (_, current), (fitted, _) in pairs]
        sigma = np.sqrt(np.maximum([e @ e for e in left] / counts, 1e-30))
        J = np.vstack([J / s for (_, J), s in zip(found, sigma, strict=True)])
        e = np.concatenate([e / s for e, s in zip(left, sigma, strict=True)])
        length = np.linalg.norm(J, axis=0)
        length = np.where(length > 0.0, length, 1.0)
        change = np.linalg.lstsq(J / length, e, rcond=tuning.GAINS_RANK)[0] / length
        largest = float(np.abs(change[problem.q :]).max(initial=0.0))
        x = x + change * min(1.0, tuning.GAINS_LONGEST_STEP / max(largest, 1e-12))
        if step and largest < tuning.GAINS_SETTLED:
            break
    return x, sigma


def _linearised(problem: _GainProblem, x: Floats) -> Rows:
    """Return the rows of all logs about a solution, for the covariance; what it leaves are their torques."""
    found = []
    for stack, change in zip(problem.stacks, problem.changes, strict=True):
        rows = stack.rows
        A = rows.W @ change
        each = [problem.linear(A[:, j], j, x) for j in range(len(problem.known))]
        fitted, J = (np.stack(part, axis=1) for part in zip(*each, strict=True))
        found.append(replace(rows, columns=(J,), tau=rows.tau - fitted))
    return joined(found)


def _variances(problem: _GainProblem, x: Floats, sigma: Floats, relative: bool) -> Floats:
    """Return the variance of log h, allowing for coloured residuals, of each unknown gain, (count,)."""
    rows = _linearised(problem, x)
    J = (rows.W * (rows.use / sigma)[:, :, None]).reshape(-1, len(x))
    information = J.T @ J
    length = np.sqrt(np.diagonal(information))
    length = np.where(length > 0.0, length, 1.0)
    values, axes = np.linalg.eigh(information / np.outer(length, length))
    kept = values > tuning.GAINS_RANK * values[-1]
    lost = np.abs(axes[problem.q :, ~kept]).max(axis=1, initial=0.0) > 1e-3
    if lost.any() and not relative:
        joints = ", ".join(problem.stacks[0].joints[k] for k in problem.unknown[lost])
        raise RankDeficient(
            f"these logs do not determine the gain of {joints}",
            fix="move more joints at once and faster, or use a heavier load",
        )
    columns = axes[:, kept] / length[:, None]
    reduced = replace(rows, columns=(rows.W @ columns,))
    inner = hac_covariance(reduced, np.zeros(columns.shape[1]), sigma)
    spread = columns[problem.q :]
    if relative:
        spread = spread - spread.mean(axis=0)
    return np.asarray(np.maximum(np.sum((spread @ inner) * spread, axis=1), 0.0))
