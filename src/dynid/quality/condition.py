"""A clean log becomes motion: resampled by time stamp, filtered without delay, differentiated twice, thinned.

Two filters: one on the positions, wide, so that velocity and acceleration can be formed; one, narrower, over torques
and regressor columns alike (``dynid.identify.stack``). Gaps are cut, never bridged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.errors import LogTooShort
from dynid.log import Log
from dynid.quality.filters import decimate, derivative_kernels, lowpass_kernel

Floats = NDArray[np.float64]

#: The cut-off lies this many times above the band of the motion: Coriolis products double frequencies, and reversals
#: of friction add harmonics.
CUTOFF_OVER_MOTION = 5.0
#: Lowest cut-off chosen by itself [Hz]: slow motions have friction reversals as sharp as fast ones.
LOWEST_CUTOFF_HZ = 5.0
#: Share of the velocity's power that lies within the band of the motion.
BAND_SHARE = 0.99
#: The position filter's cut-off over the cut-off of the parallel filter.
POSITION_OVER_PARALLEL = 2.0
#: Samples per cut-off period that the regressor is evaluated at, and that are kept after the parallel filter.
EVALUATED_PER_CUTOFF = 20.0
KEPT_PER_CUTOFF = 4.0
#: A step longer than this many samples is a gap: the motion in between is unknown.
GAP_SAMPLES = 5.0
#: Stamps that stray from an even grid by less than this share of the step are taken as even.
EVEN = 1e-3
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
        raw_tau: unfiltered torques, (N, n).
        effects: entries of the columns of added effects, (N, E).
        since: time since the log began, (N,) [s].
    """

    t: Floats
    q: Floats
    qd: Floats
    qdd: Floats
    tau: Floats
    usable: NDArray[np.bool_]
    raw_q: Floats
    raw_qd: Floats
    raw_tau: Floats
    effects: Floats
    since: Floats

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.t)


def motion_band(log: Log) -> float:
    """Return the frequency below which the motion's velocity has 99 % of its power, the noise taken off [Hz].

    The noise of the positions is taken as white; its level is read in the upper third of the spectrum.
    """
    rate = log.rate
    count = min(len(log), int(rate * 300))
    q = log.q[:count] - log.q[:count].mean(axis=0)
    f = np.fft.rfftfreq(count, 1.0 / rate)
    power = np.abs(np.fft.rfft(q * np.hanning(count)[:, None], axis=0)) ** 2
    floor = np.median(power[f > 2.0 / 3.0 * f[-1]], axis=0)
    velocity = np.maximum(power - 4.0 * floor, 0.0) * (f**2)[:, None]
    total = velocity.sum(axis=0)
    moving = total > 0
    if not moving.any():
        return 0.0
    share = np.cumsum(velocity[:, moving], axis=0) / total[moving]
    return float(max(f[np.searchsorted(column, BAND_SHARE)] for column in share.T))


def choose_filter(log: Log, cutoff: float | None = None) -> Filter:
    """Choose the filters for a log.

    Args:
        log: a prepared log.
        cutoff: cut-off of the parallel filter [Hz]; from the motion's band when None.
    """
    if cutoff is None:
        cutoff = max(LOWEST_CUTOFF_HZ, CUTOFF_OVER_MOTION * motion_band(log))
    cutoff = min(cutoff, 0.45 * log.rate)
    # Why: stamps in seconds since 1970 give rates such as 199.99999, and logs of one recorder must not differ by that.
    rate = float(f"{log.rate:.6g}")
    first = max(1, int(rate / (EVALUATED_PER_CUTOFF * cutoff)))
    second = max(1, int(rate / first / (KEPT_PER_CUTOFF * cutoff)))
    return Filter(rate, cutoff, first, second)


def condition(
    log: Log, chosen: Filter, exclude: Sequence[tuple[float, float]] = (), *, measured_velocity: bool = False
) -> list[Segment]:
    """Resample, filter and differentiate a log, one segment a stretch without gaps.

    Args:
        log: a prepared log, in DH quantities of one robot.
        chosen: the filters.
        exclude: stretches to leave out, in seconds of the log's own time.
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
    segments = [_segment(log, part, chosen, measured_velocity and log.qd is not None) for part in parts]
    if not segments:
        longest = max((len(part) for part in np.split(index, cuts)), default=0) * step
        raise LogTooShort(
            f"the longest stretch without a gap has {longest:.2f} s; the filters at {chosen.cutoff:.3g} Hz need {needed * step:.2f} s",
            where=str(log.source or ""),
            fix="record a longer motion, or raise --cutoff",
        )
    return segments


def _segment(log: Log, index: NDArray[np.intp], chosen: Filter, measured: bool) -> Segment:
    """Filter one stretch, block by block so that only the thinned result is stored."""
    t = log.t[index]
    count = round((t[-1] - t[0]) * chosen.rate) + 1
    grid = t[0] + np.arange(count) / chosen.rate
    even = count == len(t) and float(np.abs(t - grid).max()) < EVEN / chosen.rate
    kernels, step = chosen.first_kernels, chosen.first_step
    taps = kernels.shape[1]
    outputs = (count - taps) // step + 1
    per_block = max(1, BLOCK // step)
    pieces = []
    for first in range(0, outputs, per_block):
        last = min(first + per_block, outputs)
        wanted = slice(first * step, (last - 1) * step + taps)
        pieces.append(_block(log, index, grid[wanted], wanted if even else None, kernels, step, measured))
    joined = [np.concatenate(parts) for parts in zip(*pieces, strict=True)]
    nothing = np.zeros((len(joined[0]), 0))
    return Segment(*joined, effects=nothing, since=joined[0] - log.t[0])


def _block(
    log: Log, index: NDArray[np.intp], grid: Floats, even: slice | None, kernels: Floats, step: int, measured: bool
) -> tuple[Floats, Floats, Floats, Floats, Floats, NDArray[np.bool_], Floats, Floats, Floats]:
    taps = kernels.shape[1]
    half = (taps - 1) // 2

    def column(x: Floats) -> Floats:
        return x[index[even]] if even is not None else _resampled(log.t[index], x[index], grid)

    q, tau = column(log.q), column(log.tau)
    filtered = decimate(np.ascontiguousarray(q.T), kernels, step)
    if measured and log.qd is not None:
        filtered[1:] = decimate(np.ascontiguousarray(column(log.qd).T), kernels[:2], step)
    smooth_tau = decimate(np.ascontiguousarray(tau.T), kernels[:1], step)[0]
    centres = slice(half, half + (filtered.shape[2] - 1) * step + 1, step)
    clipped = log.extra.get("clipped")
    usable = np.ones(tau.shape, dtype=bool)[centres]
    if clipped is not None:
        spoilt = column(clipped.astype(float))
        usable = decimate(np.ascontiguousarray(spoilt.T), np.ones((1, taps)), step)[0].T < 0.5
    raw_qd = column(log.qd) if log.qd is not None else np.gradient(q, grid, axis=0)
    return (
        grid[centres],
        *(np.ascontiguousarray(x.T) for x in filtered),
        np.ascontiguousarray(smooth_tau.T),
        usable,
        q[centres],
        raw_qd[centres],
        tau[centres],
    )  # type: ignore[return-value]


def _resampled(t: Floats, x: Floats, grid: Floats) -> Floats:
    """Interpolate by time stamp with cubics."""
    from scipy.interpolate import CubicSpline

    near = slice(max(0, int(np.searchsorted(t, grid[0])) - 4), int(np.searchsorted(t, grid[-1])) + 5)
    return np.asarray(CubicSpline(t[near], x[near], axis=0)(grid), dtype=float)
