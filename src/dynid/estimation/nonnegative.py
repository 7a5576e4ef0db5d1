"""Least squares in which no parameter is negative.

Why not SciPy: importing its optimisation takes longer than everything else that a log of a minute is checked for.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: A column of unit length of which so little is its own is a combination of those that are in use.
OWN = 1e-10
#: A gradient this small, relative to the columns and the right side, is rounding.
ROUNDING = 1e-13


def nonnegative_least_squares(A: Floats, b: Floats, rounds: int) -> Floats:
    """Return x >= 0, (p,), that minimises |A x - b|.

    Source: Lawson, Hanson 1974, chapter 23, with an orthogonal basis of the columns in use that grows column by column.

    Args:
        A: columns, (m, p).
        b: what they shall add up to, (m,).
        rounds: limit of the columns that are taken in.
    """
    x, use = np.zeros(A.shape[1]), np.zeros(0, dtype=np.intp)
    Q, inverse = np.zeros((len(b), 0)), np.zeros((0, 0))
    barred = np.zeros(A.shape[1], dtype=bool)
    least = ROUNDING * float(np.linalg.norm(A, axis=0).max(initial=0.0)) * float(np.linalg.norm(b))
    for _ in range(rounds):
        gradient = A.T @ (b - A[:, use] @ x[use])
        gradient[use] = -np.inf
        gradient[barred] = -np.inf
        new = int(np.argmax(gradient))
        if not gradient[new] > least:
            break
        along = Q.T @ A[:, new]
        own = A[:, new] - Q @ along
        more = Q.T @ own
        along, own = along + more, own - Q @ more
        length = float(np.linalg.norm(own))
        if length <= OWN * float(np.linalg.norm(A[:, new])) or float(own @ (b - A[:, use] @ x[use])) <= 0.0:
            barred[new] = True
            continue
        use, Q = np.append(use, new), np.column_stack([Q, own / length])
        inverse = np.block([[inverse, -(inverse @ along)[:, None] / length], [np.zeros((1, len(along))), 1.0 / length]])
        barred[:] = False
        wanted = inverse @ (Q.T @ b)
        while len(use) and wanted.min() <= 0.0:
            below = wanted <= 0.0
            step = float(np.min(x[use][below] / (x[use][below] - wanted[below])))
            x[use] += step * (wanted - x[use])
            x[use[below & (x[use] <= 0.0)]] = 0.0
            kept = ~below | (x[use] > ROUNDING * float(x.max()))
            x[use[~kept]] = 0.0
            if kept.all():
                kept[np.argmin(np.where(below, x[use], np.inf))] = False
                x[use[~kept]] = 0.0
            use = use[kept]
            Q, R = np.linalg.qr(A[:, use])
            inverse = np.linalg.inv(R)
            wanted = inverse @ (Q.T @ b)
        x[use] = wanted
    return x
