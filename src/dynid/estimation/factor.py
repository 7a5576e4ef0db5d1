"""The one elimination: whitened rows of named blocks of columns, from which blocks are integrated out.

    y = sum_b X_b theta_b + e,     e ~ N(0, 1)

A Gaussian prior of a block is more rows of it. What the columns of the residual model, a joint's own parameters, a
load, a gain or a friction that changed leave to the other blocks is one QR decomposition of the rows that have them.
Source: Bierman 1977, "Factorization methods for discrete sequential estimation" (square-root information).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynid.arrays import Floats
from dynid.estimation import tuning


def triangle(rows: Floats) -> Floats:
    """Return the triangular factor of rows (N, c), (c, c), in their units."""
    R, size = np.asarray(rows[:0]), rows.shape[1]
    # Why part by part: larger ones leave the cache.
    for part in np.array_split(rows, -(-len(rows) // tuning.ROWS_FACTORED) or 1):
        R = np.asarray(np.linalg.qr(np.vstack([R, part]), mode="r"))
    return np.vstack([R, np.zeros((size - len(R), size))])


def of_unit_diagonal(H: Floats) -> tuple[Floats, Floats]:
    """Return D H D with a diagonal of ones, (c, c), and the diagonal of D, (c,); 1 where that of H is zero.

    Parameters have units: numbers of a matrix that are many orders apart would be lost beside each other.
    """
    diagonal = np.diagonal(H)
    unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return unit[:, None] * H * unit, unit


@dataclass(frozen=True)
class Conditional:
    """A block for given values z of other ones: N(mean + slope z, root root^T).

    Attributes:
        root: (k, k).
        slope: (k, c).
        mean: (k,).
    """

    root: Floats
    slope: Floats
    mean: Floats


@dataclass(frozen=True)
class Factor:
    """Whitened rows of blocks of columns and their right side; ``+`` puts rows together.

    Attributes:
        rows: [X y], (N, c + 1).
        blocks: width of each block by name, in the order of the columns.
        volume: logarithm of the determinants of what was integrated out.
    """

    rows: Floats
    blocks: dict[str, int]
    volume: float = 0.0

    @classmethod
    def of(cls, blocks: dict[str, Floats], right: Floats) -> Factor:
        """Return the rows of blocks (N, c_b) and their right side (N,)."""
        widths = {name: columns.shape[1] for name, columns in blocks.items()}
        return cls(np.column_stack([*blocks.values(), right]), widths)

    def __getitem__(self, name: str) -> Floats:
        """Return the columns of a block, (N, c_b)."""
        names = list(self.blocks)
        first = sum(self.blocks[each] for each in names[: names.index(name)])
        return self.rows[:, first : first + self.blocks[name]]

    def over(self, blocks: dict[str, int]) -> Floats:
        """Return [X y] with the columns of other blocks, (N, c + 1); zeros of those that are not here."""
        parts = [
            self[name] if name in self.blocks else np.zeros((len(self.rows), width))
            for name, width in blocks.items()
        ]
        return np.column_stack([*parts, self.rows[:, -1]])

    def __add__(self, other: Factor) -> Factor:
        """Return the rows of both."""
        blocks = {**self.blocks, **other.blocks}
        rows = np.vstack([self.over(blocks), other.over(blocks)])
        return Factor(rows, blocks, self.volume + other.volume)

    def prior(self, name: str, sd: Floats) -> Factor:
        """Return the rows with theta_b ~ N(0, sd^2), (c_b,)."""
        known = Factor.of({name: np.diag(1.0 / sd)}, np.zeros(len(sd)))
        return self + replace(known, volume=-float(np.sum(np.log(sd))))

    def without(self, *names: str) -> tuple[Factor, Factor]:
        """Return the rows of the other blocks when these are integrated out, and the rows that say what these are.

        Args:
            names: of blocks, each of which has a prior or is told by the rows.
        """
        left = {name: width for name, width in self.blocks.items() if name not in names}
        blocks = {**{name: self.blocks[name] for name in names}, **left}
        rows, k = self.over(blocks), sum(self.blocks[name] for name in names)
        touched = rows[:, :k].any(axis=1)
        R = triangle(rows[touched])
        pivots = np.maximum(np.abs(np.diagonal(R)[:k]), np.finfo(float).tiny)
        volume = self.volume - float(np.sum(np.log(pivots)))
        others = np.vstack([R[k:, k:], rows[~touched, k:]])
        return Factor(others, left, volume), Factor(R[:k], blocks)

    @property
    def conditional(self) -> Conditional:
        """The first blocks for given values of the others, of rows that are as many as these have columns."""
        k = len(self.rows)
        root = np.asarray(np.linalg.inv(self.rows[:, :k]))
        return Conditional(root, -root @ self.rows[:, k:-1], root @ self.rows[:, -1])
