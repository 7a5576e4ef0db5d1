"""Variances of many small samples, each steadied by what is usual among them.

Source: Smyth 2004 (moderated t, empirical Bayes).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def moderated(rss: Floats, freedom: NDArray[np.int64], scale: float, prior: float) -> Floats:
    """Return each series' variance, its own steadied by that of the others, (A,).

    Args:
        rss: sum of squares that each leaves, (A,).
        freedom: its degrees of freedom, (A,).
        scale: what is usual, from ``prior_variance``.
        prior: how many degrees of freedom knowing that is worth.
    """
    if np.isinf(prior):
        return np.full(len(rss), scale)
    return np.asarray((prior * scale + np.maximum(rss, 0.0)) / np.maximum(prior + np.maximum(freedom, 0), 1.0))


def prior_variance(variances: Floats, freedom: NDArray[np.int64]) -> tuple[float, float]:
    """Return what is usual among variances of small samples, and how many degrees of freedom knowing it is worth.

    Source: Smyth 2004, section 6.2: moments of the logarithms.
    """
    from scipy import special

    use = variances > 0
    if use.sum() < 2:
        return max(1.0, float(np.mean(variances)) if len(variances) else 1.0), 0.0
    d = freedom[use].astype(float)
    e = np.log(variances[use]) - special.digamma(d / 2) + np.log(d / 2)
    excess = float(np.var(e, ddof=1) - np.mean(special.polygamma(1, d / 2)))
    if excess <= 0:
        return float(np.exp(np.mean(e))), float("inf")
    half = _inverse_trigamma(excess)
    return float(np.exp(np.mean(e) + special.digamma(half) - np.log(half))), 2.0 * half


def _inverse_trigamma(x: float) -> float:
    """Return y with trigamma(y) = x, by Newton steps on 1 / trigamma, which is nearly straight."""
    from scipy import special

    if x > 1e7:
        return float(1.0 / np.sqrt(x))
    if x < 1e-6:
        return 1.0 / x
    y = 0.5 + 1.0 / x
    for _ in range(50):
        value = float(special.polygamma(1, y))
        step = value * (1.0 - value / x) / float(special.polygamma(2, y))
        y += step
        if -step / y < 1e-9:
            break
    return float(y)
