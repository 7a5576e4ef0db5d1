"""What a motion will teach, before it runs: standard errors, expected torque error, and what slowing down costs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.arrays import Floats, Mask
from dynid.model.base_model import BaseModel
from dynid.motion import Motion
from dynid.robot import Robot
from dynid.trajectory import tuning
from dynid.trajectory.basis import Sines
from dynid.trajectory.cost import FLOOR, Figures, figures
from dynid.trajectory.feasible import Bounds, Shaping, random_variables
from dynid.trajectory.plan import Trajectory


def default_noise(robot: Robot) -> Floats:
    """Return the torque noise of each joint: the robot file's, or what is assumed without one, (n,) [N m or N]."""
    if robot.torque.noise is not None:
        return np.array(robot.torque.noise)
    share, otherwise = tuning.NOISE_SHARE_OF_RATING, tuning.NOISE_WITHOUT_RATING
    return share * robot.limits("torque", otherwise / share)


@dataclass(frozen=True)
class Prediction:
    """What a log of a motion will tell.

    Attributes:
        figures: condition numbers and smallest singular value of W, unweighted.
        std_error: standard error of each base parameter, (p,); infinity where the motion does not determine it.
        torque_error: expected rms torque error on other motions, mean of all joints [N m].
    """

    figures: Figures
    std_error: Floats
    torque_error: float


def predict(
    base: BaseModel,
    motion: Motion,
    noise: Floats,
    other: Floats,
    known: Floats | None = None,
) -> Prediction:
    """Predict the errors of weighted least squares on a log of a motion.

    Args:
        base: model and base parameters.
        motion: the motion at the samples of the log.
        noise: standard deviation of each joint's torque, white, (n,) [N m or N].
        other: mean of P^T P over the motions to predict, (p, p), from ``held_out``.
        known: information matrix of earlier logs; None without any.
    """
    raw, weighted = information_of(base, motion, noise)
    total = weighted if known is None else weighted + known
    covariance, seen = _inverse(total)
    std_error = np.where(seen, np.sqrt(np.maximum(np.diag(covariance), 0.0)), np.inf)
    error = np.sqrt(np.sum(other * covariance) / base.robot.n) if seen.all() else np.inf
    return Prediction(figures(raw), std_error, float(error))


def information_of(base: BaseModel, motion: Motion, noise: Floats) -> tuple[Floats, Floats]:
    """Return W^T W of a motion, unweighted and in units of the noise, (p, p) each.

    Args:
        base: model and base parameters.
        motion: the motion at the samples of the log.
        noise: standard deviation of each joint's torque, (n,) [N m or N].
    """
    raw, weighted = np.zeros((2, base.rank, base.rank))
    for start in range(0, len(motion), 1000):
        part = slice(start, start + 1000)
        P = base.observer.dense(motion.q[part], motion.qd[part], motion.qdd[part])
        joints = np.einsum("kjp,kjq->jpq", P, P, optimize=True)
        raw += joints.sum(axis=0)
        weighted += np.einsum("jpq,j->pq", joints, 1 / noise**2)
    return raw, weighted


def _inverse(G: Floats) -> tuple[Floats, Mask]:
    """Return the inverse of a column-scaled information matrix and which parameters it determines."""
    s = 1 / np.sqrt(np.maximum(np.diag(G), np.finfo(float).tiny))
    values, U = np.linalg.eigh(G * np.outer(s, s))
    good = values > max(FLOOR * 100, 1e-13) * values[-1]
    seen = np.all(np.abs(U[:, ~good]) < 1e-6, axis=1) & (np.diag(G) > 0)
    inverse = (U[:, good] / values[good]) @ U[:, good].T
    # Why: a parameter that the motion does not show has a huge scale; its entries are not used.
    with np.errstate(over="ignore", invalid="ignore"):
        return inverse * np.outer(s, s), seen


def held_out(
    base: BaseModel,
    limits: Bounds,
    seed: int = 0,
    motions: int = tuning.OTHER_MOTIONS,
) -> Floats:
    """Return the mean of P^T P over random motions inside the limits that the model shall predict, (p, p) [(N m)^2]."""
    basis = Sines(tuning.OTHER_DURATION_S, tuning.OTHER_HARMONICS)
    t = tuning.OTHER_DURATION_S * (np.arange(200) + 0.5) / 200
    shaping = Shaping(basis, limits, t)
    total = np.zeros((base.rank, base.rank))
    for k in range(motions):
        x = random_variables(basis, limits, np.random.default_rng((seed, 1000 + k)))
        W = base.observer.dense(*shaping.motion(x))
        rows = W.reshape(-1, base.rank)
        total += rows.T @ rows / len(W)
    return total / motions


@dataclass(frozen=True)
class AlphaRow:
    """One row of the table of speed factors.

    Attributes:
        alpha: speed factor.
        duration: length of the run [s].
        torque_error: expected rms torque error on other motions [N m].
        condition: condition number of W.
        condition_scaled: the same with columns of equal length.
    """

    alpha: float
    duration: float
    torque_error: float
    condition: float
    condition_scaled: float


def alpha_table(
    trajectory: Trajectory,
    base: BaseModel,
    noise: Floats,
    other: Floats,
    samples: int,
    known: Floats | None = None,
) -> tuple[AlphaRow, ...]:
    """Return what each speed factor costs, for logs of equally many samples as the motion at full speed has.

    A slower run of the same rate has more samples; they hardly help, since what it does not show it shows nowhere.

    Args:
        trajectory: the motion; its own speed factor is in the table as well.
        base: model and base parameters.
        noise: standard deviation of each joint's torque in one sample, white, (n,) [N m or N].
        other: mean of P^T P over the motions to predict, (p, p), from ``held_out``.
        samples: number of samples of the log at full speed.
        known: information matrix of earlier logs; None without any.
    """
    count = tuning.ALPHA_TABLE_SAMPLES
    # Why: fewer samples show the same of a motion, and count for as many as the log has.
    noise = noise * np.sqrt(tuning.ALPHA_TABLE_SAMPLES / samples)
    rows = []
    for alpha in sorted({*tuning.RECOMMENDED_ALPHAS, trajectory.alpha}):
        slowed = trajectory.slowed(alpha)
        motion = slowed.motion(slowed.duration * (np.arange(count) + 0.5) / count)
        prediction = predict(base, motion, noise, other, known)
        rows.append(
            AlphaRow(
                alpha,
                slowed.duration,
                prediction.torque_error,
                prediction.figures.condition,
                prediction.figures.condition_scaled,
            )
        )
    return tuple(rows)
