"""A clean log becomes motion: resampled by time stamp, filtered without delay, differentiated twice, thinned.

Two filters: one on the positions, wide, so that velocity and acceleration can be formed; one, narrower, over torques
and regressor columns alike (``dynid.estimation.stack``). Gaps are cut, never bridged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import LogTooShort
from dynid.log import Log
from dynid.robot import Coulomb, Robot
from dynid.signals.filters import decimate, derivative_kernels, lowpass_kernel
from dynid.signals.motion import bandwidth
from dynid.signals.reversal import NOISE_SAMPLES, Reversals, reversals

Floats = NDArray[np.float64]

#: The cut-off lies this many times above the band of the motion: Coriolis products double frequencies, and reversals
#: of friction add harmonics.
CUTOFF_OVER_MOTION = 5.0
#: Lowest cut-off chosen by itself [Hz]: slow motions have friction reversals as sharp as fast ones.
LOWEST_CUTOFF_HZ = 5.0
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
#: Steps that are added up before they are counted: single ones are too uneven to tell how many sample times they are.
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
    """A stretch of a log without gaps, after the position filter.

    Attributes:
        t: (N,) [s].
        q: (N, n).
        qd: (N, n).
        qdd: (N, n).
        tau: torques under the same filter, (N, n).
        usable: False where a sample under the filter was clipped or excluded, (N, n).
        raw_q: unfiltered position at the same times, (N, n).
        raw_qd: unfiltered velocity: the driver's where there is one, otherwise plain differences, (N, n).
        command_q: commanded positions under the same filter, (N, n); empty where the log has none.
        command_qd: commanded velocities, (N, n).
        command_qdd: commanded accelerations, (N, n).
        effects: entries of the columns of added effects, (N, E).
        elapsed: time since the log began, (N,) [s].
        coulomb_sign: sign of the velocity as Coulomb friction has it, under the same filter, (N, n); empty where it is
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
    """Return the rate of the even grid that samples are put on [Hz]; logs of one recorder get the same."""
    step = np.diff(t)
    usual = float(np.median(step))
    close = step[step < GAP_SAMPLES * usual]
    if float(np.abs(close / usual - np.round(close / usual)).max(initial=0.0)) < EVEN:
        # Why: stamps in seconds since 1970 give rates such as 199.99999.
        return float(f"{1 / usual:.6g}")
    # Why not the median, and why round: uneven steps leave it open, and repeats on different grids would be no repeats.
    blocks = np.add.reduceat(close, np.arange(0, len(close), RATE_BLOCK))
    for _ in range(2):
        usual = float(blocks.sum() / max(1.0, np.round(blocks / usual).sum()))
    return float(f"{1 / usual:.3g}")


def choose_filter(log: Log, robot: Robot, cutoff: float | None = None) -> Filter:
    """Choose the filters for a log.

    Args:
        log: a prepared log.
        robot: its robot.
        cutoff: cut-off of the parallel filter [Hz]; from the motion's band when None.
    """
    if cutoff is None:
        cutoff = max(LOWEST_CUTOFF_HZ, CUTOFF_OVER_MOTION * bandwidth(log, robot))
    cutoff = min(cutoff, 0.45 * log.rate)
    rate = grid_rate(log.t)
    first = max(1, int(rate / (EVALUATED_PER_CUTOFF * cutoff)))
    second = max(1, int(rate / first / (KEPT_PER_CUTOFF * cutoff)))
    return Filter(rate, cutoff, first, second)


