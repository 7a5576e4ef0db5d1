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

from dynid.arrays import Floats, Mask
from dynid.errors import RankDeficient, WrongUsage
from dynid.estimation import tuning
from dynid.estimation.factor import triangle
from dynid.estimation.least_squares import hac_covariance, solve
from dynid.estimation.payload import friction, last_link
from dynid.estimation.rows import Rows, joined
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel


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


def known_load(base: BaseModel, stack: Stack, mass: float | None) -> Rows:
    """Return the rows of a log with a load whose mass is known.

    Their columns are those of the base parameters, of friction, which may have changed since, and of the load's centre
    and inertia, which are unknown; the last one is the torque of its mass.

    Args:
        base: model and base parameters.
        stack: the log with the load.
        mass: of the load [kg].

    Raises:
        WrongUsage: it is not given.
    """
    if mass is None:
        raise WrongUsage("--loaded needs the mass of the load", fix="--load-mass KG")
    K = base.reduction.K[:, last_link(base)] * np.append(mass, np.ones(9))
    every = np.eye(len(K))
    W = stack.rows.W @ np.column_stack([every, every[:, friction(base)], K[:, 1:], K[:, 0]])
    return replace(stack.rows, W=W)


def find_gains(
    stack: Stack, known: Floats, load: Rows | None = None, scale_error: float = 0.0
) -> Gains:
    """Find the unknown gains, all positive.

    Args:
        stack: rows whose torques are currents [A].
        known: gains that are known, NaN where not, (n,) [N m per A].
        load: a second log with a load of known mass, from ``known_load``.
        scale_error: standard deviation of the known gains as a share, common to all: the others follow their size.

    Raises:
        RankDeficient: the logs do not determine the gains.
    """
    relative = load is None and bool(np.isnan(known).all())
    rows, others = stack.rows, 1 if load is None else load.size - stack.rows.size
    rows = replace(rows, W=np.pad(rows.W, ((0, 0), (0, 0), (0, others))))
    rows = rows if load is None else joined([rows, load])
    gain, variance, lost = _solved(rows, known, relative)
    if lost.any() and not relative:
        joints = ", ".join(np.array(stack.joints)[lost])
        raise RankDeficient(
            f"these logs do not determine the gain of {joints}",
            fix="move more joints at once and faster, or use a heavier load",
        )
    error = gain * np.sqrt(variance)
    if relative:
        size = float(np.exp(np.mean(np.log(gain))))
        gain, error = gain / size, error / size
    if not np.isnan(known).all():
        error = np.hypot(error, scale_error * gain)
    return Gains(gain, error, relative)


def _solved(rows: Rows, known: Floats, relative: bool) -> tuple[Floats, Floats, Mask]:
    """Return gains, the variance of the logarithm of each, and which of them are not determined, (n,) each.

    Gauss-Newton in the factors of the columns but the last, a known torque, and the logarithms of h, of which those
    that are known change nothing, with weights from the residuals. Variances allow for coloured residuals.
    """
    free, q = np.isnan(known), rows.size - 1
    factors, counts = rows.factors(), np.maximum(rows.counts, 1)

    def linear(A: Floats, x: Floats) -> tuple[Floats, Floats]:
        """Return currents for columns (n, N, q + 1), (n, N), and their derivative by the unknowns."""
        A = np.exp(x[q:])[:, None, None] * A
        current = A @ np.append(x[:q], 1.0)
        own = current[:, :, None] * np.diag(free)[:, None]
        return current, np.concatenate([A[:, :, :-1], own], axis=2)

    size = np.maximum(np.linalg.norm(factors[:, :, -1], axis=1), 1e-30)
    # All joints begin with torques of one size: that of those whose gain is known.
    torque = 1.0 if free.all() else np.median((size * known)[~free])
    x = np.append(np.zeros(q), np.log(np.where(free, size / torque, 1.0 / known)))
    for step in range(tuning.GAINS_ROUNDS):
        current, J = linear(factors[:, :, :-1], x)
        residual = factors[:, :, -1] - current
        sigma = np.maximum(np.linalg.norm(residual, axis=1) / np.sqrt(counts), 1e-15)
        whitened = np.concatenate([J, residual[:, :, None]], axis=2) / sigma[:, None, None]
        solution = solve(triangle(whitened.reshape(-1, len(x) + 1)))
        largest = float(np.abs(solution.theta[q:]).max(initial=0.0))
        x = x + solution.theta * min(1.0, tuning.GAINS_LONGEST_STEP / max(largest, 1e-12))
        if step > 1 and largest < tuning.GAINS_SETTLED:
            break
    current, J = (each.swapaxes(0, 1) for each in linear(rows.W.swapaxes(0, 1), x))
    # What the solution leaves are the torques of the rows about it.
    rows = replace(rows, W=J, tau=rows.tau - current)
    covariance = hac_covariance(rows, np.zeros(len(x)), sigma, bread=solution.inverse)[q:, q:]
    if relative:
        centred = np.eye(len(known)) - 1.0 / len(known)
        covariance = centred @ covariance @ centred
    weak = solution.weak * np.linalg.norm(whitened[:, :, :-1], axis=(0, 1))[:, None]
    lost = np.abs(weak[q:]).max(axis=1, initial=0.0) > 1e-3
    return np.where(free, np.exp(-x[q:]), known), np.maximum(np.diagonal(covariance), 0.0), lost
