"""Logs as stacks: their rows, and triangular factors of each block of time (Paper Eq. 23).

Everything linear (ordinary and weighted least squares, hold-out) needs only the factors. Stacks are added.

How late the torques were stamped is found from a stack. A torque that is late by d is W theta at t - d, to first order
W theta - d * (W theta)'. The slope of the fitted torques is one more column of the regression, and its coefficient is
the delay; what it shares with real parameters (viscous friction looks like late gravity) widens its error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Floats, Mask
from dynid.errors import Finding
from dynid.estimation import tuning
from dynid.estimation.least_squares import Fit, coloured, merge, weighted, widened
from dynid.estimation.rows import (
    Rows,
    joined,
    on_command,
    regressor_of,
    row_times,
    rows_of,
)
from dynid.files.artifact import packed, read_artifact, reading, unpacked
from dynid.model.base_model import BaseModel
from dynid.model.regressor import Observer
from dynid.npz import write_artifact
from dynid.progress import heard_by, notice, stage
from dynid.signals.conditioned_log import (
    ConditionedLog,
    torques_moved_back,
    with_effects,
)

SCHEMA = "dynid/fullnumericregressor/1"
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Stack:
    """The rows of one or several logs.

    Attributes:
        base: model and base parameters whose columns the rows have.
        logs: the conditioned logs.
        rows: theirs.
        earlier: fit of the result that is updated, whose factors stand for its rows; None otherwise.
    """

    base: BaseModel = field(repr=False, compare=False)
    logs: tuple[ConditionedLog, ...]
    rows: Rows = field(repr=False, compare=False)
    earlier: Fit | None = field(default=None, repr=False, compare=False)

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
    def samples(self) -> int:
        """Number of instants in the stack."""
        earlier = 0 if self.earlier is None else self.earlier.counts.max()
        return int(self.rows.use.any(axis=1).sum() + earlier)

    @cached_property
    def factors(self) -> Floats:
        """One factor per joint over all rows, (n, p + 1, p + 1) [N m or N]."""
        factors, old = self.rows.factors(), self.earlier
        if old is None:
            return factors
        return np.array([merge(np.stack(pair)) for pair in zip(old.factors, factors, strict=True)])

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of rows of each joint, (n,)."""
        counts = self.rows.counts
        return counts if self.earlier is None else counts + self.earlier.counts

    @cached_property
    def first_fit(self) -> Fit:
        """Weighted least squares of all rows as they are, from which what is asked of residuals begins."""
        return weighted(self.factors, self.counts)

    def take(self, chosen: Mask) -> Stack:
        """Return some of the rows, (M,), as a stack of their own."""
        return replace(self, rows=self.rows.take(chosen))

    @property
    def instrumented(self) -> Rows:
        """The rows with the regressor on the commanded motion as instruments."""
        made = self.along(
            lambda log, t: regressor_of(on_command(log), self.observer)[np.isin(row_times(log), t)]
        )
        return replace(self.rows, Z=made)

    def save(self, path: Path, header: dict[str, Any]) -> None:
        """Write fullnumericregressor.npz: the conditioned logs and one triangular factor of [W tau] per joint.

        That is all that least squares needs, small however long the logs were; the matrix itself is never stored.
        """
        arrays = {"R": self.factors, "rows": self.counts}
        facts = {
            **header,
            "base": list(self.names),
            "joints": list(self.joints),
            "conditioned": packed(self.logs, arrays, "log"),
        }
        write_artifact(path, SCHEMA, facts, arrays)

    def along(self, made: Callable[[ConditionedLog, Floats], Floats]) -> Floats:
        """Return what is made of each log at the times of its rows, (M, ...)."""
        rows = self.rows
        return np.concatenate(
            [made(self.logs[k], rows.t[rows.log == k]) for k in np.unique(rows.log)]
        )

    def restacked(self, logs: Sequence[ConditionedLog]) -> Stack:
        """Return the stack of the same motion with other torques, friction signs and effects.

        The columns of the rigid bodies stay, and they are most of the memory: so those beside them are written over in
        the rows of this stack, which is of no use any more.
        """
        columns = self.base.reduction.base
        own = columns >= len(self.base.model.link_columns)
        rows = _rows_of_logs(logs, self.base.model.observer(columns[own]))
        self.rows.W[:, :, own] = rows.W
        return replace(self, logs=tuple(logs), rows=replace(rows, W=self.rows.W))


def load_logs(path: Path) -> tuple[tuple[ConditionedLog, ...], dict[str, Any]]:
    """Read fullnumericregressor.npz: the conditioned logs and the header."""
    artifact = read_artifact(path, SCHEMA)
    header = dict(artifact.header)
    with reading(path):
        kind, stored = tuple[ConditionedLog, ...], header.pop("conditioned")
        logs: tuple[ConditionedLog, ...] = unpacked(kind, stored, artifact.arrays)
        times = [segment.t for log in logs for segment in log.segments]
        if not times or not all(np.all(np.diff(t) > 0) for t in times):
            raise ValueError("it has no logs whose time increases")
    return logs, header


def load_factors(path: Path) -> tuple[Floats, dict[str, Any]]:
    """Return the triangular factors of [W tau] in fullnumericregressor.npz, (n, p + 1, p + 1), and its header."""
    artifact = read_artifact(path, SCHEMA)
    with reading(path):
        return artifact.arrays["R"], dict(artifact.header)


