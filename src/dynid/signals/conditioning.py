"""A clean log becomes motion: resampled by time stamp, filtered without delay, differentiated twice, thinned.

Two filters: one on the positions, wide, so that velocity and acceleration can be formed; one, narrower, over torques
and regressor columns alike (``dynid.estimation.stack``). Gaps are cut, never bridged. What is excluded was taken out of
the log before (``stamps.without_intervals``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import LogTooShort
from dynid.log import Log
from dynid.longarrays import empty, filled, median_step, release, spans
from dynid.robot import Coulomb, Robot
from dynid.signals.cutoff import choose_cutoff
from dynid.signals.filters import decimate, derivative_kernels, lowpass_kernel, pulse_width
from dynid.signals.motion import runs
from dynid.signals.pieces import samples_where
from dynid.signals.stamps import steps
from dynid.signals.velocity_sign import NOISE_SAMPLES, VelocitySign, choose_velocity_sign

Floats = NDArray[np.float64]

#: The position filter's cut-off over the cut-off of the parallel filter.
POSITION_OVER_PARALLEL = 4.0
#: Samples per cut-off period that the regressor is evaluated at, and that are kept after the parallel filter.
EVALUATED_PER_CUTOFF = 20.0
KEPT_PER_CUTOFF = 4.0
#: A joint is at rest when it stays slow for this long [s]; a reversal is shorter.
LEAST_REST = 0.25
#: A step longer than this many samples is a gap: the motion in between is unknown.
GAP_SAMPLES = 5.0
#: Stamps that stray from an even grid by less than this share of the step are taken as even.
EVEN = 1e-3
#: Steps that are added up before they are counted: single ones are too uneven to show how many sample times they are.
RATE_BLOCK = 20
#: Samples of a block when a long log is filtered piece by piece.
BLOCK = 1 << 16


@dataclass(frozen=True)
class Filter:
    """How a log was filtered.

    Attributes:
        rate: sample rate of the log [Hz].
        cutoff: cut-off of the parallel filter over torque and columns [Hz].
        first_step: thinning after the position filter.
        second_step: thinning after the parallel filter.
    """

    rate: float
    cutoff: float
    first_step: int
    second_step: int

    @property
    def position_cutoff(self) -> float:
        """Cut-off of the position filter [Hz]."""
        return POSITION_OVER_PARALLEL * self.cutoff

    @property
    def kept_rate(self) -> float:
        """Rate of the rows that are fitted [Hz]."""
        return self.rate / (self.first_step * self.second_step)

    @property
    def first_kernels(self) -> Floats:
        """Kernels for q, qd and qdd, (3, taps)."""
        return derivative_kernels(lowpass_kernel(self.position_cutoff, self.rate), self.rate)

    @property
    def second_kernel(self) -> Floats:
        """Kernel of the parallel filter, (1, taps)."""
        return lowpass_kernel(self.cutoff, self.rate / self.first_step)[None, :]


@dataclass(frozen=True)
class Segment:
    """Part of a log without gaps, after the position filter; N samples of n joints.

    Attributes:
        t: time in the log's clock, (N,) [s].
        q: positions, (N, n) [rad or m].
        qd: velocities, (N, n) [rad/s or m/s].
        qdd: accelerations, (N, n) [rad/s^2 or m/s^2].
        tau: torques under the same filter, (N, n) [N m, N or A].
        usable: False where a sample under the filter was clipped, or the joint rests, (N, n).
        raw_q: unfiltered position at the same times, (N, n) [rad or m].
        raw_qd: unfiltered velocity: the driver's where there is one, otherwise differences, (N, n) [rad/s or m/s].
        command_q: commanded positions under the same filter, (N, n) [rad or m]; (N, 0) where the log has none.
        command_qd: commanded velocities, (N, n) [rad/s or m/s].
        command_qdd: commanded accelerations, (N, n) [rad/s^2 or m/s^2].
        effects: entries of the columns of added effects, (N, E) [N m or N per unit of the parameter].
        elapsed: time since the log began, (N,) [s].
        coulomb_sign: sign of the velocity as Coulomb friction has it, under the same filter, (N, n); (N, 0) where it is
            to be taken of ``qd``.
        command_coulomb_sign: the same of the commanded motion, (N, n).
    """

    t: Floats
    q: Floats
    qd: Floats
    qdd: Floats
    tau: Floats
    usable: NDArray[np.bool_]
    raw_q: Floats
    raw_qd: Floats
    command_q: Floats
    command_qd: Floats
    command_qdd: Floats
    effects: Floats
    elapsed: Floats
    coulomb_sign: Floats
    command_coulomb_sign: Floats

    @property
    def command(self) -> tuple[Floats, Floats, Floats] | None:
        """Commanded motion, None where the log has none."""
        return (self.command_q, self.command_qd, self.command_qdd) if self.command_q.size else None

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.t)


def grid_rate(t: Floats) -> float:
    """Return the rate of the even grid that samples are put on [Hz]; logs of one recorder get the same.

    Args:
        t: increasing time stamps, (N,) [s].
    """
    close, usual = steps(t), median_step(t)
    far = samples_where(len(close), lambda part: close[part] >= GAP_SAMPLES * usual)
    close = close if not len(far) else close[close < GAP_SAMPLES * usual]
    share = max(_from_whole(close[part] / usual) for part in spans(len(close)))
    if share < EVEN:
        # Why: stamps in seconds since 1970 give rates such as 199.99999.
        return float(f"{1 / usual:.6g}")
    # Why not the median, and why round: uneven steps leave it open, and repeats on different grids would be no repeats.
    blocks = np.add.reduceat(close, np.arange(0, len(close), RATE_BLOCK))
    for _ in range(2):
        usual = float(blocks.sum() / max(1.0, np.round(blocks / usual).sum()))
    return float(f"{1 / usual:.3g}")


def _from_whole(x: Floats) -> float:
    """Return how far numbers are from whole ones at most."""
    return float(np.abs(x - np.round(x)).max(initial=0.0))


def choose_filter(log: Log, robot: Robot, cutoff: float | None = None) -> Filter:
    """Choose the filters for a log.

    Args:
        log: a prepared log.
        robot: its robot.
        cutoff: cut-off of the parallel filter [Hz]; ``choose_cutoff`` when None.

    Raises:
        LogTooShort: the filters are longer than the log.
    """
    if cutoff is None:
        cutoff = choose_cutoff([log], robot)
    cutoff = min(cutoff, 0.45 * log.rate)
    if 2.0 * pulse_width(cutoff) > log.duration:
        raise _too_short(log, f"the log has {log.duration:.2f} s", cutoff, 2.0 * pulse_width(cutoff))
    rate = grid_rate(log.t)
    first = max(1, int(rate / (EVALUATED_PER_CUTOFF * cutoff)))
    second = max(1, int(rate / first / (KEPT_PER_CUTOFF * cutoff)))
    return Filter(rate, cutoff, first, second)


def _too_short(log: Log, what: str, cutoff: float, needed: float) -> LogTooShort:
    return LogTooShort(
        f"{what}; the filters at {cutoff:.3g} Hz need {needed:.2f} s",
        where=str(log.source or ""),
        fix="record a longer motion, or raise --cutoff",
    )


def condition(
    log: Log,
    chosen: Filter,
    *,
    measured_velocity: bool = False,
    coulomb: Coulomb | None = None,
    rest_speed: Floats | None = None,
) -> list[Segment]:
    """Resample, filter and differentiate a log: one segment for each part without gaps.

    Args:
        log: a prepared log, in DH quantities of one robot.
        chosen: the filters.
        coulomb: shape of the Coulomb sign, whose column then gets the filter that the torques get; None to leave the
            sign to those who evaluate the columns.
        rest_speed: speed below which the friction of a joint is undetermined, 0 where that does not matter, (n,)
            [rad/s or m/s]; samples of a joint that stays slower for ``LEAST_REST`` are not usable.
        measured_velocity: take the velocity that the driver measured, and differentiate only that, where there is one.

    Raises:
        LogTooShort: no part is longer than the filters.
    """
    step = 1.0 / chosen.rate
    cuts = (
        samples_where(
            len(log) - 1, lambda part: np.diff(log.t[part.start : part.stop + 1]) > (GAP_SAMPLES + 0.5) * step
        )
        + 1
    )
    needed = chosen.first_kernels.shape[1] + chosen.first_step * (chosen.second_kernel.shape[1] + chosen.second_step)
    edges = [0, *cuts.tolist(), len(log)]
    parts = [slice(start, end) for start, end in pairwise(edges) if end - start > needed]
    segments = [_segment(log, part, chosen, measured_velocity and log.qd is not None, coulomb) for part in parts]
    if not segments:
        longest = max(end - start for start, end in pairwise(edges)) * step
        raise _too_short(log, f"the longest part without a gap has {longest:.2f} s", chosen.cutoff, needed * step)
    return segments if rest_speed is None else [_without_rests(segment, rest_speed) for segment in segments]


def _without_rests(segment: Segment, rest_speed: Floats) -> Segment:
    """Mark samples of joints at rest: static friction holds any torque up to its limit, which no column describes."""
    least = max(1, round(LEAST_REST / (segment.t[1] - segment.t[0]))) if len(segment) > 1 else 1
    usable = segment.usable.copy()
    for j in np.flatnonzero(rest_speed > 0.0):
        still = np.concatenate([np.abs(segment.qd[part, j]) < rest_speed[j] for part in spans(len(segment))])
        for rest in runs(still, least):
            usable[rest, j] = False
    return replace(segment, usable=usable)


@dataclass(frozen=True)
class _OnGrid:
    """Part of a log without gaps, seen on an even grid.

    Attributes:
        log: the log.
        part: its samples.
        count: number of the grid's times.
        rate: of the grid [Hz].
        even: whether the samples lie on the grid as they are.
    """

    log: Log
    part: slice
    count: int
    rate: float
    even: bool

    def times(self, wanted: slice) -> Floats:
        """Return the times of part of the grid [s]."""
        return np.asarray(
            self.log.t[self.part.start] + np.arange(wanted.start, min(wanted.stop, self.count)) / self.rate
        )

    def column(self, x: NDArray[Any], wanted: slice) -> NDArray[Any]:
        """Return a signal of the log on part of the grid."""
        if self.even:
            return x[self.part][wanted]
        return resampled(self.log.t[self.part], x[self.part], self.times(wanted))


def _segment(log: Log, part: slice, chosen: Filter, measured: bool, coulomb: Coulomb | None) -> Segment:
    """Filter one part, block by block so that only the thinned result is stored."""
    t = log.t[part]
    count = round((t[-1] - t[0]) * chosen.rate) + 1
    on_grid = _OnGrid(log, part, count, chosen.rate, even=True)
    stray = [float(np.abs(t[some] - on_grid.times(some)).max()) for some in spans(min(count, len(t)))]
    on_grid = replace(on_grid, even=count == len(t) and max(stray) < EVEN / chosen.rate)
    kernels, step = chosen.first_kernels, chosen.first_step
    taps = kernels.shape[1]
    outputs = (count - taps) // step + 1
    per_block = max(1, BLOCK // step)
    velocity_sign = None
    if coulomb is not None:
        some = on_grid.column(log.qd if measured and log.qd is not None else log.q, slice(0, NOISE_SAMPLES))
        velocity_sign = choose_velocity_sign(some, coulomb, chosen.rate, chosen.cutoff, measured=measured)
    # Why filled in place: of a long log, pieces and joined arrays would not fit into memory together.
    joined: list[Any] = []
    for first in range(0, outputs, per_block):
        last = min(first + per_block, outputs)
        wanted = slice(first * step, (last - 1) * step + taps)
        block = _block(on_grid, wanted, kernels, step, measured, velocity_sign)
        joined = joined or [empty((outputs, *x.shape[1:]), x.dtype) for x in block]
        for whole, piece in zip(joined, block, strict=True):
            whole[first:last] = piece
        if outputs > per_block:
            release()
    elapsed = filled(outputs, lambda some: joined[0][some] - log.t[0])
    joined[-2:-2] = [np.zeros((len(joined[0]), 0)), elapsed]
    return Segment(*joined)


def _block(
    on_grid: _OnGrid, wanted: slice, kernels: Floats, step: int, measured: bool, velocity_sign: VelocitySign | None
) -> tuple[NDArray[Any], ...]:
    log, grid, taps = on_grid.log, on_grid.times(wanted), kernels.shape[1]
    half = (taps - 1) // 2

    def filtered(x: NDArray[Any], weights: Floats) -> Floats:
        """Return a signal on the grid under kernels, (K, n, M)."""
        return decimate(np.ascontiguousarray(x.T, dtype=float), weights, step)

    q = on_grid.column(log.q, wanted)
    motion = filtered(q, kernels)
    if measured and log.qd is not None:
        motion[1:] = filtered(on_grid.column(log.qd, wanted), kernels[:2])
    count = motion.shape[2]
    centres = slice(half, half + (count - 1) * step + 1, step)
    clipped, command = log.extra.get("clipped"), log.extra.get("q_ref")
    usable = np.ones((count, log.n), dtype=bool)
    if clipped is not None and (some := on_grid.column(clipped, wanted)).any():
        usable = filtered(some, np.ones((1, taps)))[0].T < 0.5
    raw_qd = on_grid.column(log.qd, wanted) if log.qd is not None else np.gradient(q, grid, axis=0)
    # Why: a command has no noise, but where it is a staircase its corners are no reversals.
    sign_of_command = None if command is None or velocity_sign is None else replace(velocity_sign, measured=False)
    commanded = np.empty((3, 0, count)) if command is None else filtered(on_grid.column(command, wanted), kernels)
    return (
        grid[centres],
        *(np.ascontiguousarray(x.T) for x in motion),
        np.ascontiguousarray(filtered(on_grid.column(log.tau, wanted), kernels[:1])[0].T),
        usable,
        q[centres],
        raw_qd[centres],
        *(np.ascontiguousarray(x.T) for x in commanded),
        _coulomb_sign(on_grid, log.qd if measured else log.q, wanted, kernels, step, velocity_sign),
        _coulomb_sign(on_grid, command, wanted, kernels, step, sign_of_command),
    )


def _coulomb_sign(
    on_grid: _OnGrid, x: Floats | None, wanted: slice, kernels: Floats, step: int, velocity_sign: VelocitySign | None
) -> Floats:
    """Return the Coulomb sign of each joint under the position filter, (M, n); (M, 0) without ``velocity_sign``."""
    if velocity_sign is None or x is None:
        return np.empty(((wanted.stop - wanted.start - kernels.shape[1]) // step + 1, 0))
    start = max(0, wanted.start - velocity_sign.margin)
    around = on_grid.column(x, slice(start, wanted.stop + velocity_sign.margin))
    signs = velocity_sign.coulomb_sign(around)[wanted.start - start :][: wanted.stop - wanted.start]
    return np.ascontiguousarray(decimate(np.ascontiguousarray(signs.T), kernels[:1], step)[0].T)


def resampled(t: Floats, x: Floats, grid: Floats) -> Floats:
    """Interpolate by time stamp with the cubic through the two samples before and the two after (Lagrange).

    Args:
        t: increasing time stamps, (N,) with N >= 4 [s].
        x: signals of any unit, (N, C).
        grid: times inside those of ``t``, (M,) [s].

    Returns:
        The signals at the times of the grid, (M, C).

    Why not a spline: a cubic through four samples looks no further than they do, so a log gives the same values whether
    it is read whole or in pieces.
    """
    result = empty((len(grid), x.shape[1]))
    for part in spans(len(grid)):
        wanted = grid[part]
        right = np.clip(np.searchsorted(t, wanted), 2, len(t) - 2)
        nodes = right[:, None] + np.arange(-2, 2)
        times, found = t[nodes], np.zeros((len(wanted), x.shape[1]))
        for k in range(4):
            others = [m for m in range(4) if m != k]
            weight = np.prod([(wanted - times[:, m]) / (times[:, k] - times[:, m]) for m in others], axis=0)
            found += weight[:, None] * x[nodes[:, k]]
        result[part] = found
    return result
