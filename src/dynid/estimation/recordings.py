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

from dynid.arrays import Floats, Mask
from dynid.estimation import tuning
from dynid.estimation.residual_model import ModelError
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel


@dataclass(frozen=True)
class Parts:
    """P parts of recordings, whitened; joints that are apart have no say.

    Attributes:
        log: number of the recording of each, (P,).
        grams: of [Z W residual] of each joint about the estimate, (P, n, k + p + 1, k + p + 1).
    """

    log: NDArray[np.int64]
    grams: Floats

    @classmethod
    def of(
        cls,
        stack: Stack,
        theta: Floats,
        error: ModelError | None,
        noise: Floats,
        inflation: float,
        robust: Floats | None,
    ) -> Parts:
        """Return the quarters of each recording.

        Args:
            stack: the fitted rows.
            theta: base parameters, (p,).
            error: the residual model; None without.
            noise: sigma of each joint, (n,) [N m or N].
            inflation: how many rows are worth one independent row, as far as the covariance counts it.
            robust: estimate from which residuals are spikes, (p,); None where it gave them their whole weight.
        """
        logs, grams, rows = [], [], stack.rows
        for log in range(len(stack.logs)):
            of_log = np.unique(rows.block[rows.log == log])
            for blocks in filter(len, np.array_split(of_log, tuning.PARTS_OF_LOG)):
                part = stack.take(np.isin(rows.block, blocks))
                if error is None:
                    F, estimate = part.factors, np.tile(theta, (len(noise), 1))
                else:
                    F = error.factors(part, noise, robust) * (error.apart == 0.0)[:, None, None]
                    estimate = error.mean.copy()
                    estimate[:, error.k :] = theta
                F = F / (noise * np.sqrt(inflation))[:, None, None]
                F[:, :, -1] -= np.einsum("jmk,jk->jm", F[:, :, :-1], estimate)
                logs.append(log)
                grams.append(F.swapaxes(1, 2) @ F)
        return cls(np.array(logs), np.array(grams))

    def disagreement(self, covariance: Floats, error: ModelError | None, informed: Mask) -> float:
        """Return how many times more parts move the parameters than their rows let expect, at least 1.

        When the parameters move, the columns of the residual model follow them.

        Args:
            covariance: of the parameters, (p, p).
            error: the residual model; None without.
            informed: which parameters come from the rows, (p,).
        """
        p, n = len(covariance), self.grams.shape[1]
        k, slope, root = 0, np.zeros((n, 0, p)), np.zeros((n, 0, 0))
        if error is not None:
            k, slope, root = error.k, error.slope, error.root
        T = np.concatenate([slope[:, :k], np.tile(np.eye(p), (n, 1, 1))], axis=1)
        weight = np.where(informed, 1.0 / np.diagonal(covariance), 0.0)
        ratios = [1.0]
        for number in (np.arange(len(self.log)), self.log):
            member = number == np.unique(number)[:, None]
            if len(member) > 1 and informed.any():
                G = T.swapaxes(1, 2) @ np.tensordot(member, self.grams[:, :, :-1], axes=1)
                score, S = G[..., -1].sum(axis=1), (G[..., :-1] @ T).sum(axis=1)
                taken = G[..., :k] @ root[:, :k, :k]  # what columns may take of the information
                S_left = S - (taken @ taken.swapaxes(2, 3)).sum(axis=1) - S @ covariance @ S
                usual = np.diagonal(covariance @ S_left @ covariance, axis1=1, axis2=2)
                moved = float(np.sum((score @ covariance) ** 2 @ weight))
                ratios.append(moved / max(float(np.sum(usual @ weight)), 1e-300))
        return min(max(ratios), tuning.LARGEST_INFLATION)

    def changes(self, base: BaseModel, theta: Floats) -> Floats:
        """Return A with A A^T what other recordings will add to the covariance of the parameters, (p, 2 n).

        Args:
            base: model and base parameters.
            theta: base parameters, (p,).
        """
        count = len(np.unique(self.log))
        directions = _directions(base, theta)
        sizes = [np.sqrt(self._variance(each) / count) for each in directions]
        return np.concatenate([d * size for d, size in zip(directions, sizes, strict=True)], axis=1)

    def _variance(self, directions: Floats) -> float:
        """Return the variance by which the size of some directions, (p, n), differs between recordings.

        Each part says by how much the size of each joint's direction is another there, a, with a variance v. Within a
        recording these differ by s, and the means of recordings by ``CHANGE_BETWEEN`` times s; the result is from the
        posterior mean of s^2 on a grid, so that few parts leave it large.
        """
        p = len(directions)
        W = self.grams[:, :, -p - 1 : -1, -p - 1 :]
        along = np.einsum("pj,ljpq->ljq", directions, W)
        information = np.einsum("ljp,pj->lj", along[..., :-1], directions)
        sizes = np.geomspace(*tuning.CHANGE_SIZES, tuning.CHANGE_GRID)
        freedom = tuning.CHANGE_FREEDOM
        share = (sizes / tuning.CHANGE_PRIOR) ** 2 / freedom
        value = np.log(sizes) - 0.5 * (freedom + 1.0) * np.log1p(share)
        together = tuning.CHANGE_BETWEEN**2 * (self.log[:, None] == self.log)
        for j in np.flatnonzero(np.all(information > 0.0, axis=0) & (len(W) > 1)):
            v = 1.0 / information[:, j]
            a = along[:, j, -1] * v
            covariance = np.diag(v) + sizes[:, None, None] ** 2 * (np.eye(len(a)) + together)
            # Why without the mean: the estimate has taken it.
            weight = np.linalg.inv(covariance)
            total = weight.sum(axis=(1, 2))
            away = a - (weight.sum(axis=1) @ a / total)[:, None]
            squares = np.einsum("sl,slm,sm->s", away, weight, away)
            value -= 0.5 * (np.linalg.slogdet(covariance)[1] + np.log(total) + squares)
        chance = np.exp(value - value.max())
        return float(tuning.CHANGE_BETWEEN**2 * (chance @ sizes**2) / chance.sum())


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