def condition(
    log: Log,
    chosen: Filter,
    exclude: Sequence[tuple[float, float]] = (),
    *,
    measured_velocity: bool = False,
    coulomb: Coulomb | None = None,
    rest_speed: Floats | None = None,
) -> list[Segment]:
    """Resample, filter and differentiate a log, one segment a stretch without gaps.

    Args:
        log: a prepared log, in DH quantities of one robot.
        chosen: the filters.
        exclude: stretches to leave out, in seconds of the log's own time.
        coulomb: shape of the Coulomb sign, whose column then gets the filter that the torques get; None to leave the
            sign to those who evaluate the columns.
        rest_speed: speed below which the friction of a joint is undetermined, 0 where that does not matter, (n,); rows
            of a joint that stays slower for a while do not count.
        measured_velocity: take the velocity that the driver measured, and differentiate only that, where there is one.

    Raises:
        LogTooShort: no stretch is longer than the filters.
    """
    keep = np.ones(len(log), dtype=bool)
    for start, end in exclude:
        keep &= ~((log.t - log.t[0] >= start) & (log.t - log.t[0] <= end))
    index = np.flatnonzero(keep)
    step = 1.0 / chosen.rate
    cuts = np.flatnonzero((np.diff(index) > 1) | (np.diff(log.t[index]) > (GAP_SAMPLES + 0.5) * step)) + 1
    needed = chosen.first_kernels.shape[1] + chosen.first_step * (chosen.second_kernel.shape[1] + chosen.second_step)
    parts = [part for part in np.split(index, cuts) if len(part) > needed]
    segments = [_segment(log, part, chosen, measured_velocity and log.qd is not None, coulomb) for part in parts]
    if not segments:
        longest = max((len(part) for part in np.split(index, cuts)), default=0) * step
        raise LogTooShort(
            f"the longest stretch without a gap has {longest:.2f} s; "
            f"the filters at {chosen.cutoff:.3g} Hz need {needed * step:.2f} s",
            where=str(log.source or ""),
            fix="record a longer motion, or raise --cutoff",
        )
    return segments if rest_speed is None else [_without_rests(segment, rest_speed) for segment in segments]


def _without_rests(segment: Segment, rest_speed: Floats) -> Segment:
    """Mark the rows of joints at rest: static friction holds any torque up to its limit, which no column describes."""
    still = np.abs(segment.qd) < rest_speed
    least = max(1, round(LEAST_REST / (segment.t[1] - segment.t[0]))) if len(segment) > 1 else 1
    usable = segment.usable.copy()
    for j in np.flatnonzero(still.any(axis=0)):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], still[:, j], [False]]).astype(int)))
        for start, end in zip(edges[::2], edges[1::2], strict=True):
            if end - start >= least:
                usable[start:end, j] = False
    return replace(segment, usable=usable)


@dataclass(frozen=True)
class _Stretch:
    """One stretch of a log on an even grid.

    Attributes:
        log: the log.
        index: its samples, (N,).
        grid: the even times, (count,) [s].
        even: whether the samples lie on the grid as they are.
    """

    log: Log
    index: NDArray[np.intp]
    grid: Floats
    even: bool

    def column(self, x: NDArray[Any], wanted: slice) -> NDArray[Any]:
        """Return a signal of the log on part of the grid."""
        if self.even:
            return x[self.index[wanted]]
        return resampled(self.log.t[self.index], x[self.index], self.grid[wanted])


