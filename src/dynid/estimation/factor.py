"""The one elimination: whitened rows of named blocks of columns, from which blocks are integrated out.

    y = sum_b X_b theta_b + e,     e ~ N(0, 1)

A Gaussian prior of a block is more rows of it. What the columns of the residual model, a joint's own parameters, a
load, a gain or a friction that changed leave to the other blocks is one QR decomposition of the rows that have them.
Source: Bierman 1977, "Factorization methods for discrete sequential estimation" (square-root information).
"""

from __future__ import annotations

from dataclasses import dataclass

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
        blocks: columns of each block by name, (N, c_b).
        right: right side y, (N,).
        volume: logarithm of the determinants of what was integrated out.
    """

    blocks: dict[str, Floats]
    right: Floats
    volume: float = 0.0

    @property
    def rows(self) -> Floats:
        """[X y], (N, c + 1)."""
        return np.column_stack([*self.blocks.values(), self.right])

    def __add__(self, other: Factor) -> Factor:
        """Return the rows of both, zeros where one has no such block."""
        blocks = {
            name: np.vstack(
                [
                    each.blocks.get(name, np.zeros((len(each.right), columns.shape[1])))
                    for each in (self, other)
                ]
            )
            for name, columns in {**self.blocks, **other.blocks}.items()
        }
        return Factor(blocks, np.append(self.right, other.right), self.volume + other.volume)

    def prior(self, name: str, sd: Floats) -> Factor:
        """Return the rows with theta_b ~ N(0, sd^2), (c_b,)."""
        known = {name: np.diag(1.0 / sd)}
        return self + Factor(known, np.zeros(len(sd)), -float(np.sum(np.log(sd))))

    def without(self, *names: str) -> tuple[Factor, Factor]:
        """Return what is left of the other blocks when these are integrated out, and the rows that say what these are.

        Both are triangles, as many rows as they have columns.

        Args:
            names: of blocks, each of which has a prior or is told by the rows.
        """
        blocks = {**{name: self.blocks[name] for name in names}, **self.blocks}
        ends = np.cumsum([columns.shape[1] for columns in blocks.values()])
        k = ends[len(names) - 1]
        R = triangle(np.column_stack([*blocks.values(), self.right]))
        *columns, right = np.split(R, ends, axis=1)
        told = dict(zip(blocks, columns, strict=True))
        others = {name: told[name][k:] for name in self.blocks if name not in names}
        pivots = np.maximum(np.abs(np.diagonal(R)[:k]), np.finfo(float).tiny)
        volume = self.volume - float(np.sum(np.log(pivots)))
        of_these = Factor({name: told[name][:k] for name in blocks}, right[:k, 0])
        return Factor(others, right[k:, 0], volume), of_these

    @property
    def conditional(self) -> Conditional:
        """The first blocks for given values of the others, of rows that are as many as these have columns."""
        rows, k = self.rows, len(self.right)
        root = np.asarray(np.linalg.inv(rows[:, :k]))
        return Conditional(root, -root @ rows[:, k:-1], root @ rows[:, -1])
