"""Logs as stacks: the observation matrix as triangular factors, without ever storing it whole (Paper Eq. 23).

Rows are made block by block and folded into one small triangular factor per joint and block of time. Everything linear
(ordinary and weighted least squares, hold-out) needs only those; methods that look at single rows walk over them again,
evaluated from the conditioned logs that a stack carries. Stacks are added.

How late the torques were stamped is found from a stack. A torque that is late by d is W theta at t - d, to first order
W theta - d * (W theta)'. The slope of the fitted torques is one more column of the regression, and its coefficient is
the delay; what it shares with real parameters (viscous friction looks like late gravity) widens its error.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding
from dynid.estimation import tuning
from dynid.estimation.covariance import hac_covariance, widened
from dynid.estimation.least_squares import (
    Fit,
    merge,
    triangle,
    weighted,
    with_columns,
)
from dynid.estimation.rows import ObservationRows, fold, rows_of
from dynid.model.base_model import BaseModel, model_torques
from dynid.model.regressor import Observer
from dynid.progress import SILENT, Progress
from dynid.signals.conditioned_log import (
    ConditionedLog,
    torques_moved_back,
    with_effects,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


class LogRows:
    """The rows of one conditioned log: evaluated at the first walk over them, and kept.

    Args:
        log: the conditioned log.
        base: model and base parameters.
        commanded: whether they come with the regressor on the commanded motion.
        whole: whether rows at velocity reversals count.
    """

    def __init__(
        self,
        log: ConditionedLog,
        base: BaseModel,
        *,
        commanded: bool = False,
        whole: bool = False,
    ) -> None:
        self.log, self.base, self.commanded, self.whole = log, base, commanded, whole

    @cached_property
    def _kept(self) -> list[ObservationRows]:
        return list(
            rows_of(self.log, self.base.observer, commanded=self.commanded, whole=self.whole)
        )

    def __iter__(self) -> Iterator[ObservationRows]:
        """Walk over the rows in order of time; may be done many times."""
        # Why a copy: it makes W and Z anew, so that they do not stay in memory.
        return map(replace, self._kept)


@dataclass(frozen=True)
class Earlier:
    """What an earlier result keeps of its logs.

    Attributes:
        factors: one factor per joint, (n, p + 1, p + 1).
        noise: standard deviation of each joint then, (n,) [N m].
        covariance: covariance of its estimate, allowing for coloured residuals, (p, p).
    """

    factors: Floats
    noise: Floats
    covariance: Floats


@dataclass(frozen=True)
class Stack:
    """The observation matrix of one or several logs as triangular factors; ``+`` puts the logs of two together.

    Attributes:
        base: model and base parameters whose columns the rows have.
        factors: factor of [W tau] for each block of time and joint, (B, n, p + 1, p + 1).
        counts: number of rows in each, (B, n).
        log_of_block: number of the log of each block, (B,); -1 for an earlier result.
        block: number of each block within its log, (B,).
        rows: the single rows of each log.
        earlier: the result that is updated, None otherwise; its rows are the first block.
        silent: numbers of the joints whose rows do not count.
    """

    base: BaseModel = field(repr=False, compare=False)
    factors: Floats
    counts: Ints
    log_of_block: Ints
    block: Ints
    rows: tuple[LogRows, ...] = field(repr=False, compare=False)
    earlier: Earlier | None = field(default=None, repr=False, compare=False)
    silent: tuple[int, ...] = ()

    def __add__(self, other: Stack) -> Stack:
        """Return the stack of the logs of both."""
        return added([self, other])

    def __iter__(self) -> Iterator[ObservationRows]:
        """Walk over the single rows in order of time; may be done many times."""
        for number in range(len(self.rows)):
            yield from self.rows_of_log(number)

    def rows_of_log(self, number: int) -> Iterator[ObservationRows]:
        """Yield the single rows of one log."""
        chosen = set(self.block[self.log_of_block == number].tolist())
        found = (rows for rows in self.rows[number] if rows.block in chosen)
        if not self.silent:
            return found
        counts = ~np.isin(np.arange(len(self.joints)), self.silent)
        return (replace(rows, usable=rows.mask & counts) for rows in found)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters, (p,)."""
        return self.base.names

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names, (n,)."""
        return self.base.robot.joint_names

    @property
    def observer(self) -> Observer:
        """Evaluator of the base columns."""
        return self.base.observer

    @property
    def logs(self) -> tuple[ConditionedLog, ...]:
        """The conditioned logs."""
        return tuple(each.log for each in self.rows)

    @property
    def blocks(self) -> int:
        """Number of blocks of time."""
        return len(self.factors)

    @property
    def samples(self) -> int:
        """Number of instants in the stack."""
        return int(self.counts.max(axis=1).sum()) if len(self.counts) else 0

    @property
    def commanded(self) -> bool:
        """Whether every log says what was commanded."""
        return all(segment.command_q.size for log in self.logs for segment in log.segments)

    @cached_property
    def whole(self) -> tuple[Floats, Ints]:
        """One factor per joint over all blocks, (n, p + 1, p + 1) [N m or N], and its number of rows, (n,)."""
        return np.array([merge(part) for part in self.factors.swapaxes(0, 1)]), self.counts.sum(
            axis=0
        )

    @cached_property
    def first_fit(self) -> Fit:
        """Weighted least squares of all rows as they are, from which what is asked of residuals begins."""
        return weighted(*self.whole)

    def select(self, blocks: Mask) -> Stack:
        """Return some blocks of time, (B,), as a stack of their own."""
        if blocks.all():
            return self
        return replace(
            self,
            factors=self.factors[blocks],
            counts=self.counts[blocks],
            log_of_block=self.log_of_block[blocks],
            block=self.block[blocks],
        )

    def without(self, joints: Ints | NDArray[np.intp]) -> Stack:
        """Return the stack as if some joints, by number, had no torques."""
        factors, counts = self.factors.copy(), self.counts.copy()
        factors[:, joints], counts[:, joints] = 0.0, 0
        return replace(self, factors=factors, counts=counts, silent=tuple(int(j) for j in joints))

    @property
    def instrumented(self) -> Stack:
        """The stack with rows that come with the regressor on the commanded motion."""
        rows = (LogRows(log, self.base, commanded=True) for log in self.logs)
        return replace(self, rows=tuple(rows))


def added(stacks: Sequence[Stack]) -> Stack:
    """Return the stack of the logs of several, in their order; all have the same base parameters and cut-off."""
    first, *others = stacks
    if not others:
        return first
    shifts = np.cumsum([0, *(len(each.rows) for each in stacks[:-1])])
    rows = tuple(one for each in stacks for one in each.rows)
    places = [
        np.where(s.log_of_block < 0, -1, s.log_of_block + k)
        for s, k in zip(stacks, shifts, strict=True)
    ]
    return Stack(
        base=first.base,
        factors=np.concatenate([each.factors for each in stacks]),
        counts=np.concatenate([each.counts for each in stacks]),
        log_of_block=np.concatenate(places),
        block=np.concatenate([each.block for each in stacks]),
        rows=rows,
        earlier=next((each.earlier for each in stacks if each.earlier is not None), None),
    )


def stack_logs(
    logs: Sequence[ConditionedLog], base: BaseModel, progress: Progress = SILENT
) -> Stack:
    """Fold conditioned logs into triangular factors of a model's base columns.

    Args:
        logs: conditioned logs, all under the same filter.
        base: model and base parameters.
        progress: told how far the work is.
    """
    progress.stage("stack")
    found = added([_of_log(log, base, progress, (k, len(logs))) for k, log in enumerate(logs)])
    rows = f"{found.samples} samples x {len(found.joints)} joints"
    progress.stage("stacked", f"{rows} -> W {int(found.counts.sum())} x {len(found.names)}")
    return found


def _of_log(
    log: ConditionedLog, base: BaseModel, progress: Progress, place: tuple[int, int]
) -> Stack:
    n, size = base.robot.n, len(base.names) + 1
    factors: list[Floats] = []
    counts: list[Ints] = []
    blocks: list[int] = []
    expected, done = sum(len(s) for s in log.segments), 0
    found = LogRows(log, base)
    for rows in found:
        if rows.block not in blocks[-1:]:
            factors.append(np.zeros((n, size, size)))
            counts.append(np.zeros(n, dtype=np.int64))
            blocks.append(rows.block)
        for j in range(n):
            counts[-1][j] += fold(factors[-1][j], rows, j)
        done += len(rows.t) * log.filter.second_step
        progress.advance(place[0] + min(1.0, done / expected), place[1], log.name)
    return Stack(
        base=base,
        factors=np.array(factors).reshape(-1, n, size, size),
        counts=np.array(counts, dtype=np.int64).reshape(-1, n),
        log_of_block=np.zeros(len(blocks), dtype=np.int64),
        block=np.array(blocks, dtype=np.int64),
        rows=(found,),
    )


# ---------------------------------------------------------------- effects that scale with what is identified
def settled(
    logs: Sequence[ConditionedLog], base: BaseModel, first: Floats | None = None
) -> list[ConditionedLog]:
    """Return logs whose columns that scale with the model fit the parameters that are identified from them.

    Such columns, of load-dependent friction for example, are made with the last estimate, and the fit is repeated; the
    result is then its own reference.

    Args:
        logs: conditioned logs.
        base: model and base parameters.
        first: base parameters to begin with, (p,), each in its unit; those of a first fit when None.
    """
    found = list(logs)
    for _ in range(tuning.SCALED_ROUNDS if scale_with_model(base) else 0):
        theta = stack_logs(found, base).first_fit.theta if first is None else first
        found, first = scaled(found, base, theta), None
    return found


def scale_with_model(base: BaseModel) -> bool:
    """Return whether columns of the model's effects depend on the parameters that are identified."""
    return any(each.effect.needs_model for each in base.model.added)