def _segment(log: Log, index: NDArray[np.intp], chosen: Filter, measured: bool, coulomb: Coulomb | None) -> Segment:
    """Filter one stretch, block by block so that only the thinned result is stored."""
    t = log.t[index]
    count = round((t[-1] - t[0]) * chosen.rate) + 1
    grid = t[0] + np.arange(count) / chosen.rate
    even = count == len(t) and float(np.abs(t - grid).max()) < EVEN / chosen.rate
    stretch = _Stretch(log, index, grid, even)
    kernels, step = chosen.first_kernels, chosen.first_step
    taps = kernels.shape[1]
    outputs = (count - taps) // step + 1
    per_block = max(1, BLOCK // step)
    sharp = None
    if coulomb is not None:
        some = stretch.column(log.qd if measured and log.qd is not None else log.q, slice(0, NOISE_SAMPLES))
        sharp = reversals(some, coulomb, chosen.rate, chosen.cutoff, measured=measured)
    # Why filled in place: of a long log, pieces and joined arrays would not fit into memory together.
    joined: list[Any] = []
    for first in range(0, outputs, per_block):
        last = min(first + per_block, outputs)
        wanted = slice(first * step, (last - 1) * step + taps)
        block = _block(stretch, wanted, kernels, step, measured, sharp)
        joined = joined or [np.empty((outputs, *x.shape[1:]), dtype=x.dtype) for x in block]
        for whole, part in zip(joined, block, strict=True):
            whole[first:last] = part
    joined[-2:-2] = [np.zeros((len(joined[0]), 0)), joined[0] - log.t[0]]
    return Segment(*joined)


def _block(
    stretch: _Stretch, wanted: slice, kernels: Floats, step: int, measured: bool, sharp: Reversals | None
) -> tuple[NDArray[Any], ...]:
    log, grid, taps = stretch.log, stretch.grid[wanted], kernels.shape[1]
    half = (taps - 1) // 2
    q, tau = stretch.column(log.q, wanted), stretch.column(log.tau, wanted)
    filtered = decimate(np.ascontiguousarray(q.T), kernels, step)
    if measured and log.qd is not None:
        filtered[1:] = decimate(np.ascontiguousarray(stretch.column(log.qd, wanted).T), kernels[:2], step)
    smooth_tau = decimate(np.ascontiguousarray(tau.T), kernels[:1], step)[0]
    centres = slice(half, half + (filtered.shape[2] - 1) * step + 1, step)
    clipped = log.extra.get("clipped")
    usable = np.ones(tau.shape, dtype=bool)[centres]
    if clipped is not None:
        invalid = stretch.column(clipped, wanted).astype(float)
        usable = decimate(np.ascontiguousarray(invalid.T), np.ones((1, taps)), step)[0].T < 0.5
    raw_qd = stretch.column(log.qd, wanted) if log.qd is not None else np.gradient(q, grid, axis=0)
    command = log.extra.get("q_ref")
    # Why: a command has no noise, but where it is a staircase its corners are no reversals.
    of_command = None if command is None or sharp is None else replace(sharp, measured=False)
    return (
        grid[centres],
        *(np.ascontiguousarray(x.T) for x in filtered),
        np.ascontiguousarray(smooth_tau.T),
        usable,
        q[centres],
        raw_qd[centres],
        *_command(stretch, wanted, kernels, step, len(grid[centres])),
        _coulomb_sign(stretch, log.qd if measured else log.q, wanted, kernels, step, sharp),
        _coulomb_sign(stretch, command, wanted, kernels, step, of_command),
    )


def _coulomb_sign(
    stretch: _Stretch, x: Floats | None, wanted: slice, kernels: Floats, step: int, sharp: Reversals | None
) -> Floats:
    """Return the Coulomb sign of each joint under the position filter; an empty array without ``sharp``."""
    if sharp is None or x is None:
        return np.empty(((wanted.stop - wanted.start - kernels.shape[1]) // step + 1, 0))
    start = max(0, wanted.start - sharp.margin)
    around = stretch.column(x, slice(start, wanted.stop + sharp.margin))
    signs = sharp.coulomb_sign(around)[wanted.start - start :][: wanted.stop - wanted.start]
    return np.ascontiguousarray(decimate(np.ascontiguousarray(signs.T), kernels[:1], step)[0].T)


def _command(stretch: _Stretch, wanted: slice, kernels: Floats, step: int, count: int) -> tuple[Floats, Floats, Floats]:
    """Return the commanded motion under the position filter; empty arrays where the log has none."""
    command = stretch.log.extra.get("q_ref")
    if command is None:
        return (np.empty((count, 0)),) * 3
    on_grid = np.ascontiguousarray(stretch.column(command, wanted).T)
    q, qd, qdd = (np.ascontiguousarray(x.T) for x in decimate(on_grid, kernels, step))
    return q, qd, qdd


def resampled(t: Floats, x: Floats, grid: Floats) -> Floats:
    """Interpolate by time stamp with the cubic through the two samples before and the two after (Lagrange).

    Why not a spline: a cubic through four samples looks no further than they do, so a log gives the same values whether
    it is read whole or in pieces.
    """
    right = np.clip(np.searchsorted(t, grid), 2, len(t) - 2)
    nodes = right[:, None] + np.arange(-2, 2)
    times = t[nodes]
    result = np.zeros((len(grid), x.shape[1]))
    for k in range(4):
        others = [m for m in range(4) if m != k]
        weight = np.prod([(grid - times[:, m]) / (times[:, k] - times[:, m]) for m in others], axis=0)
        result += weight[:, None] * x[nodes[:, k]]
    return result
