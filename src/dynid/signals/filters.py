"""Zero-phase low-pass filters with finite memory, and decimation by them.

Symmetric windowed-sinc kernels delay nothing, and because their memory is finite a long log can be filtered piece by
piece with exactly the result of filtering it whole. The same kernel goes over the torques and over the columns of the
regressor (parallel filtering), so what it removes, it removes on both sides of tau = W theta. Before them, torque
samples that no arm can have produced are replaced: a filter would smear a spike over its whole length.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding
from dynid.log import Log
from dynid.longarrays import empty, median, spans
from dynid.signals.pieces import extremes

Floats = NDArray[np.float64]

#: Kaiser window for 60 dB: what is left of the stop band is a thousandth, below the noise of any joint sensor.
KAISER_BETA = 5.65
KAISER_TAPS = 3.6
#: Outputs computed together as one matrix product; measured best for 50 to 500 taps.
_TOGETHER = 20
#: Signals from which on each of their stretches is multiplied where it is.
MANY_SIGNALS = 64
#: Samples on either side that a torque sample is compared with.
REACH = 2
#: A spike is this many standard deviations of such differences away from the median, and this share of the joint's
#: range: noise is not the first, what is not the second does no harm.
DEVIATIONS, OF_RANGE = 8.0, 0.05
#: Where more samples than this share look like it, they are no accidents.
MOST = 0.03
#: Samples that show how far from the median they usually are; a longer log is thinned for it.
USUAL = 1 << 18
#: The window is at most this share of the period of the cut-off: a slower log may show a motion in five samples.
OF_PERIOD = 0.25


@lru_cache(maxsize=32)
def lowpass_kernel(cutoff: float, rate: float) -> Floats:
    """Return a symmetric low-pass kernel with sum 1, half of the amplitude at the cut-off, (odd,).

    Args:
        cutoff: [Hz]; the transition band reaches from half of it to one and a half.
        rate: sample rate [Hz].
    """
    if cutoff >= 0.5 * rate:
        return np.ones(1)
    half = max(1, math.ceil(0.5 * KAISER_TAPS * rate / cutoff))
    k = np.arange(-half, half + 1)
    kernel: Floats = np.sinc(2 * cutoff / rate * k) * np.kaiser(2 * half + 1, KAISER_BETA)
    kernel /= kernel.sum()
    kernel.setflags(write=False)
    return kernel


def pulse_width(cutoff: float) -> float:
    """Return half the length of the low-pass kernel [s]."""
    return 0.5 * KAISER_TAPS / cutoff


def pulse(lag: Floats, cutoff: float) -> Floats:
    """Return the low-pass kernel at any time: what the filter makes of an impulse, but for its size.

    Args:
        lag: time since the impulse, of any shape [s].
        cutoff: [Hz].
    """
    times, values, _ = _pulse_table()
    return np.interp(lag * cutoff, times, values, 0.0, 0.0)


def pulse_slope(lag: Floats, cutoff: float) -> Floats:
    """Return what the filter makes of the slope of an impulse, but for its size."""
    times, _, slopes = _pulse_table()
    return np.interp(lag * cutoff, times, slopes, 0.0, 0.0)


@lru_cache(maxsize=1)
def _pulse_table() -> tuple[Floats, Floats, Floats]:
    times = np.linspace(-0.5 * KAISER_TAPS, 0.5 * KAISER_TAPS, 4001)
    values = np.sinc(2 * times) * np.kaiser(len(times), KAISER_BETA)
    return times, values, np.gradient(values, times)


def derivative_kernels(kernel: Floats, rate: float) -> Floats:
    """Return the kernels that filter, filter and differentiate once, and twice, (3, taps + 4) [1, 1/s, 1/s^2].

    Args:
        kernel: symmetric low-pass, (taps,).
        rate: sample rate [Hz].

    Source: Paper Eq. 22 with its divisor doubled, here with five points: the error falls with the fourth power of the
        step, so that the filter and not the difference sets the accuracy.
    """
    first = np.array([-1.0, 8.0, 0.0, -8.0, 1.0]) * rate / 12.0
    second = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) * rate**2 / 12.0
    # Why reversed: the kernels are used as weights on x[i - half : i + half + 1], not in a convolution.
    return np.array([np.pad(kernel, 2), np.convolve(kernel, first)[::-1], np.convolve(kernel, second)])


def decimate(x: Floats, kernels: Floats, step: int) -> Floats:
    """Weight windows of x with kernels at every ``step``-th sample, without padding at the ends.

    Why not scipy.signal: of 7 joints at 200 Hz and three kernels of 41 taps, upfirdn and oaconvolve take four times as
    long at a step of 1 and ten times at 4, and importing scipy.signal takes half a second.

    Args:
        x: signals of any unit, (C, L).
        kernels: weights, (K, taps) with taps <= L.
        step: samples between outputs.

    Returns:
        (K, C, M) with M = (L - taps) // step + 1; output i is centred on sample i * step + (taps - 1) / 2.
    """
    count, taps = kernels.shape
    outputs = (x.shape[1] - taps) // step + 1
    if outputs <= 0:
        return np.empty((count, len(x), 0))
    if taps == 1 and step == 1:
        return np.ascontiguousarray(kernels[:, 0][:, None, None] * x)
    together = min(_TOGETHER, outputs)
    width = (together - 1) * step + taps
    weights = np.zeros((width, together * count))
    for i in range(together):
        weights[i * step : i * step + taps, i * count : (i + 1) * count] = kernels.T
    chunks = -(-outputs // together)
    if len(x) >= MANY_SIGNALS:
        found = np.empty((count, len(x), outputs))
        for at in range(0, outputs, together):
            # Why not all windows in one array: it is twice as large as the signals, and takes longer than the product.
            size = min(together, outputs - at)
            some = x[:, at * step : (at + size - 1) * step + taps]
            here = some @ weights[: some.shape[1], : size * count]
            found[:, :, at : at + size] = here.reshape(len(x), size, count).transpose(2, 0, 1)
        return found
    missing = (chunks - 1) * together * step + width - x.shape[1]
    padded = np.pad(x, ((0, 0), (0, max(0, missing))))
    windows = np.lib.stride_tricks.sliding_window_view(padded, width, axis=1)[:, :: together * step][:, :chunks]
    product = np.ascontiguousarray(windows).reshape(-1, width) @ weights
    shaped = product.reshape(len(x), chunks * together, count)[:, :outputs]
    return np.ascontiguousarray(shaped.transpose(2, 0, 1))


def despiked(log: Log, cutoff: float) -> tuple[Log, tuple[Finding, ...]]:
    """Replace spikes of the torques by the median around them; a log without spikes comes back as it is.

    Source: Hampel 1974 (identifier by median and median deviation).

    Args:
        log: a prepared log.
        cutoff: of the filter over the torques [Hz].
    """
    if len(log) <= 2 * REACH or (2 * REACH + 1) * cutoff > OF_PERIOD * log.rate:
        return log, ()
    every = max(1, len(log) // USUAL)
    # Why a copy: a slice would keep the whole piece in memory.
    usual = [np.abs(x - medians)[-part.start % every :: every].copy() for part, x, medians in _medians(log.tau)]
    low, high = extremes(log.tau)
    least = np.maximum(DEVIATIONS * 1.4826 * median(np.concatenate(usual), axis=0), OF_RANGE * (high - low))
    found = []
    for part, x, medians in _medians(log.tau):
        row, joint = np.nonzero(np.abs(x - medians) > least)
        found.append((part.start + row, joint, medians[row, joint]))
    row, joint, usually = (np.concatenate(column) for column in zip(*found, strict=True))
    count = np.bincount(joint, minlength=log.n)
    count[count > MOST * len(log)] = 0
    if not count.any():
        return log, ()
    tau, kept = empty(log.tau.shape), count[joint] > 0
    for part in spans(len(log)):
        tau[part] = log.tau[part]
    tau[row[kept], joint[kept]] = usually[kept]
    counts = ", ".join(f"{name} {n}" for name, n in zip(log.names, count, strict=True) if n)
    text = f"torque spikes were replaced by the median of their neighbours: {counts} of {len(log)} samples"
    return replace(log, tau=tau), (Finding("W324", "warning", text, {"samples": count.tolist()}),)


def _medians(x: Floats) -> Iterator[tuple[slice, Floats, Floats]]:
    """Yield samples of x, (N, n), piece by piece, with the median of each and its neighbours, (M, n)."""
    for part in spans(len(x)):
        first, last = max(0, part.start - REACH), min(len(x), part.stop + REACH)
        edges = REACH - (part.start - first), REACH - (last - part.stop)
        padded = np.pad(x[first:last], (edges, (0, 0)), mode="edge")
        yield part, x[part], _median_of_five(*(padded[k : k + part.stop - part.start] for k in range(2 * REACH + 1)))


def _median_of_five(a: Floats, b: Floats, c: Floats, d: Floats, e: Floats) -> Floats:
    """Return the median of five arrays, element by element.

    Why not np.partition or scipy.ndimage: comparisons of whole arrays take a third of their time.
    """
    a, b = np.minimum(a, b), np.maximum(a, b)
    c, d = np.minimum(c, d), np.maximum(c, d)
    # The smallest and the largest of the first four are not the median; it is that of the two between and the fifth.
    low, high = np.maximum(a, c), np.minimum(b, d)
    return np.asarray(np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), e)))
