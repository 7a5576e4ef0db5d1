"""Arms drawn from the posterior: possible bodies, friction, effects and what the residual model leaves, jointly.

Drawn is the normal posterior, cut off where a body stops being possible or friction being positive: a walk along
ellipses through the present arm and a fresh normal draw, which leaves that distribution as it is (elliptical slice
sampling; Murray, Adams, MacKay 2010). All draws walk together. Reads a result; writes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynid.arrays import Floats, Mask
from dynid.errors import WrongUsage
from dynid.estimation import tuning
from dynid.estimation.identified import Identified
from dynid.estimation.least_squares import symmetric_root
from dynid.estimation.possible_arm import constraints_of, objective_of
from dynid.estimation.possible_set import PhysicalConstraints, pseudo_inertia
from dynid.estimation.residual_model import SIZE

#: More arms than this are no sample any more but a load on the disk.
MOST = 100_000


@dataclass(frozen=True)
class Draws:
    """Arms drawn jointly from a posterior; D draws, c parameters, p base parameters, n joints, k residual columns.

    Attributes:
        result: what they were drawn from.
        names: parameters, (c,).
        x: their values, bodies possible, (D, c).
        residual: of each joint, factors of the residual model's columns, and what the parameters of one that
            contradicts the others differ by, (D, k) or (D, k + p) [N m or N; units of the parameters]; () without one.
        noise: rms of what repeats in no draw, such as noise and torques without a name, (n,) [N m or N].
        seed: of the draws.
    """

    result: Identified
    names: tuple[str, ...]
    x: Floats
    residual: tuple[Floats, ...]
    noise: Floats
    seed: int

    def __len__(self) -> int:
        """Return the number of draws."""
        return len(self.x)

    @property
    def theta(self) -> Floats:
        """Base parameters, (D, p)."""
        return self.x @ self.result.reduction.K.T

    def torques(self, q: Floats, qd: Floats, qdd: Floats, t: Floats | None = None) -> Floats:
        """Return the torques of a motion by each draw, without noise, (D, N, n) [N m or N].

        Args:
            q: positions, (N, n) [rad or m].
            qd: velocities, (N, n) [rad/s or m/s].
            qdd: accelerations, (N, n) [rad/s^2 or m/s^2].
            t: time, (N,) [s]; needed where the robot file lists effects.
        """
        result, error = self.result, self.result.model_error
        W = result.regressor(q, qd, qdd, t)
        tau = np.einsum("mjp,dp->dmj", W, self.theta, optimize=True)
        if error is not None:
            columns = error.columns(W, error.shapes_at(q, qd, result.base.observer))
            for j, b in enumerate(self.residual):
                tau[:, :, j] += b @ columns[:, j, : b.shape[1]].T
        return tau

    def band(
        self, q: Floats, qd: Floats, qdd: Floats, t: Floats | None = None, level: float = 0.9
    ) -> tuple[Floats, Floats]:
        """Return the torques between which a measured one lies with a probability, (N, n) each [N m or N].

        Args:
            q: positions, (N, n) [rad or m].
            qd: velocities, (N, n) [rad/s or m/s].
            qdd: accelerations, (N, n) [rad/s^2 or m/s^2].
            t: time, (N,) [s]; needed where the robot file lists effects.
            level: the probability.
        """
        rng = np.random.default_rng(self.seed)
        tau = self.torques(q, qd, qdd, t)
        tau += rng.normal(size=tau.shape) * self.noise
        low, high = np.quantile(tau, [0.5 - level / 2, 0.5 + level / 2], axis=0)
        return low, high

    def facts(self) -> dict[str, Any]:
        """Return ranges and correlations for those who randomise themselves, and the size of a random torque."""
        moving = np.flatnonzero(self.x.std(axis=0) > 0.0)
        correlation = np.corrcoef(self.x[:, moving], rowvar=False)
        ranges = np.quantile(self.x, [0.05, 0.5, 0.95], axis=0).tolist()
        error, names = self.result.model_error, self.result.robot.joint_names
        left = 0.0 * self.noise if error is None else error.rms[:, -1]
        return {
            "schema": "dynid/draws/1",
            "robot": self.result.robot.name,
            "seed": self.seed,
            "draws": len(self),
            "parameters": [
                {"name": name, "p05": low, "median": middle, "p95": high}
                for name, low, middle, high in zip(self.names, *ranges, strict=True)
            ],
            "correlated": [self.names[k] for k in moving],
            "correlation": np.round(correlation, 4).tolist(),
            "random_torque_nm": [
                {"joint": joint, "noise_rms": noise, "residual_model_rms": rms}
                for joint, noise, rms in zip(names, self.noise.tolist(), left.tolist(), strict=True)
            ],
        }


def draws(result: Identified, count: int, seed: int = 0) -> Draws:
    """Return arms drawn jointly from the posterior of a result.

    Args:
        result: the result.
        count: how many.
        seed: of the draws.

    Raises:
        WrongUsage: there are none, or too many.
        NotPhysical: the prior of the robot file is itself not physical.
    """
    if not isinstance(count, int) or not 1 <= count <= MOST:
        raise WrongUsage(f"{count!r} arms cannot be drawn", fix=f"a whole number from 1 to {MOST}")
    rng = np.random.default_rng(seed)
    physical, K = result.physical, result.reduction.K
    constraints = constraints_of(result.base)
    x = possible_draws(physical.x, symmetric_root(physical.covariance), constraints, count, rng)
    error, residual, moved = result.model_error, [], (x - physical.x) @ K.T
    if error is not None:
        for j, apart in enumerate(error.apart):
            size = None if apart else SIZE
            root, slope = error.root[j, :size, :size], error.slope[j, :size]
            z = rng.normal(size=(count, len(root)))
            residual.append(error.mean[j, :size] + moved @ slope.T + z @ root.T)
    return Draws(result, physical.names, x, tuple(residual), result.expected.noise, seed)


def possible_draws(
    x: Floats, root: Floats, constraints: PhysicalConstraints, count: int, rng: np.random.Generator
) -> Floats:
    """Return parameters from a normal distribution about possible ones, cut off at the possible set, (D, c).

    Args:
        x: possible parameters, (c,).
        root: A with A A^T the covariance, (c, c).
        constraints: the possible set.
        count: number of draws, D.
        rng: source of the draws.
    """
    free, bound = _apart(x, root, constraints)
    step = rng.normal(size=(count, free.shape[1])) @ free.T
    for _ in range(tuning.DRAW_TRIES):
        # A far draw of what hardly moves a wall is drawn nearer.
        step = np.where(_possible(x + step, constraints)[:, None], step, 0.5 * step)
    x, root, step = x + step, bound, np.zeros_like(step)
    for _ in range(tuning.DRAW_WALK):
        fresh = rng.normal(size=(count, root.shape[1])) @ root.T
        angle = rng.uniform(0.0, 2.0 * np.pi, count)
        low, high = angle - 2.0 * np.pi, angle.copy()
        left, after = np.arange(count), step.copy()
        for _ in range(tuning.DRAW_TRIES):
            tried = (
                np.cos(angle[left])[:, None] * step[left]
                + np.sin(angle[left])[:, None] * fresh[left]
            )
            good = _possible(x[left] + tried, constraints)
            after[left[good]] = tried[good]
            left = left[~good]
            if not len(left):
                break
            back = angle[left] < 0.0
            low[left[back]], high[left[~back]] = angle[left[back]], angle[left[~back]]
            angle[left] = rng.uniform(low[left], high[left])
        step = after
    return x + step


def _apart(x: Floats, root: Floats, constraints: PhysicalConstraints) -> tuple[Floats, Floats]:
    """Return directions of a root, (c, a) and (c, b): those by which no wall comes near, and the others.

    The measure is the barrier's: the sum of squares of the relative changes of second moments and positive numbers.
    """
    nothing, walls = np.zeros((0, len(x))), np.ones(len(constraints.h))
    barrier = replace(objective_of(nothing, nothing[:, 0], constraints, 1.0), mu=walls)
    near = barrier.curvature(*barrier.relative(x))
    values, vectors = np.linalg.eigh(root.T @ near @ root)
    free = np.cumsum(values) <= tuning.DRAW_FREE
    return root @ vectors[:, free], root @ vectors[:, ~free]


def _possible(x: Floats, constraints: PhysicalConstraints) -> Mask:
    """Return which parameters, (D, c), are inside the possible set, (D,)."""
    P = pseudo_inertia(x[:, constraints.bodies])
    # Why determinants: of matrices so small they take a quarter of the time of eigenvalues.
    minors = [P[..., 0, 0], *(np.linalg.det(P[..., :k, :k]) for k in (2, 3, 4))]
    bodies = np.all(np.stack(minors) > 0.0, axis=(0, 2))
    return bodies & np.all(x @ constraints.G.T >= constraints.h, axis=1)