def scaled(logs: Sequence[ConditionedLog], base: BaseModel, theta: Floats) -> list[ConditionedLog]:
    """Return logs whose model-based columns scale with given base parameters, (p,), each in its unit."""
    reference = model_torques(base.model, base.reduction, theta)
    return [with_effects(log, base.model, reference) for log in logs]


# ---------------------------------------------------------------- how late the torques are
#: Rows on either side that the slope of a torque is taken from.
REACH = 2


def is_clear(delay: float, std_error: float, reach: float) -> bool:
    """Return whether a delay of torques is large enough and certain enough to be corrected [s].

    Beyond ``reach``, the time between two rows [s], a slope is no shift any more, and its error is not to be trusted.
    """
    least = max(tuning.DELAY_LEAST_S, tuning.DELAY_CLEAR_ERRORS * std_error)
    return least < abs(delay) < reach


def estimate_delay(stack: Stack) -> tuple[float, float]:
    """Return the delay that all joints share, positive when the torques are late, and its standard error [s].

    The error allows for coloured residuals.

    Args:
        stack: the stacked logs; a rank that is short does no harm.
    """
    from scipy.linalg import block_diag

    fit = stack.first_fit
    whitened = fit.whitened[:-1, :-1]
    length = np.linalg.norm(whitened, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    _, sigma, Vt = np.linalg.svd(whitened / length)
    columns = (Vt[sigma > tuning.RANK_TOLERANCE * sigma[0]] / length).T
    slopes = _slopes(stack, fit.theta)
    rows = (_with_slope(part, slope) for part, slope in zip(stack, slopes, strict=True))
    # Why a basis: directions that the log leaves open would have no covariance.
    basis = block_diag(columns, np.eye(1))
    factors, counts = stack.whole
    seen = zip(factors, *_products(stack, slopes), strict=True)
    factors = np.array([with_columns(R, across, square, at=-1) for R, across, square in seen])
    found = weighted(
        np.array([triangle(R @ block_diag(basis, np.eye(1))) for R in factors]), counts
    )
    covariance = hac_covariance(rows, found.theta, found.noise, bread=found.covariance, basis=basis)
    variance = widened(stack, found, covariance)[-1, -1]
    return float(found.theta[-1]), float(np.sqrt(variance))


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
    )


