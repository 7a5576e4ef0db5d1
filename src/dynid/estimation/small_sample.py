"""How much too short a covariance from residuals is in a short log, found by simulation on the log's own rows.

A fit takes from the residuals just what the covariance asks them for: errors as slow as the columns. In 10 s of a
seven-joint arm little is left of those, and a variance that is estimated from few slow waves is itself uncertain. For
noise that passed the filter of the rows both effects are known: such noise is drawn, fitted and judged like the
residuals, and what comes out is compared with the true variance of its errors.

Source: Bell, McCaffrey 2002 (correction under a working model, Student's t with Satterthwaite's degrees of freedom).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.observation_rows import ObservationRows
from dynid.estimation.uncertainty import moving_sums
from dynid.signals.filters import pulse, pulse_width

Floats = NDArray[np.float64]

#: Instants beyond which a log is not short, and instants times draws that are worked on.
LONGEST, WORK = 4096, 16384
#: Fewest and most draws: the longer the log, the less a draw differs from the next.
FEWEST, MOST = 8, 48
#: Two degrees of freedom have no variance; nothing is said about fewer.
LEAST_FREEDOM = 2.5


def short_log_factor(stretches: Sequence[ObservationRows], bread: Floats, noise: Floats, lags: int) -> Floats:
    """Return the factor on each standard error after which 1.96 of them are a 95 % interval, (p,).

    Args:
        stretches: rows of each contiguous stretch; ``usable`` says which weigh in the estimate.
        bread: sensitivity of the estimate to the scores, (p, p).
        noise: standard deviation of each joint that the estimator divided by, (n,) [N m].
        lags: memory that the covariance allows for, in samples.
    """
    instants = sum(len(rows.tau) for rows in stretches)
    draws = int(np.clip(WORK // max(instants, 1), FEWEST, MOST))
    rng = np.random.default_rng(0)
    pulls = [_influence(rows, bread, noise) for rows in stretches]
    shapes = [_kernel(rows) for rows in stretches]
    drawn = [
        _filtered(rng, (draws, len(noise), len(rows.tau)), shape) * rows.mask[:, :, None]
        for rows, shape in zip(stretches, shapes, strict=True)
    ]
    error = np.sum([np.tensordot(pull, e, ((0, 2), (0, 1))) for pull, e in zip(pulls, drawn, strict=True)], axis=0)
    true, judged = np.zeros(len(bread)), np.zeros((len(bread), draws))
    for rows, pull, shape, e in zip(stretches, pulls, shapes, drawn, strict=True):
        true += _variance(pull, shape)
        left = (e - rows.W @ error / noise[:, None]) * rows.mask[:, :, None]
        width = min(lags + 1, len(left))
        sums = moving_sums((pull @ left).reshape(len(left), -1), width)
        judged += np.einsum("tk,tk->k", sums, sums).reshape(-1, draws) / width
    return _factor(true, judged)


def _factor(true: Floats, judged: Floats) -> Floats:
    from scipy import special

    mean = np.maximum(judged.mean(axis=1), np.finfo(float).tiny)
    freedom = 2.0 * mean**2 / np.maximum(judged.var(axis=1, ddof=1), np.finfo(float).tiny)
    quantile = special.stdtrit(np.maximum(freedom, LEAST_FREEDOM), 0.975) / special.ndtri(0.975)
    return np.asarray(np.sqrt(true / mean) * quantile)


def _influence(rows: ObservationRows, bread: Floats, noise: Floats) -> Floats:
    """Return what a residual of one standard deviation does to the parameters, (M, p, n)."""
    Z = rows.W if rows.Z is None else rows.Z
    return np.asarray(bread @ (Z * (rows.mask / noise)[:, :, None]).swapaxes(1, 2))


def _kernel(rows: ObservationRows) -> Floats:
    """Return what made the noise in the rows as coloured as it is, (K,), of unit length."""
    if rows.cutoff == 0.0 or len(rows.t) < 2:
        return np.ones(1)
    step = float(np.median(np.diff(rows.t)))
    half = int(pulse_width(rows.cutoff) / step)
    kernel = pulse(step * np.arange(-half, half + 1.0), rows.cutoff)
    return np.asarray(kernel / np.linalg.norm(kernel))


def _filtered(rng: np.random.Generator, shape: tuple[int, int, int], kernel: Floats) -> Floats:
    """Return coloured noise for draws, joints and instants, (M, n, draws)."""
    white = rng.standard_normal((*shape[:2], shape[2] + len(kernel) - 1))
    windows = np.lib.stride_tricks.sliding_window_view(white, len(kernel), axis=2)
    return np.ascontiguousarray((windows @ kernel).transpose(2, 1, 0))


def _variance(pull: Floats, kernel: Floats) -> Floats:
    """Return the variance that coloured noise gives the parameters, (p,)."""
    M, p, n = pull.shape
    spread = np.zeros((M + len(kernel) - 1, p, n))
    for k, size in enumerate(kernel):
        spread[k : k + M] += size * pull
    return np.asarray(np.einsum("tpj,tpj->p", spread, spread))
