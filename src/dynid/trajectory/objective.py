"""The search for a motion as one function of free variables: information along the whole path, cost, penalties.

The regressor is evaluated along the path, not at its waypoints: a well-conditioned set of waypoints says nothing about
the motion that joins them (docs/explanation/paper-map.md, Eq. 14).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.arrays import Floats, Ints
from dynid.model.regressor import Model
from dynid.model.regressor_gradient import RegressorGradient
from dynid.trajectory import tuning
from dynid.trajectory.basis import Quintic
from dynid.trajectory.clearance import Capsules
from dynid.trajectory.cost import Cost
from dynid.trajectory.feasible import Bounds, Shaping


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
        capsules: the arm and what it keeps away from; None for nothing.
        samples: samples along the path.
        narrow: limits of every other start, from the second on; those of the first when None.
    """

    model: Model
    columns: Ints
    basis: Quintic
    limits: Bounds
    cost: Cost
    noise: Floats | None = None
    known: Floats | None = None
    rate: float = 100.0
    torque: Floats | None = None
    capsules: Capsules | None = None
    samples: int = 200
    narrow: Bounds | None = None

    @property
    def weights(self) -> Floats:
        """Weights of the joints' torques, (n,)."""
        return np.ones(self.model.robot.n) if self.noise is None else 1 / self.noise

    def of_start(self, start: int) -> PlanProblem:
        """Return the problem as a start of the search sees it."""
        return self if self.narrow is None or start % 2 == 0 else replace(self, limits=self.narrow)


def information(problem: PlanProblem, W: Floats) -> Floats:
    """Return the information matrix that a log of a motion will have, earlier logs included, (p, p).

    Args:
        problem: what is planned.
        W: the regressor at evenly spaced samples of the motion, (N, n, p) [N m per unit of each parameter].
    """
    rows = (W * problem.weights[None, :, None]).reshape(-1, W.shape[2])
    G = rows.T @ rows * (problem.basis.duration * problem.rate / len(W))
    return G if problem.known is None else G + problem.known


@dataclass(frozen=True)
class Evaluation:
    """What the search gets of one motion.

    Attributes:
        value: cost plus eased penalties.
        gradient: of the value by the free variables, (size,).
        full: cost plus penalties in full, by which motions are compared.
    """

    value: float
    gradient: Floats
    full: float


class ExcitationObjective:
    """Cost and gradient of a problem as functions of free variables.

    Args:
        problem: what is planned.
    """

    def __init__(self, problem: PlanProblem) -> None:
        self.problem = problem
        # Why: samples in the middle of equal parts cover the path evenly and leave out its two motionless ends.
        fine = tuning.CONTACT_SAMPLES_A_SAMPLE * problem.samples
        t = problem.basis.duration * (np.arange(fine) + 0.5) / fine
        self.shaping = Shaping(problem.basis, problem.limits, t, refinement=2)
        self._regressor = RegressorGradient(problem.model, problem.columns, problem.samples)
        self._weights = problem.weights**2 * (
            problem.basis.duration * problem.rate / problem.samples
        )

    def __call__(self, x: Floats, power: float = np.inf, ease: float = 1.0) -> Evaluation:
        """Return cost and penalties of a motion.

        Args:
            x: free variables, (size,).
            power: p-norm of the cost, see ``Cost.value``.
            ease: factor on all penalties; small ones let a motion pass through things on its way to a good one.
        """
        problem = self.problem
        coarse = slice(tuning.MIDDLE_CONTACT_SAMPLE, None, tuning.CONTACT_SAMPLES_A_SAMPLE)
        motion = self.shaping.motion(x)
        W = self._regressor.dense(*(part[coarse] for part in motion))
        cost, slope = problem.cost.value(information(problem, W), power)
        gW = 2 * self._weights[None, :, None] * (W.reshape(-1, W.shape[2]) @ slope).reshape(W.shape)
        penalty = 0.0
        if problem.torque is not None:
            penalty, by_W = self._overload(W, problem.torque)
            gW = gW + ease * by_W
        by_motion = np.zeros((3, *motion[0].shape))
        by_motion[:, coarse] = self._regressor.gradient(gW)
        # Why: between two samples of the regressor an arm moves far enough to pass through its own wrist.
        if problem.capsules is not None:
            extra, by_q = problem.capsules.value(motion[0])
            penalty += extra
            by_motion[0] += ease * by_q
        return Evaluation(cost + ease * penalty, self.shaping.gradient(*by_motion), cost + penalty)

    def _overload(self, W: Floats, theta: Floats) -> tuple[float, Floats]:
        """Return a penalty on torques beyond their limits and its gradient by W."""
        limit = (1 - tuning.SPARE_TORQUE_SHARE) * self.problem.limits.torque
        excess = W @ theta / limit
        beyond = np.maximum(np.abs(excess) - 1, 0.0)
        slope = 2 * tuning.PENALTY_WEIGHT * beyond * np.sign(excess) / limit / len(W)
        return tuning.PENALTY_WEIGHT * float(np.sum(beyond**2)) / len(W), slope[:, :, None] * theta