def _slopes(stack: Stack, theta: Floats) -> tuple[Floats, ...]:
    """Return the time derivative of the fitted torques, one array for each piece of rows."""
    segments: list[tuple[list[int], list[Floats], list[Floats]]] = []
    for rows in stack:
        if not (rows.follows and segments):
            segments.append(([], [], []))
        lengths, times, torques = segments[-1]
        lengths.append(len(rows.t))
        times.append(rows.t)
        torques.append(rows.torque(theta))
    slopes: list[Floats] = []
    for lengths, times, torques in segments:
        slope = _slope(np.concatenate(times), np.concatenate(torques))
        slopes += np.split(slope, np.cumsum(lengths)[:-1])
    return tuple(slopes)


def _slope(t: Floats, tau: Floats) -> Floats:
    """Return the time derivative of torques, (M, n)."""
    step = (t[-1] - t[0]) / max(1, len(t) - 1)
    slope = np.gradient(tau, t, axis=0) if len(t) > 1 else np.zeros_like(tau)
    if len(t) > 2 * REACH:
        # Why five points: with four rows a period of the cut-off, two neighbours see only two thirds of a fast slope.
        slope[2:-2] = (8 * (tau[3:-1] - tau[1:-3]) - (tau[4:] - tau[:-4])) / (12 * step)
    return np.asarray(slope)