def stack_logs(logs: Sequence[ConditionedLog], base: BaseModel) -> Stack:
    """Evaluate the rows of conditioned logs in a model's base columns.

    Args:
        logs: conditioned logs, all under the same filter.
        base: model and base parameters.
    """
    stage("stack")
    stacked = Stack(base, tuple(logs), _rows_of_logs(logs, base.observer))
    size = f"{int(stacked.rows.use.sum())} x {len(stacked.names)}"
    stage("stacked", f"{stacked.samples} samples x {len(stacked.joints)} joints -> W {size}")
    return stacked


def _rows_of_logs(logs: Sequence[ConditionedLog], observer: Observer) -> Rows:
    """Return the rows of logs, one after the other."""
    parts = (rows_of(log, observer) for log in logs)
    return joined([replace(rows, log=rows.log + k) for k, rows in enumerate(parts)])


# ---------------------------------------------------------------- effects that scale with what is identified
def settled(stack: Stack) -> Stack:
    """Return a stack whose columns that scale with the model fit the parameters that are identified from them.

    Such columns, of load-dependent friction for example, are made with the last estimate, and the fit is repeated; the
    result is then its own reference.
    """
    base = stack.base
    for _ in range(tuning.SCALED_ROUNDS if scale_with_model(base) else 0):
        stack = stack.restacked(scaled(stack.logs, base, stack.first_fit.theta))
    return stack


@heard_by()
def stack_with_settled_effects(logs: Sequence[ConditionedLog], base: BaseModel) -> Stack:
    """Return logs stacked and settled, of which nothing is said."""
    return settled(stack_logs(logs, base))


def scale_with_model(base: BaseModel) -> bool:
    """Return whether columns of the model's effects depend on the parameters that are identified."""
    return any(each.effect.needs_model for each in base.model.added)


def scaled(logs: Sequence[ConditionedLog], base: BaseModel, theta: Floats) -> list[ConditionedLog]:
    """Return logs whose model-based columns scale with given base parameters, (p,), each in its unit."""
    reference = base.torques(theta)
    return [with_effects(log, base.model, reference) for log in logs]


# ---------------------------------------------------------------- how late the torques are
def estimate_delay(stack: Stack) -> tuple[float, float]:
    """Return the delay that all joints share, positive when the torques are late, and its standard error [s].

    The error allows for coloured residuals, and for joints that disagree: friction that gives way before it slips, or
    turns softer than its law, looks like a delay of its own on each.

    Args:
        stack: the stacked logs; a rank that is short does no harm.
    """
    fit, rows = stack.first_fit, stack.rows
    later = -slopes(rows, rows.torque(fit.theta))
    extended = weighted(rows.factors(None, later[:, :, None]), rows.counts)
    delay, *arm = extended.theta
    left = replace(rows, tau=rows.tau - delay * later).residual(np.array(arm)) / extended.noise**2
    scores = np.column_stack([np.sum(later * left, axis=1), rows.scores(left)])
    variance = widened(rows, extended, coloured(rows, scores, extended.covariance))[0, 0]
    pull = np.sum(later * left, axis=0), np.einsum("mjp,mj->jp", rows.W, left)
    apart = np.column_stack(pull) @ extended.covariance[0]
    return float(delay), float(np.sqrt(variance + apart @ apart))


def slopes(rows: Rows, tau: Floats) -> Floats:
    """Return the time derivative of torques at the rows, both (M, n)."""
    found = []
    for run in rows.runs:
        t, x = rows.t[run], np.pad(tau[run], ((2, 2), (0, 0)), "reflect", reflect_type="odd")
        # Why five points: with four rows a period of the cut-off, two neighbours see only two thirds of a fast slope.
        change = 8 * (x[3:-1] - x[1:-3]) - (x[4:] - x[:-4])
        found.append(change * (len(t) - 1) / (12 * np.ptp(t) or 1.0))
    return np.concatenate(found)


def on_time(stack: Stack) -> tuple[Stack, tuple[float, float], tuple[Finding, ...]]:
    """Estimate how late the torques of a stack are, and move them back when that is clear.

    Args:
        stack: the stacked logs, their torques as they were recorded.

    Returns:
        The stack, in whose logs stands by how much they were moved; the delay with its error [s]; the findings.
    """
    logs = stack.logs
    reach = 1.0 / logs[0].filter.kept_rate
    (delay, std_error), applied = estimate_delay(stack), 0.0
    # Why not beyond: there a slope is no shift any more, and its error is not to be trusted.
    clear = max(tuning.DELAY_SETTLED_S, tuning.DELAY_CLEAR_ERRORS * std_error) < abs(delay) < reach
    for _ in range(tuning.DELAY_ROUNDS if clear else 0):
        applied = delay
        stack = settled(
            stack.restacked([torques_moved_back(log, stack.base.model, applied) for log in logs])
        )
        left, std_error = estimate_delay(stack)
        delay = applied + left
        if abs(left) < tuning.DELAY_SETTLED_S:
            break
    size = f"torques {1e3 * delay:+.1f} +- {1e3 * std_error:.1f} ms after the positions"
    done = f"corrected by {1e3 * applied:.1f} ms" if applied else "left as it is"
    stage("delay", f"{size}; {done}")
    late: tuple[Finding, ...] = ()
    if abs(applied) > tuning.DELAY_SAID_S:
        size = f"{1e3 * abs(delay):.1f} +- {1e3 * std_error:.1f} ms"
        text = f"torques are stamped {size} {'later' if delay > 0 else 'earlier'} than positions; corrected"
        late = (Finding("W321", "warning", text, {"delay_s": delay, "std_error_s": std_error}),)
    notice(late)
    return stack, (delay, std_error), late
