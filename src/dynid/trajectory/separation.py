"""The motion for a gap search: it separates effects that earlier logs could not.

Two effects are separated when no parameters of the arm and of the second one can imitate the torque of the first: the
squares that are left of it, over the noise, are the lead in evidence that a log of the motion will give. Effects have
no gradient by the motion, so the best of many random motions is taken; limits hold by construction as in any other.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from dynid.arrays import Floats
from dynid.model.base_model import BaseModel
from dynid.model.effects.interface import Effect
from dynid.model.effects.motion import ArmMotion, Joints, Shape
from dynid.motion import Motion
from dynid.progress import advance
from dynid.trajectory import tuning
from dynid.trajectory.feasible import Shaping, coefficients, random_variables
from dynid.trajectory.objective import PlanProblem
from dynid.trajectory.optimise import End, SearchOutcome
from dynid.trajectory.options import PlanOptions
from dynid.trajectory.plan import Trajectory


@dataclass(frozen=True)
class Rivalry:
    """Two explanations that fitted equally well.

    Attributes:
        effect: the first.
        joints: where it sits.
        shape: its non-linear parameters.
        amplitudes: its linear ones, (k,).
        rival: the second, with whatever numbers imitate the first best.
        rival_joints: where that sits.
        text: both in words.
    """

    effect: Effect
    joints: Joints
    shape: Shape
    amplitudes: Floats
    rival: Effect
    rival_joints: Joints
    text: str


@dataclass(frozen=True)
class GapQuestion:
    """What a gap search left open.

    Attributes:
        rivalries: pairs that were not separated.
        noise: rms of each joint's torque noise after the filter of the search, (n,) [N m or N].
        theta: base parameters that effects scale with, (p,).
    """

    rivalries: tuple[Rivalry, ...]
    noise: Floats
    theta: Floats


def separation(base: BaseModel, question: GapQuestion, motion: Motion) -> tuple[float, ...]:
    """Return the lead in evidence of the first of each pair over the second that a log of a motion will give.

    Args:
        base: model and base parameters.
        question: what is open.
        motion: samples of the run.
    """
    seconds = float(motion.t[-1] - motion.t[0])
    weight = np.sqrt(tuning.INDEPENDENT_ROWS_A_SECOND * seconds / len(motion.t)) / question.noise
    reference = base.torques(question.theta)
    arm = ArmMotion(motion.t, motion.q, motion.qd, motion.qdd, base.robot, reference, lambda x: x)
    Q = _basis(_weighted(base.observer.dense(motion.q, motion.qd, motion.qdd), weight))
    return tuple(_lead(arm, pair, weight, Q) for pair in question.rivalries)


def _lead(arm: ArmMotion, pair: Rivalry, weight: Floats, Q: Floats) -> float:
    """Return the squares of the first explanation that neither the model nor the second can imitate."""
    columns = _rows(arm, pair.effect, pair.joints, pair.shape, weight)
    torque = columns @ pair.amplitudes
    left = torque - Q @ (Q.T @ torque)
    grid = pair.rival.grid(arm, pair.rival_joints)
    tried = grid[:: max(1, len(grid) // tuning.RIVAL_SHAPES)]
    best = float(left @ left)
    for shape in tried:
        rival = _rows(arm, pair.rival, pair.rival_joints, shape, weight)
        P = _basis(rival - Q @ (Q.T @ rival))
        rest = left - P @ (P.T @ left)
        best = min(best, float(rest @ rest))
    return best


def _rows(arm: ArmMotion, effect: Effect, joints: Joints, shape: Shape, weight: Floats) -> Floats:
    """Return the columns of an effect over the noise, sample by sample and joint by joint, (N n, k)."""
    columns = effect.columns(arm, joints, shape)
    rows = np.zeros((len(arm), arm.n, len(columns)))
    rows[:, list(effect.rows(joints, arm.n))] = columns.transpose(2, 1, 0)
    return _weighted(rows, weight)


def _weighted(columns: Floats, weight: Floats) -> Floats:
    """Return columns over the noise, (N, n, k), as rows, (N n, k)."""
    return (columns * weight[None, :, None]).reshape(-1, columns.shape[2])


def _basis(A: Floats) -> Floats:
    """Return an orthonormal basis of columns, (M, r)."""
    size = np.sqrt(np.einsum("mk,mk->k", A, A))
    kept = size > 0
    scaled = A[:, kept] / size[kept]
    values, V = np.linalg.eigh(scaled.T @ scaled)
    strong = values > tuning.WEAK_DIRECTION_SHARE * values.max(initial=1e-300)
    return scaled @ (V[:, strong] / np.sqrt(values[strong]))


# ---------------------------------------------------------------- search
def separate(
    problem: PlanProblem,
    base: BaseModel,
    question: GapQuestion,
    search: PlanOptions,
    limit: float,
) -> SearchOutcome:
    """Search for the motion that answers a gap search best; equal seeds give equal motions when it is not cut short.

    Args:
        problem: family of motions, limits, surroundings.
        base: model and base parameters.
        question: what is open.
        search: restarts, seed, speed factor.
        limit: time for the search [s].

    Raises:
        KeyboardInterrupt: interrupted before a motion was tried.
    """
    t = problem.basis.duration * (np.arange(tuning.RUN_SAMPLES) + 0.5) / tuning.RUN_SAMPLES
    shaping = Shaping(problem.basis, problem.limits, t)

    def cost(x: Floats) -> float:
        motion = Motion(t, *shaping.motion(x))
        penalty = 0.0 if problem.capsules is None else problem.capsules.value(motion.q)[0]
        return penalty - _worth(separation(base, question, motion.at_speed(search.alpha)))

    end, tried = time.monotonic() + limit, list[tuple[float, Floats]]()
    ended: End = "all starts"
    trials = tuning.TRIALS_A_START * search.restarts
    try:
        for trial in range(trials):
            rng = np.random.default_rng((search.seed, trial))
            x = random_variables(problem.basis, problem.limits, rng)
            tried.append((cost(x), x))
            if time.monotonic() > end:
                ended = "time"
                break
            advance(trial + 1, trials, f"motion {trial + 1}")
    except KeyboardInterrupt:
        if not tried:
            raise
        ended = "interrupt"
    best = sorted(tried, key=lambda one: one[0])[: search.restarts]
    candidates = (coefficients(problem.basis, problem.limits, x) for _, x in best)
    return SearchOutcome(tuple(candidates), len(tried) // tuning.TRIALS_A_START, ended)


def _worth(leads: tuple[float, ...]) -> float:
    """Return what the search makes large; the least counts, for one question answered well leaves the other open."""
    parts = np.log1p(leads)
    return float(parts.min() + 0.1 * parts.sum())


def run_of(trajectory: Trajectory) -> Motion:
    """Return a motion at the samples of its evaluation."""
    t = trajectory.duration * (np.arange(tuning.RUN_SAMPLES) + 0.5) / tuning.RUN_SAMPLES
    return trajectory.motion(t)
