"""How much later than the positions the torques were stamped, found from the torques themselves.

A torque that is late by d is W theta at t - d, to first order W theta - d * (W theta)'. The slope of the fitted torques
is one more column of the regression, and its coefficient is the delay; what it shares with real parameters (viscous
friction looks like late gravity) widens its error. Docs: docs/explanation/estimators.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding
from dynid.estimation import tuning
from dynid.estimation.covariance import hac_covariance
from dynid.estimation.least_squares import block_diagonal, triangle, weighted, with_columns
from dynid.estimation.observation_rows import ObservationRows, RowWalk
from dynid.estimation.stack import Stack, settled, stack_logs
from dynid.longarrays import Growing, empty, spans
from dynid.progress import SILENT, Progress
from dynid.signals.conditioned_log import torques_moved_back

Floats = NDArray[np.float64]

#: Rows on either side that the slope of a torque is taken from.
REACH = 2


@dataclass(frozen=True)
class Delay:
    """Time from positions to torques.

    Attributes:
        seconds: positive when the torques are late [s].
        std_error: standard error that allows for coloured residuals [s].
    """

    seconds: float
    std_error: float

    @property
    def clear(self) -> bool:
        """Whether it is large enough and certain enough to be corrected."""
        return (
            abs(self.seconds) >= tuning.DELAY_LEAST_S and abs(self.seconds) > tuning.DELAY_CLEAR_ERRORS * self.std_error
        )


def estimate_delay(stack: Stack) -> Delay:
    """Estimate the delay that all joints share.

    Args:
        stack: the stacked logs; a rank that is short does no harm.
    """
    fit = stack.first_fit
    whitened = fit.whitened[:-1, :-1]
    length = np.linalg.norm(whitened, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    _, sigma, Vt = np.linalg.svd(whitened / length)
    columns = (Vt[sigma > tuning.RANK_TOLERANCE * sigma[0]] / length).T
    slopes = _slopes(stack, fit.theta)
    rows = RowWalk(lambda: (_with_slope(part, slope) for part, slope in zip(stack, slopes, strict=True)))
    # Why a basis: directions that the log leaves open would have no covariance.
    basis = block_diagonal(columns, np.eye(1))
    factors, counts = stack.whole
    seen = zip(factors, *_products(stack, slopes), strict=True)
    factors = np.array([with_columns(R, across, square, at=-1) for R, across, square in seen])
    found = weighted(np.array([triangle(R @ block_diagonal(basis, np.eye(1))) for R in factors]), counts)
    variance = hac_covariance(rows, found.theta, found.noise, bread=found.covariance, basis=basis, of=[-1])[0, 0]
    return Delay(float(found.theta[-1]), float(np.sqrt(max(0.0, variance))))


def _products(stack: Stack, slopes: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Return what the column of the delay has in common with [W tau] and with itself, (n, p + 1, 1), (n, 1, 1)."""
    n, p = len(stack.joints), len(stack.names)
    across, square = np.zeros((n, p + 1, 1)), np.zeros((n, 1, 1))
    for part, slope in zip(stack, slopes, strict=True):
        late = np.where(part.mask, -slope, 0.0)
        square[:, 0, 0] += np.sum(late**2, axis=0)
        across[:, -1, 0] += np.sum(np.where(part.mask, part.tau, 0.0) * late, axis=0)
        for j in range(n):
            columns, entries = part.of_joint(j)
            across[j, columns, 0] += entries @ late[:, j]
    return across, square


def _with_slope(rows: ObservationRows, slope: Floats) -> ObservationRows:
    """Return rows with one more column, which all joints share: what a delay changes, (M, n)."""
    n = slope.shape[1]
    return replace(
        rows,
        entries=np.concatenate([rows.entries, -slope.T]),
        joints=np.concatenate([rows.joints, np.arange(n)]),
        columns=np.concatenate([rows.columns, np.full(n, rows.size)]),
        size=rows.size + 1,
        command=None,
    )


def _slopes(stack: Stack, theta: Floats) -> tuple[Floats, ...]:
    """Return the time derivative of the fitted torques, one array for each piece of rows."""
    segments: list[tuple[list[int], Growing, Growing]] = []
    for rows in stack:
        if not (rows.follows and segments):
            segments.append(([], Growing(0), Growing(len(stack.joints))))
        lengths, times, torques = segments[-1]
        lengths.append(len(rows.t))
        times.append(rows.t)
        torques.append(rows.torque(theta))
    slopes: list[Floats] = []
    for lengths, times, torques in segments:
        t, tau = times.whole(), torques.whole()
        slope = empty(tau.shape)
        step = (t[-1] - t[0]) / max(1, len(t) - 1)
        for part in spans(len(t)):
            first, last = max(0, part.start - REACH), min(len(t), part.stop + REACH)
            around = _slope(t[first:last], tau[first:last], step)
            slope[part] = around[part.start - first : part.stop - first]
        slopes += np.split(slope, np.cumsum(lengths)[:-1])
    return tuple(slopes)


def _slope(t: Floats, tau: Floats, step: float) -> Floats:
    """Return the time derivative of torques, (M, n), at times that are a step apart on average."""
    slope = np.gradient(tau, t, axis=0) if len(t) > 1 else np.zeros_like(tau)
    if len(t) > 2 * REACH:
        # Why five points: with four rows a period of the cut-off, two neighbours see only two thirds of a fast slope.
        slope[2:-2] = (8 * (tau[3:-1] - tau[1:-3]) - (tau[4:] - tau[:-4])) / (12 * step)
    return np.asarray(slope)


def delay_findings(found: Delay, applied: float) -> list[Finding]:
    """Say that the torques are late, when they are by more than a few milliseconds."""
    if abs(found.seconds) < tuning.DELAY_NOTABLE_S or not found.clear:
        return []
    word = "later" if found.seconds > 0 else "earlier"
    size = f"{1e3 * abs(found.seconds):.1f} +- {1e3 * found.std_error:.1f} ms"
    done = "corrected" if applied else "not corrected: --delay auto"
    text = f"torques are stamped {size} {word} than positions; {done}"
    return [Finding("W321", "warning", text, {"delay_s": found.seconds, "std_error_s": found.std_error})]


def on_time(stack: Stack, progress: Progress = SILENT) -> tuple[Stack, Delay, tuple[Finding, ...]]:
    """Estimate how late the torques of a stack are, and move them back when that is clear.

    Args:
        stack: the stacked logs, their torques as they were recorded.
        progress: told what was noticed.

    Returns:
        The stack, in whose logs stands by how much they were moved, the estimated delay, and the findings.
    """
    base, logs = stack.base, stack.logs
    found, applied = estimate_delay(stack), 0.0
    for _ in range(tuning.DELAY_ROUNDS if found.clear else 0):
        applied = found.seconds
        stack = stack_logs(settled([torques_moved_back(log, base.model, applied) for log in logs], base), base)
        left = estimate_delay(stack)
        found = Delay(applied + left.seconds, left.std_error)
        if abs(found.seconds - applied) < tuning.DELAY_SETTLED_S:
            break
    size = f"torques {1e3 * found.seconds:+.1f} +- {1e3 * found.std_error:.1f} ms after the positions"
    progress.stage("delay", f"{size}; {f'corrected by {1e3 * applied:.1f} ms' if applied else 'left as it is'}")
    late = tuple(delay_findings(found, applied))
    progress.findings(late)
    return stack, found, late
