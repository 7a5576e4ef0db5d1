"""Whitened rows of all joints, what explains them so far, and what is left.

Each joint has its own noise, so each has its own rows; the parameters are common. Evidence for a candidate is judged
after everything that the model could absorb has been projected out of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.gap.noise import ORDER, Noise, whitened
from dynid.gap.segments import Stretch, blocks_of
from dynid.model.effects.interface import Floats

Ints = NDArray[np.int64]

#: Directions of the normalised baseline below this share of the strongest are not excited.
WEAK = 1e-9


@dataclass
class Rows:
    """The whitened rows of one joint.

    Attributes:
        joint: its index.
        A: baseline columns, (M, p).
        y: torques, (M,).
        block: number of the block of time, rising, (M,).
        log: number of the log, (M,).
        place: which rows of the concatenated stretches they are, (M,).
    """

    joint: int
    A: Floats
    y: Floats
    block: Ints
    log: Ints
    place: Ints


@dataclass
class Board:
    """All joints.

    Attributes:
        stretches: where the rows come from.
        noise: what they were whitened with.
        joints: rows of each joint.
        prior: further rows on the baseline columns, (r, p + 1), such as what an earlier identification knows.
        added: columns of accepted effects, each {joint: (k, M_j)}.
    """

    stretches: Sequence[Stretch]
    noise: Noise
    joints: list[Rows]
    prior: Floats | None = None
    added: list[dict[int, Floats]] = field(default_factory=list)
    Q: list[Floats] = field(default_factory=list)
    e: list[Floats] = field(default_factory=list)
    theta: Floats = field(default_factory=lambda: np.zeros(0))
    inverse: Floats = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def size(self) -> int:
        """Number of baseline columns."""
        return int(self.joints[0].A.shape[1])

    @property
    def width(self) -> int:
        """Number of columns with those of accepted effects."""
        return self.size + sum(_count(one) for one in self.added)

    def whiten(self, joint: int, parts: Sequence[Floats]) -> Floats:
        """Return filtered columns of one joint, one (..., M_s) a stretch, as whitened rows, (..., M_j)."""
        ar, sigma = self.noise.ar[joint], self.noise.sigma[joint] * self.noise.count[joint] ** 0.5
        kept = [whitened(x, ar)[..., s.use[ORDER:, joint]] for x, s in zip(parts, self.stretches, strict=True)]
        rows: Floats = np.concatenate(kept, axis=-1) / sigma
        return rows

    def solve(self) -> None:
        """Fit the baseline and the accepted effects; sets ``Q``, ``e``, ``theta`` and ``inverse``."""
        width = self.width
        full = [self._full(rows) for rows in self.joints]
        gram, right = np.zeros((width, width)), np.zeros(width)
        for A, rows in zip(full, self.joints, strict=True):
            gram += A.T @ A
            right += A.T @ rows.y
        if self.prior is not None:
            p = self.size
            gram[:p, :p] += self.prior[:, :-1].T @ self.prior[:, :-1]
            right[:p] += self.prior[:, :-1].T @ self.prior[:, -1]
        length = np.sqrt(np.diag(gram))
        length = np.where(length > 0, length, 1.0)
        values, V = np.linalg.eigh(gram / np.outer(length, length))
        kept = values > WEAK * values[-1]
        root = V[:, kept] / np.sqrt(values[kept]) / length[:, None]
        self.inverse = root @ root.T
        self.theta = root @ (root.T @ right)
        self.Q = [A @ root for A in full]
        self.e = [rows.y - A @ self.theta for A, rows in zip(full, self.joints, strict=True)]

    def _full(self, rows: Rows) -> Floats:
        if not self.added:
            return rows.A
        parts = [one.get(rows.joint, np.zeros((_count(one), len(rows.y)))).T for one in self.added]
        return np.hstack([rows.A, *parts])

    def chi(self) -> Floats:
        """Return the mean square of each joint's whitened residual, freedom taken off, (n,); 1 at the noise floor."""
        chi = np.ones(len(self.joints))
        for j, (e, Q) in enumerate(zip(self.e, self.Q, strict=True)):
            freedom = len(e) - float(np.sum(Q**2))
            if len(e) > 50 and freedom > 20:
                chi[j] = self.noise.count[j] * float(e @ e) / freedom
        return chi


def _count(one: dict[int, Any]) -> int:
    return len(next(iter(one.values())))


def build_board(
    stretches: Sequence[Stretch], noise: Noise, nuisance: Sequence[Sequence[Floats]], prior: Floats | None = None
) -> Board:
    """Whiten the rows of all joints.

    Args:
        stretches: rows; only those that count are used.
        noise: the noise of each joint.
        nuisance: for each stretch and joint, columns that are not judged, (k, M).
        prior: further rows [columns, value] on the base parameters, (r, p + 1).
    """
    n = stretches[0].tau.shape[1]
    board = Board(stretches, noise, [])
    edges = np.cumsum([0, *(len(s) for s in stretches)])
    count = nuisance[0][0].shape[0]
    p = stretches[0].W.shape[2]
    blocks = blocks_of(stretches)
    for j in range(n):
        base = board.whiten(j, [s.W[:, j].T for s in stretches])
        extra = board.whiten(j, [nuisance[k][j] for k in range(len(stretches))])
        A = np.zeros((base.shape[1], p + n * count))
        A[:, :p] = base.T
        A[:, p + j * count : p + (j + 1) * count] = extra.T
        y = board.whiten(j, [s.tau[:, j] for s in stretches])
        chosen = [np.flatnonzero(s.use[ORDER:, j]) + ORDER for s in stretches]
        block = [one[rows] for one, rows in zip(blocks, chosen, strict=True)]
        log = [np.full(len(rows), s.log) for s, rows in zip(stretches, chosen, strict=True)]
        place = [rows + start for rows, start in zip(chosen, edges[:-1], strict=True)]
        board.joints.append(Rows(j, A, y, *(np.concatenate(x).astype(np.int64) for x in (block, log, place))))
    if prior is not None:
        wide = np.zeros((len(prior), p + n * count + 1))
        wide[:, :p], wide[:, -1] = prior[:, :-1], prior[:, -1]
        board.prior = wide
    board.solve()
    return board
