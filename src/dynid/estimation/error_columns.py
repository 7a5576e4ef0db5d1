"""The columns of the residual model in the rows of logs, and the triangular factors that they make with [W tau].

The columns D of a joint are sines of its position (angle offsets, springs, cable forces), its Coulomb sign times sines
of the position and times shapes of the speed (friction that depends on both), and its Coulomb sign times the torque
that the parameters ask for (friction of the load). Rows are walked over once; ``model_error`` works on the factors.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.least_squares import with_columns
from dynid.estimation.observation_rows import ObservationRows, RowWalk, fold, joined
from dynid.estimation.stack import Stack
from dynid.longarrays import spans
from dynid.model.regressor import Observer
from dynid.signals.conditioned_log import ConditionedLog
from dynid.signals.filters import decimate

Floats = NDArray[np.float64]

#: Group of each column: 0 position, 1 friction, 2 load.
GROUPS = np.repeat(
    [0, 1, 2], [2 * tuning.POSITION_HARMONICS, 2 * tuning.FRICTION_HARMONICS + len(tuning.FRICTION_SPEEDS), 1]
)


def shapes_of(q: Floats, qd: Floats, sign: Floats, speed: Floats) -> Floats:
    """Return the columns of each joint, (N, n, k); the last one, of the load, lacks its torque.

    Args:
        q: positions, (N, n) [rad or m].
        qd: velocities, (N, n) [rad/s or m/s].
        sign: Coulomb signs of the velocities, (N, n).
        speed: rms speed of each joint in the fitted motion, (n,) [rad/s or m/s].
    """
    return _shapes(q, qd, sign, speed).transpose(2, 0, 1)


def _shapes(q: Floats, qd: Floats, sign: Floats, speed: Floats) -> Floats:
    """Return the columns as ``shapes_of`` does, (n, k, N)."""
    found = np.empty((q.shape[1], len(GROUPS), len(q)))
    q, share, sign = (np.ascontiguousarray(x.T) for x in (q, np.abs(qd) / speed, sign))
    sine, cosine = found[:, 0], found[:, 1]
    np.sin(q, out=sine)
    np.cos(q, out=cosine)
    # Why not of each multiple: sums of angles take a tenth of the time of a sine.
    for k in range(2, 2 * tuning.POSITION_HARMONICS, 2):
        found[:, k] = found[:, k - 2] * cosine + found[:, k - 1] * sine
        found[:, k + 1] = found[:, k - 1] * cosine - found[:, k - 2] * sine
    place = 2 * tuning.POSITION_HARMONICS
    for k in range(2 * tuning.FRICTION_HARMONICS):
        np.multiply(sign, found[:, k], out=found[:, place + k])
    place += 2 * tuning.FRICTION_HARMONICS
    for k, least in enumerate(tuning.FRICTION_SPEEDS):
        np.multiply(sign, np.exp(share / -least), out=found[:, place + k])
    found[:, -1] = sign
    return found


def filtered_shapes(rows: ObservationRows, log: ConditionedLog, observer: Observer, speed: Floats) -> Floats:
    """Return the columns of ``shapes_of`` under the filter of some rows of a log, (n, k, M)."""
    kernel, step = log.filter.second_kernel, log.filter.second_step
    taps, count = kernel.shape[1], len(rows.t)
    middle = (taps - 1) // 2
    for segment in log.segments:
        if segment.t[0] <= rows.t[0] <= segment.t[-1]:
            break
    after = min(max(1, int(np.searchsorted(segment.t, rows.t[0]))), len(segment) - 1)
    first = after - int(rows.t[0] - segment.t[after - 1] <= segment.t[after] - rows.t[0]) - middle
    part = slice(first, first + (count - 1) * step + taps)
    q, qd = segment.q[part], segment.qd[part]
    sign = segment.coulomb_sign[part] if segment.coulomb_sign.size else observer.coulomb_sign(qd)
    shapes = _shapes(q, qd, sign, speed)
    return np.asarray(decimate(shapes.reshape(-1, len(q)), kernel, step)[0].reshape(*shapes.shape[:2], count))


def columns_of(
    rows: ObservationRows, log: ConditionedLog, observer: Observer, speed: Floats, reference: Floats
) -> Floats:
    """Return D in some rows of a log, (n, k, M); arguments as for ``folded``."""
    D = filtered_shapes(rows, log, observer, speed)
    D[:, -1] *= np.abs(rows.torque(reference)).T
    return D


def rms_speed(logs: Iterable[ConditionedLog], n: int) -> Floats:
    """Return the rms speed of each joint, never quite zero, (n,) [rad/s or m/s]."""
    squares, count = np.zeros(n), 0
    for log in logs:
        for segment in log.segments:
            for part in spans(len(segment)):
                squares += np.sum(segment.qd[part] ** 2, axis=0)
            count += len(segment)
    return np.maximum(np.sqrt(squares / max(1, count)), 1e-3)


def folded(stack: Stack, speed: Floats, reference: Floats, noise: Floats, robust: Floats | None) -> Floats:
    """Return triangular factors of [D W tau] per joint, weighted like the estimate, (n, k + p + 1, k + p + 1).

    Args:
        stack: the rows.
        speed: rms speed of each joint, (n,) [rad/s or m/s].
        reference: base parameters that give the torque of the load, (p,).
        noise: sigma of each joint, (n,) [N m or N].
        robust: estimate from which residuals are spikes, (p,); None where it gave them their whole weight.
    """
    n, p, k = len(stack.joints), len(stack.names), len(GROUPS)
    if stack.reversals is None and robust is None:
        return _beside(stack, speed, reference)
    factors = np.zeros((n, k + p + 1, k + p + 1))
    walk = walk_with_columns(stack, speed, reference)
    for rows in _together(walk if stack.reversals is None else stack.reversals.whitened(walk)):
        weight = np.ones_like(rows.tau)
        if robust is not None:
            left = np.abs(rows.tau - rows.torque(np.concatenate([np.zeros(k), robust]))) / noise
            weight = tuning.RESIDUAL_FAR / np.maximum(left, tuning.RESIDUAL_FAR)
        for j, F in enumerate(factors):
            fold(F, rows, j, weight[:, j])
    return factors


def _beside(stack: Stack, speed: Floats, reference: Floats) -> Floats:
    """Return what ``folded`` does of rows that have their whole weight, whose factors of [W tau] are there already."""
    n, p, k = len(stack.joints), len(stack.names), len(GROUPS)
    across, squares = np.zeros((n, p + 1, k)), np.zeros((n, k, k))
    for rows, D in _rows_and_columns(stack, speed, reference):
        if not rows.mask.all():
            D *= rows.mask.T[:, None]
        for j, own in enumerate(D):
            columns, entries = rows.of_joint(j)
            across[j, columns] += entries @ own.T
            across[j, -1] += own @ rows.tau[:, j]
            squares[j] += own @ own.T
    found = np.zeros((n, k + p + 1, k + p + 1))
    for F, R, common, own in zip(found, stack.whole[0], across, squares, strict=True):
        whole = with_columns(R, common, own)
        F[: len(whole)] = whole
    return found


def _rows_and_columns(stack: Stack, speed: Floats, reference: Floats) -> Iterator[tuple[ObservationRows, Floats]]:
    """Yield the rows of a stack, and D in them, (n, k, M)."""
    for number, log in enumerate(stack.logs):
        for rows in stack.rows_of_log(number):
            yield rows, columns_of(rows, log, stack.observer, speed, reference)


def walk_with_columns(stack: Stack, speed: Floats, reference: Floats) -> RowWalk:
    """Return the rows of a stack with [D W] in place of W; arguments as for ``folded``."""
    n, k = len(stack.joints), len(GROUPS)
    joints, columns = np.divmod(np.arange(n * k), k)

    def walk() -> Iterator[ObservationRows]:
        for rows, D in _rows_and_columns(stack, speed, reference):
            yield replace(
                rows,
                entries=np.concatenate([D.reshape(n * k, -1), rows.entries]),
                joints=np.concatenate([joints, rows.joints]),
                columns=np.concatenate([columns, k + rows.columns]),
                size=k + rows.size,
                command=None,
            )

    return RowWalk(walk)


def _together(rows: Iterable[ObservationRows]) -> Iterator[ObservationRows]:
    """Yield rows that are enough to be folded at once."""
    held: list[ObservationRows] = []
    for each in rows:
        held.append(each)
        if sum(len(one.tau) for one in held) >= tuning.ROWS_FOLDED:
            yield joined(held)
            held = []
    if held:
        yield joined(held)
