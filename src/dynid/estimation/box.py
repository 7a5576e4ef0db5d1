"""The smallest value of a smooth function of few numbers between bounds.

Why not SciPy: importing its optimisation takes longer than an estimate from a log of a minute.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: A slope along the box, and a relative change of the value, that count as none.
FLAT, SAME = 1e-8, 1e-13
#: A step is shortened until it gains this share of what the slope promises, at most so many times.
PROMISE, SHORTER = 1e-4, 30


def smallest_in_box(
    function: Callable[[Floats], tuple[float, Floats]], start: Floats, low: Floats, high: Floats, steps: int
) -> Floats:
    """Return where a function is smallest between bounds, (k,), as far as going downhill from a start finds it.

    Source: Bertsekas 1982 (projected steps of a quasi-Newton method), with the update of Broyden, Fletcher, Goldfarb
    and Shanno. Where changes of the value are lost in its rounding, the slopes tell whether a step is one downhill.

    Args:
        function: returns its value and its slopes, (k,).
        start: where to begin, (k,).
        low: lower bounds, (k,).
        high: upper bounds, (k,).
        steps: limit of the steps.
    """
    x = np.clip(start, low, high)
    value, slope = function(x)
    bend = np.eye(len(x)) * max(1.0, float(np.linalg.norm(slope)))
    for _ in range(steps):
        free = ~(((x <= low) & (slope > 0.0)) | ((x >= high) & (slope < 0.0)))
        if not np.any(np.abs(slope[free]) > FLAT):
            break
        way = np.zeros_like(x)
        way[free] = -np.linalg.solve(bend[np.ix_(free, free)], slope[free])
        rounding = SAME * max(1.0, abs(value))
        for _ in range(SHORTER):
            there = np.clip(x + way, low, high)
            found, turned = function(there)
            if found <= value + PROMISE * float(slope @ (there - x)) + rounding:
                break
            way = 0.5 * way
        else:
            break
        moved, change = there - x, turned - slope
        if float(moved @ change) > 1e-12 * float(np.linalg.norm(moved) * np.linalg.norm(change)):
            along = bend @ moved
            bend += np.outer(change, change) / (moved @ change) - np.outer(along, along) / (moved @ along)
        if value - found <= rounding and np.linalg.norm(turned[free]) >= np.linalg.norm(slope[free]):
            break
        x, value, slope = there, found, turned
    return x
