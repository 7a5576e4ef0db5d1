"""The motion for a gap search: it separates effects that earlier logs could not, or excites an unexplained residual.

Two effects are separated when no parameters of the arm and of the second one can imitate the torque of the first: the
squares that are left of it, over the noise, are the lead in evidence that a log of the motion will give. Of what is
unexplained nothing is known but its joint, so the motion shall determine many general columns of that joint well.
Effects have no gradient by the motion, so the search climbs by trials; limits hold by construction as in any other.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from dynid.arrays import Floats
from dynid.model.base_model import BaseModel, model_torques
from dynid.model.effects.interface import Effect
from dynid.model.effects.motion import ArmMotion, Joints, Shape
from dynid.motion import Motion
from dynid.progress import advance
from dynid.trajectory import tuning
from dynid.trajectory.feasible import Shaping, bounds, coefficients, random_variables
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
        unexplained: joints with more left than noise, 0-based.
        noise: rms of each joint's torque noise after the filter of the search, (n,) [N m or N].
        theta: base parameters that effects scale with, (p,).
    """

    rivalries: tuple[Rivalry, ...]
    unexplained: tuple[int, ...]
    noise: Floats
    theta: Floats


@dataclass(frozen=True)
class Separation:
    """What a log of a motion will tell.

    Attributes:
        leads: lead in evidence of the first of each pair over the second; 12 is beyond doubt.
        spread: how well the general columns of unexplained joints are determined, as the logarithm of the mean signal
            over noise; None where nothing is unexplained.
    """

    leads: tuple[float, ...]
    spread: float | None

    @property
    def value(self) -> float:
        """What the search makes large."""
        parts = np.log1p(self.leads).tolist() + [self.spread] * (self.spread is not None)
        # Why the least: a motion that answers one question well leaves the other open.
        return float(min(parts) + 0.1 * sum(parts))


def separation(base: BaseModel, question: GapQuestion, motion: Motion) -> Separation:
    """Return what a log of a motion will tell.

    Args:
        base: model and base parameters.
        question: what is open.
        motion: samples of the run.
    """
    seconds = float(motion.t[-1] - motion.t[0])
    weight = np.sqrt(tuning.INDEPENDENT_ROWS_A_SECOND * seconds / len(motion.t)) / question.noise
    reference = model_torques(base.model, base.reduction, question.theta)
    arm = ArmMotion(motion.t, motion.q, motion.qd, motion.qdd, base.robot, reference, lambda x: x)
    Q = _basis(_weighted(base.observer.dense(motion.q, motion.qd, motion.qdd), weight))
    leads = tuple(_lead(arm, pair, weight, Q) for pair in question.rivalries)
    return Separation(leads, _spread(arm, question, weight, Q))


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


def _spread(arm: ArmMotion, question: GapQuestion, weight: Floats, Q: Floats) -> float | None:
    """Return how well general columns of unexplained joints are determined when fitted jointly with the model."""
    if not question.unexplained:
        return None
    values = []
    for j in question.unexplained:
        made = general_columns(arm, j)
        columns = np.zeros((len(arm), arm.n, len(made)))
        # Why: each column as large as the noise on usual motion, so that none counts for its unit.
        size = usual_sizes(arm, j)
        columns[:, j] = (made / np.where(size > 0, size, 1.0)[:, None] * question.noise[j]).T
        C = _weighted(columns, weight)
        C = C - Q @ (Q.T @ C)
        values.append(float(np.mean(np.log1p(np.maximum(np.linalg.eigvalsh(C.T @ C), 0.0)))))
    return min(values)


def usual_sizes(arm: ArmMotion, joint: int) -> Floats:
    """Return the rms of general columns over poses and speeds at random inside the limits, (K,)."""
    limits = bounds(arm.robot)
    rng = np.random.default_rng(0)
    q = rng.uniform(
        np.maximum(limits.lower, -np.pi),
        np.minimum(limits.upper, np.pi),
        (tuning.USUAL_STATES, arm.n),
    )
    qd, qdd = (
        rng.uniform(-0.5, 0.5, q.shape) * most for most in (limits.velocity, limits.acceleration)
    )
    usual = replace(arm, t=np.arange(tuning.USUAL_STATES, dtype=float), q=q, qd=qd, qdd=qdd)
    return np.asarray(np.sqrt(np.mean(general_columns(usual, joint) ** 2, axis=1)))


