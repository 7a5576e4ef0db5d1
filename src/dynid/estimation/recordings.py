"""How much less a recording tells than its rows seem to, because its parts disagree.

Residuals are coloured, and an estimate counts that as far as its covariance sees it: over a second or so. What the
model lacks lasts as long as the motion stays in one place, and what changes with time (warm gears, offsets of currents)
lasts longer. So the recording is cut into parts, and each part says by how much it would move the parameters; where
they move them further than independent rows would, rows are worth less. Source: Liang, Zeger 1986 (covariances from
clusters), averaged over the parameters, for a few parts alone tell little about each.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.residual_model import ModelError, rows_under
from dynid.estimation.stack import Stack

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


def disagreement(
    stack: Stack,
    theta: Floats,
    covariance: Floats,
    error: ModelError | None,
    noise: Floats,
    worth: float,
    told: Mask,
    robust: Floats | None,
) -> float:
    """Return how many times more the parts of recordings move the parameters than their rows let expect, at least 1.

    Args:
        stack: the fitted rows.
        theta: base parameters, (p,).
        covariance: theirs, (p, p).
        error: the residual model; None without.
        noise: sigma of each joint, (n,) [N m or N].
        worth: how many rows are worth one independent row, as far as the covariance counts it.
        told: which parameters come from the rows, (p,).
        robust: estimate from which residuals are spikes, (p,); None where it gave them their whole weight.
    """
    if not told.any():
        return 1.0
    X = _covariance(covariance, error)
    weight = np.append(np.zeros(len(X) - len(theta)), np.where(told, 1.0 / np.diagonal(covariance), 0.0))
    found = [1.0]
    for masks in _divisions(stack):
        parts = [_part(stack.select(mask), theta, error, noise, worth, robust) for mask in masks]
        moved = sum(float((X @ score) ** 2 @ weight) for score, _ in parts)
        usual = sum(float(np.sum(X * ((S - S @ X @ S) @ X), axis=0) @ weight) for _, S in parts)
        found.append(moved / max(usual, 1e-300))
    return min(max(found), tuning.LARGEST_INFLATION)


def _divisions(stack: Stack) -> list[list[Mask]]:
    """Return masks of the blocks of time of a stack, one for each part: quarters of each log, and whole logs."""
    logs = [np.flatnonzero(stack.log_of_block == log) for log in sorted(set(stack.log_of_block.tolist()))]
    parts = [part for log in logs for part in np.array_split(log, tuning.PARTS_OF_LOG) if len(part)]
    divisions = [parts, logs] if len(logs) > 1 else [parts]
    return [[np.isin(np.arange(stack.blocks), part) for part in each] for each in divisions if len(each) > 1]


def _covariance(covariance: Floats, error: ModelError | None) -> Floats:
    """Return the covariance of the residual model's factors and the parameters, (n k + p, n k + p)."""
    if error is None:
        return covariance
    n, k, p = error.slope.shape
    by_theta = np.concatenate([error.slope.reshape(n * k, p), np.eye(p)])
    found = np.asarray(by_theta @ covariance @ by_theta.T)
    for j, root in enumerate(error.root):
        found[j * k : j * k + k, j * k : j * k + k] += root @ root.T
    return found


def _part(
    stack: Stack, theta: Floats, error: ModelError | None, noise: Floats, worth: float, robust: Floats | None
) -> tuple[Floats, Floats]:
    """Return what rows say against the estimate, (n k + p,), and how much they say, (n k + p, n k + p)."""
    p, whiten = len(theta), noise * np.sqrt(worth)
    if error is None:
        factors = stack.whole[0] / whiten[:, None, None]
        A, left = factors[:, :, :-1], factors @ np.append(-theta, 1.0)
        return np.einsum("jmp,jm->p", A, left), np.einsum("jmp,jmq->pq", A, A)
    factors = rows_under(stack, error, whiten, noise, robust)
    n, k = error.mean.shape
    score, square = np.zeros(n * k + p), np.zeros((n * k + p, n * k + p))
    for j in np.flatnonzero(error.apart == 0.0):
        own = np.append(np.arange(j * k, j * k + k), np.arange(n * k, n * k + p))
        A = factors[j][:, :-1]
        score[own] += A.T @ (factors[j] @ np.concatenate([-error.mean[j], -theta, [1.0]]))
        square[np.ix_(own, own)] += A.T @ A
    return score, square
