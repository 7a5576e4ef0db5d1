"""Choose measurement points from a path that is there already (Paper Eqs. 15-16 in their right form)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid.trajectory.cost import Cost

Floats = NDArray[np.float64]

#: Information that the choice starts from, as a share of the whole path's: makes the first choices well posed.
RIDGE = 1e-9
#: So many samples in turn that do not earn their place end the choice.
REFUSALS = 10


def select(W: Floats, eta: float, cost: Cost | None = None) -> NDArray[np.intp]:
    """Choose samples of a path until another one lowers the cost by no more than ``eta``.

    Args:
        W: regressor along the path, (N, n, p).
        eta: least gain of a sample, as a share of the cost (the threshold of Eq. 16).
        cost: cost function of the information matrix; Eq. 14 when None.

    Returns:
        Indices of the chosen samples in time order.

    Source: Paper Eqs. 15-16. Eq. 16 as printed keeps samples that make the cost larger; what is meant is the gain
        f(K - 1) - f(K). Samples are tried in the order of how much they add to det(G), so that K stays small.
    """
    cost = cost or Cost("paper")
    scale = 1 / np.sqrt(np.maximum(np.einsum("kjp,kjp->p", W, W), np.finfo(float).tiny))
    scaled = W * scale
    inverse = np.eye(W.shape[2]) / RIDGE
    G = np.zeros((W.shape[2], W.shape[2]))
    free = np.ones(len(W), dtype=bool)
    chosen: list[int] = []
    least = -(-W.shape[2] // W.shape[1])
    value, refused = np.inf, 0
    while free.any() and refused < REFUSALS:
        candidates = np.flatnonzero(free)
        A = scaled[candidates]
        gains = np.linalg.slogdet(np.eye(W.shape[1]) + A @ inverse @ A.transpose(0, 2, 1))[1]
        k = int(candidates[gains.argmax()])
        free[k] = False
        more = G + W[k].T @ W[k]
        after = cost.value(more)[0]
        if len(chosen) < 2 * least or value - after > eta:
            chosen.append(k)
            G, value, refused = more, after, 0
            B = scaled[k]
            gain = np.linalg.solve(np.eye(W.shape[1]) + B @ inverse @ B.T, B @ inverse)
            inverse = inverse - inverse @ B.T @ gain
        else:
            refused += 1
    return np.array(sorted(chosen), dtype=np.intp)
