"""Quantiles of the normal and of Student's distribution.

Why not SciPy: importing its special functions takes as long as an estimate from a log of a minute.
"""

from __future__ import annotations

import math
from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Degrees of freedom from which on the ratio of two gamma functions is a series.
MANY = 200.0


def normal_quantile(p: float) -> float:
    """Return what a standard normal number stays below with a probability."""
    return NormalDist().inv_cdf(p) if 0.0 < p < 1.0 else math.copysign(math.inf, p - 0.5)


def student_quantile(freedom: Floats, p: float) -> Floats:
    """Return what a number with Student's distribution stays below, (k,).

    Args:
        freedom: degrees of freedom, (k,), at least 2.
        p: probability between 0.5 and 0.99.
    """
    nodes, weights = _gauss()
    peak = np.array([_peak(float(nu)) for nu in freedom])
    t = np.full(len(freedom), normal_quantile(p))
    # Why from there: the distribution is concave, so that every step of Newton's method stays below the quantile.
    for _ in range(50):
        x = t[:, None] * nodes
        below = 0.5 + peak * t * (_density(x, freedom[:, None]) @ weights)
        step = (p - below) / (peak * _density(t, freedom))
        t = t + step
        if np.all(np.abs(step) <= 1e-14 * t):
            break
    return t


def _density(x: Floats, freedom: Floats) -> Floats:
    """Return Student's density over its value at zero."""
    return np.asarray(np.exp(-0.5 * (freedom + 1.0) * np.log1p(x**2 / freedom)))


def _peak(freedom: float) -> float:
    """Return Student's density at zero."""
    a = 0.5 * freedom
    if freedom < MANY:
        ratio = math.exp(math.lgamma(a + 0.5) - math.lgamma(a))
    else:
        # Why: the difference of two large logarithms would lose digits.
        ratio = math.sqrt(a) * (1 - 1 / (8 * a) + 1 / (128 * a**2) + 5 / (1024 * a**3) - 21 / (32768 * a**4))
    return ratio / math.sqrt(math.pi * freedom)


@lru_cache(maxsize=1)
def _gauss() -> tuple[Floats, Floats]:
    """Return nodes and weights of a quadrature from 0 to 1 (Gauss, Legendre)."""
    # Source: Golub, Welsch 1969; NumPy's would be imported with all its polynomials.
    k = np.arange(1.0, 64.0)
    beside = k / np.sqrt(4.0 * k**2 - 1.0)
    nodes, vectors = np.linalg.eigh(np.diag(beside, -1))
    return 0.5 * (nodes + 1.0), vectors[0] ** 2