def general_columns(arm: ArmMotion, joint: int) -> Floats:
    """Return columns of what a joint's torque may follow, its own motion and its neighbours', (K, N)."""
    near = [k for k in (joint, joint - 1, joint + 1) if 0 <= k < arm.n]
    q, qd = arm.q[:, joint], arm.qd[:, joint]
    columns = [
        np.abs(qd),
        qd**2,
        qd * np.abs(qd),
        arm.rigid[:, joint] * qd,
        np.abs(arm.rigid[:, joint]) * np.sign(qd),
    ]
    for h in range(1, tuning.GENERAL_HARMONICS + 1):
        for wave in (np.sin(h * q), np.cos(h * q)):
            columns += [wave, wave * np.sign(qd), wave * qd]
    for k in near[1:]:
        columns += [
            arm.qd[:, k],
            qd * arm.qd[:, k],
            np.abs(arm.qd[:, k]),
            np.sin(arm.q[:, k]),
            arm.rigid[:, k],
        ]
    return np.array(columns)


def _basis(A: Floats) -> Floats:
    """Return an orthonormal basis of columns, (M, r)."""
    size = np.sqrt(np.einsum("mk,mk->k", A, A))
    kept = size > 0
    scaled = A[:, kept] / size[kept]
    values, V = np.linalg.eigh(scaled.T @ scaled)
    strong = values > tuning.WEAK_DIRECTION_SHARE * values.max(initial=1e-300)
    return np.asarray(scaled @ (V[:, strong] / np.sqrt(values[strong])))


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
        KeyboardInterrupt: interrupted before a start was done.
    """
    t = problem.basis.duration * (np.arange(tuning.RUN_SAMPLES) + 0.5) / tuning.RUN_SAMPLES
    shaping = Shaping(problem.basis, problem.limits, t)

    def cost(x: Floats) -> float:
        motion = Motion(t, *shaping.motion(x))
        penalty = 0.0 if problem.capsules is None else problem.capsules.value(motion.q)[0]
        return penalty - separation(base, question, motion.at_speed(search.alpha)).value

    def climb(rng: np.random.Generator) -> tuple[float, Floats]:
        """Return the best of so many trials, each near the best before it."""
        best = random_variables(problem.basis, problem.limits, rng)
        least, step = cost(best), tuning.FIRST_STEP
        for _ in range(tuning.TRIALS_A_START - 1):
            if time.monotonic() > end:
                break
            x = best + step * random_variables(problem.basis, problem.limits, rng)
            value = cost(x)
            if value < least:
                best, least, step = x, value, min(step * tuning.STEP_GROWTH, 1.0)
            else:
                step = max(step * tuning.STEP_DECAY, tuning.LEAST_STEP)
        return least, best

    end = time.monotonic() + limit
    climbs = []
    ended: End = "all starts"
    finished = 0
    try:
        while finished < search.restarts and ended == "all starts":
            climbs.append(climb(np.random.default_rng((search.seed, finished))))
            if time.monotonic() > end:
                ended = "time"
            else:
                finished += 1
                advance(finished, search.restarts, f"start {finished}")
    except KeyboardInterrupt:
        if not climbs:
            raise
        ended = "interrupt"
    best = sorted(climbs, key=lambda one: one[0])
    return SearchOutcome(
        tuple(coefficients(problem.basis, problem.limits, x) for _, x in best), finished, ended
    )


def run_of(trajectory: Trajectory) -> Motion:
    """Return a motion at the samples of its evaluation."""
    t = trajectory.duration * (np.arange(tuning.RUN_SAMPLES) + 0.5) / tuning.RUN_SAMPLES
    return trajectory.motion(t)
