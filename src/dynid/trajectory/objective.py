"""The search for a motion as one function of free variables: information along the whole path, cost, penalties.

The regressor is evaluated along the path, not at its waypoints: a well-conditioned set of waypoints says nothing about
the motion that joins them (docs/explanation/paper-map.md, Eq. 14).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dynid.model.effects.interface import State
from dynid.model.regressor import Model
from dynid.model.regressor_gradient import RegressorGradient
from dynid.trajectory.basis import Basis
from dynid.trajectory.cost import Cost
from dynid.trajectory.feasible import Bounds, Shaping

Floats = NDArray[np.float64]


class Penalty(Protocol):
    """Something a motion should keep away from."""

    def value(self, q: Floats) -> tuple[float, Floats]:
        """Return the penalty of positions, (N, n) [rad or m], and its gradient by them, (N, n)."""


@dataclass(frozen=True)
class PlanProblem:
    """What is to be planned.

    Attributes:
        model: the model of the arm.
        columns: the base parameters that will be identified, as indices of the model's columns, (p,).
        basis: family of motions.
        limits: limits with their margins.
        cost: what to make small.
        noise: standard deviation of each joint's torque, (n,); equal weights when None.
        known: information matrix of earlier logs, in the same noise and for ``rate``, (p, p); None without any.
        rate: sample rate of the coming log [Hz].
        torque: prior values of ``columns``, for the torque limits, (p,); None to leave torques out.
        penalties: obstacles.
        samples: samples along the path.
    """

    model: Model
    columns: NDArray[np.intp]
    basis: Basis
    limits: Bounds
    cost: Cost
    noise: Floats | None = None
    known: Floats | None = None
    rate: float = 100.0
    torque: Floats | None = None
    penalties: Sequence[Penalty] = ()
    samples: int = 200


def information(problem: PlanProblem, W: Floats) -> Floats:
    """Return the information matrix that a log of a motion will have, earlier logs included, (p, p).

    Args:
        problem: what is planned.
        W: the regressor at evenly spaced samples of the motion, (N, n, p) [N m per unit of each parameter].
    """
    weights = np.ones(W.shape[1]) if problem.noise is None else 1 / problem.noise
    rows = (W * weights[None, :, None]).reshape(-1, W.shape[2])
    G = rows.T @ rows * (problem.basis.duration * problem.rate / len(W))
    return G if problem.known is None else G + problem.known


class ExcitationObjective:
    """Cost and gradient of a problem as functions of free variables.

    Args:
        problem: what is planned.
    """

    def __init__(self, problem: PlanProblem) -> None:
        self.problem = problem
        # Why: samples in the middle of equal parts weigh the path evenly and miss its two motionless ends.
        t = problem.basis.duration * (np.arange(problem.samples) + 0.5) / problem.samples
        self.shaping = Shaping(problem.basis, problem.limits, t)
        self._regressor = RegressorGradient(problem.model, problem.columns, problem.samples)
        weights = np.ones(problem.model.robot.n) if problem.noise is None else 1 / problem.noise
        self._weights = weights**2 * (problem.basis.duration * problem.rate / problem.samples)

    def __call__(self, x: Floats, power: float = np.inf) -> tuple[float, Floats]:
        """Return cost plus penalties and the gradient by the free variables."""
        problem = self.problem
        motion = self.shaping.motion(x)
        W = self._regressor.dense(*motion)
        value, slope = problem.cost.value(information(problem, W), power)
        gW = 2 * self._weights[None, :, None] * (W.reshape(-1, W.shape[2]) @ slope).reshape(W.shape)
        if problem.torque is not None:
            extra, by_W = self._overload(W, problem.torque)
            value, gW = value + extra, gW + by_W
        gradient = self._regressor.gradient(gW)
        for penalty in problem.penalties:
            extra, by_q = penalty.value(motion[0])
            value, gradient = value + extra, State(gradient.q + by_q, gradient.qd, gradient.qdd)
        return value, self.shaping.gradient(gradient.q, gradient.qd, gradient.qdd)

    def _overload(self, W: Floats, theta: Floats) -> tuple[float, Floats]:
        """Return a penalty on torques beyond their limits and its gradient by W."""
        limit = self.problem.limits.torque
        excess = W @ theta / limit
        beyond = np.maximum(np.abs(excess) - 1, 0.0)
        slope = 2 * WEIGHT * beyond * np.sign(excess) / limit / len(W)
        return WEIGHT * float(np.sum(beyond**2)) / len(W), slope[:, :, None] * theta


#: Weight of penalties against a logarithmic cost: 1 % of overload all along the path costs as much as 1 % of condition.
WEIGHT = 100.0
