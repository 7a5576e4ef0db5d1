"""How much less a recording tells than its rows seem to: its parts disagree, and other recordings will differ from it.

Residuals are coloured, and an estimate counts that as far as its covariance sees it: over a second or so. What the
model lacks lasts as long as the motion stays in one place, and what changes with time (warm gears, offsets of currents)
lasts longer. So the recording is cut into parts, and each part says by how much it would move the parameters; where
they move them further than independent rows would, rows are worth less. Source: Liang, Zeger 1986 (covariances from
clusters), averaged over the parameters, for a few parts alone tell little about each.

Offsets and the level of friction are known to differ from one recording to the next, which no part of one recording
shows. What wanders a little within the recording wanders further between two: the offset of each joint, as a share of
its Coulomb friction, and the level of its friction have a size that all joints share, and parts and recordings tell it
together. Source: random effects whose size has a half-t prior (Gelman 2006).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.residual_model import ModelError, rows_under
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Part:
    """Rows of some seconds of a recording, whitened.

    Attributes:
        log: number of the recording.
        grams: of [Z W left] of each joint, where left is what the estimate leaves, (n, k + p + 1, k + p + 1).
    """

    log: int
    grams: Floats


def parts_of(
    stack: Stack,
    theta: Floats,
    error: ModelError | None,
    noise: Floats,
    worth: float,
    robust: Floats | None,
) -> list[Part]:
    """Return what each quarter of each recording says; joints that are apart have no say.

    Args:
        stack: the fitted rows.
        theta: base parameters, (p,).
        error: the residual model; None without.
        noise: sigma of each joint, (n,) [N m or N].
        worth: how many rows are worth one independent row, as far as the covariance counts it.
        robust: estimate from which residuals are spikes, (p,); None where it gave them their whole weight.
    """
    whiten, found = noise * np.sqrt(worth), []
    for log in range(len(stack.logs)):
        of_log = np.unique(stack.rows.block[stack.rows.log == log])
        for blocks in np.array_split(of_log, tuning.PARTS_OF_LOG):
            if len(blocks):
                part = stack.take(np.isin(stack.rows.block, blocks))
                if error is None:
                    rows, b = part.whole[0] / whiten[:, None, None], np.zeros((len(noise), 0))
                else:
                    rows = rows_under(part, error, whiten, noise, robust)
                    rows, b = rows * (error.apart == 0.0)[:, None, None], error.mean
                estimate = np.hstack([b, np.tile(theta, (len(b), 1))])
                rows[:, :, -1] -= np.einsum("jmk,jk->jm", rows[:, :, :-1], estimate)
                found.append(Part(log, rows.swapaxes(1, 2) @ rows))
    return found


def disagreement(
    parts: list[Part], covariance: Floats, error: ModelError | None, told: Mask
) -> float:
    """Return how many times more the parts of recordings move the parameters than their rows let expect, at least 1.

    Args:
        parts: quarters of recordings.
        covariance: of the parameters, (p, p).
        error: the residual model; None without.
        told: which parameters come from the rows, (p,).
    """
    weight = np.where(told, 1.0 / np.diagonal(covariance), 0.0)
    numbers = sorted({part.log for part in parts})
    logs = [[part for part in parts if part.log == log] for log in numbers]
    found = [1.0]
    for each in ([[part] for part in parts], logs):
        sums = [_told(np.sum([part.grams for part in some], axis=0), error) for some in each]
        if len(sums) > 1 and told.any():
            moved = sum(float((covariance @ score) ** 2 @ weight) for score, _, _ in sums)
            usual = sum(
                float(
                    np.sum(covariance * ((S - taken - S @ covariance @ S) @ covariance), axis=0)
                    @ weight
                )
                for _, S, taken in sums
            )
            found.append(moved / max(usual, 1e-300))
    return min(max(found), tuning.LARGEST_INFLATION)


def _told(grams: Floats, error: ModelError | None) -> tuple[Floats, Floats, Floats]:
    """Return what rows say against the parameters, (p,), how much, and how much of it columns may take, (p, p) each.

    When the parameters move, the columns of the residual model follow them.
    """
    if error is None:
        S = grams.sum(axis=0)
        return S[:-1, -1], S[:-1, :-1], 0.0 * S[:-1, :-1]
    n, k, p = error.slope.shape
    T = np.concatenate([error.slope, np.broadcast_to(np.eye(p), (n, p, p))], axis=1)
    G = T.swapaxes(1, 2) @ grams[:, :-1]
    taken = G[:, :, :k] @ error.root
    return (
        G[:, :, -1].sum(axis=0),
        (G[:, :, :-1] @ T).sum(axis=0),
        (taken @ taken.swapaxes(1, 2)).sum(axis=0),
    )


# ---------------------------------------------------------------- what differs between recordings
def changes(parts: list[Part], base: BaseModel, theta: Floats) -> Floats:
    """Return A with A A^T what other recordings will add to the covariance of the parameters, (p, 2 n).

    Args:
        parts: quarters of recordings.
        base: model and base parameters.
        theta: base parameters, (p,).
    """
    directions = _directions(base, theta)
    count = len({part.log for part in parts})
    found = [column * np.sqrt(_variance(parts, column) / count) for column in directions]
    return np.concatenate(found, axis=1)


def _directions(base: BaseModel, theta: Floats) -> tuple[Floats, Floats]:
    """Return how offsets, and levels of friction, change the parameters, (p, n) each: one column for each joint."""
    place = {name: k for k, name in enumerate(base.names)}
    offset, level = np.zeros((2, len(theta), base.robot.n))
    for j in range(base.robot.n):
        coulomb, viscous, shift = (place.get(f"{kind}{j + 1}") for kind in ("fc", "fv", "fo"))
        if coulomb is not None and shift is not None:
            offset[shift, j] = abs(theta[coulomb])
        for k in (coulomb, viscous):
            if k is not None:
                level[k, j] = theta[k]
    return offset, level


def _variance(parts: list[Part], directions: Floats) -> float:
    """Return the variance by which the size of some directions, (p, n), differs between recordings.

    Each part says by how much the size of each joint's direction is another there, a, with a variance v. Within a
    recording these differ by s, and the means of recordings by ``CHANGE_BETWEEN`` times s; what is asked for is the
    posterior mean of s^2 on a grid, so that few parts leave it large.
    """
    p = len(directions)
    logs = sorted({part.log for part in parts})
    told = np.array(
        [
            [_size(part.grams[j], directions[:, j], p) for j in range(directions.shape[1])]
            for part in parts
        ]
    )
    number = np.array([logs.index(part.log) for part in parts])
    sizes = np.geomspace(*tuning.CHANGE_SIZES, tuning.CHANGE_GRID)
    freedom = tuning.CHANGE_FREEDOM
    value = np.log(sizes) - 0.5 * (freedom + 1.0) * np.log1p(
        (sizes / tuning.CHANGE_PRIOR) ** 2 / freedom
    )
    for j in range(directions.shape[1]):
        a, v = told[:, j].T
        if not np.all(np.isfinite(v)) or len(a) < 2:
            continue
        together = tuning.CHANGE_BETWEEN**2 * (number[:, None] == number)
        for k, size in enumerate(sizes):
            covariance = np.diag(v) + size**2 * (np.eye(len(a)) + together)
            # Why without the mean: the estimate has taken it.
            weight = np.linalg.inv(covariance)
            total = weight.sum()
            mean = weight.sum(axis=0) @ a / total
            value[k] -= 0.5 * (
                np.linalg.slogdet(covariance)[1] + np.log(total) + (a - mean) @ weight @ (a - mean)
            )
    chance = np.exp(value - value.max())
    return float(tuning.CHANGE_BETWEEN**2 * (chance @ sizes**2) / chance.sum())


def _size(gram: Floats, direction: Floats, p: int) -> tuple[float, float]:
    """Return by how much rows ask for more of a direction, (p,), and the variance of that; infinite without rows."""
    W = gram[-p - 1 : -1, -p - 1 : -1]
    told = float(direction @ W @ direction)
    return (
        (float(direction @ gram[-p - 1 : -1, -1]) / told, 1.0 / told)
        if told > 0.0
        else (0.0, np.inf)
    )