def delay_findings(delay: float, std_error: float, applied: float, reach: float) -> list[Finding]:
    """Say that the torques are late, when they are by more than a few milliseconds [s]."""
    if abs(delay) < tuning.DELAY_NOTABLE_S or not is_clear(delay, std_error, reach):
        return []
    word = "later" if delay > 0 else "earlier"
    size = f"{1e3 * abs(delay):.1f} +- {1e3 * std_error:.1f} ms"
    done = "corrected" if applied else "not corrected: --delay auto"
    text = f"torques are stamped {size} {word} than positions; {done}"
    return [Finding("W321", "warning", text, {"delay_s": delay, "std_error_s": std_error})]


def on_time(
    stack: Stack, progress: Progress = SILENT
) -> tuple[Stack, tuple[float, float], tuple[Finding, ...]]:
    """Estimate how late the torques of a stack are, and move them back when that is clear.

    Args:
        stack: the stacked logs, their torques as they were recorded.
        progress: told what was noticed.

    Returns:
        The stack, in whose logs stands by how much they were moved; the delay with its error [s]; the findings.
    """
    base, logs = stack.base, stack.logs
    reach = 1.0 / logs[0].filter.kept_rate
    (delay, std_error), applied = estimate_delay(stack), 0.0
    for _ in range(tuning.DELAY_ROUNDS if is_clear(delay, std_error, reach) else 0):
        applied = delay
        stack = stack_logs(
            settled([torques_moved_back(log, base.model, applied) for log in logs], base), base
        )
        left, std_error = estimate_delay(stack)
        delay = applied + left
        if abs(delay - applied) < tuning.DELAY_SETTLED_S:
            break
    size = f"torques {1e3 * delay:+.1f} +- {1e3 * std_error:.1f} ms after the positions"
    progress.stage(
        "delay", f"{size}; {f'corrected by {1e3 * applied:.1f} ms' if applied else 'left as it is'}"
    )
    late = tuple(delay_findings(delay, std_error, applied, reach))
    progress.findings(late)
    return stack, (delay, std_error), late
