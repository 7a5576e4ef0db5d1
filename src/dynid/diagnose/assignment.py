"""Which column belongs to which joint: the assignment of least cost.

Why not SciPy: importing its optimisation takes longer than everything else that a log of a minute is checked for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def assignment(cost: Floats) -> list[int]:
    """Return the column of each row such that the costs of all add up to the least.

    Source: Kuhn 1955; shortest augmenting paths as in Jonker, Volgenant 1987.

    Args:
        cost: of every row with every column, (n, n), in any unit.
    """
    n = len(cost)
    row_price, price = np.zeros(n), np.zeros(n)
    row_of = np.full(n, -1)
    for start in range(n):
        distance, before, done = np.full(n, np.inf), np.full(n, -1), np.zeros(n, dtype=bool)
        row, column = start, -1
        while True:
            if column >= 0:
                done[column] = True
            reduced = cost[row] - row_price[row] - price + (distance[column] if column >= 0 else 0.0)
            shorter = ~done & (reduced < distance)
            distance[shorter], before[shorter] = reduced[shorter], column
            column = int(np.argmin(np.where(done, np.inf, distance)))
            if row_of[column] < 0:
                break
            row = int(row_of[column])
        row_price[start] += distance[column]
        for other in np.flatnonzero(done):
            row_price[row_of[other]] += distance[column] - distance[other]
            price[other] -= distance[column] - distance[other]
        while column >= 0:
            last = int(before[column])
            row_of[column] = start if last < 0 else row_of[last]
            column = last
    return [int(k) for k in np.argsort(row_of)]
